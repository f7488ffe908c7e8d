"""Whether a vehicle that is inside a junction can still change to a lanelet beside its own there."""

import math

from plannerforge.engine.edits.changes import DrivePlan, SteeringOver
from plannerforge.engine.edits.lanelet_targets import nearest_driven
from plannerforge.engine.edits.last_lane_change import last_beside, last_place
from plannerforge.engine.edits.resimulation import front_of
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.steering_over import PROGRESS_ACROSS
from plannerforge.engine.edits.turn_speed import HARDEST_LATERAL_MPS2
from plannerforge.engine.geometry.polyline import project
from plannerforge.schemas.errors import NotPossible

USUAL_S = 3.0
"""A driver in no hurry takes so long for a change of lane."""

USUAL_STEEPNESS, STEEPEST = 0.3, 1.0
"""Metres aside for a metre along the lane, at most: 17° in no hurry, 45° of the front bumper where room is short.

The motion is smoothed, and the body follows its front: it turns by less than 25°.
"""

TO_SPARE_M = 0.5
"""A vehicle is across by one step and so much before the lanelets part."""


def steering_over(scene: Scene, plan: DrivePlan, way: tuple[int, ...], who: str) -> SteeringOver | None:
    """How a vehicle changes lanes inside a junction where its way begins so; None where it does not.

    It moves aside by a smooth step, 3p² - 2p³ of the way p: at most 1.5 times as steep as on average, and with at most
    6 v² · aside / way² across.

    Raises:
        NotPossible: it is too near the end of its lanelet for that, or too fast.
    """
    end = last_beside(scene, way, 0)
    if end == 0 or way[0] in scene.layout.lane_of:
        return None
    index, lanes = plan.from_step - plan.start.first_step, scene.layout.table.lanes
    front, speed_mps = front_of(plan.start, index), max(float(plan.start.speeds_mps[index]), 0.0)
    room_m = lanes[way[0]].length_m - project(lanes[way[0]].center, front)[0] + last_place(scene, way, 0, end)[0]
    aside_m = abs(project(lanes[way[end]].center, front)[1])
    to_spare_m = TO_SPARE_M + speed_mps * scene.step_s
    within_m = (room_m - to_spare_m) / PROGRESS_ACROSS
    shortest_m = max(1.5 * aside_m / STEEPEST, speed_mps * math.sqrt(6.0 * aside_m / HARDEST_LATERAL_MPS2))
    if within_m < shortest_m:
        raise NotPossible(
            f"{who} would have to steer over from lanelet {way[0]} to {way[end]} inside a junction: at "
            f"{speed_mps:.1f} m/s that takes {shortest_m * PROGRESS_ACROSS + to_spare_m:.0f} m, and "
            f"{max(room_m, 0.0):.0f} m are left ahead of its front",
            valid=nearest_driven(scene, way[0], [way[-1]]),
            next_step="choose a target farther on or straight ahead",
        )
    usual_m = max(speed_mps * USUAL_S, 1.5 * aside_m / USUAL_STEEPNESS)
    return SteeringOver(way[end], min(usual_m, within_m))
