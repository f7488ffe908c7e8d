"""What is said about edits that were carried out: routes, arrival, feasibility, collisions."""

import numpy as np

from plannerforge.engine.edits.cascade import Resimulated
from plannerforge.engine.edits.changes import DrivePlan, EditStep
from plannerforge.engine.edits.handover import TouchedTrack
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.traffic.feasibility import check_kinematics
from plannerforge.schemas.modification import (
    LETTERS,
    EditCollision,
    EditReport,
    ModificationRequest,
    TouchedVehicle,
    VehicleRoute,
)


def edit_reports(
    request: ModificationRequest, scene: Scene, steps: tuple[EditStep, ...], result: Resimulated
) -> tuple[EditReport, ...]:
    """One report per edit of this request; those of earlier requests are not repeated."""
    found = []
    for index in range(request.earlier, len(request.edits)):
        edit, step = request.edits[index], steps[index]
        driven = [key for key in step.vehicles if key in result.tracks]
        routes = tuple(vehicle_route(scene, result.plans[key], result.tracks[key]) for key in driven)
        found.append(
            EditReport(
                index=index - request.earlier,
                op=edit.op,
                letter=LETTERS[edit.op],
                done=True,
                what=step.what,
                vehicles=step.vehicles,
                routes=routes,
            )
        )
    return tuple(found)


def vehicle_route(scene: Scene, plan: DrivePlan, track: TouchedTrack) -> VehicleRoute:
    """The lanelets that a vehicle drives, as simulated, and whether it gets where it is sent."""
    driven = driven_lanelets(scene, track, plan)
    if not plan.targets:
        return VehicleRoute(vehicle_id=track.vehicle_id, lanelets=driven)
    arrives = bool(plan.targets & set(driven))
    reason = "" if arrives else _why_not(scene, plan, track, driven)
    way = driven if arrives else plan.lanelets
    return VehicleRoute(vehicle_id=track.vehicle_id, lanelets=way, arrives=arrives, reason=reason)


def driven_lanelets(scene: Scene, track: TouchedTrack, plan: DrivePlan) -> tuple[int, ...]:
    """Lanelets under the front bumper of the driven part, in order, as SUMO assigns its lanes."""
    found = list(plan.lanelets[:1]) if track.first_step == plan.start.first_step else []
    for lane in track.lanes:
        for key in scene.layout.lanelets_of_lane.get(lane, ()):
            if key not in found[-4:]:
                found.append(key)
    return tuple(found)


def touched_vehicles(scene: Scene, result: Resimulated) -> tuple[TouchedVehicle, ...]:
    """Feasibility and hand-over of every touched vehicle."""
    return tuple(_touched(scene, result.plans[key], track) for key, track in result.tracks.items())


def reported_collisions(scene: Scene, result: Resimulated) -> tuple[EditCollision, ...]:
    """The overlaps that are left, in time order."""
    return tuple(
        EditCollision(vehicles=(hit.first, hit.second), time_s=round(hit.step * scene.step_s, 3))
        for hit in result.overlaps
    )


def _touched(scene: Scene, plan: DrivePlan, track: TouchedTrack) -> TouchedVehicle:
    verdict = check_kinematics(track.motion, scene.step_s)
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


def _why_not(scene: Scene, plan: DrivePlan, track: TouchedTrack, driven: tuple[int, ...]) -> str:
    target = next((key for key in plan.lanelets if key in plan.targets), plan.lanelets[-1])
    if track.leaves:
        return f"it leaves the network on lanelet {driven[-1] if driven else plan.lanelets[0]} before lanelet {target}"
    lane = scene.layout.lane_of.get(target)
    speed = float(track.motion.speeds_mps[-1])
    if lane and track.lanes and track.lanes[-1].rpartition("_")[0] == lane[0]:
        return f"no room to change into lanelet {target} before the end at {scene.last_step * scene.step_s:.1f} s"
    if speed < 0.1:
        return f"it stands on lanelet {driven[-1] if driven else plan.lanelets[0]} when the scenario ends"
    return f"the scenario ends at {scene.last_step * scene.step_s:.1f} s while it is on its way to lanelet {target}"
