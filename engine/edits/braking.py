"""How a driven vehicle brakes: with its driver's own deceleration, harder only where that comes too late."""

import math

import numpy as np

from plannerforge.engine.edits.turn_speed import HARDEST_BRAKING_MPS2
from plannerforge.engine.geometry.polyline import Values

SHORTEST_M = 0.5


def next_speed_mps(
    speed_mps: float,
    usual_mps2: float,
    step_s: float,
    room_m: float | Values,
    left_m: float | Values,
    final_mps: float | Values = 0.0,
) -> float | None:
    """The speed after the next step of one that shall be slow within some room, and has to within all that is left.

    None while it may drive as it likes. ``usual_mps2``: the driver's own deceleration. ``final_mps``: how slow; it
    stands by default. There may be several places (n,) with the room up to each and the speed there.
    """
    room_m = np.maximum(room_m - speed_mps * step_s, 0.0)
    allowed = math.sqrt(float(np.min(final_mps**2 + 2 * usual_mps2 * room_m)))
    if speed_mps + usual_mps2 * step_s <= allowed:
        return None
    too_fast = allowed < speed_mps - usual_mps2 * step_s
    needed = float(np.max((speed_mps**2 - final_mps**2) / (2 * np.maximum(left_m, SHORTEST_M)))) if too_fast else 0.0
    slowest = max(speed_mps - min(max(needed, usual_mps2), HARDEST_BRAKING_MPS2) * step_s, 0.0)
    return max(min(allowed, speed_mps), slowest)
