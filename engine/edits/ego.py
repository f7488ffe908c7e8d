"""Edits G: move the ego's goal; let the ego start elsewhere, or in place of a recorded vehicle.

A goal that the ego cannot meet is refused: the ego must be there within the time window, at a speed in the interval. No
planner is run. A goal is refused only if no vehicle of the ego's class could meet it along the lanelets' centre lines
(for a car: with the limits of CommonRoad's vehicle 2). Distances are in m along lanelets.
"""

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...schemas.errors import InvalidRequest, NotPossible, Remedy, UnknownName, instead, with_values
from ...schemas.grammar import parse_interval
from ...schemas.modification import Edit
from ..commonroad import Track, center_of, size_of
from ..cosimulation import DrivePlan, first_curve_too_tight
from ..geometry import point_at, project
from ..network import posted_speeds, station_m
from ..scene import Ego, Scene, goal_center_lanelets
from ..vehicles import (
    BMW_320I,
    VehicleParameters,
    can_be_between,
    ego_class,
    ego_class_of,
    latest_passing_s,
    least_time_s,
    vehicle_class_of,
)
from .changes import Changes, EditStep, GoalChange, car_plan, check_speed, is_relative, parse_speed
from .entries import PLACE_TAKEN, OccupiedPlaces
from .placement import Place, first_place
from .population import check_allowed
from .references import reachable_lanelets, route_to, select, target_lanelets
from .rerouting import branch_for
from .writing import USUAL_GOAL_SIZE_M

_SPEED_TOLERANCE_MPS = 1.0
"""Half the width of the speed interval of a goal with a single speed (chosen)."""
_LARGEST_RECTANGLE_M = 500.0
"""Longer than any goal region of a published scenario: a larger value is a wrong unit (chosen)."""
_LET_VANISH = "let it vanish: no driver can continue its drive"
_TIMES, _SPEEDS, _SPEED_STEP_MPS = 101, 41, 0.1
"""Samples of a goal's time window and speed interval, and the step of the speeds that a refusal lists (chosen)."""
_SLACK_M = 2.0
"""Distances are measured along centre lines, which no car follows exactly (chosen)."""
_LONGEST_S = 60.0
"""Without a time limit, a car has this long to reach any speed."""
_AFTER_START = "add a set_goal edit after set_ego, or choose another start"


def set_goal(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Move the goal of the ego's planning problem onto a lanelet; what the edit does not give stays unchanged.

    An edit with only a time or a speed leaves the goal where it is.

    If the ego enters a curve too fast, this is noted but not refused: lanelets of real maps bend where their roads do
    not.

    Raises:
        InvalidRequest: a place is needed, but neither ``to`` nor ``turn`` is given, or both, or a rectangle or interval
            is invalid.
        NotPossible: there is no ego, or no vehicle can reach the goal in its time at its speed.
    """
    ego = scene.ego
    if ego is None or not ego.lanelets:
        raise NotPossible(
            "the scenario has no ego on a lanelet, so its goal cannot be set",
            next_step="choose a scenario with a planning problem, or let the ego start on a lanelet with set_ego",
        )
    if _keeps_place(edit):
        return _with_intervals(edit, scene, changes, ego)
    routes = _routes_to(edit, scene, changes, ego.lanelets)
    # A time or speed that an earlier edit gave to the goal stays when the goal moves.
    carried = changes.goal if changes.goal is not None and changes.goal.keeps_place else None
    route, goal, task, distance = _first_feasible(routes, edit, scene, ego, carried)
    turned = f"{edit.turn} turn at the next fork: " if edit.turn in ("left", "right") else ""
    turned = "straight on at the next fork: " if edit.turn == "straight" else turned
    where = f"lanelet {goal.lanelet_id} at {_station_m(edit, scene, route):.1f} m"
    what = f"{turned}goal on {where}, {distance:.1f} m ahead of the ego, {task}"
    pace = task.pace_note(scene.last_step * scene.step_s) + _above_limit(scene, route, task)
    curve = first_curve_too_tight(scene, route, ego.position, ego.speed_mps)
    warning = "" if curve is None else f"; the ego {curve}"
    return EditStep(replace(changes, goal=goal), (), what + pace + warning)


def _keeps_place(edit: Edit) -> bool:
    """Return True if an edit changes only the time or speed of a goal."""
    has_place = edit.to or edit.turn is not None or edit.position is not None or edit.rectangle_m is not None
    return not has_place and (edit.goal_time is not None or edit.goal_speed is not None)


def _with_intervals(edit: Edit, scene: Scene, changes: Changes, ego: Ego) -> EditStep:
    """Return the step that gives the present goal another time or speed where it is.

    Raises:
        NotPossible: no vehicle meets the goal in this time at this speed.
    """
    present = changes.goal or GoalChange(
        ego.problem_id, ego.lanelets[0], ego.position, 0.0, None, None, None, keeps_place=True
    )
    steps = _steps(edit, scene, ego) if edit.goal_time is not None else present.steps
    speed_mps = _speeds(edit.goal_speed, ego) if edit.goal_speed is not None else present.speed_mps
    goal = replace(present, steps=steps, speed_mps=speed_mps)
    changed = replace(changes, goal=goal)
    checked = _goal_task(scene, changed, ego)
    if checked is not None:
        checked.check()
    task = checked or _GoalTask.of(scene, ego, goal, 0.0)
    where = "" if checked is None else f", {checked.ahead_m:.1f} m ahead of the ego"
    pace = "" if checked is None else task.pace_note(scene.last_step * scene.step_s)
    return EditStep(changed, (), f"goal where it was{where}, {task}{pace}")


def _above_limit(scene: Scene, route: tuple[int, ...], task: "_GoalTask") -> str:
    """Return text if the average speed that a goal needs is above every signed limit of a route, otherwise ""."""
    posted = posted_speeds(scene.network)
    limits_mps = [posted[key] for key in route if key in posted]
    needed_mps = task.least_average_mps
    if not limits_mps or needed_mps is None or needed_mps <= max(limits_mps):
        return ""
    return f", above the speed limit of {max(limits_mps) * 3.6:.0f} km/h"


def _routes_to(edit: Edit, scene: Scene, changes: Changes, starts: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Return the ego's routes to the goal, in order: to the given lanelet, or to those of the matching branch."""
    if bool(edit.to) == bool(edit.turn):
        near = reachable_lanelets(scene, starts)
        raise InvalidRequest(
            "set_goal takes either a lanelet in 'to' or a 'turn' at the next fork, not both"
            if edit.to
            else "set_goal needs either a lanelet in 'to' or a 'turn' at the next fork, unless it changes only its "
            "time or speed",
            valid=[*starts, *near],
            next_step="give one that the ego reaches, or turn=left, right or straight",
            remedies=[with_values(turn=None, to=[str(key)]) for key in near[:_AHEAD_TRIED]],
        )
    if edit.turn is None:
        try:
            targets = target_lanelets(edit.to, scene, changes)
        except UnknownName as error:
            near = reachable_lanelets(scene, starts)
            raise UnknownName(
                error.message,
                valid=[*starts, *near],
                next_step="choose one of these; the ego reaches them, the nearest first",
                remedies=[*error.remedies, *(with_values(to=[str(key)]) for key in near[:_AHEAD_TRIED])],
            ) from error
        return [route_to(scene, starts, targets, "the ego")]
    branch = branch_for(scene, starts[0], edit.turn, "the ego")
    return [route_to(scene, starts[:1], [lanelet], "the ego") for lanelet in branch.lanelets]


def _first_feasible(
    routes: list[tuple[int, ...]], edit: Edit, scene: Scene, ego: Ego, carried: GoalChange | None
) -> tuple[tuple[int, ...], GoalChange, "_GoalTask", float]:
    """Return the first route with an end that the ego can meet, and the goal there.

    Raises:
        NotPossible: no route has an end that the ego can meet; the error is that of the first route.
    """
    refused: NotPossible | None = None
    for route in routes:
        try:
            return (route, *_goal_at_end_of_route(route, edit, scene, ego, carried))
        except NotPossible as error:
            refused = refused or error
    raise refused or NotPossible("the ego has no route to a goal", next_step="give a lanelet in 'to'")


_AHEAD_TRIED = 3
"""Number of reachable lanelets that a refusal proposes as goals (chosen)."""
_SECONDS_MORE = (1, 5)
"""How much later than the earliest arrival the times end that a refusal proposes (chosen)."""


def _farther_on(scene: Scene, ego: Ego) -> list[Remedy]:
    """Return goals ahead of the ego: the end of the given lanelet, or of lanelets that the ego reaches."""
    ahead = reachable_lanelets(scene, ego.lanelets)[:_AHEAD_TRIED]
    return [with_values(position="final"), *(with_values(turn=None, to=[str(key)], position="final") for key in ahead)]


def _station_m(edit: Edit, scene: Scene, route: tuple[int, ...]) -> float:
    lane = scene.layout.table.lanes[route[-1]]
    return station_m(edit.position or "final", route[-1], lane.length_m)


def _goal_at_end_of_route(
    route: tuple[int, ...], edit: Edit, scene: Scene, ego: Ego, carried: GoalChange | None
) -> tuple[GoalChange, "_GoalTask", float]:
    """Return the goal on a route's last lanelet, its task, and its distance ahead of the ego in m.

    Raises:
        NotPossible: the goal is behind the ego, or no vehicle meets it in its time at its speed.
    """
    place = Place(route[-1], _station_m(edit, scene, route))
    distance = _distance_along(scene, ego, route, place.station_m)
    if distance < 0.0:
        raise NotPossible(
            f"lanelet {place.lanelet_id} at {place.station_m:.1f} m is {-distance:.1f} m behind the ego",
            next_step="choose a later position or a lanelet ahead",
            remedies=_farther_on(scene, ego),
        )
    size_m, steps, speed_mps = _size(edit.rectangle_m), _steps(edit, scene, ego), _speeds(edit.goal_speed, ego)
    if carried is not None:
        steps = carried.steps or steps if edit.goal_time is None else steps
        speed_mps = carried.speed_mps if speed_mps is None else speed_mps
    goal = GoalChange(ego.problem_id, place.lanelet_id, *place.pose(scene), size_m, steps, speed_mps)
    task = _GoalTask.of(scene, ego, goal, distance)
    task.check()
    return goal, task, distance


def _size(rectangle_m: list[float] | None) -> tuple[float, float] | None:
    if rectangle_m is None:
        return None
    if len(rectangle_m) != 2 or not all(0.0 < side <= _LARGEST_RECTANGLE_M for side in rectangle_m):
        raise InvalidRequest(
            f"rectangle_m={rectangle_m} is not a goal region",
            valid=[f"[length, width] in m, both above 0 and at most {_LARGEST_RECTANGLE_M:g}"],
            next_step="give both sides, as in [8, 3]",
            remedies=[with_values(rectangle_m=[8.0, 3.0])],
        )
    return rectangle_m[0], rectangle_m[1]


def _steps(edit: Edit, scene: Scene, ego: Ego) -> tuple[int, int] | None:
    """Return the first and last steps of the goal, or None to keep the current ones.

    If neither ``goal_time`` nor a current goal states them, they span the scenario from the ego's start.
    """
    if edit.goal_time is None:
        return None if _goal_states(scene, ego) else (ego.step, scene.last_step)
    try:
        interval = parse_interval(edit.goal_time, "s", step_s=scene.step_s)
    except InvalidRequest as error:
        raise error.also(with_values(goal_time=None)) from error.__cause__
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
            remedies=[with_values(goal_time=f"<={end * scene.step_s:.1f}s")],
        )
    if not 0 <= first <= last or last <= ego.step:
        raise InvalidRequest(
            f"goal_time '{edit.goal_time}' is not after the start",
            valid=["'8..12s'", "'<=9s'"],
            next_step=f"choose a goal_time after {ego.step * scene.step_s:g} s",
            remedies=[with_values(goal_time=f"<={end * scene.step_s:.1f}s"), with_values(goal_time=None)],
        )
    return first, last


def _speeds(text: str | None, ego: Ego) -> tuple[float, float] | None:
    if text is None:
        return None
    if text.strip().startswith("+"):
        plain = text.strip().lstrip("+").strip()
        raise InvalidRequest(
            f"goal_speed '{text}' is relative, but a goal has no earlier speed that it could refer to",
            valid=["'5..10m/s'", "'<=8m/s'"],
            next_step="give the speed without a sign",
            remedies=[instead(text, plain, "goal_speed")],
        )
    try:
        interval = parse_interval(text, "m/s")
    except InvalidRequest as error:
        raise error.also(with_values(goal_speed=None)) from error.__cause__
    slack, top_mps = _SPEED_TOLERANCE_MPS if interval.exact else 0.0, ego.vehicle.maximum_speed_mps
    low = max((interval.low or 0.0) - slack, 0.0)
    high = (top_mps if interval.high is None else interval.high) + slack
    if high > top_mps + _SPEED_TOLERANCE_MPS or high <= low:
        raise InvalidRequest(
            f"a {ego.vehicle_class} cannot drive at goal_speed '{text}'",
            valid=[f"0 to {top_mps} m/s"],
            next_step="choose a speed or an interval within it, as '8..12m/s'",
            remedies=[with_values(goal_speed=f"<={top_mps:g}m/s")],
        )
    return low, high


def set_ego(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Start the ego with a new position, speed or class, or in place of a recorded vehicle, which is removed.

    If the ego replaces a vehicle, it takes that vehicle's class unless another is given, and its goal becomes the end
    of that vehicle's recording. The former ego vanishes, or becomes a vehicle that SUMO drives to the former goal.

    Raises:
        InvalidRequest: no vehicle, start or class is given, or both a vehicle and a start, or the former ego would stay
            where the ego still starts.
        UnknownName: the ego cannot have this class.
        NotPossible: there is no ego or no such vehicle at the ego's first step, the position is occupied, or the
            lanelet is closed to the class.
    """
    ego = scene.ego
    if ego is None:
        raise NotPossible("the scenario has no ego", next_step="choose a scenario with a planning problem")
    moved = edit.at is not None or edit.speed is not None
    if bool(edit.vehicles) == moved and (moved or edit.vehicle_class is None):
        raise InvalidRequest(
            "set_ego takes a vehicle in 'vehicles', a start, or a class for the ego",
            valid=["vehicles=[ID]", "at=LANELET", "speed='8m/s'", "vehicle_class=truck"],
            next_step="use one of these",
        )
    if edit.former_ego == "traffic" and not edit.vehicles and edit.at is None:
        raise InvalidRequest(
            "former_ego=traffic would put a car where the ego still starts",
            valid=["at=LANELET", "vehicles=[ID]", "former_ego=vanish"],
            next_step="let the ego start elsewhere too",
        )
    before = changes
    changes, what = (_instead_of if edit.vehicles else _started)(edit, scene, changes, ego)
    new = changes.ego or ego
    _check_class(new, scene, changes, edit)
    what += (
        "" if new.vehicle_class == ego.vehicle_class else f"; vehicle class: {ego_class(new.vehicle_class).in_words}"
    )
    if edit.former_ego != "traffic":
        return EditStep(changes, (), what)
    plan = _former(scene, before, ego)
    who = plan.start.obstacle_id
    changes = replace(changes.with_plan(plan), next_id=who + 1)
    return EditStep(changes, (who,), f"{what}; the former ego is {ego.vehicle_class} {who}", added=(who,))


def _requested_class(edit: Edit, otherwise: str) -> str:
    """Return the name of the class that an edit gives for the ego.

    Raises:
        UnknownName: the ego cannot have this class.
    """
    if edit.vehicle_class is None:
        return otherwise
    return ego_class(vehicle_class_of(edit.vehicle_class) or edit.vehicle_class.strip().lower()).name


def _check_class(ego: Ego, scene: Scene, changes: Changes, edit: Edit) -> None:
    """Refuse a start if its lanelet is closed to the ego's class, or its speed or room does not suit the class."""
    name = ego.vehicle_class
    top_mps, lanelets = ego.vehicle.maximum_speed_mps, ego.lanelets[:1]
    check_speed(ego.speed_mps, top_mps, f"a {name} cannot drive at {ego.speed_mps:.1f} m/s", "choose another speed")
    if name != "car" and lanelets:
        check_allowed(name, lanelets[0], scene)
    if edit.vehicle_class is None and not edit.vehicles:
        return  # if a start was given, its room was checked
    others = replace(scene, ego=None)
    taken = OccupiedPlaces.at(others, ego.step, changes).occupant_at(ego.position, ego.heading_rad, ego.size_m)
    if taken is not None:
        raise NotPossible(
            f"a {ego_class(name).in_words} has no room at the ego's start: {taken} is there",
            next_step="choose a shorter class, another start, or call remove_vehicle first",
            reason=PLACE_TAKEN,
        )


def _instead_of(edit: Edit, scene: Scene, changes: Changes, ego: Ego) -> tuple[Changes, str]:
    chosen = select(edit.vehicles, scene, changes)
    classes = {
        key: known.name
        for key, track in scene.tracks.items()
        if track.first_step <= ego.step < track.last_step and key in scene.matches and key not in changes.removed
        if (known := ego_class_of(track.kind, track.length_m)) is not None
    }
    if len(chosen) != 1 or chosen[0] not in classes:
        names = ", ".join(map(str, chosen))
        raise NotPossible(
            f"vehicle {names} cannot become the ego: give one recorded motor vehicle that is on a lanelet when the ego "
            "starts",
            valid=classes,
            next_step="use one of these",
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
        _requested_class(edit, classes[chosen[0]]),
        scene.friction,
    )
    changes = replace(changes.without(chosen[0]), ego=new)
    what = f"the ego is {track.kind} {chosen[0]} at {new.speed_mps:.1f} m/s"
    goal = _goal_at_end_of(track, scene, ego)
    if goal is None:
        return changes, what
    what += f", with its goal at the end of its recording, on lanelet {goal.lanelet_id}"
    return replace(changes, goal=goal), what


def _goal_at_end_of(track: Track, scene: Scene, ego: Ego) -> GoalChange | None:
    """Return the last recorded position of a vehicle as the goal, or None if the file's goal has no position.

    The goal's time and speed intervals are widened to include the vehicle's time and speed there.
    """
    if not goal_center_lanelets(scene.network, scene.loaded.problem(ego.problem_id)):
        return None
    first, last = _kept_steps(scene, ego) or (track.last_step, track.last_step)
    requested, there = _kept_speeds(scene, ego), max(float(track.speeds_mps[-1]), 0.0)
    keeps_speeds = requested is None or requested[0] <= there <= requested[1]
    return GoalChange(
        problem_id=ego.problem_id,
        lanelet_id=scene.matches[track.obstacle_id].lanelets[-1],
        center=track.positions[-1],
        heading_rad=float(track.headings_rad[-1]),
        size_m=None,
        steps=(min(first, track.last_step), max(last, track.last_step)),
        speed_mps=None if requested is None or keeps_speeds else (min(requested[0], there), max(requested[1], there)),
    )


def _started(edit: Edit, scene: Scene, changes: Changes, ego: Ego) -> tuple[Changes, str]:
    name = _requested_class(edit, ego.vehicle_class)
    vehicle = ego_class(name).vehicle.on_road(scene.friction)
    speed, from_before = ego.speed_mps, ""
    if edit.speed is not None:
        speed = parse_speed(edit.speed, vehicle.maximum_speed_mps, ego.speed_mps)
        from_before = f" ({ego.speed_mps:.1f} m/s before)" if is_relative(edit.speed) else ""
        refusal = f"the ego cannot drive at {edit.speed}{from_before}"
        check_speed(speed, vehicle.maximum_speed_mps, refusal, "choose another speed")
    if edit.at is None:
        start = replace(ego, speed_mps=speed, vehicle_class=name)
        return replace(changes, ego=start), f"the ego starts at {speed:.1f} m/s{from_before}"
    place = first_place(edit, scene, changes, vehicle.length_m)
    # The former ego is in the way only if it stays as traffic.
    others = scene if edit.former_ego == "traffic" else replace(scene, ego=None)
    OccupiedPlaces.at(others, ego.step, changes).check_free(place, vehicle.size_m, "choose a free place")
    position, heading = place.pose(scene)
    new = Ego(ego.problem_id, ego.step, position, heading, speed, (place.lanelet_id,), name, scene.friction)
    what = f"the ego starts on lanelet {place.lanelet_id} at {place.station_m:.1f} m, {speed:.1f} m/s{from_before}"
    return replace(changes, ego=new), what


def _former(scene: Scene, changes: Changes, ego: Ego) -> DrivePlan:
    """Return a plan for the former ego: a vehicle of its class that drives to the former goal, or straight ahead."""
    if not ego.lanelets:
        raise NotPossible("the former ego is not on a lanelet", valid=["former_ego=vanish"], next_step=_LET_VANISH)
    goals = tuple(key for key in _goal_lanelet_ids(scene, changes, ego) if key in scene.layout.table.lanes)
    route = scene.lanelet_graph.shortest_route(ego.lanelets[:1], goals) if goals else None
    edges = scene.edge_graph.route(route or ego.lanelets[:1])
    if edges is None:
        route, edges = None, scene.edge_graph.route(ego.lanelets[:1])
    if edges is None:
        raise NotPossible(
            "the former ego's route leaves the lanelet graph", valid=["former_ego=vanish"], next_step=_LET_VANISH
        )
    targets = frozenset(goals) if route else frozenset()
    return car_plan(scene, ego, changes.next_id, route or ego.lanelets[:1], edges, targets)


@dataclass(frozen=True)
class _GoalTask:
    """The task to be ``ahead_m`` ± ``half_m`` along the route within a time window and a speed interval.

    The window counts in s from the ego's start, which is ``start_s`` after the scenario's; None means any time or any
    speed. ``speed_mps``: the ego's speed at its start; ``vehicle``: its limits. ``comes_back``: whether a route leads
    from the goal back to the goal, so the ego may pass the goal first.
    """

    ahead_m: float
    half_m: float
    start_s: float
    window_s: tuple[float, float] | None
    speeds_mps: tuple[float, float] | None
    speed_mps: float
    comes_back: bool
    vehicle: VehicleParameters = BMW_320I

    @classmethod
    def of(cls, scene: Scene, ego: Ego, goal: GoalChange, ahead_m: float) -> "_GoalTask":
        """Return the task of a goal that an edit moves; what the edit does not give comes from the file's goal."""
        steps, speeds = goal.steps or _kept_steps(scene, ego), goal.speed_mps or _kept_speeds(scene, ego)
        window = None if steps is None else (max(steps[0] - ego.step, 0), max(steps[1] - ego.step, 0))
        onward = scene.layout.table.successors[goal.lanelet_id]
        kept_length_m = getattr(_kept(scene, ego, "position"), "length", USUAL_GOAL_SIZE_M[0])
        length_m = goal.size_m[0] if goal.size_m else kept_length_m
        return cls(
            ahead_m=ahead_m,
            half_m=float(length_m) / 2,
            start_s=ego.step * scene.step_s,
            window_s=None if window is None else (window[0] * scene.step_s, window[1] * scene.step_s),
            speeds_mps=speeds,
            speed_mps=max(ego.speed_mps, 0.0),
            comes_back=bool(onward) and scene.lanelet_graph.shortest_route(onward, (goal.lanelet_id,)) is not None,
            vehicle=ego.vehicle,
        )

    @property
    def bounds_m(self) -> tuple[float, float]:
        """The first and last position of the goal along the route, with slack."""
        return self.ahead_m - self.half_m - _SLACK_M, self.ahead_m + self.half_m + _SLACK_M

    def __str__(self) -> str:
        """Return the time window (counted from the scenario's start) and the speed interval as text."""
        time, speed = "at any time", "at any speed"
        if self.window_s is not None:
            first, last = (f"{self.start_s + time_s:.1f}" for time_s in self.window_s)
            time = f"at {first} s" if first == last else f"from {first} to {last} s"
        if self.speeds_mps is not None:
            speed = f"at {self.speeds_mps[0]:.1f} to {self.speeds_mps[1]:.1f} m/s"
        return f"{time}, {speed}"

    def check(self) -> None:
        """Refuse a goal that no vehicle meets from the ego's start.

        Raises:
            NotPossible: the error states the times or speeds at which a vehicle can be there.
        """
        nearest, farthest = self.bounds_m
        if farthest < 0.0 and not self.comes_back:
            raise NotPossible(
                f"the goal is {-self.ahead_m:.1f} m behind the ego",
                next_step="choose a later position or a lanelet ahead",
                remedies=[with_values(position="final")],
            )
        if self.window_s is not None:
            least = least_time_s(self.speed_mps, nearest, self.vehicle)
            latest = latest_passing_s(self.speed_mps, farthest, self.vehicle)
            if least > self.window_s[1] + 1e-9:
                raise NotPossible(
                    f"no {self.vehicle.vehicle_class} that starts at {self.speed_mps:.1f} m/s covers "
                    f"{self.ahead_m:.1f} m within {self.window_s[1]:.1f} s",
                    valid=[f"goal_time of at least {math.ceil((self.start_s + least) * 10) / 10:.1f} s"],
                    next_step="give a later goal_time, or choose a nearer place",
                    remedies=[
                        with_values(goal_time=f"<={math.ceil(self.start_s + least) + more}s") for more in _SECONDS_MORE
                    ],
                )
            if latest < self.window_s[0] - 1e-9 and not self.comes_back:
                raise NotPossible(
                    f"any {self.vehicle.vehicle_class} at {self.speed_mps:.1f} m/s has passed the goal "
                    f"{self.ahead_m:.1f} m ahead by {self.start_s + latest:.1f} s, however hard it brakes; the goal is "
                    f"{self}",
                    valid=[f"goal_time that begins by {math.floor((self.start_s + latest) * 10) / 10:.1f} s"],
                    next_step="start the goal_time earlier, or choose a place farther ahead",
                    remedies=[with_values(goal_time=f"<={math.floor((self.start_s + latest) * 10) / 10:.1f}s")],
                )
        if self.speeds_mps is not None:
            self._check_speeds(*self.speeds_mps)

    def _check_speeds(self, low: float, high: float) -> None:
        times = np.linspace(*(self.window_s or (0.0, _LONGEST_S)), _TIMES)
        bounds = self.bounds_m[0], math.inf if self.comes_back else self.bounds_m[1]
        wanted = np.append(np.linspace(low, high, _SPEEDS), np.clip(self.speed_mps, low, high))
        if can_be_between(self.speed_mps, bounds, times, wanted, self.vehicle).any():
            return
        every = np.arange(0.0, self.vehicle.maximum_speed_mps, _SPEED_STEP_MPS)
        possible = every[can_be_between(self.speed_mps, bounds, times, every, self.vehicle).any(axis=0)]
        raise NotPossible(
            f"no {self.vehicle.vehicle_class} that starts at {self.speed_mps:.1f} m/s can be {self.ahead_m:.1f} m on "
            f"{self}",
            valid=[f"goal_speed='{possible[0]:.1f}..{possible[-1]:.1f}m/s'"] if len(possible) else [],
            next_step="choose another goal_speed, a place farther ahead or more time",
        )

    @property
    def least_average_mps(self) -> float | None:
        """The average speed that takes the ego to the goal when its time ends; None if the goal allows any time."""
        if self.window_s is None or self.window_s[1] <= 0.0:
            return None
        return max(self.ahead_m, 0.0) / self.window_s[1]

    def pace_note(self, recording_end_s: float) -> str:
        """Return the average speed that the ego needs, as text after a semicolon; empty if the goal allows any time.

        If the goal's time continues after the recording's end (in s from the scenario's start), the text states this:
        no traffic is recorded then. A recording without motion has no end.
        """
        needed_mps = self.least_average_mps
        if self.window_s is None or needed_mps is None:
            return ""
        first_s, last_s = self.window_s
        pace = f"; this requires {needed_mps:.1f} m/s on average"
        left_s = recording_end_s - self.start_s
        if not 0.0 < left_s < last_s:
            return pace
        if first_s <= left_s and least_time_s(self.speed_mps, self.bounds_m[0], self.vehicle) <= left_s:
            by_then_mps = max(self.ahead_m, 0.0) / left_s
            return f"{pace}, by the recording's end at {recording_end_s:.1f} s {by_then_mps:.1f} m/s"
        return f"{pace}; the recording ends earlier, at {recording_end_s:.1f} s"


def check_goal(scene: Scene, changes: Changes) -> None:
    """Refuse a new start of the ego from which its goal cannot be reached in its time at its speed.

    Raises:
        NotPossible: no route leads from the start to the goal, or no vehicle meets the goal from there.
    """
    ego = changes.ego
    if ego is None:
        return
    goals = _goal_lanelet_ids(scene, changes, ego)
    if goals and scene.lanelet_graph.shortest_route(ego.lanelets, goals) is None:
        raise NotPossible(
            f"the goal on lanelet {', '.join(map(str, goals))} cannot be reached from the ego's new start on lanelet "
            f"{', '.join(map(str, ego.lanelets))}",
            next_step=_AFTER_START,
        )
    task = _goal_task(scene, changes, ego)
    if task is None:
        return
    try:
        task.check()
    except NotPossible as error:
        message = (
            f"the goal on lanelet {', '.join(map(str, goals))} cannot be met from the ego's new start: {error.message}"
        )
        raise NotPossible(message, valid=error.valid, next_step=_AFTER_START) from error


def _goal_task(scene: Scene, changes: Changes, ego: Ego) -> "_GoalTask | None":
    """Return the task of the goal as edited, or as in the file; None if it has no single place on the ego's route."""
    goal = changes.goal
    if goal is None or goal.keeps_place:
        kept = _kept_goal(scene, ego)
        goal = kept if kept is None or goal is None else replace(kept, steps=goal.steps, speed_mps=goal.speed_mps)
    route = None if goal is None else scene.lanelet_graph.shortest_route(ego.lanelets, (goal.lanelet_id,))
    if goal is None or route is None:
        return None
    station = project(scene.layout.table.lanes[goal.lanelet_id].center, goal.center)[0]
    return _GoalTask.of(scene, ego, goal, _distance_along(scene, ego, route, station))


def _distance_along(scene: Scene, ego: Ego, route: tuple[int, ...], station_m: float) -> float:
    """Return the distance along a route to an arc length of its last lanelet; a lane change covers no distance."""
    lanes, successors = scene.layout.table.lanes, scene.layout.table.successors
    here_m, total_m = project(lanes[route[0]].center, ego.position)[0], 0.0
    for current, following in itertools.pairwise(route):
        if following in successors[current]:
            total_m, here_m = total_m + lanes[current].length_m - here_m, 0.0
        else:
            here_m = project(lanes[following].center, point_at(lanes[current].center, here_m)[0])[0]
    return total_m + station_m - here_m


def _goal_lanelet_ids(scene: Scene, changes: Changes, ego: Ego) -> tuple[int, ...]:
    """Return the lanelets of the goal, as moved by edits or as in the file; empty if the goal has no lanelet."""
    if changes.goal and not changes.goal.keeps_place:
        return (changes.goal.lanelet_id,)
    return tuple(goal_center_lanelets(scene.network, scene.loaded.problem(ego.problem_id)))


def _kept_steps(scene: Scene, ego: Ego) -> tuple[int, int] | None:
    """Return the first and last steps of the file's goal, or None if it has no time."""
    ends = _ends(_kept(scene, ego, "time_step"))
    return None if ends is None else (int(ends[0]), int(ends[1]))


def _kept_speeds(scene: Scene, ego: Ego) -> tuple[float, float] | None:
    """Return the speed interval in m/s of the file's goal, or None if any speed is allowed."""
    return _ends(_kept(scene, ego, "velocity"))


def _goal_states(scene: Scene, ego: Ego) -> list[Any]:
    return list(scene.loaded.problem(ego.problem_id).goal.state_list)


def _kept_goal(scene: Scene, ego: Ego) -> GoalChange | None:
    """Return the file's goal if it is a single area centred on one of its own lanelets, else None."""
    states = _goal_states(scene, ego)
    lanelets = goal_center_lanelets(scene.network, scene.loaded.problem(ego.problem_id))
    shape = getattr(states[0], "position", None) if len(states) == 1 else None
    if shape is None or hasattr(shape, "shapes"):
        return None
    center = np.asarray(center_of(shape), dtype=float)
    on = sorted(set(scene.network.find_lanelet_by_position([center])[0]) & set(lanelets) & {*scene.layout.table.lanes})
    if not on:
        return None
    longest = max(size_of(shape))
    return GoalChange(ego.problem_id, int(on[0]), center, 0.0, (longest, longest), None, None)


def _kept(scene: Scene, ego: Ego, name: str) -> Any:
    return getattr(next(iter(_goal_states(scene, ego)), None), name, None)


def _ends(value: Any) -> tuple[float, float] | None:
    """Return the two ends of an interval, which are equal for a single value; None for None."""
    return None if value is None else (float(getattr(value, "start", value)), float(getattr(value, "end", value)))
