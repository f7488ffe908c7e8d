"""Why a driven vehicle does not get where, or does not drive as fast as, an edit wants it to."""

import math
from collections.abc import Mapping

import numpy as np

from plannerforge.engine.edits.cascade import Resimulated
from plannerforge.engine.edits.changes import DrivePlan, EditStep
from plannerforge.engine.edits.delays import delay
from plannerforge.engine.edits.driven_way import driven_lanelets
from plannerforge.engine.edits.handover import TouchedTrack
from plannerforge.engine.edits.leaders import in_words
from plannerforge.engine.edits.manoeuvring import LANE_CHANGE_S
from plannerforge.engine.edits.overruled import next_speed, sent_elsewhere
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import Values
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.errors import NotPossible

SPEED_TOLERANCE_MPS = 0.3
STILL_CHANGING_MPS2 = 0.3
MOST_NAMED = 3


def why_not(
    scene: Scene,
    step: EditStep,
    plan: DrivePlan,
    track: TouchedTrack,
    driven: tuple[int, ...],
    targets: frozenset[int],
    others: Mapping[int, Track],
) -> str:
    """The reason for which a vehicle, which drives over these lanelets, gets to none of an edit's targets.

    ``others``: everybody as the edits leave them.
    """
    if sent_elsewhere(step, plan, targets):
        return "a later edit sends it another way"
    since = step.since.get(track.vehicle_id, track.first_step)
    return _held_up(scene, plan, track, driven, targets, since, others)


def check_not_driven_past(scene: Scene, plan: DrivePlan, track: TouchedTrack) -> None:
    """Refuse to send a recorded vehicle to a target that it passes for good.

    One that waits for a gap, or can still come back to its target, is on its way.

    Raises:
        NotPossible: naming the target, and why the vehicle does not get there.
    """
    driven = driven_lanelets(scene, track, plan)
    leads_there = plan.targets & (set(plan.lanelets) | _beside_any(scene, frozenset(plan.lanelets)))
    if plan.cause != "edited" or not leads_there or plan.targets & set(driven):
        return
    ahead = None if track.leaves else scene.lanelet_graph.shortest_route(driven[-1:], sorted(plan.targets))
    if ahead is None:
        reason = _held_up(scene, plan, track, driven, plan.targets, track.first_step, {})
        raise NotPossible(
            f"vehicle {track.vehicle_id} would drive past lanelet {_first_target(plan, plan.targets)}: {reason}, and "
            "it is too fast to wait for a gap",
            next_step="choose a target farther on or straight ahead, or make room beside it",
        )


def speeds_reached(scene: Scene, step: EditStep, result: Resimulated) -> list[str]:
    """For each vehicle that is held to a speed, when it reaches it, or how close it comes and what keeps it from it."""
    found = []
    for key, (wanted, first) in step.speeds.items():
        track = result.tracks.get(key)
        if track is None:
            continue
        later = next_speed(step, result.plans[key])
        until = None if later is None else max(later.from_step - track.first_step + 1, 1)
        speeds = track.motion.speeds_mps[max(first - track.first_step, 0) : until]
        near = np.flatnonzero(np.abs(speeds - wanted) <= SPEED_TOLERANCE_MPS)
        if len(near):
            when = (max(first, track.first_step) + int(near[0])) * scene.step_s
            found.append(f"{key} reaches it at {when:.1f} s")
        elif later is not None:
            held = f"{later.speed_mps:.1f} m/s from {later.from_step * scene.step_s:g} s on"
            found.append(f"{key} does not reach it: another edit holds it to {held}")
        elif len(speeds):
            closest = float(speeds[np.argmin(np.abs(speeds - wanted))])
            found.append(
                f"{key} does not reach it, {closest:.1f} m/s at best: {_held_back(scene, track, speeds, wanted)}"
            )
    return found


def _held_up(
    scene: Scene,
    plan: DrivePlan,
    track: TouchedTrack,
    driven: tuple[int, ...],
    targets: frozenset[int],
    since: int,
    others: Mapping[int, Track],
) -> str:
    """The missing gap if the vehicle was beside a target, else where it is at the end."""
    target, last = _first_target(plan, targets), driven[-1] if driven else plan.lanelets[0]
    ends = f"it leaves the network on lanelet {last}" if track.leaves else _scenario_ends(scene)
    edges = {scene.layout.lane_of[key][0] for key in targets if key in scene.layout.lane_of}
    lane = track.lanes[-1] if track.lanes else ""
    gets_over = not targets.isdisjoint(scene.layout.lanelets_of_lane.get(lane, ()))
    if lane.rpartition("_")[0] in edges and not gets_over:
        missing = "room" if (track.last_step - since) * scene.step_s > LANE_CHANGE_S else "time"
        beside = _beside_last(scene, track, targets)
        return f"no {missing} to change into lanelet {beside} before {ends}{_in_the_way(scene, track)}"
    if set(driven) & _beside_any(scene, targets) and not gets_over:
        return f"no room to change into lanelet {target} before its road ends{_in_the_way(scene, track)}"
    if track.leaves:
        return f"{ends} before lanelet {target}"
    if float(track.motion.speeds_mps[-1]) < 0.1:
        return f"it stands on lanelet {last} when {ends}{delay(scene, track, others, driven)}"
    return f"{ends} while it is on its way to lanelet {target}{delay(scene, track, others, driven)}"


def _in_the_way(scene: Scene, track: TouchedTrack) -> str:
    """Who left no room for a change of lane, in words; empty where nobody is known to."""
    found = [in_words(scene, key) for key in track.in_the_way]
    more = " and others" if len(found) > MOST_NAMED else ""
    return f"; in the way: {', '.join(found[:MOST_NAMED])}{more}" if found else ""


def _held_back(scene: Scene, track: TouchedTrack, speeds: Values, wanted_mps: float) -> str:
    """Why a speed is not reached by the last of those since it was ordered: no time, or something in the way.

    Nothing in the way keeps a vehicle from slowing down, and in less than a second nothing can be told.
    """
    a_second = round(1.0 / scene.step_s)
    gained_mps = float(speeds[-1] - speeds[-a_second - 1]) if len(speeds) > a_second else math.inf
    if speeds[-1] < wanted_mps and gained_mps < STILL_CHANGING_MPS2:
        return "traffic ahead, a junction or a bend holds it back"
    if track.leaves:
        return "it leaves the network before"
    return _scenario_ends(scene)


def _scenario_ends(scene: Scene) -> str:
    return f"the scenario ends at {scene.last_step * scene.step_s:.1f} s"


def _beside_any(scene: Scene, lanelets: frozenset[int]) -> set[int]:
    """All lanelets side by side with any of some."""
    edges = {scene.layout.lane_of[key][0] for key in lanelets if key in scene.layout.lane_of}
    return {key for edge in edges for key in scene.layout.edges[edge]}


def _first_target(plan: DrivePlan, targets: frozenset[int]) -> int:
    return next((key for key in plan.lanelets if key in targets), min(targets))


def _beside_last(scene: Scene, track: TouchedTrack, targets: frozenset[int]) -> int:
    """The target on the edge where the vehicle is last."""
    edge = track.lanes[-1].rpartition("_")[0]
    return min(key for key in targets if scene.layout.lane_of.get(key, ("", 0))[0] == edge)
