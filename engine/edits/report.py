"""What is said about edits that were carried out: routes, arrival, feasibility, collisions."""

from collections.abc import Callable, Mapping

import numpy as np

from ...schemas.modification import (
    LETTERS,
    EditCollision,
    EditReport,
    ModificationRequest,
    TouchedVehicle,
    VehicleRoute,
)
from ..commonroad import Track
from ..cosimulation import DrivePlan, Replay, TakenOverTrack
from ..scene import Scene
from ..vehicles import Feasibility, Motion, check_kinematics, nearest_class
from .changes import Changes, EditStep
from .entry_checks import bodies_asked_for, shifted_body
from .explanations import driven_lanelets, driven_since, is_gone, is_replaced, overruled, speeds_reached, why_not
from .simulation import Body, Resimulated, body_of_track, new_overlaps
from .writing import replayed_motion

# ---------- driven_shifts
# Recordings moved in time that are driven after all, because they would hit somebody, and the words for it.

MOST_NAMED = 3


def _driven_shifts(changes: Changes, result: Resimulated) -> tuple[int, ...]:
    """The vehicles that edits only move in time and that are driven nevertheless, by ascending id."""
    shifted = [key for key, one in changes.replays.items() if one.recording is not None]
    return tuple(key for key in shifted if key in result.tracks and result.plans[key].cause == "handed_over")


def _why_driven(vehicles: tuple[int, ...], scene: Scene, changes: Changes, result: Resimulated) -> list[str]:
    """For the first three of some vehicles that are moved in time: from when on they are driven and why."""
    found = [key for key in _driven_shifts(changes, result) if key in vehicles]
    bodies = bodies_asked_for(scene, changes, result) if found else {}
    said = [_why(key, scene, changes, result, bodies) for key in found[:MOST_NAMED]]
    return said + ([f"{len(found) - MOST_NAMED} more are driven, too"] if len(found) > MOST_NAMED else [])


def _why(key: int, scene: Scene, changes: Changes, result: Resimulated, bodies: dict[int, Body]) -> str:
    driven = f"{key} is driven from {result.tracks[key].first_step * scene.step_s:.1f} s on"
    mine = shifted_body(changes.replays[key])
    after = {one: body_of_track(track.whole(result.plans[one].start)) for one, track in result.tracks.items()}
    for there in (bodies, after):
        hits = new_overlaps([mine], (body for other, body in there.items() if other != key), {key: mine})
        if hits:
            return f"{driven}: its recording would hit vehicle {hits[0].second} at {hits[0].step * scene.step_s:.1f} s"
    return f"{driven}, because others react"


# ---------- edit_report
# What is said about edits that were carried out: routes, arrival, feasibility, collisions.


def edit_reports(
    request: ModificationRequest,
    scene: Scene,
    steps: tuple[EditStep, ...],
    result: Resimulated,
    others: Mapping[int, Track],
) -> tuple[EditReport, ...]:
    """One report per edit of this request; those of earlier requests are not repeated.

    An edit is not done where those that follow leave nothing of it.

    ``others``: everybody as the edits leave them.
    """
    found = []
    for index in range(request.earlier, len(request.edits)):
        edit, step = request.edits[index], steps[index]
        driven = [key for key in step.vehicles if key in result.tracks]
        routes = tuple(vehicle_route(scene, step, result.plans[key], result.tracks[key], others) for key in driven)
        speeds = speeds_reached(scene, step, result)
        kept = _why_driven(step.vehicles, scene, steps[-1].changes, result) if edit.op == "shift_time" else []
        undone = _undone(edit.op, step, steps[index + 1 :], result, routes)
        found.append(
            EditReport(
                index=index - request.earlier,
                op=edit.op,
                letter=LETTERS[edit.op],
                done=not undone,
                what="; ".join([step.what, *speeds, *kept, *undone]),
                vehicles=step.vehicles,
                routes=routes,
            )
        )
    return tuple(found)


def _undone(
    op: str, step: EditStep, later: tuple[EditStep, ...], result: Resimulated, routes: tuple[VehicleRoute, ...]
) -> list[str]:
    """Why nothing is left of an edit; empty where something is."""
    final = (step, *later)[-1].changes
    if is_replaced(op, step, final):
        return ["a later edit replaces it"]
    arrived = [route.vehicle_id for route in routes if route.arrives]
    if not step.vehicles or overruled(step, later, result, arrived) != step.vehicles:
        return []
    is_removed = all(is_gone(key, step, final) for key in step.vehicles)
    return ["a later edit removes what it is about" if is_removed else "later edits overrule it"]


def vehicle_route(
    scene: Scene, step: EditStep, plan: DrivePlan, track: TakenOverTrack, others: Mapping[int, Track]
) -> VehicleRoute:
    """The lanelets that a vehicle drives, as simulated, and whether it gets to one lanelet of each aim of an edit.

    For one that does not get there in time they go on as it would drive, as long as there is a way.
    """
    key = track.vehicle_id
    driven, aims = driven_lanelets(scene, track, plan), step.aims.get(key, ())
    if not aims:
        return VehicleRoute(vehicle_id=key, lanelets=driven)
    later = driven_since(scene, track, step.since[key]) if key in step.since else driven
    missed = [targets for targets in aims if not targets & set(later)]
    reason = why_not(scene, step, plan, track, driven, missed[0], others) if missed else ""
    way = (*driven, *_way_on(scene, plan, track, driven)) if missed else driven
    return VehicleRoute(vehicle_id=key, lanelets=way, arrives=not missed, reason=reason)


def _way_on(scene: Scene, plan: DrivePlan, track: TakenOverTrack, driven: tuple[int, ...]) -> tuple[int, ...]:
    """The lanelets after those driven so far, to the nearest target of a plan; none where no way is left."""
    if track.leaves or not plan.targets or plan.targets & set(driven):
        return ()
    way = scene.lanelet_graph.shortest_route(driven[-1:] or plan.lanelets[:1], sorted(plan.targets))
    return () if way is None else way[len(driven[-1:]) :]


def touched_vehicles(
    scene: Scene, changes: Changes, result: Resimulated, check: Callable[..., Feasibility] = check_kinematics
) -> tuple[TouchedVehicle, ...]:
    """Feasibility (by a check) and hand-over of every touched vehicle, by ascending id.

    One that an edit moves in time is named as shifted where it is driven because it would hit somebody, too.
    """
    driven = {
        key: _touched(scene, result.plans[key], track, _verdict(scene, result.plans[key].start, track.motion, check))
        for key, track in result.tracks.items()
    }
    for key in _driven_shifts(changes, result):
        driven[key] = driven[key].model_copy(update={"cause": "shifted"})
    given = {key: _given(scene, replay, check) for key, replay in changes.replays.items() if key not in driven}
    return tuple(vehicle for _, vehicle in sorted((driven | given).items()))


def reported_collisions(scene: Scene, result: Resimulated) -> tuple[EditCollision, ...]:
    """The overlaps that are left, in time order."""
    return tuple(
        EditCollision(vehicles=(hit.first, hit.second), time_s=round(hit.step * scene.step_s, 3))
        for hit in result.overlaps
    )


def _verdict(scene: Scene, track: Track, motion: Motion, check: Callable[..., Feasibility]) -> Feasibility:
    """What a check says of a motion, with the axles of the class that the vehicle is of by its type and length."""
    chassis = nearest_class(track.kind, track.length_m)
    return check(motion, scene.step_s, wheelbase_m=chassis.wheelbase_m, rear_axle_m=chassis.rear_axle_m)


def _given(scene: Scene, replay: Replay, check: Callable[..., Feasibility]) -> TouchedVehicle:
    """A road user that moves by a given track; people on foot are not held to what vehicles can do."""
    motion = None if replay.recording is None else replayed_motion(replay, scene.step_s)
    verdict = None if motion is None else _verdict(scene, replay.track, motion, check)
    return TouchedVehicle(
        vehicle_id=replay.track.obstacle_id,
        cause="added" if verdict is None else "shifted",
        from_time_s=round(replay.track.first_step * scene.step_s, 3),
        until_time_s=round(replay.track.last_step * scene.step_s, 3),
        leaves_network=False,
        feasible=verdict is None or verdict.feasible,
        feasible_share=1.0 if verdict is None else round(verdict.share_of_steps, 4),
    )


def _touched(scene: Scene, plan: DrivePlan, track: TakenOverTrack, verdict: Feasibility) -> TouchedVehicle:
    speeds, positions = track.motion.speeds_mps, track.motion.positions
    moved = np.linalg.norm(np.diff(positions[:2], axis=0), axis=1)[0]
    recorded = plan.cause != "added"
    return TouchedVehicle(
        vehicle_id=track.vehicle_id,
        cause=plan.cause,
        from_time_s=round(track.first_step * scene.step_s, 3),
        until_time_s=round(track.last_step * scene.step_s, 3),
        leaves_network=track.leaves,
        feasible=verdict.feasible,
        feasible_share=round(verdict.share_of_steps, 4),
        handover_jump_m=round(max(float(moved) - float(speeds[:2].max()) * scene.step_s, 0.0), 4) if recorded else None,
        handover_speed_step_mps=round(abs(float(speeds[1] - speeds[0])), 4) if recorded else None,
    )
