"""The interface of planners: a planner is reset for one planning problem, then returns a plan at every call.

Planners that satisfy :class:`Planner` run in the loop of ``simulation.py``; ``external/conformance.py`` checks them.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, Protocol, runtime_checkable

import numpy as np

from ...schemas.planning import PlannerConfiguration
from ..commonroad import MadeOnce
from ..geometry import Points, Values
from ..vehicles import VehicleParameters

if TYPE_CHECKING:
    from commonroad.planning.goal import GoalRegion
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.lanelet import LaneletNetwork

    from .lanes import Road
    from .reference_path import ReferencePath

PlanKind = Literal["regular", "standstill", "stopping"]
_MOST_MADE = 16
"""Values that planners derive from a task and keep (chosen): a planner has about five."""


@dataclass(frozen=True)
class EgoState:
    """The ego at one time step: centre (2,) in m, heading in rad, and its derivatives.

    ``steering_rad``: the steering angle if the ego moves as a vehicle does (``driving/following.py``); None if it is
    unknown, as at the first step of a run.
    """

    step: int
    position: Points
    heading_rad: float
    speed_mps: float
    acceleration_mps2: float = 0.0
    yaw_rate_radps: float = 0.0
    steering_rad: float | None = None

    @property
    def key(self) -> tuple[float, ...]:
        """All values except the steering angle, to look up what depends on the state."""
        return (
            self.step,
            *self.position.tolist(),
            self.heading_rad,
            self.speed_mps,
            self.acceleration_mps2,
            self.yaw_rate_radps,
        )

    @classmethod
    def of(cls, state: Any) -> "EgoState":
        """Return the ego in an initial state; intervals are replaced by their midpoints, missing values as 0."""
        position = state.position.center if hasattr(state.position, "center") else state.position
        return cls(
            step=int(_middle(state.time_step)),
            position=np.array(position, dtype=float),
            heading_rad=_middle(getattr(state, "orientation", None)),
            speed_mps=_middle(getattr(state, "velocity", None)),
            acceleration_mps2=_middle(getattr(state, "acceleration", None)),
            yaw_rate_radps=_middle(getattr(state, "yaw_rate", None)),
        )


def _middle(value: Any) -> float:
    if value is None:
        return 0.0
    number = 0.5 * (float(value.start) + float(value.end)) if hasattr(value, "start") else float(value)
    return number if math.isfinite(number) else 0.0


@dataclass(frozen=True)
class PredictedObstacle:
    """A road user's present (index 0) and predicted future, one entry per step: centres (n, 2), headings (n,).

    ``covariance`` of the centre in m²: (2, 2), or (n, 2, 2) with one matrix per step if it changes. ``length_m`` and
    ``width_m`` include the prediction's safety margin; ``observed_size_m`` is length and width without it. ``kind``:
    CommonRoad's obstacle type.
    """

    obstacle_id: int
    positions: Points
    headings_rad: Values
    covariance: Points
    length_m: float
    width_m: float
    speed_mps: float = 0.0
    kind: str = "unknown"
    observed_size_m: tuple[float, float] | None = None


@dataclass(frozen=True)
class Observation:
    """What the planner sees before it plans."""

    ego: EgoState
    obstacles: tuple[PredictedObstacle, ...]


@dataclass(frozen=True)
class PlanningTask:
    """Everything that stays the same during a run; a planner knows only the traffic that it observes.

    ``aim``: the goal state that the reference path leads to, if the problem has several; None means the problem's goal.
    ``made``: what planners derive from network, reference path, vehicle and time step. Runs of built-in planners with
    the same start and goal share it.
    """

    network: "LaneletNetwork"
    problem: "PlanningProblem"
    configuration: PlannerConfiguration
    reference: "ReferencePath"
    road: "Road"
    vehicle: VehicleParameters
    step_s: float
    aim: "GoalRegion | None" = None
    made: MadeOnce = field(default_factory=lambda: MadeOnce(_MOST_MADE), repr=False, compare=False)

    @property
    def goal_ahead(self) -> "GoalRegion":
        """The goal to drive to: a single goal state if the problem has several."""
        return self.aim or self.problem.goal

    def on_path(self, reference: "ReferencePath") -> "PlanningTask":
        """Return the same task with another reference path."""
        return replace(self, reference=reference, made=MadeOnce(_MOST_MADE))


@dataclass(frozen=True)
class PlannedTrajectory:
    """States of the centre, one per step starting with the present: positions (n, 2), the others (n,).

    ``steering_rad``: the steering angles of a motion that the vehicle drives exactly (``driving/following.py``); None
    for a motion that gives only the intended positions of the centre.
    """

    positions: Points
    headings_rad: Values
    speeds_mps: Values
    accelerations_mps2: Values
    steering_rad: Values | None = None

    def until(self, count: int) -> "PlannedTrajectory":
        """Return the first ``count`` states."""
        return self._part(slice(count))

    def since(self, index: int) -> "PlannedTrajectory":
        """Return the states from an index on."""
        return self._part(slice(index, None))

    def _part(self, part: slice) -> "PlannedTrajectory":
        steering_rad = None if self.steering_rad is None else self.steering_rad[part]
        return PlannedTrajectory(
            self.positions[part],
            self.headings_rad[part],
            self.speeds_mps[part],
            self.accelerations_mps2[part],
            steering_rad,
        )

    def state_at(self, index: int, step: int, step_s: float) -> EgoState:
        """Return the state ``index`` steps ahead, as the ego state of time step ``step``."""
        before = max(index - 1, 0)
        turn = float(self.headings_rad[index] - self.headings_rad[before])
        return EgoState(
            step=step,
            position=np.array(self.positions[index]),
            heading_rad=float(self.headings_rad[index]),
            speed_mps=float(self.speeds_mps[index]),
            acceleration_mps2=float(self.accelerations_mps2[index]),
            yaw_rate_radps=turn / step_s if index > before else 0.0,
            steering_rad=None if self.steering_rad is None else float(self.steering_rad[index]),
        )


@dataclass(frozen=True)
class DebugValues:
    """Values that a planner reports for a planning step in addition to its plan, under names of its choice.

    ``polygons``: outlines of shape (n, 2) in m. The values are stored with the run up to the bounds of
    ``schemas/runs.py``, shown in the player and exported; they never affect the run.
    """

    numbers: Mapping[str, float] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)
    polygons: Mapping[str, Points] = field(default_factory=dict)


NO_DEBUG_VALUES = DebugValues()


@dataclass(frozen=True)
class Plan:
    """An answer of a planner; ``trajectory`` is None if no candidate can be driven.

    ``costs``: the chosen candidate's value per weighted cost term; ``rejected``: the number of candidates that each
    constraint rejected; ``core_s``: the computation time of the planner's native core, if it has one.
    """

    trajectory: PlannedTrajectory | None
    costs: Mapping[str, float] = field(default_factory=dict)
    rejected: Mapping[str, int] = field(default_factory=dict)
    candidates: int = 0
    kind: PlanKind = "regular"
    core_s: float = 0.0
    debug: DebugValues = NO_DEBUG_VALUES


def evenly_chosen(count: int, most: int) -> list[int]:
    """Return at most ``most`` of ``count`` indices, including the first and the last."""
    return sorted({round(place) for place in np.linspace(0, count - 1, min(most, count))}) if count else []


@runtime_checkable
class ShowsCandidates(Protocol):
    """A planner that can show the candidates of its last planning step."""

    def shown_candidates(self, most: int) -> Sequence[Points]:
        """Return centres (n, 2) of at most ``most`` feasible candidates, evenly spread over their ranks."""


class Planner(Protocol):
    """A motion planner, which keeps the state of one run between :meth:`reset` and the next call of it."""

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run.

        Raises:
            NotPossible: The planner cannot attempt this problem.
        """

    def plan(self, observation: Observation) -> Plan:
        """Return the trajectory to follow from the observed state, at least one second long if there is one."""
