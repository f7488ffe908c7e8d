"""How far a recorded vehicle gets on its way although it brakes as hard as it can."""

from plannerforge.engine.edits.turn_speed import HARDEST_BRAKING_MPS2
from plannerforge.engine.geometry.polyline import Points, arc_length, oriented_rectangle, rectangles_overlap
from plannerforge.engine.scenarios.tracks import Track

REACTION_S = 0.5
"""The least time after which a driver brakes hard."""


def stopping_way_m(speed_mps: float) -> float:
    """The way in m in which a driver stops from a speed, or in which he loses one by which he comes closer."""
    return speed_mps * REACTION_S + speed_mps**2 / (2 * HARDEST_BRAKING_MPS2)


def gets_onto(coming: Track, step: int, center: Points, heading_rad: float, size_m: tuple[float, float]) -> bool:
    """Whether a vehicle gets onto a rectangle (length, width) on its recorded way if it brakes hard from a step on."""
    index = coming.index_at(step)
    if index is None:
        return False
    speed_mps = max(float(coming.speeds_mps[index]), 0.0)
    stops_after_m = stopping_way_m(speed_mps)
    place, size = oriented_rectangle(center, heading_rad, size_m), (coming.length_m, coming.width_m)
    count = int((arc_length(coming.positions[index:]) <= stops_after_m).sum())
    return any(
        rectangles_overlap(oriented_rectangle(coming.positions[at], float(coming.headings_rad[at]), size), place)
        for at in range(index, index + count)
    )
