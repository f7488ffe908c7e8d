"""Re-simulation in rounds: who would run into an edited vehicle is handed over too, in time to react."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..commonroad import Track
from ..cosimulation import (
    Actor,
    DrivenTrack,
    DrivePlan,
    Halt,
    SimulationSetup,
    TakenOverTrack,
    all_actors,
    drivable_ids,
    front_of,
    not_drivable,
    recorded_plan,
    resimulate,
    taken_over_track,
)
from ..geometry import Points, Values, arc_length, oriented_rectangle, project, rectangles_overlap
from ..scene import Scene
from ..vehicles import HARDEST_BRAKING_MPS2
from .changes import Changes

# ---------- collisions
# Collisions that edits bring about: overlaps of touched vehicles that are not in the recording.

TOUCH_M = 0.05
"""Bodies that overlap by less are not colliding: recorded positions are not better than that."""
NEAR_STEPS = 10
"""An overlap that begins so soon before or after a recorded one of the same two is the recorded one."""


@dataclass(frozen=True)
class Body:
    """A moving rectangle: centres (n, 2) and headings (n,) from ``first_step`` on, length and width in m.

    ``shifted_steps``: how much later than recorded it moves, of a recording moved in time.
    """

    key: int
    first_step: int
    positions: Points
    headings_rad: Values
    size_m: tuple[float, float]
    shifted_steps: int = 0


@dataclass(frozen=True)
class Overlap:
    """The step from which on two bodies overlap; ``first`` is a touched one."""

    first: int
    second: int
    step: int


def body_of_track(track: Track) -> Body:
    """A recorded road user."""
    return Body(
        track.obstacle_id, track.first_step, track.positions, track.headings_rad, (track.length_m, track.width_m)
    )


def body_of_touched(track: TakenOverTrack) -> Body:
    """A touched vehicle."""
    size = (track.length_m, track.width_m)
    return Body(track.vehicle_id, track.first_step, track.motion.positions, track.motion.headings_rad, size)


def new_overlaps(touched: Iterable[Body], others: Iterable[Body], recorded: Mapping[int, Body]) -> tuple[Overlap, ...]:
    """First overlaps of touched bodies with all others and with one another, ordered by step.

    An overlap that begins where the same two overlap in the recording is left out: no edit caused it. The recordings
    of two that are moved in time alike count as recorded, those of two that are moved otherwise do not. Several of the
    others may have one key: they stand for one obstacle.
    """
    moved, rest = list(touched), list(others)
    found: dict[tuple[int, int], Overlap] = {}
    for number, body in enumerate(moved):
        among_moved = [(other, recorded.get(other.key)) for other in moved[number + 1 :]]
        for other, before in among_moved + [(other, recorded.get(other.key, other)) for other in rest]:
            step, pair = _first_new(body, other, recorded.get(body.key), before), (body.key, other.key)
            if step is not None and (pair not in found or step < found[pair].step):
                found[pair] = Overlap(*pair, step)
    return tuple(sorted(found.values(), key=lambda hit: (hit.step, hit.first, hit.second)))


def overlap_steps(first: Body, second: Body) -> Iterator[int]:
    """The steps at which two bodies overlap, ascending."""
    begin = max(first.first_step, second.first_step)
    end = min(first.first_step + len(first.positions), second.first_step + len(second.positions))
    if begin >= end:
        return
    one, two = (
        slice(begin - first.first_step, end - first.first_step),
        slice(begin - second.first_step, end - second.first_step),
    )
    apart = np.linalg.norm(first.positions[one] - second.positions[two], axis=1)
    reach = (math.hypot(*first.size_m) + math.hypot(*second.size_m)) / 2
    for offset in np.flatnonzero(apart < reach).tolist():
        corners = [
            oriented_rectangle(body.positions[index], float(body.headings_rad[index]), body.size_m)
            for body, index in ((first, one.start + offset), (second, two.start + offset))
        ]
        if rectangles_overlap(corners[0], corners[1], TOUCH_M):
            yield int(begin + offset)


def _first_new(first: Body, second: Body, first_before: Body | None, second_before: Body | None) -> int | None:
    """The first step at which two bodies begin to overlap and did not about then as they were before; or None."""
    steps = overlap_steps(first, second)
    step = next(steps, None)
    if step is None or first_before is None or second_before is None:
        return step
    if first_before.shifted_steps != second_before.shifted_steps:
        return step
    known = tuple(overlap_steps(first_before, second_before))
    before = -2
    for now in itertools.chain([step], steps):
        if now > before + 1 and not any(abs(now - one) <= NEAR_STEPS for one in known):
            return now
        before = now
    return None


# ---------- giving_way
# Who gives way where SUMO lets two driven vehicles collide, and where it waits.
#
# SUMO knows lanes, not bodies: it does not see who stands askew between two lanes, a rear that cuts a corner, or two
# lanelets that overlap before they meet, and takes nobody to be in the way who has passed its stop line already.

CLEAR_LENGTH_M, CLEAR_WIDTH_M = 0.5, 0.3
"""So much longer and wider is the body that has to find room where it waits."""
STOP_BEFORE_M = 0.5
"""Smoothing moves a vehicle along its way by so much at most."""
SAME_PLACE_M = 0.1
"""Poses nearer to each other than this are looked at once."""
AFTER_STEPS = 2


@dataclass(frozen=True)
class _Wait:
    """A vehicle that can give way: where, and at which step it comes to what it waits for."""

    plan: DrivePlan
    halt: Halt
    step: int


def plans_giving_way(
    plans: Mapping[int, DrivePlan],
    tracks: Mapping[int, TakenOverTrack],
    bodies: Mapping[int, Body],
    overlaps: Iterable[Overlap],
) -> dict[int, DrivePlan]:
    """Plans with one halt more for one vehicle of every pair that overlaps and in which one can still stop before.

    That is one that was handed over rather than one that an edit is about, and of two such the later one.

    Args:
        plans: of the driven vehicles, whose new motions are in ``tracks``.
        bodies: everybody as the edits leave them.
    """
    found: dict[int, DrivePlan] = {}
    for hit in overlaps:
        if hit.first in found or hit.second in found:
            continue
        pairs = ((hit.first, hit.second), (hit.second, hit.first))
        waits = [
            _wait(plans[key], tracks[key], bodies[other], hit.step)
            for key, other in pairs
            if key in tracks and other in bodies
        ]
        possible = [wait for wait in waits if wait is not None]
        if possible:
            best = min(possible, key=lambda wait: (wait.plan.cause != "handed_over", -wait.step))
            found[best.plan.start.obstacle_id] = replace(best.plan, halts=(*best.plan.halts, best.halt))
    return found


def _wait(plan: DrivePlan, track: TakenOverTrack, other: Body, hit_step: int) -> _Wait | None:
    """How a vehicle waits until another one is gone from where they meet; None if it cannot stop before.

    It reacts to nobody who has not entered yet.
    """
    body, in_the_way = body_of_touched(track), _in_the_way(other, hit_step)
    roomy = (body.size_m[0] + CLEAR_LENGTH_M, body.size_m[1] + CLEAR_WIDTH_M)
    index, gone = hit_step - body.first_step, hit_step
    while index >= 0:
        mine = oriented_rectangle(body.positions[index], float(body.headings_rad[index]), roomy)
        met = [step for step, corners in in_the_way if rectangles_overlap(mine, corners)]
        if not met:
            break
        gone, index = max(gone, met[-1]), index - 1
    if index < 0:
        return None
    from_step = max(body.first_step, other.first_step)
    stations = arc_length(track.motion.positions)
    rolled_m = max(float(stations[index]) - STOP_BEFORE_M, 0.0)
    now = from_step - body.first_step
    if float(track.motion.speeds_mps[now]) ** 2 > 2 * HARDEST_BRAKING_MPS2 * (rolled_m - float(stations[now])):
        return None
    return _Wait(plan, Halt(from_step, gone + AFTER_STEPS, rolled_m), body.first_step + index)


def _in_the_way(body: Body, from_step: int) -> list[tuple[int, Points]]:
    """The corners (4, 2) of a body from a step on, each place once: with the last step at which it is there."""
    places: list[tuple[int, int]] = []
    for index in range(max(from_step - body.first_step, 0), len(body.positions)):
        stays = bool(places) and math.dist(body.positions[places[-1][0]], body.positions[index]) < SAME_PLACE_M
        first = places.pop()[0] if stays else index
        places.append((first, index))
    return [
        (
            body.first_step + last,
            oriented_rectangle(body.positions[first], float(body.headings_rad[first]), body.size_m),
        )
        for first, last in places
    ]


# ---------- cascade
# Re-simulation in rounds: who would run into an edited vehicle is handed over too, in time to react.

ROUNDS = 8
"""Each may reach one vehicle farther back in a queue."""
END_M = 0.5
REACTION_S = 4.0
"""A handed-over vehicle is driven from so long before the collision on."""


@dataclass(frozen=True)
class Resimulated:
    """The outcome of all rounds: plans and new tracks of the driven vehicles, and the overlaps that are left."""

    plans: Mapping[int, DrivePlan]
    tracks: Mapping[int, TakenOverTrack]
    overlaps: tuple[Overlap, ...]
    missing: tuple[int, ...]


def resimulate_until_clear(
    scene: Scene, changes: Changes, setup: SimulationSetup, shown: tuple[Actor, ...] = (), *, everybody: bool = False
) -> Resimulated:
    """Simulate, hand over whom a driven vehicle hits, and simulate again, at most eight rounds more.

    Where all that are hit are driven already, one of them is told to give way, as long as fewer collide so.

    Args:
        shown: further road users that the driven ones see, but that collide with nobody (the ego). They are replayed,
            unless there is a collision left and they drive through a driven vehicle: then they are driven too.
        everybody: hand over all vehicles at their first step, so that everybody reacts.
    """
    plans: dict[int, DrivePlan] = {**(_everybody(scene, changes) if everybody else {}), **changes.driven}
    plans = dict(sorted(plans.items()))
    best = result = _round(scene, changes, setup, plans, shown)
    for _ in range(ROUNDS):
        more, reacting = _handed_over(scene, plans, result.overlaps), _reacting(scene, shown, result)
        if not more and reacting is None:
            more = _giving_way(scene, changes, result)
            if not more:
                break
        shown = reacting or shown
        plans = dict(sorted({**plans, **more}.items()))
        result = _round(scene, changes, setup, plans, shown)
        if len(result.overlaps) < len(best.overlaps) or not any(plan.halts for plan in plans.values()):
            best = result
    # The last simulation leaves its files behind; they have to be those of the motion that is written.
    return best if best is result else _round(scene, changes, setup, best.plans, shown)


def scene_after(scene: Scene, changes: Changes, result: Resimulated) -> Scene:
    """The scene as the edits leave it: simulated tracks in place of recorded ones, and without whom they removed."""
    driven = {key: track.whole(result.plans[key].start) for key, track in result.tracks.items()}
    return replace(
        scene,
        tracks={key: track for key, track in sorted((scene.tracks | driven).items()) if key not in changes.removed},
        standing={key: track for key, track in scene.standing.items() if key not in changes.removed},
        regions=tuple(region for region in scene.regions if region.obstacle_id not in changes.removed),
    )


def tracks_after(scene: Scene, changes: Changes, result: Resimulated) -> tuple[Track, ...]:
    """Everybody as the edits leave them: recorded, standing and driven road users by ascending id, then regions."""
    after = scene_after(scene, changes, result)
    tracks = (track for _, track in sorted((after.tracks | after.standing).items()))
    return (*tracks, *(region.track for region in after.regions))


def bodies_after(scene: Scene, changes: Changes, result: Resimulated) -> dict[int, Body]:
    """The bodies of everybody as the edits leave them, by the id of the track."""
    return {track.obstacle_id: body_of_track(track) for track in tracks_after(scene, changes, result)}


def _everybody(scene: Scene, changes: Changes) -> dict[int, DrivePlan]:
    return {
        key: recorded_plan(scene, key, "handed_over", scene.tracks[key].first_step)
        for key in drivable_ids(scene)
        if key not in changes.removed
    }


def _round(
    scene: Scene, changes: Changes, setup: SimulationSetup, plans: Mapping[int, DrivePlan], shown: tuple[Actor, ...]
) -> Resimulated:
    driven = resimulate(setup, (*all_actors(scene, plans, changes.removed, changes.replays.values()), *shown))
    tracks: dict[int, TakenOverTrack] = {}
    for key, plan in plans.items():
        seen = driven.get(key) or _gone_at_once(scene, plan)
        over_m = plan.junction_lane_change.within_m if plan.junction_lane_change else None
        made = None if seen is None else taken_over_track(plan.start, seen, scene.step_s, scene.last_step, over_m)
        if made is not None:
            tracks[key] = made
    bodies = {key: body_of_track(track) for key, track in (scene.tracks | scene.standing).items()}
    moved = [bodies[key] for key in changes.replays if key not in tracks]
    recorded = {key: body for key, body in bodies.items() if not changes.is_added(key)}
    for key, replay in changes.replays.items():
        if key in recorded:
            recorded[key] = replace(recorded[key], shifted_steps=replay.shifted_steps)
    kept = recorded.keys() - tracks.keys() - changes.replays.keys() - changes.removed
    others = [recorded[key] for key in sorted(kept)]
    regions = [region for region in scene.regions if region.obstacle_id not in changes.removed]
    others += [replace(body_of_track(region.track), key=region.obstacle_id) for region in regions]
    overlaps = new_overlaps([*moved, *(body_of_touched(track) for track in tracks.values())], others, recorded)
    return Resimulated(plans, tracks, overlaps, tuple(key for key in plans if key not in tracks))


def _gone_at_once(scene: Scene, plan: DrivePlan) -> DrivenTrack | None:
    """The track of a vehicle that SUMO never showed because its bumper is beyond the end of the network."""
    index = plan.from_step - plan.start.first_step
    match = scene.matches.get(plan.start.obstacle_id)
    lanelet = plan.lanelets[0] if match is None else match.at(index)
    lane, front = scene.layout.table.lanes[lanelet], front_of(plan.start, index)
    station, _ = project(lane.center, front)
    if scene.layout.table.successors[lanelet] or station < lane.length_m - END_M:
        return None
    return DrivenTrack(plan.from_step, front[None], (), leaves=True)


def _handed_over(scene: Scene, plans: Mapping[int, DrivePlan], overlaps: tuple[Overlap, ...]) -> dict[int, DrivePlan]:
    """Plans for the replayed vehicles that are hit, and earlier hand-overs for those handed over too late."""
    before = round(REACTION_S / scene.step_s)
    found: dict[int, DrivePlan] = {}
    for hit in overlaps:
        for key in (hit.first, hit.second):
            plan = plans.get(key)
            if plan is not None and plan.cause != "handed_over":
                continue
            if plan is None and (key not in scene.tracks or not_drivable(scene, key)):
                continue
            first = scene.tracks[key].first_step
            step = max(first, hit.step - before if plan is None else plan.from_step - before)
            if plan is not None and step == plan.from_step:
                continue
            made = plan or recorded_plan(scene, key, "handed_over", step)
            earliest = min(step, found[key].from_step) if key in found else step
            found[key] = replace(made, from_step=earliest, halts=())
    return found


def _giving_way(scene: Scene, changes: Changes, result: Resimulated) -> dict[int, DrivePlan]:
    """Nobody makes room for who enters where he stands: a taken place is refused."""
    overlaps = tuple(hit for hit in result.overlaps if not _is_taken_place(changes, result.plans, hit))
    if not overlaps:
        return {}
    return plans_giving_way(result.plans, result.tracks, bodies_after(scene, changes, result), overlaps)


def _is_taken_place(changes: Changes, plans: Mapping[int, DrivePlan], hit: Overlap) -> bool:
    entering = {key: plan.from_step for key, plan in plans.items() if plan.cause == "added"}
    entering |= {key: replay.track.first_step for key, replay in changes.replays.items()}
    return hit.step in (entering.get(hit.first), entering.get(hit.second))


def _reacting(scene: Scene, shown: tuple[Actor, ...], result: Resimulated) -> tuple[Actor, ...] | None:
    """The road users shown besides, driven from before they pass through a driven vehicle on; None if nobody does.

    SUMO keeps its order of the vehicles on a lane where one is put through another: those behind see it as their leader
    from then on, and not the one that it passed through, and run into that.
    """
    if not result.overlaps or any(plan.halts for plan in result.plans.values()):
        return None
    driven, before = [body_of_touched(track) for track in result.tracks.values()], round(REACTION_S / scene.step_s)
    found = {}
    for one in shown:
        hits = new_overlaps([body_of_track(one.track)], driven, {}) if one.drive_from is None else ()
        if hits:
            found[one.key] = replace(one, drive_from=max(one.track.first_step, hits[0].step - before))
    return tuple(found.get(one.key, one) for one in shown) if found else None
