"""Re-simulation in rounds: who would run into an edited vehicle is handed over too, in time to react."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from plannerforge.engine.edits.changes import Changes, DrivePlan, drivable_ids, not_drivable, recorded_plan
from plannerforge.engine.edits.collisions import Body, Overlap, body_of_touched, body_of_track, new_overlaps
from plannerforge.engine.edits.giving_way import plans_giving_way
from plannerforge.engine.edits.handover import TouchedTrack, touched_track
from plannerforge.engine.edits.participants import Participant, participants
from plannerforge.engine.edits.resimulation import DrivenTrack, front_of, resimulate
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.sumo_process import SimulationSetup
from plannerforge.engine.geometry.polyline import project
from plannerforge.engine.scenarios.tracks import Track

ROUNDS = 8
"""Each may reach one vehicle farther back in a queue."""

END_M = 0.5
REACTION_S = 4.0
"""A handed-over vehicle is driven from so long before the collision on."""


@dataclass(frozen=True)
class Resimulated:
    """The outcome of all rounds: plans and new tracks of the driven vehicles, and the overlaps that are left."""

    plans: Mapping[int, DrivePlan]
    tracks: Mapping[int, TouchedTrack]
    overlaps: tuple[Overlap, ...]
    missing: tuple[int, ...]


def resimulate_until_clear(
    scene: Scene,
    changes: Changes,
    setup: SimulationSetup,
    shown: tuple[Participant, ...] = (),
    *,
    everybody: bool = False,
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
    scene: Scene,
    changes: Changes,
    setup: SimulationSetup,
    plans: Mapping[int, DrivePlan],
    shown: tuple[Participant, ...],
) -> Resimulated:
    driven = resimulate(setup, (*participants(scene, plans, changes.removed, changes.replays.values()), *shown))
    tracks: dict[int, TouchedTrack] = {}
    for key, plan in plans.items():
        seen = driven.get(key) or _gone_at_once(scene, plan)
        over_m = plan.steering_over.within_m if plan.steering_over else None
        made = None if seen is None else touched_track(plan.start, seen, scene.step_s, scene.last_step, over_m)
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


def _reacting(scene: Scene, shown: tuple[Participant, ...], result: Resimulated) -> tuple[Participant, ...] | None:
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
