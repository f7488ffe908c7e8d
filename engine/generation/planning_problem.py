"""Chooses the ego and its goal: one recorded vehicle becomes the planning problem, and its recorded path gives the
goal.

The ego is a car, or a vehicle of the requested class (``type:truck``); below, "car" means either. Of the cars that can
have this goal, the choice prefers one with a drivable recorded path that passes the site along lanes that a planner
with a reference path can follow. Maps have corners, and where lanes do not face each other, netconvert joins them with
sideways jogs. Recorded cars cut these corners and jogs, but a planner that follows the centre lines may find no
trajectory.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...schemas.errors import NotPossible, UnknownName, closest, with_values
from ...schemas.generation import LaneletGoal, RequestedEgo, RequestedGoal
from ...schemas.text import counted
from ..geometry import (
    Points,
    Values,
    arc_length,
    gaussian,
    oriented_rectangle,
    point_at,
    project,
    resample,
    without_repeats,
    wrap_angle,
)
from ..network import WIDEST_TURN_RAD, LaneletLookup, RoadLanelet, RoadNetwork, station_m
from ..traffic import GeneratedVehicle
from ..vehicles import ego_class
from .sites import SiteFocus
from .turns import MadeTurn, drives_through, leads_without_change, turn_made

SHORTEST_PATH_M = 10.0
"""Minimum distance to a goal after a number of steps (chosen): a car that waits has no task."""
SHORTEST_REQUESTED_PATH_M = 4.0
"""The same for a goal by distance, which is at least 5 m, or by lanelet (chosen)."""


@dataclass(frozen=True)
class TaskSpec:
    """The request for a planning problem: the goal, the ego, and how long the scenario lasts."""

    goal: RequestedGoal
    ego: RequestedEgo
    duration_s: float

    @property
    def shortest_path_m(self) -> float:
        """The minimum distance that a car must drive to the goal."""
        return SHORTEST_PATH_M if self.goal.steps is not None or self.goal.is_through else SHORTEST_REQUESTED_PATH_M


TIME_MARGIN_S = 1.5
"""The goal may be reached this much before and after the recorded car is there (chosen)."""
THROUGH_MARGIN = 0.25
"""The same for a goal beyond the site, as a share of the time to it if that is more (chosen)."""
NO_TURN = "no_turn"
"""Reason for refusing traffic in which no possible ego makes the requested turn."""
MOST_DETOUR = 1.5
"""A route to the goal without a lane change counts only up to this multiple of the driven length (chosen)."""
HEADING_MARGIN_RAD = 0.25
"""Allowed deviation from the recorded heading at the goal, to either side (chosen)."""


@dataclass(frozen=True)
class PlanningTask:
    """Initial state and goal of the ego.

    The goal is a rectangle (length, width) in m around ``center`` (2,), turned by ``heading_rad``, that the ego must
    reach within ``time_steps``. These fields rank egos:

    - ``takes_street``: the path passes the site's ring, or leads along or across a requested street.
    - ``focus_passed``: the number of the site's areas that the recorded path to the goal passes.
    - ``on_spot``: the path passes the exact spot of the site, not only another junction nearby. If the goal should be
      beyond it, the path also starts before it.
    - ``turns_clearly``: the path makes no other turn than the requested one.
    - ``focus_left``: the goal is beyond these areas.
    - ``takes_most``: a goal that should be beyond the site takes at least half of the duration.
    - ``followable``: for such goals, a planner at a steady speed can follow the lanes, and the car's body has room on
      them.
    - ``stands_in``: the ego replaces the car requested by number, because that car cannot have the goal.
    """

    ego: GeneratedVehicle
    goal_step: int
    goal_distance_m: float
    lanelet_id: int
    center: Points
    heading_rad: float
    size_m: tuple[float, float]
    time_steps: tuple[int, int]
    takes_street: bool = True
    focus_passed: int = 1
    on_spot: bool = True
    turns_clearly: bool = True
    focus_left: bool = True
    takes_most: bool = True
    followable: bool = True
    stands_in: bool = False


def choose_task(
    spec: TaskSpec,
    vehicles: Sequence[GeneratedVehicle],
    network: RoadNetwork,
    focus: SiteFocus,
    step_s: float,
    accepts: Callable[[PlanningTask], bool] | None = None,
) -> PlanningTask:
    """Return the task of the requested car, or of the best vehicle of the class that can have the goal.

    If the car with the requested index has no such goal, for example because it waits in a queue, the best later car
    replaces it.

    Cars with a drivable recorded path come first, then cars with a path along or across a requested street. Further
    criteria in order are: the path passes the site; it passes the exact spot; it makes no other turn than the requested
    turn. After these, it must suit a goal beyond the site, and its lanes can be followed. A path suits a goal
    that must be beyond the site if it leaves the site and takes most of the duration. The first car wins a tie. Tasks
    that ``accepts`` rejects are skipped.

    Raises:
        NotPossible: there are fewer cars than the requested index, or no car reaches the requested goal.
        UnknownName: the goal is on a lanelet that the site does not have.
        InvalidRequest: the goal is beyond its lanelet.
    """
    goal, index, name = spec.goal, spec.ego.index, spec.ego.vehicle_class
    top_mps = ego_class(name).vehicle.maximum_speed_mps
    cars = [vehicle for vehicle in vehicles if vehicle.vehicle_class.name == name]
    cars = [vehicle for vehicle in cars if vehicle.motion.speeds_mps[0] <= top_mps]
    lookup = LaneletLookup(network)
    if index is not None and index >= len(cars):
        fitting = (
            place
            for place in reversed(range(len(cars)))
            if _best_task([cars[place]], spec, network, lookup, focus, step_s, accepts) is not None
        )
        last = next(fitting, None)  # a lower index stands for the next car that has the goal
        raise NotPossible(
            f"ego index:{index} is out of range: the traffic has {counted(len(cars), name)}",
            valid=[] if last is None else [f"index:0 to index:{last}"],
            next_step="choose a smaller index or a higher density",
            remedies=[*([] if last is None else [with_values(ego=f"index:{last}")]), with_values(ego=None)],
        )
    choice = [cars[index]] if index is not None else cars
    _check_lanelet(goal, network)
    if (task := _best_task(choice, spec, network, lookup, focus, step_s, accepts)) is not None:
        return task
    others = [] if index is None else cars[index + 1 :]
    if (task := _best_task(others, spec, network, lookup, focus, step_s, accepts)) is not None:
        return replace(task, stands_in=True)
    raise NotPossible(
        f"no {name} ({len(choice) + len(others)} tried) reaches a goal {goal.in_words()} before the recording ends; "
        f"the goal must be at least {spec.shortest_path_m:g} m from the start and not overlap it",
        valid=_driven_lanelets([*choice, *others], lookup) if goal.lanelet else [],
        next_step="choose another goal, a longer duration_s, another ego or another seed",
        reason=NO_TURN if goal.turn is not None else "",
        remedies=[with_values(goal=None, ego=None)],
    )


def _best_task(
    cars: Sequence[GeneratedVehicle],
    spec: TaskSpec,
    network: RoadNetwork,
    lookup: LaneletLookup,
    focus: SiteFocus,
    step_s: float,
    accepts: Callable[[PlanningTask], bool] | None,
) -> PlanningTask | None:
    """Return the task of the best car in the ranking of ``choose_task``, or None if no car has the goal."""
    best: tuple[tuple[int, ...], PlanningTask] | None = None
    for car in cars:
        task = _task(car, spec, network, lookup, focus, step_s)
        if task is None or (spec.goal.turn == "lane_change" and _is_ahead_in_lane(task, network, lookup)):
            continue
        task = _with_site_criteria(task, spec, focus, network, lookup, step_s)
        merit = (
            car.feasible,
            task.takes_street,
            task.focus_passed,
            task.on_spot,
            task.turns_clearly,
            task.focus_left,
            task.takes_most,
        )
        if (best is not None and (*merit, True) <= best[0]) or (accepts is not None and not accepts(task)):
            continue
        # If a planner has most of the duration, it drives more evenly than the car, which other traffic may have
        # delayed.
        evenly_mps = task.goal_distance_m / (task.goal_step * step_s) if spec.goal.is_through else 0.0
        smooth = car.feasible and follows_smooth_lanes(car, task.goal_step, network, lookup, evenly_mps)
        smooth = smooth and _has_room(car, task.goal_step, network)
        if best is None or (*merit, smooth) > best[0]:
            best = (*merit, smooth), replace(task, followable=smooth or not spec.goal.is_through)
        if best[0] == (True, True, focus.parts, True, True, True, True, True):
            break
    return None if best is None else best[1]


def _is_ahead_in_lane(task: PlanningTask, network: RoadNetwork, lookup: LaneletLookup) -> bool:
    """Return whether the ego can reach the goal in its start lane, without a lane change."""
    from shapely import Polygon

    start = _under(lookup, task.ego, 0)
    region = Polygon(oriented_rectangle(task.center, task.heading_rad, task.size_m))
    return start is not None and leads_without_change(start, region, network, MOST_DETOUR * task.goal_distance_m)


def _with_site_criteria(
    task: PlanningTask, spec: TaskSpec, focus: SiteFocus, network: RoadNetwork, lookup: LaneletLookup, step_s: float
) -> PlanningTask:
    """Return the task with the parts of the site that it passes and, if required, whether the goal is beyond it."""
    passed = focus.parts_passed(task.ego, task.goal_step)
    on_spot = not passed or focus.is_on_spot(task.ego, task.goal_step)
    takes_street = focus.takes_street(task.ego, task.goal_step)
    if not spec.goal.is_through:
        return replace(task, takes_street=takes_street, focus_passed=passed, on_spot=on_spot)
    on_spot = on_spot and (not passed or drives_through(task.ego, task.goal_step, focus, network, lookup))
    left = passed > 0 and focus.is_left_by(task.ego, task.goal_step)
    return replace(
        task,
        takes_street=takes_street,
        focus_passed=passed,
        on_spot=on_spot,
        focus_left=left,
        takes_most=task.goal_step * step_s >= spec.duration_s / 2,
    )


def _check_lanelet(goal: RequestedGoal, network: RoadNetwork) -> None:
    """Raise an error if the network does not have the lanelet, or if the position is beyond it."""
    if goal.lanelet is None:
        return
    key = goal.lanelet.lanelet_id
    if key not in network.lanelets:
        raise UnknownName(
            f"the site has no lanelet {key}",
            valid=closest(str(key), [str(known) for known in sorted(network.lanelets)]),
            next_step="generate without a goal, then move it with op set_goal of modify_scenario",
            remedies=[with_values(goal=None)],
        )
    station_m(goal.lanelet.position, key, float(arc_length(network.lanelets[key].center)[-1]))


def _driven_lanelets(cars: Sequence[GeneratedVehicle], lookup: LaneletLookup) -> list[int]:
    """Return the lanelets that the cars drive over; positions are sampled twice a second."""
    passed = (_under(lookup, car, step) for car in cars for step in range(0, len(car.motion.positions), 5))
    return sorted({lanelet.lanelet_id for lanelet in passed if lanelet is not None})


def _under(lookup: LaneletLookup, vehicle: GeneratedVehicle, step: int) -> RoadLanelet | None:
    return lookup.under(vehicle.motion.positions[step], float(vehicle.motion.headings_rad[step]))


def _task(
    car: GeneratedVehicle, spec: TaskSpec, network: RoadNetwork, lookup: LaneletLookup, focus: SiteFocus, step_s: float
) -> PlanningTask | None:
    """Return the task of a car, or None if it does not reach the goal or lanelets do not lead there.

    A car that must make a turn has its goal before the next one.
    """
    goal, at_goal, made = spec.goal, passage(spec, car, network, step_s), MadeTurn(0)
    if at_goal is not None and goal.turn is not None:
        turned = turn_made(goal.turn, car, at_goal.step, focus, network, lookup)
        at_goal = None if turned is None else _at_step(car, turned.last_step, spec)
        made = turned or made
    if at_goal is None:
        return None
    start = _under(lookup, car, 0)
    if goal.lanelet is not None:
        end: RoadLanelet | None = network.lanelets[goal.lanelet.lanelet_id]
    else:
        end = lookup.under(at_goal.center, at_goal.heading_rad)
    if start is None or end is None or end.lanelet_id not in network.graph.reachable([start.lanelet_id]):
        return None
    size_m = goal.lanelet.size_m if goal.lanelet else None
    return PlanningTask(
        ego=car,
        goal_step=at_goal.step,
        goal_distance_m=float(arc_length(car.motion.positions)[at_goal.step]),
        lanelet_id=end.lanelet_id,
        center=at_goal.center,
        heading_rad=at_goal.heading_rad,
        size_m=size_m or _usual_size(end, at_goal.center, float(car.motion.speeds_mps[at_goal.step])),
        time_steps=_window(spec, at_goal.step, step_s),
        turns_clearly=made.is_clear,
    )


def _window(spec: TaskSpec, step: int, step_s: float) -> tuple[int, int]:
    """Return the first and last steps of the goal's time window around the step at which the recorded car reaches the
    goal.
    """
    margin = round(TIME_MARGIN_S / step_s)
    if not spec.goal.is_through:
        return max(1, step - margin), step + margin
    margin = max(margin, round(THROUGH_MARGIN * step))
    return max(1, step - margin), min(step + margin, round(spec.duration_s / step_s))


def _usual_size(lanelet: RoadLanelet, center: Points, speed_mps: float) -> tuple[float, float]:
    """Return a rectangle as wide as the lanelet (2 to 3.5 m) and as long as the car drives in 0.8 s (6 to 20 m)."""
    station, _ = project(lanelet.center, center)
    width = float(np.interp(station, arc_length(lanelet.center), np.linalg.norm(lanelet.left - lanelet.right, axis=1)))
    length = min(max(6.0, 0.8 * speed_mps), 20.0)
    return round(length, 2), round(min(max(width, 2.0), 3.5), 2)


LARGEST_GAP_M = 3.0
"""Maximum distance of a recorded position from a point on the car's path: half its path between two steps."""
STANDS_WITHIN_M = 0.5
"""A waiting car creeps by less than this (chosen)."""
FARTHEST_ASIDE_M = 1.5
"""A car that passes a point at a larger lateral distance is in another lane (chosen)."""


@dataclass(frozen=True)
class _Passage:
    """A car at the goal: the step, the centre of the goal (2,) in m, and the heading."""

    step: int
    center: Points
    heading_rad: float


def passage(spec: TaskSpec, car: GeneratedVehicle, network: RoadNetwork, step_s: float) -> _Passage | None:
    """Return a car's passage of the goal; None if it never gets there, or if the goal is too close to its start."""
    goal, driven = spec.goal, arc_length(car.motion.positions)
    if goal.lanelet is not None:
        return _on_lanelet(goal.lanelet, car, network.lanelets[goal.lanelet.lanelet_id], driven)
    step = _farthest(driven, spec.duration_s, step_s) if goal.is_through else _ahead(goal, driven)
    return None if step is None else _at_step(car, step, spec)


def _at_step(car: GeneratedVehicle, step: int, spec: TaskSpec) -> _Passage | None:
    """Return a car's passage at a step, or None if that is too close to its start."""
    if arc_length(car.motion.positions)[step] < spec.shortest_path_m:
        return None
    return _Passage(step, car.motion.positions[step], float(car.motion.headings_rad[step]))


def _ahead(goal: RequestedGoal, driven: Values) -> int | None:
    """Return the step after the requested steps or metres, or None if that is beyond the car's recording."""
    if goal.steps is not None:
        return goal.steps if goal.steps < len(driven) else None
    reached = np.flatnonzero(driven >= (goal.distance_m or 0.0))
    return int(reached[0]) if len(reached) else None


def _farthest(driven: Values, duration_s: float, step_s: float) -> int | None:
    """Return the step of the farthest possible goal, or None if the car leaves the map section first.

    A goal at the end of the scenario leaves some time for a late ego. A goal at the end of the section leaves some lane
    beyond it. For a car that waits at the end, the step is its arrival.
    """
    last_step = round(duration_s / step_s)
    if len(driven) > last_step:
        farthest_m = float(driven[last_step - round(TIME_MARGIN_S / step_s)])
    else:
        farthest_m = float(driven[-1]) - BEYOND_M
    return int(np.searchsorted(driven, farthest_m - STANDS_WITHIN_M)) if farthest_m > 0 else None


def _on_lanelet(goal: LaneletGoal, car: GeneratedVehicle, lanelet: RoadLanelet, driven: Values) -> _Passage | None:
    """Return the step at which the car is nearest to the position, if it drives over that position.

    A rectangle that contains the car at its start is not a goal.
    """
    station = station_m(goal.position, lanelet.lanelet_id, float(arc_length(lanelet.center)[-1]))
    center, heading = point_at(lanelet.center, station)
    offsets = car.motion.positions - center
    step = int(np.argmin(np.linalg.norm(offsets, axis=1)))
    forward = np.array([math.cos(heading), math.sin(heading)])
    leftward = np.array([-forward[1], forward[0]])
    ahead, aside = offsets[step] @ forward, offsets[step] @ leftward
    length, width = goal.size_m or (0.0, 0.0)
    if abs(offsets[0] @ forward) <= length / 2 and abs(offsets[0] @ leftward) <= width / 2:
        return None
    turned = wrap_angle(float(car.motion.headings_rad[step]) - heading)
    passes = abs(ahead) < LARGEST_GAP_M and abs(aside) < FARTHEST_ASIDE_M and abs(turned) < WIDEST_TURN_RAD
    return _Passage(step, center, heading) if passes and driven[step] >= SHORTEST_REQUESTED_PATH_M else None


LARGEST_CURVATURE_PER_M = 0.2
"""A radius of 5 m (chosen); CommonRoad's vehicle 2 (BMW 320i) can turn more tightly, with 0.7 1/m at full lock."""
LARGEST_CURVATURE_RATE_PER_MS = 0.4
"""The Frenetix core's limit."""
SMOOTHING_M = 2.0
"""Standard deviation of the smoothing before curvature is measured: a polyline has no curvature at corners (chosen)."""
BEFORE_M, BEYOND_M = 2.0, 20.0
"""Lanes are examined from before the start to beyond the goal, where a planner's horizon ends (chosen)."""
OVERHANG_M = 0.3
"""Maximum overhang of a long body's corner beyond the road's edge in a turn (chosen)."""
SAMPLED_EVERY = 5
"""Steps (0.5 s) between two samples of the car's lanelet and speed."""


def follows_smooth_lanes(
    car: GeneratedVehicle, last_step: int, network: RoadNetwork, lookup: LaneletLookup, least_mps: float = 0.0
) -> bool:
    """Return whether the car can steer along the centre lines under it up to a step and 20 m beyond.

    The car is assumed to drive at its recorded speed, but at no less than ``least_mps``.
    """
    under = [_under(lookup, car, step) for step in range(0, last_step + 1, SAMPLED_EVERY)]
    route = [lanelet for lanelet, _ in itertools.groupby(lanelet for lanelet in under if lanelet is not None)]
    return all(_is_smooth(line, car, last_step, least_mps) for line in _lines(route, network))


def _has_room(car: GeneratedVehicle, last_step: int, network: RoadNetwork) -> bool:
    """Return whether the body stays on the road up to a step: long bodies may cut corners, cars always pass."""
    if car.vehicle_class.name == "car":
        return True
    from shapely import contains_xy

    motion = car.motion
    corners = [
        oriented_rectangle(motion.positions[step], float(motion.headings_rad[step]), car.size_m)
        for step in range(0, last_step + 1, SAMPLED_EVERY)
    ]
    x, y = np.concatenate(corners).T
    return bool(contains_xy(network.surface.buffer(OVERHANG_M), x, y).all())


def _lines(route: Sequence[RoadLanelet], network: RoadNetwork) -> list[Points]:
    """Return the centre lines of lanelets, joined along successors and split at lane changes."""
    lines: list[list[Points]] = []
    for before, lanelet in itertools.pairwise([None, *route]):
        if lanelet is None:
            continue
        if before is None or lanelet.lanelet_id not in before.successors:
            lines.append([])
        lines[-1].append(lanelet.center)
    if route and len(route[-1].successors) == 1:
        lines[-1].append(network.lanelets[route[-1].successors[0]].center)
    return [without_repeats(np.concatenate(parts)) for parts in lines]


def _is_smooth(line: Points, car: GeneratedVehicle, last_step: int, least_mps: float) -> bool:
    length = float(arc_length(line)[-1])
    if length < 4 * SMOOTHING_M:
        return True
    own = ego_class(car.vehicle_class.name).vehicle
    spacing = length / round(length)
    points = gaussian(resample(line, round(length) + 1), SMOOTHING_M / spacing)
    turns = np.diff(np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1])))
    curvature = turns / spacing
    stations = arc_length(points)[1:-1]
    first, last = (project(points, car.motion.positions[step])[0] for step in (0, last_step))
    watched = (stations > first - BEFORE_M) & (stations < last + BEYOND_M)
    speed = np.maximum(_speeds_along(points, stations, car, last_step), least_mps)
    rate = np.abs(np.gradient(curvature, spacing)) * speed if len(curvature) > 1 else curvature
    too_tight = np.abs(curvature) > min(LARGEST_CURVATURE_PER_M, own.largest_curvature_per_m)
    return not bool(np.any(watched & (too_tight | (rate > LARGEST_CURVATURE_RATE_PER_MS))))


def _speeds_along(line: Points, stations: Points, car: GeneratedVehicle, last_step: int) -> Points:
    """Return the car's recorded speed at every station; beyond either end, return the speed at that end."""
    steps = np.arange(0, last_step + 1, SAMPLED_EVERY)
    at = np.array([project(line, car.motion.positions[step])[0] for step in steps])
    order = np.argsort(at, kind="stable")
    speeds: Points = np.interp(stations, at[order], car.motion.speeds_mps[steps][order])
    return speeds
