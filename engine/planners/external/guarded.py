"""Runs a planner from another package in the loop; its exceptions and invalid answers become named errors."""

import inspect
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from ....schemas.errors import PlannerFailure, PlannerForgeError
from ....schemas.text import cited
from ...geometry import Points
from ..driving.drivability import violated_limit
from ..interface import Observation, Plan, Planner, PlanningTask, ShowsCandidates
from .conformance import plan_breaches

_CALLS = (("reset", "task"), ("plan", "observation"))


def guarded(name: str, make: Callable[[], Planner]) -> Planner:
    """Return a new planner that checks every plan against the contract.

    Raises:
        PlannerFailure: The planner cannot be created, or its methods do not take the loop's arguments.
    """
    with _attribute_errors(name, "was created"):
        planner: object = make()
        wrong = [words for words in (_not_callable(planner, *call) for call in _CALLS) if words]
    if wrong:
        raise PlannerFailure(f"planner {name} breaks its contract: {'; '.join(wrong)}", reason="contract_broken")
    return _Guarded(name, cast("Planner", planner))


def _not_callable(planner: object, method: str, argument: str) -> str:
    """Return why a method cannot take one argument; empty if it can, or if its signature is unavailable."""
    made = f"{type(planner).__name__}.{method}"
    called = getattr(planner, method, None)
    if not callable(called):
        return f"{made} is missing; it needs {method}({argument})"
    try:
        inspect.signature(called).bind(object())
    except TypeError:
        return f"{made}{inspect.signature(called)} does not take one argument; it needs {method}({argument})"
    except ValueError:  # compiled code
        return ""
    return ""


class _Guarded:
    """A planner from another package, with its answers checked.

    See :class:`plannerforge.engine.planners.interface.Planner`.
    """

    def __init__(self, name: str, planner: Planner) -> None:
        self._name, self._planner = name, planner

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run.

        Raises:
            PlannerFailure: The planner raised an exception.
        """
        self._task = task
        with _attribute_errors(self._name, "was reset"):
            self._planner.reset(task)

    def plan(self, observation: Observation) -> Plan:
        """Return the planner's plan, without its trajectory if the vehicle cannot drive it.

        Raises:
            PlannerFailure: The planner raised an exception, or its plan breaks the contract.
        """
        with _attribute_errors(self._name, f"planned step {observation.ego.step}"):
            plan = self._planner.plan(observation)
            breaches = plan_breaches(plan, observation, self._task.step_s)
        if breaches:
            raise PlannerFailure(
                f"planner {self._name} breaks its contract at step {observation.ego.step}: {'; '.join(breaches)}",
                reason="contract_broken",
            )
        return drivable(plan, self._task)

    def shown_candidates(self, most: int) -> Sequence[Points]:
        """Return the last step's candidates if the planner offers them; lines with non-finite points are dropped.

        Raises:
            PlannerFailure: The planner raised an exception.
        """
        if not isinstance(self._planner, ShowsCandidates):
            return ()
        with _attribute_errors(self._name, "showed its candidates"):
            lines = [np.asarray(line, dtype=float) for line in self._planner.shown_candidates(most)]
        return [line for line in lines[:most] if line.ndim == 2 and line.shape[1] == 2 and np.isfinite(line).all()]


def drivable(plan: Plan, task: PlanningTask) -> Plan:
    """Return the plan, without its trajectory if the vehicle cannot drive the steps until the next plan.

    The steering of a user's plan is computed from its states; the plan's own steering is ignored.
    """
    if plan.trajectory is None:
        return plan
    trajectory = replace(plan.trajectory, steering_rad=None)
    plan = replace(plan, trajectory=trajectory)
    next_steps = trajectory.until(task.configuration.settings.replan_steps + 1)
    limit = violated_limit(next_steps, task.vehicle, task.step_s)
    return plan if limit is None else replace(plan, trajectory=None, costs={}, rejected={**plan.rejected, limit: 1})


@contextmanager
def _attribute_errors(name: str, doing: str) -> Iterator[None]:
    try:
        yield
    except PlannerForgeError:
        raise
    except (
        Exception,
        SystemExit,
    ) as error:  # the boundary to other people's code: any exception becomes this run's error
        at = traceback.extract_tb(error.__traceback__)[-1]
        raise PlannerFailure(
            f"planner {name} raised {type(error).__name__} when it {doing}: {cited(error)}"
            f" ({Path(at.filename).name}, line {at.lineno})",
            reason="raised",
        ) from error
