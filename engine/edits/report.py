"""The answer to a request: what each edit did, the motion of touched vehicles, collisions, dangers, warnings."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ...schemas.modification import (
    EDITS,
    Achieved,
    EditReport,
    EgoDanger,
    ModificationOutcome,
    ModificationRequest,
    TouchedVehicle,
)
from ..commonroad import Track
from ..cosimulation import DrivePlan, HandoverTrack, Replay
from ..scene import NOT_DRIVEN, Scene, is_own_recording
from ..vehicles import Feasibility, Motion, check_drivability, check_kinematics, nearest_class, refused_by_planners
from .changes import listed
from .edited_scene import EditedScene, SimulatedEdits
from .ego_risk import EgoRisk
from .entries import entering_onto_ego
from .explanations import (
    speeds_reached,
    stood_until_s,
    vehicle_route,
    why_handed_over,
    why_missed,
    why_shifts_are_driven,
    why_undone,
)
from .writing import replayed_motion

_MOST_VALUES = 4
"""Number of values in an edit's sentence (chosen); the structured answer has all."""


def outcome_of(
    request: ModificationRequest,
    simulated: SimulatedEdits,
    risks: tuple[EgoRisk | None, EgoRisk | None],
    files: tuple[Path | None, Path | None],
    notes: list[str],
) -> ModificationOutcome:
    """Return the outcome of a request.

    Args:
        request: the edits and the requested detail.
        simulated: the edits after their simulation.
        risks: the ego's risk before and after the edits; None if there is no ego or the risk is not reported.
        files: the scenario file and its SUMO network; None for a dry run.
        notes: sentences on what else changed when the files were written.
    """
    scene, changes, result, (before, after) = simulated.scene, simulated.changes, simulated.result, risks
    edits = _edit_reports(request, simulated)
    touched, agree = _judged(request, simulated)
    recorded = set(scene.tracks) - set(result.tracks) - changes.removed - set(changes.replays)
    warnings = [*notes, *simulated.notes, *_ego_notes(simulated), *_warnings(request, simulated)]
    return ModificationOutcome(
        xml=files[0],
        net=files[1],
        edits=edits,
        touched=touched,
        removed=tuple(sorted(changes.removed)),
        collisions=simulated.collisions,
        ego_before=_danger(before),
        ego_after=_danger(after),
        checked_by="closed_form" if agree is None else "drivability_checker",
        checkers_agree=agree,
        untouched=len(recorded),
        planners_refuse="" if scene.ego is None else refused_by_planners(scene.ego.vehicle_class),
        warnings=(*warnings, *_left_out_notes(before, after)),
    )


def _edit_reports(request: ModificationRequest, simulated: SimulatedEdits) -> tuple[EditReport, ...]:
    """Return one report per edit of this request; the edits of earlier requests are not reported again.

    An edit counts as not done if later edits undo it completely.
    """
    reports = []
    for index in range(request.earlier, len(request.edits)):
        edit, step = request.edits[index], simulated.steps[index]
        driven = [key for key in step.vehicles if key in simulated.result.tracks]
        routes = tuple(vehicle_route(simulated, step, key) for key in driven)
        speeds, achieved = speeds_reached(simulated, step)
        shifts = why_shifts_are_driven(simulated, step.vehicles) if edit.op == "shift_time" else []
        values = step.measure(simulated)
        undone = why_undone(edit.op, step, simulated.steps[index + 1 :], simulated.result, routes) or why_missed(values)
        reports.append(
            EditReport(
                index=index - request.earlier,
                op=edit.op,
                letter=EDITS[edit.op].letter,
                done=undone is None,
                what="; ".join(
                    [step.what, *speeds, *_values_in_words(values), *shifts, *([] if undone is None else [undone])]
                ),
                vehicles=step.vehicles,
                routes=routes,
                achieved=(*achieved, *values),
                meant=step.meant,
            )
        )
    return tuple(reports)


def _values_in_words(values: tuple[Achieved, ...]) -> list[str]:
    """Return the achieved values of an edit as text, for its first vehicles; equal results are merged."""
    vehicles: dict[str, list[int]] = {}
    for one in values[:_MOST_VALUES]:
        why = f"; {one.reason}" if one.reason else ""
        requested = "" if one.asked is None or one.reached else f" (requested: {one.asked:.4g} {one.unit}{why})"
        words = f"{one.quantity.replace('_', ' ')} {one.value:.3g} {one.unit}".rstrip() + requested
        vehicles.setdefault(words, []).append(one.vehicle_id)
    by_vehicles: dict[tuple[int, ...], list[str]] = {}
    for words, keys in vehicles.items():
        by_vehicles.setdefault(tuple(keys), []).append(words)
    return [f"result for {listed(keys)}: {', '.join(words)}" for keys, words in by_vehicles.items()]


def _judged(request: ModificationRequest, edited: EditedScene) -> tuple[tuple[TouchedVehicle, ...], int | None]:
    """Return the touched vehicles, and on how many of them the checks agree; None if one check was requested."""
    screened = _touched_vehicles(edited, check_kinematics)
    if request.detail == "brief":
        return screened, None
    checked = _touched_vehicles(edited, check_drivability)
    return checked, sum(one.feasible == other.feasible for one, other in zip(screened, checked, strict=True))


def infeasible_vehicles(edited: EditedScene) -> tuple[int, ...]:
    """Return the touched vehicles whose motion a vehicle of their class cannot drive (closed form), by ascending id."""
    return tuple(one.vehicle_id for one in _touched_vehicles(edited, check_kinematics) if not one.feasible)


def _touched_vehicles(edited: EditedScene, check: Callable[..., Feasibility]) -> tuple[TouchedVehicle, ...]:
    """Return feasibility (by a check) and hand-over of every touched vehicle, by ascending id.

    A vehicle that an edit moves in time is reported as shifted even if it is driven to avoid a collision.
    """
    scene, result = edited.scene, edited.result
    driven = {
        key: _touched(scene, result.plans[key], track, _verdict(scene, track, track.motion, check))
        for key, track in result.tracks.items()
    }
    for key in result.tracks:
        stood_s = None if key in edited.ordered_speeds else stood_until_s(edited, key)
        if stood_s is not None:
            driven[key] = driven[key].model_copy(update={"stood_until_s": round(stood_s, 3)})
    for key in edited.driven_shifts:
        driven[key] = driven[key].model_copy(update={"cause": "shifted"})
    for key, reason in why_handed_over(edited).items():
        driven[key] = driven[key].model_copy(update={"reason": reason})
    replayed = {key: replay for key, replay in edited.changes.replays.items() if key not in driven}
    given = {key: _given(scene, replay, check) for key, replay in replayed.items()}
    return tuple(vehicle for _, vehicle in sorted((driven | given).items()))


def _verdict(scene: Scene, track: Track, motion: Motion, check: Callable[..., Feasibility]) -> Feasibility:
    """Return the verdict of a check on a motion, with the axles of the class that fits its type and length."""
    chassis = nearest_class(track.kind, track.length_m)
    axles = {"wheelbase_m": chassis.wheelbase_m, "rear_axle_m": chassis.rear_axle_m}
    return check(motion, scene.step_s, **axles, friction=scene.friction)


def _given(scene: Scene, replay: Replay, check: Callable[..., Feasibility]) -> TouchedVehicle:
    """Return the report on a road user that follows a given track; vehicle limits do not apply to pedestrians."""
    is_vehicle = replay.track.kind not in NOT_DRIVEN and len(replay.track.positions) > 1
    motion = replayed_motion(replay.track, scene.step_s) if is_vehicle else None
    verdict = None if motion is None else _verdict(scene, replay.track, motion, check)
    cause = "added" if replay.recording is None else "shifted" if replay.shifted_steps else "edited"
    first = max(replay.track.first_step, replay.from_step)
    return TouchedVehicle(
        vehicle_id=replay.track.obstacle_id,
        cause=cause,
        from_time_s=round(first * scene.step_s, 3),
        until_time_s=round(replay.track.last_step * scene.step_s, 3),
        leaves_network=False,
        feasible=verdict is None or verdict.feasible,
        feasible_share=1.0 if verdict is None else round(verdict.share_of_steps, 4),
    )


def _touched(scene: Scene, plan: DrivePlan, track: HandoverTrack, verdict: Feasibility) -> TouchedVehicle:
    speeds, positions = track.speeds_mps, track.positions
    moved = np.linalg.norm(np.diff(positions[:2], axis=0), axis=1)[0]
    recorded = plan.cause != "added"
    return TouchedVehicle(
        vehicle_id=track.obstacle_id,
        cause=plan.cause,
        from_time_s=round(track.first_step * scene.step_s, 3),
        until_time_s=round(track.last_step * scene.step_s, 3),
        leaves_network=track.leaves,
        feasible=verdict.feasible,
        feasible_share=round(verdict.share_of_steps, 4),
        handover_jump_m=round(max(float(moved) - float(speeds[:2].max()) * scene.step_s, 0.0), 4) if recorded else None,
        handover_speed_step_mps=round(abs(float(speeds[1] - speeds[0])), 4) if recorded else None,
        moved_m=_moved_m(track, scene.tracks[track.obstacle_id]) if recorded else None,
    )


def _moved_m(track: HandoverTrack, recorded: Track) -> float:
    """Return the largest distance in m between two tracks at the same steps."""
    first = max(track.first_step, recorded.first_step)
    ours, theirs = track.positions[first - track.first_step :], recorded.positions[first - recorded.first_step :]
    steps = min(len(ours), len(theirs))
    return round(float(np.linalg.norm(ours[:steps] - theirs[:steps], axis=1).max(initial=0.0)), 2)


def _ego_notes(simulated: SimulatedEdits) -> list[str]:
    """Return notes about the ego that are no reason for a refusal: entries at its position, and its own recording."""
    notes = []
    entering = entering_onto_ego(simulated)
    if entering:
        keys = ", ".join(map(str, entering))
        who = f"vehicle {keys} enters" if len(entering) == 1 else f"vehicles {keys} enter"
        notes.append(f"{who} at the position of an ego that drives like an ordinary driver")
    start, removed = simulated.changes.ego or simulated.scene.ego, simulated.changes.removed
    left = {key: track for key, track in simulated.scene.tracks.items() if key not in removed}
    own = [key for key, track in left.items() if start is not None and is_own_recording(track, start)]
    if own:
        keys = ", ".join(map(str, own))
        notes.append(
            f"{keys} is the ego's own recording: the minimum distance is 0 m until you remove it (remove_vehicle)"
        )
    return notes


def _danger(risk: EgoRisk | None) -> EgoDanger | None:
    return None if risk is None else risk.figures.model_copy(update={"left_out": risk.left_out})


def _left_out_notes(before: EgoRisk | None, after: EgoRisk | None) -> list[str]:
    """Return a note on vehicles that are newly left out of the ego's figures because of the edits."""
    known = () if before is None else before.left_out
    new = [key for key in (() if after is None else after.left_out) if key not in known]
    if not new:
        return []
    keys = ", ".join(map(str, new))
    return [f"the ego's risk after the edit does not count {keys}, which would hit it from behind as recorded"]


def _warnings(request: ModificationRequest, edited: EditedScene) -> list[str]:
    scene, changes, result = edited.scene, edited.changes, edited.result
    unseen = {key for key in scene.tracks if key not in scene.matches and not changes.is_added(key)}
    unseen |= {region.obstacle_id for region in scene.regions if region.match is None}
    unseen -= changes.removed
    phantoms = sorted(int(one.obstacle_id) for one in scene.loaded.scenario.phantom_obstacle)
    warnings = _late_entries(edited)
    if unseen and result.plans:
        off = ", ".join(map(str, sorted(unseen)))
        why = "it is recorded" if len(unseen) == 1 else "they are recorded"
        warnings.append(f"driven vehicles do not see {off}, because {why} off the lanelets")
    if phantoms and result.plans:
        warnings.append(f"other vehicles neither see nor hit phantom obstacles: {', '.join(map(str, phantoms))}")
    return warnings + _kept_recordings(request, edited)


def _late_entries(edited: EditedScene) -> list[str]:
    """Return a warning on road users that enter after time 0, which CommonRoad's schema does not allow."""
    steps = {key: plan.from_step for key, plan in edited.result.plans.items() if plan.cause == "added"}
    steps |= {
        key: replay.track.first_step
        for key, replay in edited.changes.replays.items()
        if replay.recording is None or replay.recording.first_step != replay.track.first_step
    }
    late: dict[int, list[int]] = {}
    for key, step in sorted(steps.items(), key=lambda entry: (entry[1], entry[0])):
        if step > 0:
            late.setdefault(step, []).append(key)
    if not late:
        return []
    entries = [
        f"{', '.join(map(str, keys))} enter{'s' * (len(keys) == 1)} at {step * edited.scene.step_s:.1f} s"
        for step, keys in late.items()
    ]
    return [f"{', '.join(entries)}: CommonRoad's schema requires time 0, but its reader accepts this"]


def _kept_recordings(request: ModificationRequest, edited: EditedScene) -> list[str]:
    """Return warnings about vehicles that should react to the edits but do not."""
    scene, changes, result = edited.scene, edited.changes, edited.result
    warnings = []
    if result.missing:
        keys = ", ".join(map(str, result.missing))
        who = f"vehicle {keys} keeps its" if len(result.missing) == 1 else f"vehicles {keys} keep their"
        them = "it" if len(result.missing) == 1 else "them"
        warnings.append(
            f"{who} recording instead of reacting, because SUMO did not insert {them} before the scenario ends"
        )
    mute = [key for key in scene.tracks if key not in {*result.plans, *changes.removed, *changes.replays}]
    if request.traffic == "reactive" and mute:
        keys = ", ".join(map(str, mute))
        who = f"vehicle {keys} keeps its" if len(mute) == 1 else f"vehicles {keys} keep their"
        warnings.append(f"{who} recording, because SUMO cannot drive {'it' if len(mute) == 1 else 'them'}")
    return warnings
