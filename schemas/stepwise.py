"""The stepwise protocol between the run loop and a planner program: one JSON object per line in each direction.

The loop writes :class:`StartMessage` once per run and :class:`StepMessage` once per planning step to the program's
standard input. The program answers each with one line on standard output: :class:`ReadyMessage`, then
:class:`PlanMessage`. Lengths are in m, angles in rad, speeds in m/s. Positions are those of a body's centre.
"""

from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints, model_validator

from .base import Model
from .planning import MOST_TERMS, CommandTrajectory, PrintedName
from .runs import MOST_DEBUG_POINTS, MOST_DEBUG_POLYGONS, MOST_DEBUG_VALUES, Bounded, BoundedCost

PROTOCOL = 1
"""The version of these messages. It changes if a program for an older version would no longer work."""
MOST_SHOWN_CANDIDATES, MOST_CANDIDATE_POINTS = 16, 200
"""The maximum number of other candidates that a plan may show, and of points per candidate, as drawn by the player."""
MOST_STATES = 10_000
"""The maximum number of states of a plan: 1,000 s in steps of 0.1 s, which is longer than any recording."""
_Step = Annotated[int, Field(ge=0)]


class Line(Model):
    """A line or the outline of an area, as x and y in m, one entry each per point."""

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
    """A rejected candidate trajectory, as shown in the player, with at most one point per time step."""

    x_m: tuple[float, ...] = Field(min_length=2, max_length=MOST_CANDIDATE_POINTS)
    y_m: tuple[float, ...] = Field(min_length=2, max_length=MOST_CANDIDATE_POINTS)


class Polygon(Line):
    """The outline of an area that the planner wants to show. The player closes it."""

    x_m: tuple[float, ...] = Field(min_length=2, max_length=MOST_DEBUG_POINTS)
    y_m: tuple[float, ...] = Field(min_length=2, max_length=MOST_DEBUG_POINTS)


class PlannedStates(CommandTrajectory):
    """A planned trajectory with one state per time step from the present on. All lists have the same length."""

    x_m: tuple[Bounded, ...] = Field(max_length=MOST_STATES)
    y_m: tuple[Bounded, ...] = Field(max_length=MOST_STATES)
    heading_rad: tuple[Bounded, ...] = Field(max_length=MOST_STATES)
    speed_mps: tuple[Bounded, ...] = Field(max_length=MOST_STATES)


class LaneletMessage(Model):
    """A lanelet near the route: its bounds in driving direction, its neighbours, its speed limit and lights."""

    id: int
    left: Line
    right: Line
    successors: tuple[int, ...] = ()
    left_neighbour: int | None = Field(None, description="lanelet to its left, in any direction")
    left_same_direction: bool = Field(False, description="whether that one leads in the same direction")
    right_neighbour: int | None = Field(None, description="lanelet to its right, in any direction")
    right_same_direction: bool = Field(False, description="whether that one leads in the same direction")
    speed_limit_mps: float | None = Field(None, description="posted limit; null if no limit is posted")
    signals: tuple[int, ...] = Field((), description="ids of the traffic lights at its end")


class GoalMessage(Model):
    """A goal state. Reaching any goal state ends the run as a success. A null field accepts any value."""

    first_step: int
    last_step: int
    areas: tuple[Line, ...] | None = Field(description="outlines; the ego's centre must be in one of them")
    heading_rad: tuple[float, float] | None = Field(description="smallest and largest heading")
    speed_mps: tuple[float, float] | None = Field(description="smallest and largest speed")


class StartMessage(Model):
    """The start of a run. The program forgets any previous run and answers with ``ready``.

    ``vehicle`` gives the ego's size and limits. The route leads to the first of the ``goals``. ``reference`` is the
    path of the route, from behind the ego to beyond the goal, with a point about every metre. ``lanelets`` are those
    near that path.
    """

    type: Literal["start"] = "start"
    protocol: Literal[1] = 1
    scenario_id: str
    problem_id: int
    planner: str
    config_id: str
    weights: dict[str, float]
    settings: dict[str, float] = Field(description="numeric settings of the configuration")
    vehicle: dict[str, float] = Field(
        description="length_m, width_m, wheelbase_m, rear_axle_behind_center_m, maximum_acceleration_mps2 (friction: "
        "along and across together), maximum_speed_mps, switching_speed_mps (above it the engine's power limits the "
        "acceleration), maximum_steering_rad, maximum_steering_rate_radps"
    )
    ego_class: str = Field("car", description="class of the ego: car, truck, bus, motorcycle …")
    friction: float | None = Field(
        None,
        exclude_if=lambda friction: friction is None,
        description="coefficient of friction of the road, which already limits maximum_acceleration_mps2; null or "
        "missing: the scenario does not state it",
    )
    step_s: float = Field(description="time step of the scenario and of every plan")
    first_step: int = Field(description="first step of the run")
    last_step: int = Field(description="last step of the goal's time")
    replan_steps: int = Field(description="steps of each plan that are driven before the next plan is requested")
    horizon_steps: int = Field(description="steps over which others are predicted")
    goals: tuple[GoalMessage, ...]
    reference: Line
    route: tuple[int, ...] = Field(description="lanelets of the route in driving order")
    lanelets: tuple[LaneletMessage, ...]


class ReadyMessage(Model):
    """The program's answer to ``start``: it is ready to plan."""

    type: Literal["ready"] = "ready"
    protocol: int = Field(description="the version that the program supports: 1")


class EgoMessage(Model):
    """The ego at this step, where a plan begins."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    acceleration_mps2: float
    yaw_rate_radps: float


class PredictedMessage(Model):
    """The predicted positions of another road user, one entry per step, starting with the present.

    ``heading_rad`` and ``covariance_m2`` (xx, xy and yy of the position) have a single entry if it is valid for all
    steps, which keeps messages with many road users short. ``length_m`` and ``width_m`` include the prediction's safety
    margin.
    """

    x_m: tuple[float, ...]
    y_m: tuple[float, ...]
    heading_rad: tuple[float, ...]
    covariance_m2: tuple[tuple[float, float, float], ...]
    length_m: float
    width_m: float


class OtherMessage(Model):
    """Another road user as observed, rounded to 0.1 mm, and as predicted."""

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
    """A traffic light on the route ahead at this step."""

    id: int
    lanelet: int = Field(description="route lanelet with the light at its end")
    state: str = Field(description="red, redYellow, yellow, green or inactive, as CommonRoad writes it")
    ahead_m: float = Field(description="distance along the route from the ego's centre to the end of that lanelet")


class RouteMessage(Model):
    """The ego's position relative to its reference path.

    ``offset_m`` is positive to the left of the path. ``to_goal_m`` is measured along the path to the first goal,
    negative beyond it, and null for a goal without a position.
    """

    station_m: float
    offset_m: float
    heading_error_rad: float
    to_goal_m: float | None
    desired_speed_mps: float = Field(description="target speed of the built-in planners")
    desired_speed_reason: str = Field(description="reason: goal_mean, goal_end, goal_interval, speed_limit or curve")


class StepMessage(Model):
    """The request for a plan. The program answers with ``plan`` for the same step."""

    type: Literal["step"] = "step"
    step: _Step
    time_s: float = Field(description="since the beginning of the run")
    ego: EgoMessage
    others: tuple[OtherMessage, ...]
    signals: tuple[SignalMessage, ...]
    route: RouteMessage


class DebugMessage(Model):
    """Values that the planner reports for this step, by name. The player shows them, and exports include them."""

    numbers: dict[PrintedName, float] = Field(default_factory=dict, max_length=MOST_DEBUG_VALUES)
    texts: dict[PrintedName, Annotated[str, StringConstraints(max_length=2000)]] = Field(
        default_factory=dict, max_length=MOST_DEBUG_VALUES
    )
    polygons: dict[PrintedName, Polygon] = Field(default_factory=dict, max_length=MOST_DEBUG_POLYGONS)


class PlanMessage(Model):
    """The program's answer to ``step``.

    ``trajectory`` has one state per time step, starting with the present, and covers at least 1 s. Null means that no
    trajectory is drivable, which ends the run as infeasible; ``rejected`` then says why.
    """

    type: Literal["plan"] = "plan"
    step: _Step = Field(description="as in the request")
    trajectory: PlannedStates | None
    costs: dict[PrintedName, BoundedCost] = Field(
        default_factory=dict, max_length=MOST_TERMS, description="weighted cost term: value"
    )
    rejected: dict[PrintedName, Annotated[int, Field(ge=0)]] = Field(
        default_factory=dict, max_length=MOST_TERMS, description="constraint: candidates that it rejected"
    )
    candidates: int = Field(1, ge=0, description="number of candidates examined")
    shown: tuple[Candidate, ...] = Field((), max_length=MOST_SHOWN_CANDIDATES, description="other candidates")
    debug: DebugMessage = DebugMessage()
