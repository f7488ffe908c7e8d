"""Edits T with a prescribed motion: cut_in, swerve, wrong_way, and speeds and lane changes with prescribed values.

The motion is computed here and replayed: other road users see the vehicle and react, while it does not react to them.
The resulting values are measured on the written motion. Lengths are in m, speeds in m/s; times count from the
scenario's start.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...schemas.errors import InvalidRequest, NotPossible, with_values
from ...schemas.modification import Achieved, Edit
from ..commonroad import Track
from ..cosimulation import (
    LANE_CHANGE_S,
    NOT_DRIVABLE,
    Act,
    LateralAct,
    Replay,
    Script,
    ScriptPart,
    SpeedAct,
    Trigger,
    beyond,
    class_of,
    joined_track,
    line_from,
    not_drivable,
    scripted_track,
    smooth_step,
)
from ..geometry import Points, Values, arc_length, interpolate, point_at, project, project_all, wrap_angle
from ..scene import Scene, straightness
from ..vehicles import TIME_GAP_MPS, comfortable_mps2, hardest_braking_mps2
from .changes import (
    Changes,
    EditStep,
    adjacent_lanes,
    check_speed,
    first_step_with_lane,
    named_vehicles,
    no_such_lane,
    parse_speed,
    requested_speed,
    within_time,
)
from .edited_scene import EditedScene
from .entries import OccupiedPlaces
from .placement import first_place, held, read_trigger
from .population import resolve_class
from .references import EGO_WORDS, select, select_one

_LOOK_M = 250.0
"""A path extends at least this far beyond a motion (chosen)."""
_BACK_M = 150.0
"""A path extends this far back from the start of a motion (chosen)."""
CUT_IN_S, SWERVE_S = 3.0, 1.5
"""Default durations of a lane change, at about 1.2 m/s to the side, and of a swerve (chosen)."""
_USUAL_GAP_S = 1.0
"""The default time gap of a cut-in (chosen): below the 2 s of UN Regulation 157."""
_SWERVE_M, _SWERVE_HOLD_S = 1.0, 1.0
"""By default a swerve goes this far to the side and stays there this long (chosen)."""
_EASY_MPS2, _HARDEST_MPS2 = 2.0, 6.0
"""A cut-in starts as soon as its preparation needs at most the first; above the second it is refused."""
_NEXT_LANE_M = (1.8, 6.0)
"""Lateral distance of a vehicle in the next lane from a path (chosen): half a lane to one and a half lanes."""
_TRIED_S = 0.2
"""Start times of a cut-in are tried at this interval (chosen)."""
_VALUE_SHARE = 0.1
"""A prescribed value is reached if it differs by no more than this share (chosen)."""
_GAPS_TRIED_S = (1.0, 2.0)
"""Time gaps of a cut-in that are proposed if another one is not possible (chosen)."""
_ONCOMING_RAD = math.radians(120.0)
"""If the directions of two lanes differ by more, each is oncoming to the other (chosen)."""


def prescribed(
    scene: Scene,
    changes: Changes,
    vehicle_id: int,
    part: ScriptPart,
    *,
    dodges: bool = False,
    motion: "tuple[Track, tuple[Act, ...]] | None" = None,
) -> tuple[Changes, Track, Track]:
    """Return the changes with a vehicle's motion as prescribed by acts, and its tracks before and after.

    ``dodges``: whether it brakes in reactive traffic before it would hit the ego. ``motion``: its ``motion_of``, if the
    caller knows it.

    Raises:
        NotPossible: the vehicle cannot be driven, was rerouted by an earlier edit, or has no motion left.
    """
    base, earlier = motion or motion_of(scene, changes, vehicle_id)
    ahead = beyond(scene, base)
    track = scripted_track(base, (*earlier, *part.acts), ahead, scene.last_step, scene.step_s)
    if track is None:
        raise NotPossible(
            f"the scenario ends before vehicle {vehicle_id} could change its motion",
            valid=[f"time_s up to {max(base.last_step - 5, base.first_step) * scene.step_s:g}"],
            next_step="choose an earlier time_s",
            remedies=within_time(scene.last_step, base.first_step, base.last_step - 5, scene),
        )
    first = min(act.from_step for act in (*earlier, *part.acts))
    before = changes.replays.get(vehicle_id)
    script = None if before is None else before.script
    if script is None and (dodges or part.trigger is not None):
        script = Script(scripted_track(base, earlier, ahead, scene.last_step, scene.step_s) or base)
    if script is not None:
        script = Script(script.base, (*script.parts, part), script.dodges or dodges)
    depends = script is not None and script.depends_on_ego
    return with_motion(scene, changes, vehicle_id, track, first, script if depends else None), base, track


def with_motion(
    scene: Scene, changes: Changes, vehicle_id: int, track: Track, from_step: int, script: Script | None = None
) -> Changes:
    """Return the changes with a prescribed motion of a vehicle that differs from its recording after ``from_step``."""
    before = changes.replays.get(vehicle_id)
    recording = None if changes.is_added(vehicle_id) else scene.tracks[vehicle_id]
    if before is not None:
        recording = before.recording
        from_step = -1 if before.shifted_steps else min(from_step, before.from_step or from_step)
    match = scene.matcher.match(track)
    return changes.with_replay(Replay(track, match, recording, is_scripted=True, from_step=from_step, script=script))


def motion_of(scene: Scene, changes: Changes, vehicle_id: int) -> tuple[Track, tuple[Act, ...]]:
    """Return the motion of a vehicle after earlier edits, and the acts that those edits order in addition.

    Raises:
        NotPossible: the vehicle cannot be driven, or an earlier edit reroutes it.
    """
    plan = changes.driven.get(vehicle_id)
    if plan is None:
        why = not_drivable(scene, vehicle_id)
        if why and vehicle_id not in changes.scripted:
            raise NotPossible(why, next_step="choose a vehicle that can be driven", reason=NOT_DRIVABLE)
        return scene.tracks[vehicle_id], ()
    if plan.targets and plan.cause != "added":
        raise NotPossible(
            f"vehicle {vehicle_id} was rerouted by an earlier edit, so its motion is not known yet",
            valid=["the two edits in two calls", "this edit without the reroute"],
            next_step="remove one of the two",
        )
    base = plan.start if plan.cause != "added" else _rolling(scene, plan.start, plan.lanelets)
    acts: list[Act] = []
    for order in plan.manoeuvres:
        if order.speed_mps is not None:
            rate = comfortable_mps2(scene.friction)
            acts.append(SpeedAct(max(order.from_step, plan.from_step), order.speed_mps, rate))
        else:
            width = scene.layout.table.lanes[plan.lanelets[0]].width_m
            acts.append(LateralAct(order.from_step, order.lanes_left * width, LANE_CHANGE_S))
    return base, tuple(acts)


def _rolling(scene: Scene, start: Track, lanelets: tuple[int, ...]) -> Track:
    """Return the track of a vehicle that enters and continues at its speed along lanelets, then straight ahead."""
    line = line_from(scene, start.positions[0], lanelets)
    along = arc_length(line)
    count = scene.last_step - start.first_step + 1
    stations = np.arange(count) * scene.step_s * float(start.speeds_mps[0])
    centers = interpolate(line, along, stations[stations <= along[-1]])
    if float(start.speeds_mps[0]) <= 0.0:
        return _standing(start, count)
    one = replace(
        start, positions=start.positions[:1], headings_rad=start.headings_rad[:1], speeds_mps=start.speeds_mps[:1]
    )
    return joined_track(one, start.first_step, centers, scene.last_step, scene.step_s) or one


def _standing(start: Track, count: int) -> Track:
    return replace(
        start,
        positions=np.repeat(start.positions[:1], count, axis=0),
        headings_rad=np.repeat(start.headings_rad[:1], count),
        speeds_mps=np.zeros(count),
    )


def _behind(scene: Scene, point: Points, lanelet_id: int) -> Points:
    """Return the path (n, 2) that leads to a point on a lanelet, without the point itself."""
    table = scene.layout.table
    chain, total = [lanelet_id], project(table.lanes[lanelet_id].center, point)[0]
    while total < _BACK_M:
        before = [key for key in table.predecessors[chain[0]] if key not in chain]
        if not before:
            break
        own = table.lanes[chain[0]].center
        chain.insert(0, max(before, key=lambda key: (straightness(table.lanes[key].center, own), -key)))
        total += table.lanes[chain[0]].length_m
    middle = np.concatenate([table.lanes[key].center for key in chain])
    along = arc_length(middle)
    here = project(middle, point)[0]
    points: Points = interpolate(middle, along, np.arange(max(here - _BACK_M, 0.0), max(here - 1.0, 0.0), 1.0))
    return points


@dataclass(frozen=True)
class _Path:
    """The path of a road user's centre: its line (n, 2) with arc lengths, and its station at every state."""

    line: Points
    along: Values
    stations: Values

    @classmethod
    def of(cls, scene: Scene, track: Track, ahead: Points | None = None) -> "_Path":
        """Return the path of a track, extended at both ends."""
        match = scene.matcher.match(track)
        back = np.zeros((0, 2)) if match is None else _behind(scene, track.positions[0], match.at(0))
        line = _thinned(np.concatenate([back, track.positions, beyond(scene, track) if ahead is None else ahead]))
        stations, _ = project_all(line, track.positions)
        return cls(line, arc_length(line), np.maximum.accumulate(stations))


def _thinned(points: Points) -> Points:
    """Drop points of a path that are less than half a metre from the previous point."""
    kept = [points[0]]
    for point in points[1:]:
        if float(np.linalg.norm(point - kept[-1])) >= 0.5:
            kept.append(point)
    if len(kept) < 2:
        kept.append(kept[0] + np.array([1.0, 0.0]))
    return np.array(kept)


def _begin_of(edit: Edit, scene: Scene, changes: Changes, track: Track) -> tuple[int, Trigger | None]:
    """Return the step at which an edit starts, and its trigger.

    The edit starts at its time, when its trigger holds for SUMO's ego, or at the first step at which ego and
    vehicle are present.

    Raises:
        InvalidRequest: the vehicle is absent at that time, or there is no such trigger.
        NotPossible: the trigger never holds.
    """
    if edit.when is not None:
        return _triggered(edit, scene, changes, track)
    begin = max(track.first_step, scene.ego.step if scene.ego else 0)
    step = begin if edit.time_s is None else round(edit.time_s / scene.step_s)
    last = track.last_step - 2
    if not track.first_step <= step <= last:
        raise InvalidRequest(
            f"vehicle {track.obstacle_id} is not there at {step * scene.step_s:g} s",
            valid=[f"time_s from {track.first_step * scene.step_s:g} to {max(last, 0) * scene.step_s:g}"],
            next_step="choose a time_s at which it is there",
            remedies=within_time(step, begin, last, scene),
        )
    return step, None


def _since(edit: Edit, made: Mapping[int, tuple[int, float, Track]], scene: Scene) -> str:
    """Return when an edit starts, as the end of a sentence; ``made`` contains its start steps."""
    if edit.when is not None:
        steps = [step for step, _, _ in made.values()]
        times = ", ".join(f"{step * scene.step_s:.1f} s" for step in steps[:3])
        egos = f"here at {times} for an ego that SUMO drives; in reactive runs for the planner's ego"
        return f" once {edit.when} holds{held(max(steps), scene) or f' ({egos})'}"
    return "" if edit.time_s is None else f" from {edit.time_s:g} s"


def _triggered(edit: Edit, scene: Scene, changes: Changes, track: Track) -> tuple[int, Trigger]:
    """Return the step at which the trigger of an edit holds for an ego that SUMO drives, and the trigger.

    Raises:
        InvalidRequest: a time is also given, or there is no such trigger.
        NotPossible: the trigger never holds while the vehicle is in the scenario.
    """
    if edit.time_s is not None:
        raise InvalidRequest(
            "when and time_s both set the start", valid=["when", "time_s"], next_step="give one of them"
        )

    def place_at(step: int) -> Points | None:
        index = track.index_at(step)
        return None if index is None else track.positions[index]

    trigger, step = read_trigger(edit.when or "", scene, changes, place_at)
    if not track.first_step <= step <= track.last_step - 2:
        raise NotPossible(
            f"vehicle {track.obstacle_id} is gone when the trigger holds, at {step * scene.step_s:.1f} s",
            valid=["another trigger", "time_s"],
            next_step="choose one of these",
            remedies=[with_values(when=None, time_s=round(track.first_step * scene.step_s, 3))],
        )
    return step, trigger


def scripted_speed(edit: Edit, scene: Scene, changes: Changes, vehicles: Iterable[int]) -> EditStep:
    """Bring vehicles to a speed with a prescribed acceleration, whatever is ahead of them."""
    vehicles = tuple(vehicles)
    rate = comfortable_mps2(scene.friction) if edit.rate_mps2 is None else edit.rate_mps2
    hardest = hardest_braking_mps2(scene.friction)
    if rate > hardest:
        on_road = "" if scene.friction is None else f" on a road with a friction of {scene.friction:g}"
        raise InvalidRequest(
            f"no vehicle can accelerate or brake at {rate:g} m/s²{on_road}",
            valid=[f"0 to {hardest:g} m/s²"],
            next_step="choose a smaller rate_mps2",
            remedies=[with_values(rate_mps2=hardest)],
        )
    made: dict[int, tuple[int, float, Track]] = {}
    for vehicle_id in vehicles:
        motion = motion_of(scene, changes, vehicle_id)
        base = motion[0]
        step, trigger = _begin_of(edit, scene, changes, base)
        now_mps = float(base.speeds_mps[step - base.first_step])
        wanted = requested_speed(edit.speed or "", now_mps)
        check_speed(
            wanted, class_of(base.kind).maximum_speed_mps, f"a {base.kind} cannot drive at {edit.speed}", "go slower"
        )
        part = ScriptPart(step, (SpeedAct(step, wanted, rate),), trigger)
        changes, _, track = prescribed(scene, changes, vehicle_id, part, dodges=bool(edit.dodge), motion=motion)
        made[vehicle_id] = step, wanted, track

    def measured(edited: EditedScene) -> tuple[Achieved, ...]:
        found = []
        for key, (step, wanted, track) in made.items():
            final = edited.changes.replays[key].track if key in edited.changes.replays else track
            speeds = final.speeds_mps[step - final.first_step :]
            closest = float(speeds[int(np.argmin(np.abs(speeds - wanted)))])
            within = round(1.0 / scene.step_s)
            change = np.abs(speeds[within:] - speeds[:-within]) if len(speeds) > within else np.zeros(1)
            quantity = "deceleration" if wanted < float(speeds[0]) else "acceleration"
            found.append(achieved(key, "speed", wanted, closest, "m/s", reached=abs(closest - wanted) <= 0.3))
            total = abs(float(speeds[0]) - wanted)
            if edit.rate_mps2 is not None and total > 1.5 * rate:
                found.append(achieved(key, quantity, rate, float(change.max()), "m/s²"))
        return tuple(found)

    when = _since(edit, made, scene)
    speed = ", ".join(f"{round(wanted, 1):g} m/s" for _, wanted, _ in list(made.values())[:3])
    what = f"{named_vehicles(vehicles)} brought to {speed} at a prescribed {rate:g} m/s²{when}"
    return EditStep(changes, vehicles, what, measure=measured)


def achieved(
    key: int, quantity: str, asked: float | None, value: float, unit: str, *, reached: bool | None = None
) -> Achieved:
    """Return a measured value with the requested value, which counts as reached within a tenth by default."""
    if reached is None:
        reached = asked is None or abs(value - asked) <= _VALUE_SHARE * max(abs(asked), 0.5)
    rounded = None if asked is None else round(asked, 3)
    return Achieved(vehicle_id=key, quantity=quantity, asked=rounded, value=round(value, 3), unit=unit, reached=reached)


def missed(key: int, quantity: str, reason: str, value: float = 0.0, unit: str = "") -> Achieved:
    """Return the result for a requested motion that did not happen, with the reason, such as "it is too late"."""
    return Achieved(
        vehicle_id=key, quantity=quantity, value=round(value, 3), unit=unit, reached=False, reason=f"not done: {reason}"
    )


def scripted_lane_change(edit: Edit, scene: Scene, changes: Changes, vehicles: Iterable[int]) -> EditStep:
    """Move vehicles to the next lane in a prescribed time, even if that lane is occupied."""
    vehicles, duration_s = tuple(vehicles), CUT_IN_S if edit.lateral_s is None else edit.lateral_s
    made: dict[int, tuple[int, float, Track]] = {}
    for vehicle_id in vehicles:
        motion = motion_of(scene, changes, vehicle_id)
        base = motion[0]
        step, trigger = _begin_of(edit, scene, changes, base)
        aside_m = _aside_to_lane(scene, base, step, str(edit.lane))
        part = ScriptPart(step, (LateralAct(step, aside_m, duration_s),), trigger)
        changes, before, _ = prescribed(scene, changes, vehicle_id, part, dodges=bool(edit.dodge), motion=motion)
        made[vehicle_id] = step, aside_m, before
    when = _since(edit, made, scene)
    what = f"{named_vehicles(vehicles)} moved one lane to the {edit.lane} within a prescribed {duration_s:g} s{when}"
    return EditStep(changes, vehicles, what, measure=lambda edited: _asides(edited, made))


def _asides(edited: EditedScene, made: dict[int, tuple[int, float, Track]]) -> tuple[Achieved, ...]:
    """Measure how far vehicles moved to the side relative to their earlier motion."""
    found = []
    for key, (step, aside_m, before) in made.items():
        if key not in edited.changes.replays:
            continue
        track = edited.changes.replays[key].track
        reached_m = _largest_aside(before, track, step, aside_m)
        found.append(achieved(key, "lateral_shift", abs(aside_m), reached_m, "m"))
    return tuple(found)


def _largest_aside(before: Track, track: Track, step: int, aside_m: float) -> float:
    """Return the largest lateral distance of a motion from an earlier one after a step, on the intended side."""
    line = _thinned(before.positions)
    ahead = track.positions[step - track.first_step :]
    offsets = project_all(line, ahead)[1]
    return float((offsets * math.copysign(1.0, aside_m)).max())


def _aside_to_lane(scene: Scene, track: Track, step: int, side: str) -> float:
    """Return how far a vehicle has to move to the centre of the next lane; left is positive.

    Raises:
        NotPossible: there is no lane in the vehicle's direction on that side.
    """
    match, index = scene.matcher.match(track), step - track.first_step
    here = None if match is None else match.at(index)
    adjacent = [] if here is None else adjacent_lanes(scene, [here], side)
    if not adjacent:
        keys = [] if match is None else match.at_each(len(track.positions))
        first = first_step_with_lane(scene, track, keys, side)
        raise no_such_lane(scene, track.obstacle_id, here, side, first)
    return -project(scene.layout.table.lanes[adjacent[0]].center, track.positions[index])[1]


def swerve(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Move vehicles to the side and back again, in prescribed times.

    Raises:
        InvalidRequest: the vehicles are absent at that time.
        NotPossible: the vehicles cannot be driven.
    """
    vehicles = select(edit.vehicles, scene, changes)
    far_m = _SWERVE_M if edit.offset_m is None else abs(edit.offset_m)
    aside_m = far_m * (-1.0 if edit.side == "right" else 1.0)
    duration_s = SWERVE_S if edit.lateral_s is None else edit.lateral_s
    hold_s = _SWERVE_HOLD_S if edit.duration_s is None else edit.duration_s
    made: dict[int, tuple[int, float, Track]] = {}
    for vehicle_id in vehicles:
        motion = motion_of(scene, changes, vehicle_id)
        base = motion[0]
        step, trigger = _begin_of(edit, scene, changes, base)
        back = step + round((duration_s + hold_s) / scene.step_s)
        acts = LateralAct(step, aside_m, duration_s), LateralAct(back, -aside_m, duration_s)
        part = ScriptPart(step, acts, trigger)
        changes, before, _ = prescribed(scene, changes, vehicle_id, part, dodges=bool(edit.dodge), motion=motion)
        made[vehicle_id] = step, aside_m, before
    side = "right" if edit.side == "right" else "left"
    when = _since(edit, made, scene)
    what = (
        f"{named_vehicles(vehicles)} {_verb('swerve', vehicles)} {far_m:g} m to the {side}{when} (over "
        f"{duration_s:g} s), {_verb('stay', vehicles)} there "
        f"{hold_s:g} s and {_verb('return', vehicles)}"
    )
    return EditStep(changes, vehicles, what, measure=lambda edited: _asides(edited, made))


@dataclass(frozen=True)
class _CutIn:
    """A cut-in: stations on the other vehicle's path after step ``first``, and the step at which it is complete."""

    first: int
    last: int
    stations: Values
    hardest_mps2: float


def cut_in(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Have a vehicle in the next lane cut in ahead of the ego, or of another vehicle, with a time gap.

    The vehicle takes on the speed of the vehicle that it cuts off, or the given speed, and moves over in the prescribed
    time. The gap applies at the end of the move. The ego is assumed to drive like an ordinary driver.

    Raises:
        InvalidRequest: several vehicles are given, or the vehicle is not there at that time.
        NotPossible: it is not in the next lane, or cannot reach that gap.
    """
    key = select_one(edit, scene, changes)
    other, who = _cut_off(edit, scene, changes)
    base, earlier = motion_of(scene, changes, key)
    if earlier:
        base = scripted_track(base, earlier, beyond(scene, base), scene.last_step, scene.step_s) or base
    gap_s, lateral_s = _USUAL_GAP_S if edit.gap_s is None else edit.gap_s, edit.lateral_s or CUT_IN_S
    first = max(base.first_step, other.first_step, scene.ego.step if scene.ego else 0)
    path, own = _Path.of(scene, other), _Path.of(scene, base)
    _check_next_lane(scene, base, path, first, who, other)
    found = _cut_in_motion(edit, scene, base, other, path, first, gap_s, lateral_s, who)
    over = round(lateral_s / scene.step_s)
    share = smooth_step((np.arange(len(found.stations)) - (found.last - over - found.first)) / over)
    there = interpolate(path.line, path.along, found.stations)
    kept = interpolate(own.line, own.along, project_all(own.line, there)[0])
    centers = kept * (1.0 - share)[:, None] + there * share[:, None]
    track = joined_track(base, found.first, centers, scene.last_step, scene.step_s)
    if track is None:
        raise NotPossible(f"the scenario ends before vehicle {key} could cut in", next_step="choose an earlier time_s")
    script = Script(track, dodges=True) if edit.dodge else None
    changes = with_motion(scene, changes, key, track, found.first, script)

    def measured(edited: EditedScene) -> tuple[Achieved, ...]:
        return _cut_in_achieved(edited, key, other, path, found, gap_s)

    moment_s = found.last * scene.step_s
    what = f"vehicle {key} cuts in ahead of {who}, moving over from {moment_s - lateral_s:.1f} to {moment_s:.1f} s"
    return EditStep(changes, (key,), what, measure=measured)


def _cut_off(edit: Edit, scene: Scene, changes: Changes) -> tuple[Track, str]:
    """Return the motion and the name of the road user that the vehicle cuts off."""
    text = (edit.at or "ego").strip()
    if text.lower() in EGO_WORDS:
        drive = changes.ego_drive()
        if drive is None:
            raise NotPossible("the scenario has no driving ego", next_step="give a vehicle in 'at'")
        return drive, "the ego"
    others = select([text.removeprefix("vehicle:")], scene, changes)
    if len(others) != 1:
        raise NotPossible(f"'{text}' matches {len(others)} vehicles", valid=others, next_step="give one by its id")
    base, earlier = motion_of(scene, changes, others[0])
    track = scripted_track(base, earlier, beyond(scene, base), scene.last_step, scene.step_s) if earlier else base
    return track or base, f"vehicle {others[0]}"


def _check_next_lane(scene: Scene, base: Track, path: _Path, first: int, who: str, other: Track) -> None:
    """Refuse a vehicle that is not in the lane next to the path of the other road user.

    Raises:
        NotPossible: the vehicle is not in that lane; the message states where it is.
    """
    index = first - base.first_step
    if not 0 <= index < len(base.positions):
        raise NotPossible(
            f"vehicle {base.obstacle_id} and {who} are not there at the same time", next_step="choose another vehicle"
        )
    station, aside = project(path.line, base.positions[index])
    along = point_at(path.line, station)[1]
    turned = abs(wrap_angle(float(base.headings_rad[index]) - along))
    low, high = _NEXT_LANE_M
    if low <= abs(aside) <= high and turned < math.radians(45.0):
        return
    where = "heads elsewhere" if turned >= math.radians(45.0) else f"is {_from_path(aside, who)}"
    fitting = [
        key for key in scene.tracks if key != base.obstacle_id and _is_in_next_lane(scene.tracks[key], path, first)
    ]
    sides = _next_lanes(scene, other, first)
    added = [f"add_vehicle at={_name_of(who)} lane={side}, then vehicles=new:0" for side in sides]
    none_next = "" if fitting or sides else f"; {who} has no lane next to it in its direction at that time"
    raise NotPossible(
        f"vehicle {base.obstacle_id} cannot cut in on {who}, because it is not in the next lane: it {where}{none_next}",
        valid=[f"vehicles=['{key}']" for key in fitting] or added,
        next_step="choose a vehicle in the next lane, or add one there"
        if fitting or sides
        else f"use a scenario in which {who} has a lane next to it",
    )


def _name_of(who: str) -> str:
    """Return a road user as an edit names it: ``ego`` for *the ego*, otherwise its id."""
    return who.rpartition(" ")[2]


def _next_lanes(scene: Scene, track: Track, step: int) -> list[str]:
    """Return the sides on which a road user has a lane in its direction at a step."""
    match = scene.matcher.match(track)
    here = [] if match is None else [match.at(max(step - track.first_step, 0))]
    return [side for side in ("left", "right") if adjacent_lanes(scene, here, side)]


def _is_in_next_lane(track: Track, path: _Path, step: int) -> bool:
    index = track.index_at(step)
    if index is None:
        return False
    station, aside = project(path.line, track.positions[index])
    turned = abs(wrap_angle(float(track.headings_rad[index]) - point_at(path.line, station)[1]))
    return _NEXT_LANE_M[0] <= abs(aside) <= _NEXT_LANE_M[1] and turned < math.radians(45.0)


def _cut_in_motion(
    edit: Edit,
    scene: Scene,
    base: Track,
    other: Track,
    path: _Path,
    first: int,
    gap_s: float,
    lateral_s: float,
    who: str,
) -> _CutIn:
    """Find the motion along the other vehicle's path that ends with the gap: the earliest gentle motion, else the
    gentlest.

    While the vehicle prepares, its acceleration changes linearly in time, so it reaches the right position and speed at
    the end.

    Raises:
        NotPossible: no time is possible, or the given time is not.
    """
    step_s, index = scene.step_s, first - base.first_step
    x0, v0 = project(path.line, base.positions[index])[0], float(max(base.speeds_mps[index], 0.0))
    over = round(lateral_s / step_s)
    last = min(scene.last_step - 1, other.last_step)
    if edit.time_s is not None:
        ends: Sequence[int] = [round(edit.time_s / step_s) + over]
    else:
        ends = range(first + over, last + 1, max(round(_TRIED_S / step_s), 1))
    best: _CutIn | None = None
    for end in ends:
        if not first + over <= end <= last:
            continue
        made = _prepared(edit, scene, base, other, path, first, end, gap_s, x0, v0)
        if made is None:
            continue
        if made.hardest_mps2 <= _EASY_MPS2:
            return made
        if best is None or made.hardest_mps2 < best.hardest_mps2:
            best = made
    if best is None or best.hardest_mps2 > min(_HARDEST_MPS2, hardest_braking_mps2(scene.friction)):
        what = "exceeds its acceleration and braking" if best else "is not possible before the end"
        raise NotPossible(
            f"a cut-in of vehicle {base.obstacle_id} ahead of {who} with a gap of {gap_s:g} s {what}",
            valid=[*(["without time_s"] if edit.time_s is not None else []), "a larger gap_s", "another vehicle"],
            next_step="choose one of these",
            remedies=[
                *([with_values(time_s=None)] if edit.time_s is not None else []),
                *(with_values(gap_s=gap) for gap in _GAPS_TRIED_S if gap != gap_s),
            ],
        )
    return best


def _prepared(
    edit: Edit,
    scene: Scene,
    base: Track,
    other: Track,
    path: _Path,
    first: int,
    end: int,
    gap_s: float,
    x0: float,
    v0: float,
) -> _CutIn | None:
    step_s, at = scene.step_s, end - other.first_step
    other_mps = float(other.speeds_mps[at])
    final_mps = other_mps if edit.speed is None else requested_speed(edit.speed, other_mps)
    goal = float(path.stations[at]) + gap_s * other_mps + (base.length_m + other.length_m) / 2
    taken_s = (end - first) * step_s
    distance = goal - x0
    begin_mps2 = 6 * distance / taken_s**2 - (4 * v0 + 2 * final_mps) / taken_s
    end_mps2 = -6 * distance / taken_s**2 + (2 * v0 + 4 * final_mps) / taken_s
    times = np.arange(end - first + 1) * step_s
    slope = (end_mps2 - begin_mps2) / taken_s
    speeds = v0 + begin_mps2 * times + slope * times**2 / 2
    if speeds.min() < 0.0:
        return None
    stations = x0 + v0 * times + begin_mps2 * times**2 / 2 + slope * times**3 / 6
    later = np.arange(1, scene.last_step - end + 1) * step_s * final_mps + goal
    whole = np.concatenate([stations, later])
    whole = whole[whole <= path.along[-1]]
    if len(whole) <= end - first:
        return None
    return _CutIn(first, end, whole, max(abs(begin_mps2), abs(end_mps2)))


def _cut_in_achieved(
    edited: EditedScene, key: int, other: Track, path: _Path, found: _CutIn, gap_s: float
) -> tuple[Achieved, ...]:
    """Measure the gap at the end of the move, in s and in m, on the written motions."""
    replay = edited.changes.replays.get(key)
    if replay is None:
        return ()
    track = replay.track
    target = edited.road_users.get(other.obstacle_id, other)
    at, mine = target.index_at(found.last), track.index_at(found.last)
    if at is None or mine is None:
        return ()
    ahead = project(path.line, track.positions[mine])[0] - project(path.line, target.positions[at])[0]
    gap_m = ahead - (track.length_m + target.length_m) / 2
    speed = float(target.speeds_mps[at])
    if speed <= TIME_GAP_MPS:  # a standing vehicle has no time gap, so the request is not fulfilled
        why = "the vehicle behind it has stopped by then, so there is no time gap"
        return (missed(key, "gap to a standing vehicle", why, gap_m, "m"),)
    in_s = achieved(key, "gap", gap_s, gap_m / speed, "s", reached=abs(gap_m / speed - gap_s) <= 0.1)
    return (in_s, achieved(key, "gap", None, gap_m, "m"))


def wrong_way(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    """Have vehicles drive in the oncoming lane, or add one that drives against the direction of a lane.

    Raises:
        InvalidRequest: neither vehicles nor a place is given, or both are.
        NotPossible: there is no oncoming lane, the place is occupied, or a vehicle cannot be driven.
    """
    if bool(edit.vehicles) == (edit.at is not None):
        raise InvalidRequest(
            "wrong_way takes either vehicles, which move to the oncoming lane, or a place in 'at' for a new one",
            valid=["vehicles=['12']", "at=LANELET"],
            next_step="give one of the two",
        )
    return _added_wrong_way(edit, scene, changes) if edit.at is not None else _sent_wrong_way(edit, scene, changes)


_OF_ADDED = ("vehicle_class", "lane", "offset_m", "position", "speed")
"""Arguments of wrong_way for an added vehicle only."""


def _sent_wrong_way(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    foreign = [name for name in _OF_ADDED if name in edit.given]
    if foreign:
        raise InvalidRequest(
            f"{' and '.join(foreign)} {'applies' if len(foreign) == 1 else 'apply'} to a vehicle that wrong_way adds, "
            "not to existing vehicles",
            valid=["vehicles", "time_s", "when", "lateral_s", "dodge"],
            next_step=f"remove {' and '.join(foreign)}; set_speed in a further edit changes the speed",
            remedies=[with_values(**dict.fromkeys(foreign))],
        )
    vehicles, duration_s = select(edit.vehicles, scene, changes), edit.lateral_s or CUT_IN_S
    made: dict[int, tuple[int, float, Track]] = {}
    for vehicle_id in vehicles:
        motion = motion_of(scene, changes, vehicle_id)
        base = motion[0]
        step, trigger = _begin_of(edit, scene, changes, base)
        aside_m = _aside_to_oncoming(scene, base, step)
        part = ScriptPart(step, (LateralAct(step, aside_m, duration_s),), trigger)
        changes, before, _ = prescribed(scene, changes, vehicle_id, part, dodges=bool(edit.dodge), motion=motion)
        made[vehicle_id] = step, aside_m, before
    when = _since(edit, made, scene)
    moves, stays = _verb("move", vehicles), _verb("stay", vehicles)
    what = f"{named_vehicles(vehicles)} {moves} to the oncoming lane over {duration_s:g} s and {stays} there{when}"
    return EditStep(changes, vehicles, what, measure=lambda edited: _asides(edited, made))


def _from_path(aside_m: float, who: str) -> str:
    """Return the distance from another road user's path as text; a distance below 0.5 m counts as in its lane."""
    return f"{abs(aside_m):.1f} m from the path of {who}" if abs(aside_m) >= 0.5 else f"in the lane of {who}"


def _verb(word: str, vehicles: Sequence[int]) -> str:
    """Return a regular verb in the form that the number of vehicles needs."""
    return word if len(vehicles) > 1 else f"{word}s"


def _aside_to_oncoming(scene: Scene, track: Track, step: int) -> float:
    """Return how far a vehicle has to move to the centre of the nearest oncoming lane; left is positive.

    Raises:
        NotPossible: no oncoming lane is near.
    """
    index = step - track.first_step
    place, heading = track.positions[index], float(track.headings_rad[index])
    found = []
    for key, lane in scene.layout.table.lanes.items():
        station, aside = project(lane.center, place)
        against = abs(wrap_angle(point_at(lane.center, station)[1] - heading)) > _ONCOMING_RAD
        if against and 1.0 < abs(aside) < 12.0 and 0.0 < station < lane.length_m:
            found.append((abs(aside), key, aside))
    if not found:
        raise NotPossible(
            f"vehicle {track.obstacle_id} has no oncoming lane next to it at {step * scene.step_s:g} s",
            valid=["at=LANELET (adds a vehicle that drives the wrong way there)", "another time_s"],
            next_step="choose one of these",
            remedies=[with_values(vehicles=None, at=str(scene.matches[track.obstacle_id].at(index)))]
            if track.obstacle_id in scene.matches
            else [],
        )
    # The oncoming lane runs the other way, so the vehicle's offset from it has the sign of its offset from the vehicle.
    return min(found)[2]


def _added_wrong_way(edit: Edit, scene: Scene, changes: Changes) -> EditStep:
    vehicle_class = resolve_class(edit.vehicle_class or "car")
    place = first_place(edit, scene, changes, vehicle_class.length_m)
    table = scene.layout.table
    usual_mps, largest_mps = scene.lane_speeds_mps[place.lanelet_id] * 0.8, vehicle_class.maximum_speed_mps
    speed = usual_mps if edit.speed is None else parse_speed(edit.speed, largest_mps)
    check_speed(speed, largest_mps, f"a {vehicle_class.name} cannot drive at {edit.speed}", "choose a lower speed")
    chain = [place.lanelet_id]
    while sum(table.lanes[key].length_m for key in chain) < _LOOK_M:
        before = [key for key in table.predecessors[chain[-1]] if key not in chain]
        if not before:
            break
        own = table.lanes[chain[-1]].center
        chain.append(max(before, key=lambda key: (straightness(table.lanes[key].center, own), -key)))
    center, heading = place.pose(scene)
    line = np.concatenate([table.lanes[key].center[::-1] for key in chain])
    along = arc_length(line)
    step = 0 if edit.time_s is None else round(edit.time_s / scene.step_s)
    step = max(step, scene.ego.step if scene.ego and edit.time_s is None else 0)
    start = Track(
        obstacle_id=changes.next_id,
        kind=vehicle_class.commonroad_type,
        length_m=vehicle_class.length_m,
        width_m=vehicle_class.width_m,
        first_step=step,
        positions=center[None],
        headings_rad=np.array([wrap_angle(heading + math.pi)]),
        speeds_mps=np.array([speed]),
    )
    places = OccupiedPlaces.at(scene, step, changes)
    places.check_free(place, (vehicle_class.length_m, vehicle_class.width_m), "choose a free place")
    stations = project(line, start.positions[0])[0] + np.arange(scene.last_step - step + 1) * scene.step_s * speed
    centers = interpolate(line, along, stations[stations <= along[-1]])
    track = joined_track(start, step, centers, scene.last_step, scene.step_s) if speed > 0.0 else start
    if track is None:
        raise NotPossible("the scenario ends before it could drive", next_step="choose an earlier time_s")
    key = changes.next_id
    script = Script(track, dodges=True) if edit.dodge else None
    replay = Replay(track, scene.matcher.match(track), None, is_scripted=True, from_step=-1, script=script)
    changes = replace(changes.with_replay(replay), next_id=key + 1)
    what = (
        f"{vehicle_class.name} {key} drives the wrong way along lanelet {place.lanelet_id} from "
        f"{place.station_m:.1f} m at {speed:.1f} m/s, from {step * scene.step_s:.1f} s"
    )
    return EditStep(changes, (key,), what, added=(key,))
