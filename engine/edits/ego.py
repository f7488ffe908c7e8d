"""Edit G: let the ego start elsewhere, or be another of the recorded cars."""

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...schemas.errors import InvalidRequest, NotPossible
from ...schemas.grammar import parse_interval, parse_quantity
from ...schemas.modification import Edit
from ..commonroad import Track, center_of, size_of
from ..cosimulation import DrivePlan, first_curve_too_tight, usual_behaviour
from ..geometry import point_at, project
from ..network import station_m
from ..scene import Ego, Scene, stated_goal_lanelets
from ..vehicles import EGO_SIZE_M, LARGEST_SPEED_MPS, can_be_there, latest_passing_s, least_time_s, vehicle_classes
from .changes import Changes, EditStep, GoalChange
from .placement import Place, first_place, free_places, occupant
from .references import reach, reachable_lanelets, select, target_lanelets
from .writing import USUAL_GOAL_SIZE_M

# ---------- goal_reach
# Whether the ego can meet a goal: be on it within its time window, at a speed of its interval.

TIMES, SPEEDS, SPEED_STEP_MPS = 101, 41, 0.1
SLACK_M = 2.0
"""No car drives exactly along the middles of lanelets, which is how distances are measured."""
LONGEST_S = 60.0
"""A car without a time to keep has had time for every speed until then."""


@dataclass(frozen=True)
class _GoalTask:
    """What a goal asks: to be ``ahead_m`` ± ``half_m`` along the way in a time window and a speed interval.

    The window counts in s from the ego's start, ``start_s``; None: at any time, at any speed.
    """

    ahead_m: float
    half_m: float
    start_s: float
    window_s: tuple[float, float] | None
    speeds_mps: tuple[float, float] | None

    @property
    def bounds_m(self) -> tuple[float, float]:
        """Where the goal begins and ends along the way, at least and at most."""
        return self.ahead_m - self.half_m - SLACK_M, self.ahead_m + self.half_m + SLACK_M

    def __str__(self) -> str:
        """The time window (counted from the scenario's start) and the speed interval in words."""
        time, speed = "at any time", "at any speed"
        if self.window_s is not None:
            time = f"from {self.start_s + self.window_s[0]:.1f} to {self.start_s + self.window_s[1]:.1f} s"
        if self.speeds_mps is not None:
            speed = f"at {self.speeds_mps[0]:.1f} to {self.speeds_mps[1]:.1f} m/s"
        return f"{time}, {speed}"


def _goal_task(scene: Scene, ego: Ego, goal: GoalChange, ahead_m: float) -> _GoalTask:
    """What a moved goal asks of the ego; what an edit does not name is what the problem's goal asks."""
    steps, speeds = goal.steps or _kept_steps(scene, ego), goal.speed_mps or _kept_speeds(scene, ego)
    window = None if steps is None else (max(steps[0] - ego.step, 0), max(steps[1] - ego.step, 0))
    return _GoalTask(
        ahead_m=ahead_m,
        half_m=_length_m(scene, ego, goal) / 2,
        start_s=ego.step * scene.step_s,
        window_s=None if window is None else (window[0] * scene.step_s, window[1] * scene.step_s),
        speeds_mps=speeds,
    )


def _check_task(scene: Scene, ego: Ego, goal: GoalChange, task: _GoalTask) -> None:
    """Refuse a goal that no car meets from the ego's start.

    Raises:
        NotPossible: with the times or speeds at which a car can be there.
    """
    speed = max(ego.speed_mps, 0.0)
    nearest, farthest = task.bounds_m
    comes_back = _comes_back(scene, goal.lanelet_id)
    if farthest < 0.0 and not comes_back:
        raise NotPossible(
            f"the goal lies {-task.ahead_m:.1f} m behind the ego",
            next_step="choose a later position or a lanelet ahead",
        )
    if task.window_s is not None:
        least, latest = least_time_s(speed, nearest), latest_passing_s(speed, farthest)
        if least > task.window_s[1] + 1e-9:
            raise NotPossible(
                f"{task.ahead_m:.1f} m within {task.window_s[1]:.1f} s is out of reach of any car from {speed:.1f} m/s",
                valid=[f"goal_time of at least {math.ceil((task.start_s + least) * 10) / 10:.1f} s"],
                next_step="name a later goal_time, or choose a nearer place",
            )
        if latest < task.window_s[0] - 1e-9 and not comes_back:
            raise NotPossible(
                f"the goal {task.ahead_m:.1f} m ahead is one {task}, and from {speed:.1f} m/s any car has passed it by "
                f"{task.start_s + latest:.1f} s, however hard it brakes",
                valid=[f"goal_time that begins by {math.floor((task.start_s + latest) * 10) / 10:.1f} s"],
                next_step="let the time begin earlier, or choose a place farther ahead",
            )
    if task.speeds_mps is not None:
        _check_speeds(task, speed, math.inf if comes_back else farthest)


def _pace_words(task: _GoalTask, speed_mps: float, recording_end_s: float) -> str:
    """How fast the ego has to be on average, after a semicolon; empty for a goal at any time.

    Where the goal's time goes on after the recording's end, in s from the scenario's start, that is told too: later
    there is nobody around. A recording without motion has no end.
    """
    if task.window_s is None or task.window_s[1] <= 0.0:
        return ""
    first_s, last_s = task.window_s
    pace = f"; to be there in time takes {max(task.ahead_m, 0.0) / last_s:.1f} m/s on average"
    left_s = recording_end_s - task.start_s
    if not 0.0 < left_s < last_s:
        return pace
    if first_s <= left_s and least_time_s(max(speed_mps, 0.0), task.bounds_m[0]) <= left_s:
        return f"{pace}, by the recording's end at {recording_end_s:.1f} s {max(task.ahead_m, 0.0) / left_s:.1f} m/s"
    return f"{pace}; the recording ends earlier, at {recording_end_s:.1f} s"


def _distance_along(scene: Scene, ego: Ego, way: tuple[int, ...], station_m: float) -> float:
    """Distance in m along a way to an arc length of its last lanelet; a change to the lane beside covers none."""
    lanes, successors = scene.layout.table.lanes, scene.layout.table.successors
    here_m, total_m = project(lanes[way[0]].center, ego.position)[0], 0.0
    for current, following in itertools.pairwise(way):
        if following in successors[current]:
            total_m, here_m = total_m + lanes[current].length_m - here_m, 0.0
        else:
            here_m = project(lanes[following].center, point_at(lanes[current].center, here_m)[0])[0]
    return total_m + station_m - here_m


def _kept_steps(scene: Scene, ego: Ego) -> tuple[int, int] | None:
    """First and last step of the goal that the file has; None where it has none with a time."""
    found = _ends(_kept(scene, ego, "time_step"))
    return None if found is None else (int(found[0]), int(found[1]))


def _kept_speeds(scene: Scene, ego: Ego) -> tuple[float, float] | None:
    """Speed interval in m/s of the goal that the file has; None where any speed will do."""
    return _ends(_kept(scene, ego, "velocity"))


def _kept_goal(scene: Scene, ego: Ego) -> GoalChange | None:
    """The goal that the file has, where it is a single one with a place on a lanelet of its own; else None."""
    states, lanelets = (
        _goal_states(scene, ego),
        stated_goal_lanelets(scene.network, scene.loaded.problem(ego.problem_id)),
    )
    shape = getattr(states[0], "position", None) if len(states) == 1 else None
    if shape is None or hasattr(shape, "shapes"):
        return None
    center = np.asarray(center_of(shape), dtype=float)
    on = sorted(set(scene.network.find_lanelet_by_position([center])[0]) & set(lanelets) & {*scene.layout.table.lanes})
    if not on:
        return None
    longest = max(size_of(shape))
    return GoalChange(ego.problem_id, int(on[0]), center, 0.0, (longest, longest), None, None)


def _goal_states(scene: Scene, ego: Ego) -> list[Any]:
    """The goal states of the ego's planning problem."""
    return list(scene.loaded.problem(ego.problem_id).goal.state_list)


def _check_speeds(task: _GoalTask, speed_mps: float, farthest_m: float) -> None:
    low, high = task.speeds_mps or (0.0, LARGEST_SPEED_MPS)
    times = np.linspace(*(task.window_s or (0.0, LONGEST_S)), TIMES)
    bounds = task.bounds_m[0], farthest_m
    wanted = np.append(np.linspace(low, high, SPEEDS), np.clip(speed_mps, low, high))
    if can_be_there(speed_mps, bounds, times, wanted).any():
        return
    every = np.arange(0.0, LARGEST_SPEED_MPS, SPEED_STEP_MPS)
    possible = every[can_be_there(speed_mps, bounds, times, every).any(axis=0)]
    raise NotPossible(
        f"no car that starts at {speed_mps:.1f} m/s is {task.ahead_m:.1f} m ahead {task}",
        valid=[f"goal_speed '{possible[0]:.1f}..{possible[-1]:.1f}m/s'"] if len(possible) else [],
        next_step="choose another goal_speed, a place farther ahead or more time",
    )


def _comes_back(scene: Scene, lanelet_id: int) -> bool:
    """Whether a way leads from a lanelet back to it, so that who has passed a place on it can come there again."""
    onward = scene.layout.table.successors[lanelet_id]
    return bool(onward) and scene.lanelet_graph.shortest_route(onward, (lanelet_id,)) is not None


def _length_m(scene: Scene, ego: Ego, goal: GoalChange) -> float:
    """Length of the goal region: as named, as the file's rectangle, or the usual one."""
    kept = _kept(scene, ego, "position")
    return float(goal.size_m[0] if goal.size_m else getattr(kept, "length", USUAL_GOAL_SIZE_M[0]))


def _kept(scene: Scene, ego: Ego, name: str) -> Any:
    return getattr(next(iter(_goal_states(scene, ego)), None), name, None)


def _ends(value: Any) -> tuple[float, float] | None:
    """Both ends of an interval, or a value as both; None for None."""
    return None if value is None else (float(getattr(value, "start", value)), float(getattr(value, "end", value)))


# ---------- set_goal
# Edit G: move the ego's goal.

SPEED_TOLERANCE_MPS = 1.0
LARGEST_RECTANGLE_M = 500.0


def set_goal(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Move the goal of the first planning problem onto a lanelet; what is not named stays as it is.

    A bend that the ego comes to too fast is told, not refused: lanelets of real maps bend where their roads do not.

    Raises:
        InvalidRequest: no lanelet, a bad rectangle or interval.
        NotPossible: no ego, or a goal that it cannot reach, or that no car meets in its time at its speed.
    """
    ego = scene.ego
    if ego is None or not ego.lanelets:
        raise NotPossible(
            "the scenario has no ego on a lanelet, so there is no goal to set",
            next_step="choose a scenario with a planning problem, or let the ego start on a lanelet with set_ego",
        )
    starts = _starts(scene, ego)
    if not edit.to:
        near = reachable_lanelets(scene, starts)
        raise InvalidRequest("set_goal needs a lanelet in 'to'", valid=near, next_step="name one that the ego reaches")
    way = reach(scene, starts, target_lanelets(edit.to, scene, changes), "the ego")
    lane = scene.layout.table.lanes[way[-1]]
    place = Place(way[-1], station_m(edit.position or "final", way[-1], lane.length_m))
    distance = _distance_along(scene, ego, way, place.station_m)
    if distance < 0.0:
        raise NotPossible(
            f"lanelet {place.lanelet_id} at {place.station_m:.1f} m lies {-distance:.1f} m behind the ego",
            next_step="choose a later position or a lanelet ahead",
        )
    goal = GoalChange(
        problem_id=ego.problem_id,
        lanelet_id=place.lanelet_id,
        center=place.pose(scene)[0],
        heading_rad=place.pose(scene)[1],
        size_m=_size(edit.rectangle_m),
        steps=_steps(edit, scene, ego),
        speed_mps=_speeds(edit.goal_speed),
    )
    task = _goal_task(scene, ego, goal, distance)
    _check_task(scene, ego, goal, task)
    what = f"goal on lanelet {place.lanelet_id} at {place.station_m:.1f} m, {distance:.1f} m ahead of the ego, {task}"
    hurry = _pace_words(task, ego.speed_mps, scene.last_step * scene.step_s)
    bend = first_curve_too_tight(scene, way, ego.position, ego.speed_mps)
    warning = "" if bend is None else f"; the ego {bend}"
    return EditStep(replace(changes, goal=goal), (), what + hurry + warning)


def _starts(scene: Scene, ego: Ego) -> tuple[int, ...]:
    """The lanelets that the ego stands on; the nearest one where it stands on none."""
    under = set(scene.network.find_lanelet_by_position([ego.position])[0])
    return tuple(key for key in ego.lanelets if key in under) or ego.lanelets[:1]


def _size(rectangle_m: list[float] | None) -> tuple[float, float] | None:
    if rectangle_m is None:
        return None
    if len(rectangle_m) != 2 or not all(0.0 < side <= LARGEST_RECTANGLE_M for side in rectangle_m):
        raise InvalidRequest(
            f"rectangle_m={rectangle_m} is no goal region",
            valid=[f"[length, width] in m, both above 0 and at most {LARGEST_RECTANGLE_M:g}"],
            next_step="give both sides, as in [8, 3]",
        )
    return rectangle_m[0], rectangle_m[1]


def _steps(edit: Edit, scene: Scene, ego: Ego) -> tuple[int, int] | None:
    """First and last step of the goal; None keeps the one there is. A problem without any gets the whole scenario."""
    if edit.goal_time is None:
        return None if _goal_states(scene, ego) else (ego.step, scene.last_step)
    interval = parse_interval(edit.goal_time, "s", step_s=scene.step_s)
    end = max(scene.last_step, (_kept_steps(scene, ego) or (0, 0))[1])
    last = end if interval.high is None else math.floor(interval.high / scene.step_s + 1e-6)
    first = math.ceil((interval.low or 0.0) / scene.step_s - 1e-6)
    if interval.exact:
        first = last = round((interval.high or 0.0) / scene.step_s)
    if first > end > 0:
        raise InvalidRequest(
            f"goal_time '{edit.goal_time}' begins after the scenario's end at {end * scene.step_s:.1f} s",
            valid=[f"'<={end * scene.step_s:.1f}s'"],
            next_step="choose an earlier goal_time",
        )
    if not 0 <= first <= last or last <= ego.step:
        raise InvalidRequest(
            f"goal_time '{edit.goal_time}' does not lie after the start",
            valid=["'8..12s'", "'<=9s'"],
            next_step=f"choose a goal_time after {ego.step * scene.step_s:g} s",
        )
    return first, last


def _speeds(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    interval = parse_interval(text, "m/s")
    slack = SPEED_TOLERANCE_MPS if interval.exact else 0.0
    low = max((interval.low or 0.0) - slack, 0.0)
    high = (LARGEST_SPEED_MPS if interval.high is None else interval.high) + slack
    if high > LARGEST_SPEED_MPS + SPEED_TOLERANCE_MPS or high <= low:
        raise InvalidRequest(
            f"goal_speed '{text}' is no speed of a car",
            valid=[f"0 … {LARGEST_SPEED_MPS} m/s"],
            next_step="choose a speed or an interval within it, as '8..12m/s'",
        )
    return low, high


# ---------- set_ego
# Edit G: let the ego start elsewhere, or be another of the recorded cars.

LET_VANISH = "let it vanish: nobody can drive it on"
AFTER_START = "add a set_goal edit after set_ego, or choose another start"


def set_ego(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Start the ego at another place or speed, or put it in the place of a recorded car, which leaves the traffic.

    In the place of a car the goal becomes the end of that car's recording. The former ego vanishes, or becomes a car
    that SUMO drives to the former goal.

    Raises:
        InvalidRequest: neither a car nor a start, or both, or a former ego that stays where the ego still starts.
        NotPossible: no ego, no such car at the ego's first step, or a place that is taken.
    """
    ego = scene.ego
    if ego is None:
        raise NotPossible("the scenario has no ego", next_step="choose a scenario with a planning problem")
    moved = edit.at is not None or edit.speed is not None
    if bool(edit.vehicles) == moved:
        raise InvalidRequest(
            "set_ego takes either a car in 'vehicles' or a start",
            valid=["vehicles=[ID]", "at=LANELET", "speed='8m/s'"],
            next_step="give one of these",
        )
    if edit.former_ego == "traffic" and not edit.vehicles and edit.at is None:
        raise InvalidRequest(
            "former_ego=traffic would put a car where the ego still starts",
            valid=["at=LANELET", "vehicles=[ID]", "former_ego=vanish"],
            next_step="let the ego start elsewhere too",
        )
    before = changes
    if edit.vehicles:
        changes, what = _instead_of(edit, scene, changes, ego)
    else:
        changes, what = _started(edit, scene, changes, ego)
    if edit.former_ego != "traffic":
        return EditStep(changes, (), what)
    plan = _former(scene, before, ego)
    who = plan.start.obstacle_id
    changes = replace(changes.with_plan(plan), next_id=who + 1)
    return EditStep(changes, (who,), f"{what}; the former ego is car {who}", added=(who,))


def check_goal(scene: Scene, changes: Changes) -> None:
    """Refuse a new start of the ego from which its goal cannot be reached, or not in its time at its speed.

    Raises:
        NotPossible: the goal lies where no lanelet leads from the start, or no car meets it from there.
    """
    if changes.ego is None:
        return
    _check_way(scene, changes, changes.ego)
    goal = changes.goal or _kept_goal(scene, changes.ego)
    way = None if goal is None else scene.lanelet_graph.shortest_route(changes.ego.lanelets, (goal.lanelet_id,))
    if goal is None or way is None:
        return
    station = project(scene.layout.table.lanes[goal.lanelet_id].center, goal.center)[0]
    task = _goal_task(scene, changes.ego, goal, _distance_along(scene, changes.ego, way, station))
    try:
        _check_task(scene, changes.ego, goal, task)
    except NotPossible as error:
        message = f"the goal on lanelet {goal.lanelet_id} cannot be met from the ego's new start: {error.message}"
        raise NotPossible(message, valid=error.valid, next_step=AFTER_START) from error


def _check_way(scene: Scene, changes: Changes, ego: Ego) -> None:
    problem = scene.loaded.problem(ego.problem_id)
    goals = (changes.goal.lanelet_id,) if changes.goal else stated_goal_lanelets(scene.network, problem)
    if goals and scene.lanelet_graph.shortest_route(ego.lanelets, goals) is None:
        raise NotPossible(
            f"the goal on lanelet {', '.join(map(str, goals))} cannot be reached from the ego's new start on lanelet "
            f"{', '.join(map(str, ego.lanelets))}",
            next_step=AFTER_START,
        )


def _instead_of(edit: Edit, scene: Scene, changes: Changes, ego: Ego) -> tuple[Changes, str]:
    chosen = select(edit.vehicles, scene, changes)
    cars = [key for key, track in scene.tracks.items() if _fits(scene, changes, track, ego.step)]
    if len(chosen) != 1 or chosen[0] not in cars:
        names = ", ".join(map(str, chosen))
        raise NotPossible(
            f"vehicle {names} cannot become the ego: that takes one recorded car, on a lanelet when the ego starts",
            valid=cars,
            next_step="name one of these",
        )
    track = scene.tracks[chosen[0]]
    index = ego.step - track.first_step
    new = Ego(
        ego.problem_id,
        ego.step,
        track.positions[index],
        float(track.headings_rad[index]),
        max(float(track.speeds_mps[index]), 0.0),
        (scene.matches[chosen[0]].at(index),),
    )
    changes = replace(changes.without(chosen[0]), ego=new)
    what = f"the ego is car {chosen[0]} at {new.speed_mps:.1f} m/s"
    goal = _goal_at_its_end(scene, track)
    if goal is None:
        return changes, what
    return replace(
        changes, goal=goal
    ), f"{what}, its goal where that car's recording ends, on lanelet {goal.lanelet_id}"


def _fits(scene: Scene, changes: Changes, track: Track, step: int) -> bool:
    key = track.obstacle_id
    there = track.index_at(step) is not None and track.last_step > step and key in scene.matches
    return track.kind == "car" and there and key not in changes.removed


def _goal_at_its_end(scene: Scene, track: Track) -> GoalChange | None:
    """The last recorded place of a car as goal, which time and speed are widened to; None where it has no place."""
    ego = scene.ego
    if ego is None or not stated_goal_lanelets(scene.network, scene.loaded.problem(ego.problem_id)):
        return None
    state = scene.loaded.problem(ego.problem_id).goal.state_list[0]
    time = getattr(state, "time_step", track.last_step)
    first, last = int(getattr(time, "start", time)), int(getattr(time, "end", time))
    asked, there = _kept_speeds(scene, ego), max(float(track.speeds_mps[-1]), 0.0)
    keeps_speeds = asked is None or asked[0] <= there <= asked[1]
    return GoalChange(
        problem_id=ego.problem_id,
        lanelet_id=scene.matches[track.obstacle_id].lanelets[-1],
        center=track.positions[-1],
        heading_rad=float(track.headings_rad[-1]),
        size_m=None,
        steps=(min(first, track.last_step), max(last, track.last_step)),
        speed_mps=None if asked is None or keeps_speeds else (min(asked[0], there), max(asked[1], there)),
    )


def _started(edit: Edit, scene: Scene, changes: Changes, ego: Ego) -> tuple[Changes, str]:
    speed = ego.speed_mps if edit.speed is None else parse_quantity(edit.speed, "m/s")
    if not 0.0 <= speed <= LARGEST_SPEED_MPS:
        raise InvalidRequest(
            f"the ego does not drive {edit.speed}",
            valid=[f"0 … {LARGEST_SPEED_MPS:g} m/s"],
            next_step="choose another speed",
        )
    if edit.at is None:
        return replace(changes, ego=replace(ego, speed_mps=speed)), f"the ego starts at {speed:.1f} m/s"
    place = first_place(edit, scene, changes, EGO_SIZE_M[0])
    _check_free(edit, scene, changes, place, ego)
    position, heading = place.pose(scene)
    new = Ego(ego.problem_id, ego.step, position, heading, speed, (place.lanelet_id,))
    what = f"the ego starts on lanelet {place.lanelet_id} at {place.station_m:.1f} m, {speed:.1f} m/s"
    return replace(changes, ego=new), what


def _check_free(edit: Edit, scene: Scene, changes: Changes, place: Place, ego: Ego) -> None:
    """The former ego is in the way only where it stays as traffic."""
    others = scene if edit.former_ego == "traffic" else replace(scene, ego=None)
    who = occupant(others, changes, place, EGO_SIZE_M, ego.step)
    if who:
        raise NotPossible(
            f"lanelet {place.lanelet_id} at {place.station_m:.1f} m is taken by {who}",
            valid=free_places(others, changes, place, EGO_SIZE_M, ego.step),
            next_step="choose a free place",
        )


def _former(scene: Scene, changes: Changes, ego: Ego) -> DrivePlan:
    """The former ego as a car that drives to the former goal, or straight on."""
    if not ego.lanelets:
        raise NotPossible("the former ego stands on no lanelet", valid=["former_ego=vanish"], next_step=LET_VANISH)
    problem = scene.loaded.problem(ego.problem_id)
    goals = (changes.goal.lanelet_id,) if changes.goal else stated_goal_lanelets(scene.network, problem)
    goals = tuple(key for key in goals if key in scene.layout.table.lanes)
    way = scene.lanelet_graph.shortest_route(ego.lanelets[:1], goals) if goals else None
    edges = scene.edge_graph.route(way or ego.lanelets[:1])
    if edges is None:
        way, edges = None, scene.edge_graph.route(ego.lanelets[:1])
    if edges is None:
        raise NotPossible(
            "the former ego's way leaves the lanelet graph", valid=["former_ego=vanish"], next_step=LET_VANISH
        )
    lanelets, car = way or ego.lanelets[:1], vehicle_classes()["car"]
    start = Track(
        obstacle_id=changes.next_id,
        kind=car.commonroad_type,
        length_m=EGO_SIZE_M[0],
        width_m=EGO_SIZE_M[1],
        first_step=ego.step,
        positions=np.asarray(ego.position)[None],
        headings_rad=np.array([ego.heading_rad]),
        speeds_mps=np.array([ego.speed_mps]),
    )
    return DrivePlan(
        start=start,
        cause="added",
        from_step=ego.step,
        lanelets=lanelets,
        edges=scene.edge_graph.extended(edges, lanelets[-1]),
        targets=frozenset(goals) if way else frozenset(),
        behaviour=usual_behaviour(car),
        vehicle_class=car,
    )
