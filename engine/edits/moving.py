"""Edits that move or replace vehicles, make them run a red light, or close a lane for a time.

Lengths are in m, speeds in m/s; times count from the scenario's start.
"""

import math
from dataclasses import replace

import numpy as np

from ...schemas.errors import LANELETS_LISTED, VEHICLES_LISTED, InvalidRequest, NotPossible, with_values
from ...schemas.modification import Achieved, Edit
from ...schemas.text import class_noun
from ..commonroad import Track
from ..cosimulation import (
    DrivePlan,
    Manoeuvre,
    Replay,
    distances_ahead_m,
    joined_track,
    line_from,
    not_drivable,
    recorded_plan,
    resized,
    sent_on,
    usual_behaviour,
)
from ..geometry import Points, arc_length, interpolate, point_at
from ..network import Signal, station_m
from ..scene import LaneMatch, Scene
from ..vehicles import VehicleClass
from .changes import Changes, EditStep, check_speed, named_vehicles, parse_speed, plan_of, within_time
from .edited_scene import EditedScene
from .entries import OccupiedPlaces
from .placement import Place, first_place
from .population import check_allowed, resolve_class
from .references import select, select_one, target_lanelets
from .scripted import achieved, missed, motion_of

_BARRIER_M, _BARRIER_MARGIN_M = 1.0, 0.2
"""Length of the barrier that closes a lane, and the room that it leaves on either side (chosen)."""
_RED = frozenset("ru")
"""SUMO's letters of a red light, and of red and yellow."""
_SLOWEST_SHARE, _FASTEST_SHARE, _LEAST_MPS = 0.4, 1.4, 3.0
"""Range of speeds relative to its own at which a vehicle may run a light, and the lowest speed (chosen)."""
_OVER_LINE_M = 1.0
"""A front this far behind the line has crossed it; a nose over the line has not (chosen)."""
_NEAR_LINE_M = 8.0
"""A front farther behind the line crossed it earlier, or elsewhere (chosen)."""
_INTO_RED_S = 0.7
"""A vehicle that runs a light crosses the line this long after it turns red and before it turns green (chosen)."""
_SPEEDING_UP_MPS2 = 2.0
"""Assumed acceleration to another speed when the crossing time is estimated (chosen)."""


def move(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Put a vehicle elsewhere; it keeps its id, class, speeds and, if possible from there, its route.

    Raises:
        InvalidRequest: several vehicles are given, or no position is.
        NotPossible: the position is occupied, or the vehicle cannot be driven.
    """
    key = select_one(edit, scene, changes)
    base, earlier = motion_of(scene, changes, key)
    if earlier or key in changes.driven or key in changes.scripted:
        raise NotPossible(
            f"vehicle {key} no longer follows its recording",
            valid=["move it first, then apply the other edit"],
            next_step="change the order of the edits",
        )
    place = first_place(edit, scene, changes, base.length_m)
    center, heading = place.pose(scene)
    without = replace(changes, removed=changes.removed | {key})
    places = OccupiedPlaces.at(scene, base.first_step, without)
    places.check_free(place, base.size_m, "choose a free place")
    first = replace(base.part(0, 1), positions=center[None], headings_rad=np.array([heading]))
    line = line_from(scene, first.positions[0], _route_from(scene, key, place.lanelet_id))
    along = arc_length(line)
    rolled = np.concatenate([[0.0], np.cumsum(np.maximum(base.speeds_mps[:-1], 0.0) * scene.step_s)])
    centers = interpolate(line, along, rolled[rolled <= along[-1]])
    track = joined_track(first, base.first_step, centers, base.last_step, scene.step_s) if rolled[-1] > 0.0 else None
    if track is None:
        track = replace(
            base,
            positions=np.repeat(center[None], len(base.positions), axis=0),
            headings_rad=np.full(len(base.positions), heading),
        )
    before = changes.replays.get(key)
    recording = scene.tracks[key] if before is None else before.recording
    match = scene.matcher.match(track)
    changes = changes.with_replay(Replay(track, match, recording, from_step=-1))
    there = scene if match is None else _with_track(scene, track, match)
    obeys = match is not None and _crosses_at_red(there, track, match) and not not_drivable(there, key)
    if obeys:
        changes = changes.with_plan(recorded_plan(there, key, "edited", track.first_step))
    moved_m = float(np.linalg.norm(center - base.positions[0]))
    what = (
        f"vehicle {key} put on lanelet {place.lanelet_id} at {place.station_m:.1f} m, {moved_m:.1f} m from where it "
        f"was, {'driven, because it would cross a red light' if obeys else 'with its recorded speeds'}"
    )
    return EditStep(changes, (key,), what)


def _with_track(scene: Scene, track: Track, match: LaneMatch) -> Scene:
    key = track.obstacle_id
    return replace(scene, tracks=scene.tracks | {key: track}, matches=scene.matches | {key: match})


def _crosses_at_red(scene: Scene, track: Track, match: LaneMatch) -> bool:
    """Return True if a motion crosses the line of a red light."""
    lit = {key: signal for signal in scene.signals for key in signal.lanelets}
    for lanelet in lit.keys() & set(match.sequence):
        step = crossing_step(scene, track, lanelet)
        if step is not None and lit[lanelet].letter_at(step * scene.step_s) in _RED:
            return True
    return False


def _route_from(scene: Scene, key: int, lanelet_id: int) -> tuple[int, ...]:
    """Return the lanelets from a start to a vehicle's last recorded lanelet; only the start if there is no route."""
    match = scene.matches.get(key)
    if match is None:
        return (lanelet_id,)
    if lanelet_id in match.sequence:
        return match.sequence[match.sequence.index(lanelet_id) :]
    ahead = [other for other in match.sequence if other in scene.layout.table.successors[lanelet_id]]
    return (lanelet_id, *match.sequence[match.sequence.index(ahead[0]) :]) if ahead else (lanelet_id,)


def replace_vehicle(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Give vehicles a new class: they drive as before, with the type, size and limits of that class.

    Raises:
        InvalidRequest: no class is given.
        UnknownName: there is no such class.
        NotPossible: the road is closed to the class, or a vehicle cannot be driven.
    """
    vehicles, vehicle_class = select(edit.vehicles, scene, changes), resolve_class(edit.vehicle_class)
    for key in vehicles:
        plan = changes.driven.get(key)
        base, _ = motion_of(scene, changes, key) if plan is None or not plan.targets else (plan.start, ())
        match = scene.matches.get(key)
        for lanelet in () if match is None else match.sequence:
            check_allowed(vehicle_class.name, lanelet, scene)
        body = vehicle_class.commonroad_type, vehicle_class.length_m, vehicle_class.width_m
        track = resized(base, *body)
        if plan is not None and plan.cause == "added":
            changes = changes.with_plan(_of_class(replace(plan, start=resized(plan.start, *body)), vehicle_class))
            continue
        before = changes.replays.get(key)
        recording = scene.tracks[key] if before is None else before.recording
        replay = Replay(
            track,
            scene.matches.get(key),
            recording,
            0 if before is None else before.shifted_steps,
            is_scripted=before is not None and before.is_scripted,
            from_step=scene.last_step if before is None else before.from_step,
            script=None if before is None else before.script,
        )
        changes = changes.with_replay(replay)
        fastest = float(base.speeds_mps.max(initial=0.0))
        if plan is not None:
            changes = changes.with_plan(_of_class(replace(plan, start=track), vehicle_class))
        elif fastest > vehicle_class.maximum_speed_mps:
            there = replace(scene, tracks=scene.tracks | {key: track})
            changes = changes.with_plan(_of_class(recorded_plan(there, key, "edited", track.first_step), vehicle_class))
    what = f"{named_vehicles(vehicles)} is now a {class_noun(vehicle_class.name)} ({vehicle_class.length_m:g} m long)"
    return EditStep(changes, vehicles, what)


def _of_class(plan: DrivePlan, vehicle_class: VehicleClass) -> DrivePlan:
    return replace(plan, vehicle_class=vehicle_class, behaviour=usual_behaviour(vehicle_class))


def run_red_light(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Have vehicles cross the next light on their route at red: they adapt their speed and do not stop.

    They obey no lights and do not yield, but they keep their distance from the vehicle ahead.

    Raises:
        NotPossible: no light is ahead, or it is not red when a vehicle can be there.
    """
    vehicles = select(edit.vehicles, scene, changes)
    lines: dict[int, tuple[Signal, int]] = {}
    words = []
    for key in vehicles:
        plan = sent_on(plan_of(scene, changes, key))
        signal, lanelet, away_m = _next_light(scene, plan)
        index = plan.from_step - plan.start.first_step
        now_mps = float(max(plan.start.speeds_mps[index], 0.0))
        limit_mps = min(scene.lane_speeds_mps[lanelet], plan.vehicle_class.maximum_speed_mps)
        if edit.speed is None:
            speed_mps = _speed_into_red(scene, signal, plan, away_m, now_mps, limit_mps)
        else:
            speed_mps = parse_speed(edit.speed, plan.vehicle_class.maximum_speed_mps, now_mps)
            check_speed(
                speed_mps,
                plan.vehicle_class.maximum_speed_mps,
                f"a {plan.start.kind} cannot drive that fast",
                "choose a lower speed",
            )
        if speed_mps is None:
            raise NotPossible(
                f"the light of lanelet {lanelet} is not red when vehicle {key} can reach it",
                valid=["set_light with params=['red=60'] first", "another vehicle"],
                next_step="make the light red with set_light, or choose another vehicle",
                remedies=[VEHICLES_LISTED],
            )
        order = Manoeuvre(plan.from_step, speed_mps=speed_mps)
        # It stays in the lanes that lead to its light: other lanes have a different light or no light.
        kept = (
            plan.through | {*plan.lanelets[: plan.lanelets.index(lanelet) + 1]}
            if lanelet in plan.lanelets
            else plan.through
        )
        plan = replace(plan, manoeuvres=(*plan.manoeuvres, order), ignores_lights=True, through=kept)
        changes = changes.with_plan(plan)
        lines[key] = signal, lanelet
        words.append(f"{key} reaches the light of lanelet {lanelet} at {speed_mps:.1f} m/s")

    def measured(edited: EditedScene) -> tuple[Achieved, ...]:
        found = []
        for key, (signal, lanelet) in lines.items():
            track = edited.road_users.get(key)
            step = None if track is None else crossing_step(scene, track, lanelet)
            if step is None:
                why = "the stop line is not crossed before the recording ends"
                found.append(missed(key, "lines crossed", why))
            elif signal.letter_at(step * scene.step_s) in _RED:
                found.append(achieved(key, "crossing at red", None, step * scene.step_s, "s"))
            else:
                why = "the light is no longer red when the vehicle crosses"
                found.append(missed(key, "crossing", why, step * scene.step_s, "s"))
        return tuple(found)

    return EditStep(changes, vehicles, f"runs a red light: {'; '.join(words[:3])}", measure=measured)


_LIGHTS_NAMED = 8
"""Number of lanelets with lights that a refusal names (chosen)."""


def _next_light(scene: Scene, plan: DrivePlan) -> tuple[Signal, int, float]:
    """Return the first light on a vehicle's route, its lanelet, and how far ahead of the front its line is.

    Raises:
        NotPossible: there is no light ahead.
    """
    by_lanelet = {key: signal for signal in scene.signals for key in signal.lanelets}
    for key, start_m in distances_ahead_m(scene, plan).items():
        line_m = start_m + scene.layout.table.lanes[key].length_m
        if key in by_lanelet and line_m > 0.0:
            return by_lanelet[key], key, line_m
    # The lanelets behind a vehicle's first one are ahead of it; its plan may differ from its recording.
    reaching = [key for key, match in scene.matches.items() if not by_lanelet.keys().isdisjoint(match.sequence)]
    lights = ", ".join(map(str, sorted(by_lanelet)[:_LIGHTS_NAMED]))
    where = f"; lights with a cycle are at {lights}" if by_lanelet else "; no light of the scenario has a cycle"
    raise NotPossible(
        f"no traffic light with a cycle is ahead on the route of vehicle {plan.start.obstacle_id}{where}",
        valid=[f"vehicles=['{key}']" for key in sorted(reaching) if key != plan.start.obstacle_id],
        next_step=f"{'choose a vehicle that reaches a light, or ' if reaching else ''}add a light with op set_light",
    )


def _speed_into_red(
    scene: Scene, signal: Signal, plan: DrivePlan, away_m: float, now_mps: float, limit_mps: float
) -> float | None:
    """Return the speed nearest a vehicle's usual one at which it crosses the stop line at a red light, or None."""
    usual = max(now_mps, 0.6 * limit_mps, _LEAST_MPS)
    low, high = (
        max(_SLOWEST_SHARE * usual, _LEAST_MPS),
        min(_FASTEST_SHARE * usual, plan.vehicle_class.maximum_speed_mps),
    )
    begin_s = plan.from_step * scene.step_s
    left_s = (scene.last_step - plan.from_step) * scene.step_s - 1.0
    for speed in sorted(np.linspace(low, max(high, low), 41).tolist(), key=lambda speed: abs(speed - usual)):
        ramp_s = abs(speed - now_mps) / _SPEEDING_UP_MPS2
        ramp_m = (speed + now_mps) / 2 * ramp_s
        is_ramp = ramp_m > away_m
        taken_s = 2 * away_m / max(speed + now_mps, 0.1) if is_ramp else ramp_s + (away_m - ramp_m) / speed
        moments = (begin_s + taken_s - _INTO_RED_S, begin_s + taken_s, begin_s + taken_s + _INTO_RED_S)
        if taken_s < left_s and all(signal.letter_at(max(moment, 0.0)) in _RED for moment in moments):
            return float(speed)
    return None


def crossing_step(scene: Scene, track: Track, lanelet: int) -> int | None:
    """Return the step at which a vehicle's front first crosses the end of a lanelet, within its width, or None."""
    lane = scene.layout.table.lanes[lanelet]
    end, heading = point_at(lane.center, lane.length_m)
    ahead, left = np.array([math.cos(heading), math.sin(heading)]), np.array([-math.sin(heading), math.cos(heading)])
    for index in range(len(track.positions)):
        away = track.front_at(index) - end
        if _OVER_LINE_M < float(away @ ahead) < _NEAR_LINE_M and abs(float(away @ left)) < lane.width_m / 2:
            return track.first_step + index
    return None


def close_lane(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Close lanelets with a barrier across each, permanently or for a time; vehicles that would hit it react.

    Raises:
        InvalidRequest: no lanelet is given, or a time is outside the scenario.
        UnknownName: there is no such lanelet.
        NotPossible: a road user is where the barrier would be.
    """
    lanelets = sorted(target_lanelets(edit.to, scene, changes)) if edit.to else []
    if not lanelets:
        raise InvalidRequest(
            "close_lane needs lanelets",
            valid=["to=[LANELET]"],
            next_step="give them in 'to'",
            remedies=[LANELETS_LISTED],
        )
    begin = 0 if edit.time_s is None else round(edit.time_s / scene.step_s)
    last = scene.last_step if edit.duration_s is None else begin + round(edit.duration_s / scene.step_s)
    last = min(last, scene.last_step)
    if not 0 <= begin < last:
        raise InvalidRequest(
            f"a closure from {begin * scene.step_s:g} s is outside the scenario",
            valid=[f"time_s from 0 to {(scene.last_step - 1) * scene.step_s:g}"],
            next_step="choose another time",
            remedies=within_time(begin, 0, scene.last_step - 1, scene),
        )
    is_always = begin == 0 and last == scene.last_step
    added = []
    for lanelet in lanelets:
        lane = scene.layout.table.lanes[lanelet]
        place = Place(lanelet, station_m(edit.position or "middle", lanelet, lane.length_m, _BARRIER_M / 2))
        center, heading = place.pose(scene)
        size = _BARRIER_M, max(lane.width_m - 2 * _BARRIER_MARGIN_M, 1.0)
        occupant = OccupiedPlaces.at(scene, begin, changes).occupant_at(center, heading, size)
        if occupant is not None:
            raise NotPossible(
                f"lanelet {lanelet} cannot be closed at {place.station_m:.1f} m: {occupant} is there",
                valid=["another position", "a later time_s"],
                next_step="choose one of these",
                remedies=[with_values(position=word) for word in ("final", "beginning", "quarter", "three_quarter")],
            )
        track = _barrier(changes.next_id, center, heading, size, (begin, last), is_always=is_always)
        match = scene.matcher.match(track)
        changes = replace(
            changes.with_replay(Replay(track, match, None, is_scripted=True, is_parked=is_always, from_step=-1)),
            next_id=changes.next_id + 1,
        )
        added.append(track.obstacle_id)
    when = "" if is_always else f" from {begin * scene.step_s:g} to {last * scene.step_s:g} s"
    where = ", ".join(map(str, lanelets))
    what = (
        f"lanelet {where} closed{when} by barrier {', '.join(map(str, added))} (position {edit.position or 'middle'})"
    )
    return EditStep(changes, tuple(added), what, added=tuple(added))


def _barrier(
    key: int, center: Points, heading: float, size: tuple[float, float], steps: tuple[int, int], *, is_always: bool
) -> Track:
    begin, last = steps
    count = last - begin + 1
    return Track(
        obstacle_id=key,
        kind="constructionZone" if is_always else "unknown",
        length_m=size[0],
        width_m=size[1],
        first_step=begin,
        positions=np.repeat(center[None], count, axis=0),
        headings_rad=np.full(count, heading),
        speeds_mps=np.zeros(count),
    )
