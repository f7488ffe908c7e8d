"""Edits T and B: when, how fast, in which lane and in what manner recorded or added vehicles drive.

Each edit creates or changes plans of vehicles (``DrivePlan``) or replays of recordings; SUMO drives the plans later.
Times count from the scenario's start.
"""

from dataclasses import replace

import numpy as np

from ...schemas.errors import InvalidRequest, NotPossible, with_values
from ...schemas.grammar import parse_selector
from ...schemas.modification import Achieved, Edit
from ..commonroad import Track
from ..cosimulation import (
    Behaviour,
    DrivePlan,
    Manoeuvre,
    Replay,
    StopOrder,
    behaviour_from,
    beyond,
    class_of,
    distances_ahead_m,
    own_minimum_gap_m,
    parameters_set,
    presets,
    scripted_track,
    sent_on,
    values_set,
)
from ..geometry import Values, point_at, project
from ..scene import Scene
from ..vehicles import STANDING_MPS, hardest_braking_mps2
from .changes import (
    FEWEST_STATES,
    MOST_NAMED,
    Changes,
    EditStep,
    adjacent_lanes,
    car_at_start,
    check_speed,
    first_step_with_lane,
    is_relative,
    listed,
    moved_in_time,
    named_vehicles,
    no_such_lane,
    parse_speed,
    plan_of,
    requested_speed,
    within_time,
)
from .edited_scene import EGO, EditedScene, new_overlaps
from .explanations import why_slower_or_faster
from .placement import Place, first_place
from .references import nearest_ids, select
from .scripted import achieved, missed, motion_of, scripted_lane_change, scripted_speed

_AT_PLACE_M = 1.0
"""A stop this near the ordered place is at it (chosen): the written motion is smoothed by up to 0.5 m."""
_AROUND_PLACE_M = 10.0
"""A vehicle that stands within this distance of the ordered place stands for it (chosen): others may stand there."""
_AT_LENGTH_S = 0.5
"""A stop that is shorter or longer by no more than this is as long as ordered (chosen)."""
_LEAST_STAND_S = 2.0
"""How long a stop without a duration should stand at least in a place that is proposed as within reach (chosen)."""
_BRAKING_ROOM = 1.2
"""A refused stop proposes a place this many braking distances ahead (chosen)."""
_NEAR_SHARE = 0.02
"""A mean speed is reached within this share of it (chosen)."""


def change_lane(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Send the selected vehicles one lane to the left or right at a time, as soon as there is a gap.

    A vehicle keeps its route if the new lane leads along it, and otherwise continues in the new lane.

    Raises:
        InvalidRequest: neither left nor right is given, or a vehicle is absent at that time.
        NotPossible: there is no such lane in the vehicle's direction at that time, or the vehicle cannot be driven.
    """
    if edit.lane not in ("left", "right"):
        raise InvalidRequest(
            "change_lane goes left or right", valid=["lane=left", "lane=right"], next_step="give one in 'lane'"
        )
    vehicles = select(edit.vehicles, scene, changes)
    if edit.lateral_s is not None or edit.when is not None or edit.dodge or not changes.scripted.isdisjoint(vehicles):
        return scripted_lane_change(edit, scene, changes, vehicles)
    aims: dict[int, tuple[frozenset[int], ...]] = {}
    since: dict[int, int] = {}
    for vehicle_id in vehicles:
        plan, step = _plan_from(scene, changes, vehicle_id, edit.time_s, sends_on=True)
        is_first = vehicle_id not in changes.driven
        here = _lanelets_at(scene, plan, step, exact=is_first)
        adjacent = adjacent_lanes(scene, here, edit.lane)
        if not adjacent:
            raise _no_such_lane(edit, scene, plan, here[0])
        plan = _with_route_of_lane(scene, plan, here, adjacent[0])
        order = Manoeuvre(step, lanes_left=1 if edit.lane == "left" else -1)
        changes = changes.with_plan(_with_manoeuvre(plan, order))
        since[vehicle_id] = step
        # The change may happen farther along the road than requested.
        aims[vehicle_id] = (frozenset({*adjacent, *adjacent_lanes(scene, plan.lanelets, edit.lane)}),)
    when = "" if edit.time_s is None else f" from {edit.time_s:g} s"
    return EditStep(
        changes, vehicles, f"{named_vehicles(vehicles)} sent one lane to the {edit.lane}{when}", aims=aims, since=since
    )


def _lanelets_at(scene: Scene, plan: DrivePlan, step: int, *, exact: bool) -> tuple[int, ...]:
    """Return the lanelet at a step (``exact``); for a vehicle on another route than recorded, its whole route.

    Lane changes that were ordered earlier count as done.
    """
    match = scene.matches.get(plan.start.obstacle_id)
    lanelets = (match.at(step - plan.start.first_step),) if exact and match else plan.lanelets
    shift = sum(order.lanes_left for order in plan.manoeuvres if order.from_step <= step)
    for _ in range(abs(shift)):
        lanelets = tuple(adjacent_lanes(scene, lanelets, "left" if shift > 0 else "right")) or lanelets
    return lanelets


def _with_route_of_lane(scene: Scene, plan: DrivePlan, here: tuple[int, ...], lane: int) -> DrivePlan:
    """Return the unchanged plan if the new lane leads along it, else a plan that continues in the new lane."""
    edge = scene.layout.lane_of.get(lane, ("", 0))[0]
    if edge not in plan.edges or _leads_on(scene, plan, lane, edge):
        return plan
    lanes = scene.layout.table.lanes
    start = next(
        place for place, key in enumerate(plan.lanelets) if key in here or lane in (lanes[key].left, lanes[key].right)
    )
    route = (*plan.lanelets[: start + 1], lane)
    edges = scene.edge_graph.route(route)
    return plan if edges is None else replace(plan, lanelets=route, edges=scene.edge_graph.extended(edges, lane))


def _leads_on(scene: Scene, plan: DrivePlan, lanelet_id: int, edge: str) -> bool:
    """Return True if a lane leads to the next edge of the route (at the route's end, always)."""
    onward = plan.edges[plan.edges.index(edge) + 1 :][:1]
    paths, lane_of = scene.layout.paths, scene.layout.lane_of
    indices = scene.edge_graph.paths_from.get(lanelet_id, ())
    return not onward or any(lane_of[paths[index].exit][0] == onward[0] for index in indices)


def _no_such_lane(edit: Edit, scene: Scene, plan: DrivePlan, here: int) -> NotPossible:
    vehicle_id, side = plan.start.obstacle_id, str(edit.lane)
    later = [f"on lanelet {key}" for key in plan.lanelets if adjacent_lanes(scene, [key], side)]
    track, match = scene.tracks.get(vehicle_id), scene.matches.get(vehicle_id)
    keys = [] if track is None or match is None else match.at_each(len(track.positions) - 1)
    step = None if track is None else first_step_with_lane(scene, track, keys, side)
    return no_such_lane(scene, vehicle_id, here, side, step, later)


def set_speed(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Bring the selected vehicles to a speed from a given time, where the traffic ahead allows it.

    They accelerate and brake within their own limits; 0 stops them.

    Raises:
        InvalidRequest: no speed or an impossible speed is given, or a vehicle is absent at that time.
        NotPossible: a vehicle cannot be driven.
    """
    if edit.speed is None:
        raise InvalidRequest(
            "set_speed needs a speed", valid=["speed='30km/h'", "speed='0m/s'"], next_step="give one in 'speed'"
        )
    vehicles = select(edit.vehicles, scene, changes)
    if edit.rate_mps2 is not None or edit.when is not None or edit.dodge or not changes.scripted.isdisjoint(vehicles):
        return scripted_speed(edit, scene, changes, vehicles)
    if is_relative(edit.speed):
        return _relative_speed(edit, scene, changes, vehicles)
    speeds: dict[int, tuple[float, int]] = {}
    for vehicle_id in vehicles:
        plan, step = _plan_from(scene, changes, vehicle_id, edit.time_s)
        kind = plan.start.kind
        largest_mps = class_of(kind).maximum_speed_mps
        wanted = parse_speed(edit.speed, largest_mps)
        check_speed(wanted, largest_mps, f"a {kind} cannot drive at {edit.speed}", "choose another speed")
        changes = changes.with_plan(_with_manoeuvre(plan, Manoeuvre(step, speed_mps=wanted)))
        speeds[vehicle_id] = (wanted, step)
    when = "" if edit.time_s is None else f" from {edit.time_s:g} s"
    return EditStep(
        changes, vehicles, f"{named_vehicles(vehicles)} set to {speeds[vehicles[0]][0]:.1f} m/s{when}", speeds=speeds
    )


def stop_at(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Have the selected vehicles stop with their front at a place on their route, and then drive on.

    They brake for the place as its distance requires, and stand for ``duration_s``, or until the scenario ends.

    Raises:
        InvalidRequest: no place is given, or a vehicle is absent at that time.
        NotPossible: the place is not on the route, too near to brake for, or the vehicle cannot be driven.
    """
    vehicles = select(edit.vehicles, scene, changes)
    stands_steps = None if edit.duration_s is None else round(edit.duration_s / scene.step_s)
    place = first_place(edit, scene, changes, 0.0)
    order = StopOrder(place.lanelet_id, place.station_m, stands_steps)
    for vehicle_id in vehicles:
        plan, _ = _plan_from(scene, changes, vehicle_id, edit.time_s, sends_on=True)
        _check_stop(scene, plan, place)
        # It stays in the lane of the place: a vehicle in the next lane would stop beside it.
        kept = plan.through | ({place.lanelet_id} & {*plan.lanelets})
        changes = changes.with_plan(replace(plan, stops=(*plan.stops, order), through=kept))

    def measured(edited: EditedScene) -> tuple[Achieved, ...]:
        return tuple(one for key in vehicles for one in _stop_achieved(edited, key, place, edit.duration_s))

    stop = "stops" if len(vehicles) == 1 else "stop"
    how_long = "" if edit.duration_s is None else f" for {edit.duration_s:g} s"
    what = f"{named_vehicles(vehicles)} {stop} on lanelet {place.lanelet_id} at {place.station_m:.1f} m{how_long}"
    return EditStep(changes, vehicles, what, measure=measured)


def _check_stop(scene: Scene, plan: DrivePlan, place: Place) -> None:
    """Refuse a place that is not ahead on a vehicle's route, or that it cannot brake for when its plan begins.

    Raises:
        NotPossible: with the places at which the vehicle can stop.
    """
    starts_m = distances_ahead_m(scene, plan)
    speed_mps = float(plan.start.speeds_mps[plan.from_step - plan.start.first_step])
    braking_m = speed_mps**2 / (2 * hardest_braking_mps2(scene.friction))
    lanes, key = scene.layout.table.lanes, plan.start.obstacle_id
    room_m = starts_m[place.lanelet_id] + place.station_m if place.lanelet_id in starts_m else None
    if room_m is not None and room_m >= braking_m:
        return
    possible = [one for one in starts_m if starts_m[one] + lanes[one].length_m > _BRAKING_ROOM * braking_m]
    nearest = []
    for one in possible[:1]:
        station = max(_BRAKING_ROOM * braking_m - starts_m[one], lanes[one].length_m / 2)
        nearest = [with_values(at=str(one), position=f"{station:.1f}m", lane=None, offset_m=None)]
    raise NotPossible(
        f"the route of vehicle {key} does not pass lanelet {place.lanelet_id}"
        if room_m is None
        else f"the place is {room_m:.1f} m ahead of vehicle {key}, which needs {braking_m:.1f} m to brake from "
        f"{speed_mps:.1f} m/s"
        if room_m > 0.0
        else f"vehicle {key} has already passed lanelet {place.lanelet_id} at {place.station_m:.1f} m",
        valid=[f"at={one}" for one in possible],
        next_step="choose a place farther ahead on its route",
        remedies=nearest,
    )


def _stop_achieved(edited: EditedScene, key: int, place: Place, asked_s: float | None) -> tuple[Achieved, ...]:
    """Measure where and for how long a vehicle stands near a place, on the written motion."""
    track, step_s = edited.road_users.get(key), edited.scene.step_s
    if track is None:
        return ()
    center = edited.scene.layout.table.lanes[place.lanelet_id].center
    target = point_at(center, place.station_m)[0]
    near = [
        index
        for index in range(len(track.speeds_mps))
        if np.linalg.norm(track.front_at(index) - target) <= _AROUND_PLACE_M
    ]
    stands = [index for index in near if track.speeds_mps[index] <= STANDING_MPS]
    if not stands:
        is_there = any(np.linalg.norm(track.front_at(index) - target) <= _AT_PLACE_M for index in near)
        if is_there:
            return (missed(key, "stops", "it slows down, but does not stand"),)
        farthest = _farthest_stop(edited, key, asked_s)
        within = "" if farthest is None else f"; in reach: at={farthest.lanelet_id} position={farthest.station_m:.0f}m"
        return (missed(key, "stops", f"it does not get there before the scenario ends{within}"),)
    station = project(center, track.front_at(stands[0]))[0]
    standing_s = len(stands) * step_s
    is_long_enough = asked_s is None or abs(standing_s - asked_s) <= _AT_LENGTH_S
    return (
        achieved(key, "stop at", place.station_m, station, "m", reached=abs(station - place.station_m) <= _AT_PLACE_M),
        achieved(key, "standing time", asked_s, standing_s, "s", reached=is_long_enough),
    )


def _farthest_stop(edited: EditedScene, key: int, asked_s: float | None) -> Place | None:
    """Return the farthest place on a vehicle's written motion at which it can stop and stand before the scenario ends.

    A vehicle that brakes at its usual deceleration for a place gets there later than one that passes it, by half the
    time for which it brakes.
    """
    plan, track = edited.result.plans.get(key), edited.road_users[key]
    if plan is None:
        return None
    lanes, step_s = edited.scene.layout.table.lanes, edited.scene.step_s
    stands_s = _LEAST_STAND_S if asked_s is None else asked_s
    for index in range(len(track.speeds_mps) - 1, -1, -1):
        left_s = (len(track.speeds_mps) - 1 - index) * step_s
        late_s = float(track.speeds_mps[index]) / (2 * plan.vehicle_class.deceleration_mps2)
        if left_s < late_s + stands_s:
            continue
        front = track.front_at(index)
        for lanelet in plan.lanelets:
            station_m, lateral_m = project(lanes[lanelet].center, front)
            if 0.0 < station_m < lanes[lanelet].length_m and abs(lateral_m) < lanes[lanelet].width_m / 2:
                return Place(lanelet, station_m)
        return None
    return None


def _relative_speed(edit: Edit, scene: Scene, changes: Changes, vehicles: tuple[int, ...]) -> EditStep:
    """Have vehicles drive faster or slower, by a share or a difference, at every point of their path."""
    text, since, made = edit.speed or "", dict[int, int](), dict[int, tuple[int, float, float]]()
    for vehicle_id in vehicles:
        motion, orders = motion_of(scene, changes, vehicle_id)
        if orders:
            as_ordered = scripted_track(motion, orders, beyond(scene, motion), scene.last_step, scene.step_s)
            motion = as_ordered or motion
        plan, step = _plan_from(scene, changes, vehicle_id, edit.time_s)
        now = motion.speeds_mps[step - motion.first_step :]
        wanted = np.array([requested_speed(text, float(speed)) if speed > STANDING_MPS else 0.0 for speed in now])
        extreme_mps = float(wanted.min() if wanted.min() < 0.0 else wanted.max())
        check_speed(
            extreme_mps,
            class_of(motion.kind).maximum_speed_mps,
            f"a {motion.kind} cannot drive at {extreme_mps:.1f} m/s, as vehicle {vehicle_id} would with speed={text}",
            "give a smaller change, or the new speed itself",
        )
        profile = _by_place(now, wanted)
        order = Manoeuvre(step, speed_mps=profile[-1], profile_mps=profile)
        changes = changes.with_plan(_with_manoeuvre(plan, order))
        since[vehicle_id] = step
        made[vehicle_id] = step, float(now.sum()), float(np.sum(profile[: len(now)]))

    def measured(edited: EditedScene) -> tuple[Achieved, ...]:
        found = []
        for key, (step, _, asked) in made.items():
            track = edited.result.tracks.get(key)
            if track is None:
                continue
            speeds = track.speeds_mps[max(step - track.first_step, 0) :]
            count = min(len(speeds), len(profile_of(edited, key)))
            mean = float(speeds[:count].mean())
            wanted_mps = float(np.mean(profile_of(edited, key)[:count])) if count else asked
            is_reached = abs(mean - wanted_mps) <= _NEAR_SHARE * wanted_mps
            value = achieved(key, "mean speed", wanted_mps, mean, "m/s", reached=is_reached)
            why = "" if is_reached else why_slower_or_faster(edited, track, speeds[:count], wanted_mps)
            found.append(value.model_copy(update={"reason": why}))
        return tuple(found)

    def profile_of(edited: EditedScene, key: int) -> tuple[float, ...]:
        orders = edited.result.plans[key].manoeuvres
        return next((order.profile_mps for order in reversed(orders) if order.profile_mps), ())

    when = "" if edit.time_s is None else f" from {edit.time_s:g} s"
    drive = "set to drive"
    what = (
        f"{named_vehicles(vehicles)} {drive} {text[1:]} {'faster' if text[0] == '+' else 'slower'} than before{when}"
        if text[:1] in ("+", "-")
        else f"{named_vehicles(vehicles)} {drive} at {text} of the previous speed{when}"
    )
    return EditStep(changes, vehicles, what, since=since, measure=measured)


def _by_place(now: Values, wanted: Values) -> tuple[float, ...]:
    """Return the speeds over time of a drive that has the wanted speeds at the points of a motion's path.

    After the end of the motion the last speed is kept; if the motion stood, the drive stands as long.
    """
    speeds, place = [], 0.0
    while place < len(now) - 1:
        at = int(place)
        speeds.append(float(wanted[at]))
        place += float(wanted[at] / now[at]) if now[at] > STANDING_MPS else 1.0
    return (*speeds, float(wanted[-1]))


def shift_time(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Move the recordings of the selected vehicles in time; states outside the scenario are cut off.

    The motion itself stays as recorded, unless the vehicle would hit another one: then it is handed over to SUMO.

    Raises:
        InvalidRequest: no time is given, or it leaves nothing of a recording.
        NotPossible: a vehicle was added, is driven by an earlier edit, or has no trajectory.
    """
    steps = 0 if edit.time_s is None else round(edit.time_s / scene.step_s)
    if steps == 0:
        raise InvalidRequest(
            "shift_time needs a time_s of at least one time step",
            valid=["time_s=2", "time_s=-1.5"],
            next_step=f"give a time_s of {scene.step_s:g} or more, or of {-scene.step_s:g} or less",
        )
    vehicles = select(edit.vehicles, scene, changes)
    for vehicle_id in vehicles:
        _check(scene, changes, vehicle_id)
        before = changes.replays.get(vehicle_id)
        recording = before.recording if before and before.recording else scene.tracks[vehicle_id]
        total = steps + (before.shifted_steps if before else 0)
        track = moved_in_time(recording, total, scene)
        if track is None:
            raise _nothing_left(recording, total, scene)
        changes = changes.with_replay(Replay(track, scene.matcher.match(track), recording, total))
    how = f"{abs(steps) * scene.step_s:g} s {'later' if steps > 0 else 'earlier'}"
    drive = "drives" if len(vehicles) == 1 else "drive"
    return EditStep(changes, vehicles, f"{named_vehicles(vehicles)} {drive} {how} than recorded")


def _check(scene: Scene, changes: Changes, vehicle_id: int) -> None:
    if changes.is_added(vehicle_id):
        raise NotPossible(f"vehicle {vehicle_id} is not recorded", next_step=f"exclude it with '!{vehicle_id}'")
    if vehicle_id in changes.driven:
        raise NotPossible(
            f"vehicle {vehicle_id} no longer follows its recording",
            next_step="shift it before the edit that drives it, on the scenario without that edit",
        )
    if vehicle_id not in scene.tracks:
        raise NotPossible(
            f"obstacle {vehicle_id} has no trajectory that could be shifted in time",
            valid=nearest_ids(vehicle_id, list(scene.tracks)),
            next_step="give a moving vehicle",
        )


_SHARES_SHIFTED = (1.0, 0.5, 0.25)
"""Shares of the largest possible time shift that a refusal proposes in turn (chosen)."""


def _nothing_left(track: Track, steps: int, scene: Scene) -> InvalidRequest:
    low = (FEWEST_STATES - 1 - track.last_step) * scene.step_s
    high = (scene.last_step - FEWEST_STATES + 1 - track.first_step) * scene.step_s
    furthest = low if steps < 0 else high
    fitting = _furthest_clear(track, steps, scene)
    return InvalidRequest(
        f"a shift by {steps * scene.step_s:g} s would leave nothing of vehicle {track.obstacle_id}'s recording, which "
        f"can move by {low:g} to {high:g} s",
        valid=[f"time_s={fitting * scene.step_s:g}"] if fitting else [],
        next_step="shift it by less",
        remedies=[
            *([with_values(time_s=round(fitting * scene.step_s, 3))] if fitting else []),
            *(with_values(time_s=round(share * furthest, 3)) for share in _SHARES_SHIFTED),
        ],
    )


def _furthest_clear(track: Track, steps: int, scene: Scene) -> int:
    """Return the largest shift, in steps in the requested direction, after which a recording starts clear of all.

    The result is 0 if there is none.
    """
    sign = -1 if steps < 0 else 1
    others = [other for key, other in (scene.tracks | scene.standing).items() if key != track.obstacle_id]
    others += [] if scene.ego is None else [car_at_start(scene.ego, EGO)]
    for size in range(scene.last_step, 0, -1):
        moved = moved_in_time(track, sign * size, scene)
        if moved is not None and not new_overlaps(
            [moved.part(0, 1)], others, {track.obstacle_id: moved}, {track.obstacle_id: sign * size}
        ):
            return sign * size
    return 0


def set_behaviour(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Give the selected vehicles a preset, single parameters, or a preset with single parameters on top.

    A vehicle keeps its class, length and width. A class with its own minimum gap also keeps that gap, unless a
    parameter sets it.

    Raises:
        InvalidRequest: neither a preset nor parameters are given, or a value is out of range.
        UnknownName: there is no such preset or parameter.
    """
    if edit.preset is None and not edit.params:
        raise InvalidRequest(
            "set_behaviour needs a preset or params",
            valid=[*presets(), "params=['tau=0.7']"],
            next_step="give a preset, or set individual parameters",
        )
    vehicles, undrivable = _drivable(edit, scene, changes)
    kept: list[str] = []
    behaviours: list[Behaviour] = []
    for vehicle_id in vehicles:
        plan = plan_of(scene, changes, vehicle_id)
        own_gap_m = own_minimum_gap_m(plan.vehicle_class)
        behaviour = behaviour_from(plan.behaviour, edit.preset, edit.params, own_gap_m)
        if edit.preset and own_gap_m is not None and behaviour.values["minGap"] == own_gap_m:
            kept.append(f"{plan.vehicle_class.name} {vehicle_id} keeps its own minGap of {own_gap_m:g} m")
        changes = changes.with_plan(replace(plan, behaviour=behaviour))
        behaviours.append(behaviour)
    words = [edit.preset.strip().lower()] if edit.preset else []
    what = f"{' '.join([*words, *values_set(edit.params, behaviours)])} for {listed(vehicles)}"
    left = [f"as recorded, because edits cannot drive them: {listed(undrivable)}"] if undrivable else []
    notes = "; ".join([what, *left, *kept[:MOST_NAMED]])
    return EditStep(changes, vehicles, notes, parameters=parameters_set(edit.preset, edit.params))


def _drivable(edit: Edit, scene: Scene, changes: Changes) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the selected vehicles that can be driven and, if only whole groups were requested, those that cannot.

    Raises:
        NotPossible: a vehicle requested individually cannot be driven, or no vehicle of a group can.
    """
    vehicles = select(edit.vehicles, scene, changes)
    is_group = all(parse_selector(text).kind in ("all", "class") for text in edit.vehicles if not text.startswith("!"))
    refusals: dict[int, NotPossible] = {}
    for vehicle_id in vehicles:
        try:
            plan_of(scene, changes, vehicle_id)
        except NotPossible as refusal:
            refusals[vehicle_id] = refusal
    if refusals and (not is_group or len(refusals) == len(vehicles)):
        raise next(iter(refusals.values()))
    return tuple(key for key in vehicles if key not in refusals), tuple(refusals)


def _plan_from(
    scene: Scene, changes: Changes, vehicle_id: int, time_s: float | None, *, sends_on: bool = False
) -> tuple[DrivePlan, int]:
    """Return the plan of a vehicle that is driven from a given time at the latest, and the step of that time.

    ``time_s``: from the scenario's start; None means from the vehicle's first step. ``sends_on``: whether a vehicle
    that was added to stand starts to move.

    Raises:
        InvalidRequest: the vehicle is absent at that time.
        NotPossible: the vehicle cannot be driven.
    """
    before = changes.driven.get(vehicle_id)
    plan = plan_of(scene, changes, vehicle_id)
    plan = sent_on(plan) if sends_on else plan
    first, last = plan.from_step, scene.last_step - 1
    if vehicle_id in scene.tracks and before is None:
        last = scene.tracks[vehicle_id].last_step - 1
    step = first if time_s is None else round(time_s / scene.step_s)
    if not first <= step <= last:
        requested_s = step * scene.step_s if time_s is None else time_s
        raise InvalidRequest(
            f"vehicle {vehicle_id} is not there at {requested_s:g} s",
            valid=[f"time_s from {first * scene.step_s:g} to {last * scene.step_s:g}"],
            next_step="choose a time_s at which it is there",
            remedies=within_time(step, first, last, scene),
        )
    return replace(plan, from_step=step if before is None else min(step, before.from_step)), step


def _with_manoeuvre(plan: DrivePlan, manoeuvre: Manoeuvre) -> DrivePlan:
    """Return the plan with one more manoeuvre; manoeuvres are ordered by step, and then by when they were added."""
    manoeuvres = sorted((*plan.manoeuvres, manoeuvre), key=lambda order: order.from_step)
    return replace(plan, manoeuvres=tuple(manoeuvres))
