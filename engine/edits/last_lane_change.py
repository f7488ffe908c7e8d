"""Whether a vehicle can still change lanes where a new way needs it."""

from plannerforge.engine.edits.changes import DrivePlan
from plannerforge.engine.edits.manoeuvring import LANE_CHANGE_S
from plannerforge.engine.edits.resimulation import front_of
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.edits.turn_speed import HARDEST_BRAKING_MPS2
from plannerforge.engine.geometry.polyline import project
from plannerforge.schemas.errors import NotPossible


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
        end = last_beside(scene, way, place)
        left_m += lanes[way[place]].length_m
        needed_m = min(speed_mps**2 / (2 * HARDEST_BRAKING_MPS2), speed_mps * LANE_CHANGE_S * (end - place))
        room_m, wrong, right = last_place(scene, way, place, end)
        if end > place and left_m + room_m < needed_m:
            raise NotPossible(
                f"{who} drives {speed_mps:.1f} m/s and lanelet {wrong}, which it has to leave for {right}, "
                f"ends {max(left_m + room_m, 0.0):.0f} m ahead of its front: it can neither change lanes nor stop "
                "before",
                next_step="choose a target farther on or straight ahead",
            )
        place = end + 1


def last_beside(scene: Scene, way: tuple[int, ...], place: int) -> int:
    """The index of the last lanelet of a row of lane changes that begins at an index (the same without any)."""
    neighbours = scene.lanelet_graph.neighbours
    while place + 1 < len(way) and way[place + 1] in neighbours.get(way[place], ()):
        place += 1
    return place


def last_place(scene: Scene, way: tuple[int, ...], place: int, end: int) -> tuple[float, int, int]:
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
