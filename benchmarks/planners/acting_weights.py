"""Finds the cost weights that act: an increase changes the planner's choice in the same situation."""

from collections.abc import Sequence

import numpy as np

from plannerforge.engine.commonroad import LoadedScenario
from plannerforge.engine.execution import silent
from plannerforge.engine.geometry import Points
from plannerforge.engine.planners import Observation, Plan, Planner, PlanningTask, make_planner, simulate
from plannerforge.engine.tuning import tuning_of
from plannerforge.schemas.planning import PlannerConfiguration

_BOUNDS = 0.0, 1e6
"""Zero, and a weight at which the term outweighs all others; the bounds for a weight with its own range."""


class _FirstPlan:
    """A planner that plans once."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self.first: Plan | None = None

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        self._planner.reset(task)
        self.first = None

    def plan(self, observation: Observation) -> Plan:
        """Return the first plan, and None afterwards."""
        if self.first is not None:
            return Plan(None)
        self.first = self._planner.plan(observation)
        return self.first


def acting_weights(configuration: PlannerConfiguration, situations: Sequence[LoadedScenario]) -> frozenset[str]:
    """Return the acting weights of a configuration: their lowest and highest values lead to different choices.

    The other weights stay unchanged. The situations are the starts of scenarios; a weight acts if it changes the choice
    in any of them.
    """
    limits = tuning_of(configuration.planner).limits

    def differs(name: str, situation: LoadedScenario) -> bool:
        lowest, highest = (_chosen(configuration, name, value, situation) for value in limits.get(name, _BOUNDS))
        return not np.array_equal(lowest, highest)

    return frozenset(
        name for name in configuration.weights if any(differs(name, situation) for situation in situations)
    )


def _chosen(configuration: PlannerConfiguration, name: str, weight: float, situation: LoadedScenario) -> Points:
    weighted = configuration.model_copy(update={"weights": configuration.weights | {name: weight}})
    planner = _FirstPlan(make_planner(configuration.planner))
    simulate(situation.scenario, situation.problem(), weighted, planner, "constant_velocity", silent)
    trajectory = planner.first.trajectory if planner.first else None
    return np.zeros((0, 2)) if trajectory is None else trajectory.positions
