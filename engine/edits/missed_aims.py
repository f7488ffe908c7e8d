"""Why a driven vehicle does not get where, or does not drive as fast as, an edit wants it to."""

import numpy as np

from plannerforge.engine.edits.cascade import Resimulated
from plannerforge.engine.edits.changes import DrivePlan, EditStep
from plannerforge.engine.edits.driven_way import driven_lanelets
from plannerforge.engine.edits.handover import TouchedTrack
from plannerforge.engine.edits.scene import Scene
from plannerforge.schemas.errors import NotPossible

SPEED_TOLERANCE_MPS = 0.3
STILL_CHANGING_MPS2 = 0.3


def why_not(
    scene: Scene, plan: DrivePlan, track: TouchedTrack, driven: tuple[int, ...], targets: frozenset[int]
) -> str:
    """The reason for which a vehicle, which drives over these lanelets, gets to none of the targets."""
    if not _is_still_sent_to(scene, plan, targets):
        return "a later edit sends it another way"
    target = _first_target(plan, targets)
    if track.leaves:
        return f"it leaves the network on lanelet {driven[-1] if driven else plan.lanelets[0]} before lanelet {target}"
    end = f"the scenario ends at {scene.last_step * scene.step_s:.1f} s"
    edges = {scene.layout.lane_of[key][0] for key in targets if key in scene.layout.lane_of}
    if track.lanes and track.lanes[-1].rpartition("_")[0] in edges:
        return f"no room to change into lanelet {_beside_last(scene, track, targets)} before {end}"
    if set(driven) & _beside_any(scene, targets):
        return f"no room to change into lanelet {target} before its road ends"
    if float(track.motion.speeds_mps[-1]) < 0.1:
        return f"it stands on lanelet {driven[-1] if driven else plan.lanelets[0]} when {end}"
    return f"{end} while it is on its way to lanelet {target}"


def check_not_driven_past(scene: Scene, plan: DrivePlan, track: TouchedTrack) -> None:
    """Refuse to send a recorded vehicle to a target that it passes for good.

    One that waits for a gap, or can still come back to its target, is on its way.

    Raises:
        NotPossible: naming the target, and why the vehicle does not get there.
    """
    driven = driven_lanelets(scene, track, plan)
    if plan.cause != "edited" or not _is_still_sent_to(scene, plan, plan.targets) or plan.targets & set(driven):
        return
    ahead = None if track.leaves else scene.lanelet_graph.shortest_route(driven[-1:], sorted(plan.targets))
    if ahead is None:
        raise NotPossible(
            f"vehicle {track.vehicle_id} would drive past lanelet {_first_target(plan, plan.targets)}: "
            f"{why_not(scene, plan, track, driven, plan.targets)}, and it is too fast to wait for a gap",
            next_step="choose a target farther on or straight ahead, or make room beside it",
        )


def speeds_reached(scene: Scene, step: EditStep, result: Resimulated) -> list[str]:
    """For each vehicle that is held to a speed, when it reaches it, or how close it comes."""
    found = []
    for key, (wanted, first) in step.speeds.items():
        track = result.tracks.get(key)
        if track is None:
            continue
        speeds = track.motion.speeds_mps[max(first - track.first_step, 0) :]
        near = np.flatnonzero(np.abs(speeds - wanted) <= SPEED_TOLERANCE_MPS)
        if len(near):
            when = (max(first, track.first_step) + int(near[0])) * scene.step_s
            found.append(f"{key} reaches it at {when:.1f} s")
        elif len(speeds):
            closest = float(speeds[np.argmin(np.abs(speeds - wanted))])
            found.append(f"{key} does not reach it, {closest:.1f} m/s at best: {_held_back(scene, track, wanted)}")
    return found


def _is_still_sent_to(scene: Scene, plan: DrivePlan, targets: frozenset[int]) -> bool:
    """Whether the way of a plan still leads to one of some targets, or past it in the lane beside."""
    return bool(targets & (set(plan.lanelets) | _beside(scene, plan)))


def _held_back(scene: Scene, track: TouchedTrack, wanted_mps: float) -> str:
    """Why a speed is not reached: no time, or something in the way."""
    missing = np.abs(track.motion.speeds_mps[-round(1.0 / scene.step_s) - 1 :] - wanted_mps)
    if missing[0] - missing[-1] < STILL_CHANGING_MPS2:
        return "traffic ahead, a junction or a bend holds it back"
    if track.leaves:
        return "it leaves the network before"
    return f"the scenario ends at {scene.last_step * scene.step_s:.1f} s"


def _beside(scene: Scene, plan: DrivePlan) -> set[int]:
    """All lanelets side by side with those of the way."""
    return _beside_any(scene, frozenset(plan.lanelets))


def _beside_any(scene: Scene, lanelets: frozenset[int]) -> set[int]:
    edges = {scene.layout.lane_of[key][0] for key in lanelets if key in scene.layout.lane_of}
    return {key for edge in edges for key in scene.layout.edges[edge]}


def _first_target(plan: DrivePlan, targets: frozenset[int]) -> int:
    return next((key for key in plan.lanelets if key in targets), min(targets))


def _beside_last(scene: Scene, track: TouchedTrack, targets: frozenset[int]) -> int:
    """The target on the edge where the vehicle is last."""
    edge = track.lanes[-1].rpartition("_")[0]
    return min(key for key in targets if scene.layout.lane_of.get(key, ("", 0))[0] == edge)
