"""Whether a vehicle can still change lanes where a new way needs it."""

import math

from ...schemas.errors import NotPossible
from ..cosimulation import LANE_CHANGE_S, PROGRESS_ACROSS, DrivePlan, JunctionLaneChange, front_of
from ..geometry import project
from ..scene import Scene
from ..vehicles import HARDEST_BRAKING_MPS2, HARDEST_LATERAL_MPS2
from .references import nearest_driven

# ---------- last_lane_change
# Whether a vehicle can still change lanes where a new way needs it.


def check_lane_changes(scene: Scene, plan: DrivePlan, way: tuple[int, ...], who: str) -> None:
    """Refuse a way with a change of lane whose last place the vehicle passes, even if it brakes as hard as it can.

    One that can stop and wait for a gap is sent there, even if it does not get there in time.

    Raises:
        NotPossible: naming the lanelet whose end is too near.
    """
    lanes = scene.layout.table.lanes
    index = plan.from_step - plan.start.first_step
    speed_mps = max(float(plan.start.speeds_mps[index]), 0.0)
    left_m = -project(lanes[way[0]].center, front_of(plan.start, index))[0]
    place = 0
    while place < len(way):
        end = _last_beside(scene, way, place)
        left_m += lanes[way[place]].length_m
        needed_m = min(speed_mps**2 / (2 * HARDEST_BRAKING_MPS2), speed_mps * LANE_CHANGE_S * (end - place))
        room_m, wrong, right = _last_place(scene, way, place, end)
        if end > place and left_m + room_m < needed_m:
            raise NotPossible(
                f"{who} drives {speed_mps:.1f} m/s and lanelet {wrong}, which it has to leave for {right}, "
                f"ends {max(left_m + room_m, 0.0):.0f} m ahead of its front: it can neither change lanes nor stop "
                "before",
                next_step="choose a target farther on or straight ahead",
            )
        place = end + 1


def _last_beside(scene: Scene, way: tuple[int, ...], place: int) -> int:
    """The index of the last lanelet of a row of lane changes that begins at an index (the same without any)."""
    neighbours = scene.lanelet_graph.neighbours
    while place + 1 < len(way) and way[place + 1] in neighbours.get(way[place], ()):
        place += 1
    return place


def _last_place(scene: Scene, way: tuple[int, ...], place: int, end: int) -> tuple[float, int, int]:
    """How much farther on in m the change can still be made, and its last place: the wrong lane, and that of the way.

    The lanes may go on side by side after their end.
    """
    more_m, wrong, right = 0.0, way[place], way[end]
    for onward in way[end + 1 :]:
        straight = scene.lanelet_graph.beside([onward]).intersection(scene.layout.table.successors[wrong]) - {onward}
        if not straight:
            break
        wrong, right = min(straight), onward
        more_m += scene.layout.table.lanes[wrong].length_m
    return more_m, wrong, right


# ---------- lane_change_inside
# Whether a vehicle that is inside a junction can still change to a lanelet beside its own there.

USUAL_S = 3.0
"""A driver in no hurry takes so long for a change of lane."""
USUAL_STEEPNESS, STEEPEST = 0.3, 1.0
"""Metres aside for a metre along the lane, at most: 17° in no hurry, 45° of the front bumper where room is short.

The motion is smoothed, and the body follows its front: it turns by less than 25°.
"""
TO_SPARE_M = 0.5
"""A vehicle is across by one step and so much before the lanelets part."""


def junction_lane_change(scene: Scene, plan: DrivePlan, way: tuple[int, ...], who: str) -> JunctionLaneChange | None:
    """How a vehicle changes lanes inside a junction where its way begins so; None where it does not.

    It moves aside by a smooth step, 3p² - 2p³ of the way p: at most 1.5 times as steep as on average, and with at most
    6 v² · aside / way² across.

    Raises:
        NotPossible: it is too near the end of its lanelet for that, or too fast.
    """
    end = _last_beside(scene, way, 0)
    if end == 0 or way[0] in scene.layout.lane_of:
        return None
    index, lanes = plan.from_step - plan.start.first_step, scene.layout.table.lanes
    front, speed_mps = front_of(plan.start, index), max(float(plan.start.speeds_mps[index]), 0.0)
    room_m = lanes[way[0]].length_m - project(lanes[way[0]].center, front)[0] + _last_place(scene, way, 0, end)[0]
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
    return JunctionLaneChange(way[end], min(usual_m, within_m))
