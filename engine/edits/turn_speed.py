"""Whether a vehicle can still slow down enough for the bends of a new way."""

import math

from plannerforge.engine.edits.changes import DrivePlan
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import maximum_curvature, project
from plannerforge.schemas.errors import NotPossible

HARDEST_BRAKING_MPS2 = 8.0
HARDEST_LATERAL_MPS2 = 8.0
"""What tyres hold on a dry road; comfort is half of it."""

SMOOTHING_M = 4.0


def check_bends(scene: Scene, plan: DrivePlan, way: tuple[int, ...], who: str) -> None:
    """Refuse a way with a bend that the vehicle comes to too fast, even if it brakes as hard as it can.

    Lanelets of the recorded way are left out: the vehicle was recorded in their bends.

    Raises:
        NotPossible: naming the lanelet, the speed there at best and the highest that its bend takes.
    """
    lanes = scene.layout.table.lanes
    index = plan.from_step - plan.start.first_step
    recorded = scene.matches.get(plan.start.obstacle_id)
    known = set(recorded.sequence) if recorded is not None and plan.cause != "added" else set()
    speed = max(float(plan.start.speeds_mps[index]), 0.0)
    ahead_m = -project(lanes[way[0]].center, plan.start.positions[index])[0]
    for before, key in zip((None, *way), way, strict=False):
        if before is not None and key in scene.layout.table.successors[before]:
            ahead_m += lanes[before].length_m
        curvature = maximum_curvature(lanes[key].center, SMOOTHING_M)
        if key in known or curvature <= 0.0:
            continue
        at_best = math.sqrt(max(speed**2 - 2 * HARDEST_BRAKING_MPS2 * max(ahead_m, 0.0), 0.0))
        highest = math.sqrt(HARDEST_LATERAL_MPS2 / curvature)
        if at_best > highest:
            raise NotPossible(
                f"{who} drives {speed:.1f} m/s {max(ahead_m, 0.0):.0f} m before lanelet {key}, whose bend takes "
                f"at most {highest:.1f} m/s: it cannot brake enough",
                next_step="choose a target straight ahead, or remove the vehicle and add one that starts slower",
            )
