"""The stepwise protocol between the run loop and a planner that is a program: one JSON object a line, each way.

The loop writes :class:`StartMessage` once a run and :class:`StepMessage` once a planning step to the program's standard
input. The program answers each of them with one line on standard output: :class:`ReadyMessage`, then
:class:`PlanMessage`. Lengths are in m, angles in rad, speeds in m/s; positions are those of a body's centre.
"""

from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints, model_validator

from .base import Model
from .planning import MOST_TERMS, CommandTrajectory, PrintedName
from .runs import MOST_DEBUG_POINTS, MOST_DEBUG_POLYGONS, MOST_DEBUG_VALUES, Bounded, BoundedCost

PROTOCOL = 1
"""The version of the messages in this module; it changes when a program for an older one would no longer work."""
MOST_SHOWN_CANDIDATES, MOST_CANDIDATE_POINTS = 16, 200
"""Other candidates that a plan may show, and the points of each: as many as the player draws."""
MOST_STATES = 10_000
"""States of a plan: 1,000 s in steps of 0.1 s, longer than any recording, so that no answer is an endless one."""
_Step = Annotated[int, Field(ge=0)]


class Line(Model):
    """A line or the outline of an area: the same number of x and y."""

    x_m: tuple[float, ...]
    y_m: tuple[float, ...]

    @model_validator(mode="before")
    @classmethod
    def _same_lengths(cls, value: Any) -> Any:
        if isinstance(value, dict):
            x, y = value.get("x_m"), value.get("y_m")
            if isinstance(x, list | tuple) and isinstance(y, list | tuple) and len(x) != len(y):
                raise ValueError(f"the lists have different lengths: x_m {len(x)}, y_m {len(y)}")
        return value


class Candidate(Line):
    """A candidate that was not chosen, for the player; one point for each time step or fewer."""

    x_m: tuple[float, ...] = Field(min_length=2, max_length=MOST_CANDIDATE_POINTS)
    y_m: tuple[float, ...] = Field(min_length=2, max_length=MOST_CANDIDATE_POINTS)


class Polygon(Line):
    """The outline of an area that the planner wants to show; the player closes it."""

    x_m: tuple[float, ...] = Field(min_length=2, max_length=MOST_DEBUG_POINTS)
    y_m: tuple[float, ...] = Field(min_length=2, max_length=MOST_DEBUG_POINTS)


class PlannedStates(CommandTrajectory):
    """A planned trajectory: one state for each time step, from the present one on. All lists have the same length."""

    x_m: tuple[Bounded, ...] = Field(max_length=MOST_STATES)
    y_m: tuple[Bounded, ...] = Field(max_length=MOST_STATES)
    heading_rad: tuple[Bounded, ...] = Field(max_length=MOST_STATES)
    speed_mps: tuple[Bounded, ...] = Field(max_length=MOST_STATES)


class LaneletMessage(Model):
    """A lanelet near the route: its bounds in driving direction, its neighbours, what is posted on it."""

    id: int
    left: Line
    right: Line
    successors: tuple[int, ...] = ()
    left_neighbour: int | None = Field(None, description="lanelet to its left, whatever its direction")
    left_same_direction: bool = Field(False, description="whether that one leads in the same direction")
    right_neighbour: int | None = Field(None, description="lanelet to its right, whatever its direction")
    right_same_direction: bool = Field(False, description="whether that one leads in the same direction")
    speed_limit_mps: float | None = Field(None, description="posted limit; null if nothing is posted")
    signals: tuple[int, ...] = Field((), description="ids of the traffic lights at its end")


class GoalMessage(Model):
    """A goal state; reaching one of them ends the run as a success. What is null may have any value."""

    first_step: int
    last_step: int
    areas: tuple[Line, ...] | None = Field(description="outlines; the ego's centre has to be in one of them")
    heading_rad: tuple[float, float] | None = Field(description="smallest and largest heading")
    speed_mps: tuple[float, float] | None = Field(description="smallest and largest speed")


class StartMessage(Model):
    """A run begins, or begins anew: the program forgets the run before and answers with ``ready``.

    ``vehicle``: size and limits of the ego. ``goals``: the route leads to the first one. ``reference``: the path of the
    route, from behind the ego to beyond the goal, with a point about every metre. ``lanelets``: those near that path.
    """

    type: Literal["start"] = "start"
    protocol: Literal[1] = 1
    scenario_id: str
    problem_id: int
    planner: str
    config_id: str
    weights: dict[str, float]
    settings: dict[str, float] = Field(description="settings of the configuration that are numbers")
    vehicle: dict[str, float] = Field(
        description="length_m, width_m, wheelbase_m, rear_axle_behind_center_m, maximum_acceleration_mps2 (friction: "
        "along and across together), maximum_speed_mps, switching_speed_mps (above it the engine's power limits the "
        "acceleration), maximum_steering_rad, maximum_steering_rate_radps"
    )
    ego_class: str = Field("car", description="what the ego is: car, truck, bus, motorcycle …")
    friction: float | None = Field(
        None,
        exclude_if=lambda friction: friction is None,
        description="coefficient of friction of the road, which the vehicle's largest acceleration contains; null or "
        "missing: the scenario does not state it",
    )
    step_s: float = Field(description="time step of the scenario and of every plan")
    first_step: int = Field(description="step at which the run begins")
    last_step: int = Field(description="last step of the goal's time")
    replan_steps: int = Field(description="steps of each plan that are driven before the next plan is asked for")
    horizon_steps: int = Field(description="steps over which others are predicted")
    goals: tuple[GoalMessage, ...]
    reference: Line
    route: tuple[int, ...] = Field(description="lanelets of the route in driving order")
    lanelets: tuple[LaneletMessage, ...]


class ReadyMessage(Model):
    """The program is ready to plan; its answer to ``start``."""

    type: Literal["ready"] = "ready"
    protocol: int = Field(description="the version that the program speaks: 1")


class EgoMessage(Model):
    """The ego at the step; a plan begins here."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    acceleration_mps2: float
    yaw_rate_radps: float


class PredictedMessage(Model):
    """Where another is expected: one entry for each step, the present first.

    ``heading_rad`` and ``covariance_m2`` (xx, xy and yy of the position) have a single entry if it holds for all steps,
    which is most of what a message for many road users would hold otherwise. ``length_m`` and ``width_m``
    contain the safety margin of the prediction.
    """

    x_m: tuple[float, ...]
    y_m: tuple[float, ...]
    heading_rad: tuple[float, ...]
    covariance_m2: tuple[tuple[float, float, float], ...]
    length_m: float
    width_m: float


class OtherMessage(Model):
    """Another road user as it is observed, rounded to 0.1 mm, and as it is predicted."""

    id: int
    kind: str = Field(description="CommonRoad obstacle type, such as car, truck, pedestrian")
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    length_m: float
    width_m: float
    predicted: PredictedMessage


class SignalMessage(Model):
    """A traffic light at the route ahead, as it is at the step."""

    id: int
    lanelet: int = Field(description="lanelet of the route that it ends")
    state: str = Field(description="red, redYellow, yellow, green or inactive, as CommonRoad writes it")
    ahead_m: float = Field(description="along the route from the ego's centre to the end of that lanelet")


class RouteMessage(Model):
    """Where the ego is on its reference path.

    ``offset_m``: to the left of the path; ``to_goal_m``: along the path to the first goal, negative behind it, null for
    a goal without a place.
    """

    station_m: float
    offset_m: float
    heading_error_rad: float
    to_goal_m: float | None
    desired_speed_mps: float = Field(description="what the built-in planners aim at")
    desired_speed_reason: str = Field(description="why: goal_mean, goal_end, goal_interval, speed_limit or curve")


class StepMessage(Model):
    """A plan is asked for; the program answers with ``plan`` for the same step."""

    type: Literal["step"] = "step"
    step: _Step
    time_s: float = Field(description="since the beginning of the run")
    ego: EgoMessage
    others: tuple[OtherMessage, ...]
    signals: tuple[SignalMessage, ...]
    route: RouteMessage


class DebugMessage(Model):
    """What the planner wants to keep of this step, by name; shown in the player and exported with the run."""

    numbers: dict[PrintedName, float] = Field(default_factory=dict, max_length=MOST_DEBUG_VALUES)
    texts: dict[PrintedName, Annotated[str, StringConstraints(max_length=2000)]] = Field(
        default_factory=dict, max_length=MOST_DEBUG_VALUES
    )
    polygons: dict[PrintedName, Polygon] = Field(default_factory=dict, max_length=MOST_DEBUG_POLYGONS)


class PlanMessage(Model):
    """The program's answer to ``step``.

    ``trajectory``: one state for each time step, the present first, at least a second long; null if nothing can be
    driven, which ends the run as infeasible, with ``rejected`` saying why.
    """

    type: Literal["plan"] = "plan"
    step: _Step = Field(description="as in the question")
    trajectory: PlannedStates | None
    costs: dict[PrintedName, BoundedCost] = Field(
        default_factory=dict, max_length=MOST_TERMS, description="weighted cost term: value"
    )
    rejected: dict[PrintedName, Annotated[int, Field(ge=0)]] = Field(
        default_factory=dict, max_length=MOST_TERMS, description="constraint: candidates that it rejected"
    )
    candidates: int = Field(1, ge=0, description="how many were looked at")
    shown: tuple[Candidate, ...] = Field((), max_length=MOST_SHOWN_CANDIDATES, description="other candidates")
    debug: DebugMessage = DebugMessage()
