"""Whether a vehicle can still change lanes where a new route needs it: before a road ends, and inside a junction.

Distances are in m, speeds in m/s.
"""

import math

from ...schemas.errors import NotPossible
from ..cosimulation import LANE_CHANGE_S, PROGRESS_ACROSS, DrivePlan, JunctionLaneChange, front_of
from ..geometry import project
from ..scene import Scene
from ..vehicles import HARDEST_BRAKING_MPS2, HARDEST_LATERAL_MPS2
from .references import nearest_driven

_USUAL_S = 3.0
"""A driver in no hurry takes this long for a change of lane (chosen)."""
_USUAL_STEEPNESS, _STEEPEST = 0.3, 1.0
"""Metres aside for a metre along the lane, at most: 17° in no hurry, 45° of the front bumper where room is short.

The motion is smoothed, and the body follows its front: it turns by less than 25°.
"""
_TO_SPARE_M = 0.5
"""A vehicle is across by one step and this before the lanelets part (chosen)."""


def check_lane_changes(scene: Scene, plan: DrivePlan, route: tuple[int, ...], who: str) -> None:
    """Refuse a route with a change of lane whose last place the vehicle passes, even if it brakes as hard as it can.

    One that can stop and wait for a gap is sent there, even if it does not get there in time.

    Raises:
        NotPossible: naming the lanelet whose end is too near.
    """
    lanes = scene.layout.table.lanes
    index = plan.from_step - plan.start.first_step
    speed_mps = max(float(plan.start.speeds_mps[index]), 0.0)
    left_m = -project(lanes[route[0]].center, front_of(plan.start, index))[0]
    place = 0
    while place < len(route):
        end = _last_beside(scene, route, place)
        left_m += lanes[route[place]].length_m
        needed_m = min(speed_mps**2 / (2 * HARDEST_BRAKING_MPS2), speed_mps * LANE_CHANGE_S * (end - place))
        room_m, wrong, right = _last_place(scene, route, place, end)
        if end > place and left_m + room_m < needed_m:
            raise NotPossible(
                f"{who} drives {speed_mps:.1f} m/s and lanelet {wrong}, which it has to leave for {right}, "
                f"ends {max(left_m + room_m, 0.0):.0f} m ahead of its front: it can neither change lanes nor stop "
                "before",
                next_step="choose a target farther on or straight ahead",
            )
        place = end + 1


def _last_beside(scene: Scene, route: tuple[int, ...], place: int) -> int:
    """The index of the last lanelet of a row of lane changes that begins at an index (the same without any)."""
    neighbours = scene.lanelet_graph.neighbours
    while place + 1 < len(route) and route[place + 1] in neighbours.get(route[place], ()):
        place += 1
    return place


def _last_place(scene: Scene, route: tuple[int, ...], place: int, end: int) -> tuple[float, int, int]:
    """How much farther on in m the change can still be made, and its last place: the wrong lane, and that of the route.

    The lanes may go on side by side after their end.
    """
    more_m, wrong, right = 0.0, route[place], route[end]
    for onward in route[end + 1 :]:
        straight = scene.lanelet_graph.beside([onward]).intersection(scene.layout.table.successors[wrong]) - {onward}
        if not straight:
            break
        wrong, right = min(straight), onward
        more_m += scene.layout.table.lanes[wrong].length_m
    return more_m, wrong, right


def junction_lane_change(scene: Scene, plan: DrivePlan, route: tuple[int, ...], who: str) -> JunctionLaneChange | None:
    """How a vehicle changes lanes inside a junction where its route begins with that; None where it does not.

    It moves aside by a smooth step, 3p² - 2p³ after the share p of the length: at most 1.5 times as steep as on
    average, and with a lateral acceleration of at most 6 v² · aside / length².

    Raises:
        NotPossible: it is too near the end of its lanelet for that, or too fast.
    """
    end = _last_beside(scene, route, 0)
    if end == 0 or route[0] in scene.layout.lane_of:
        return None
    index, lanes = plan.from_step - plan.start.first_step, scene.layout.table.lanes
    front, speed_mps = front_of(plan.start, index), max(float(plan.start.speeds_mps[index]), 0.0)
    room_m = lanes[route[0]].length_m - project(lanes[route[0]].center, front)[0] + _last_place(scene, route, 0, end)[0]
    aside_m = abs(project(lanes[route[end]].center, front)[1])
    to_spare_m = _TO_SPARE_M + speed_mps * scene.step_s
    within_m = (room_m - to_spare_m) / PROGRESS_ACROSS
    shortest_m = max(1.5 * aside_m / _STEEPEST, speed_mps * math.sqrt(6.0 * aside_m / HARDEST_LATERAL_MPS2))
    if within_m < shortest_m:
        raise NotPossible(
            f"{who} would have to steer over from lanelet {route[0]} to {route[end]} inside a junction: at "
            f"{speed_mps:.1f} m/s that takes {shortest_m * PROGRESS_ACROSS + to_spare_m:.0f} m, and "
            f"{max(room_m, 0.0):.0f} m are left ahead of its front",
            valid=nearest_driven(scene, route[0], [route[-1]]),
            next_step="choose a target farther on or straight ahead",
        )
    usual_m = max(speed_mps * _USUAL_S, 1.5 * aside_m / _USUAL_STEEPNESS)
    return JunctionLaneChange(route[end], min(usual_m, within_m))
