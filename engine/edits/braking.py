"""How a driven vehicle brakes: with its driver's own deceleration, harder only where that comes too late."""

import math

from plannerforge.engine.edits.turn_speed import HARDEST_BRAKING_MPS2

SHORTEST_M = 0.5


def next_speed_mps(
    speed_mps: float, usual_mps2: float, step_s: float, room_m: float, left_m: float, final_mps: float = 0.0
) -> float | None:
    """The speed after the next step of one that shall be slow within some room, and has to within all that is left.

    None while it may drive as it likes. ``usual_mps2``: the driver's own deceleration. ``final_mps``: how slow; it
    stands by default.
    """
    allowed = math.sqrt(final_mps**2 + 2 * usual_mps2 * max(room_m - speed_mps * step_s, 0.0))
    if speed_mps + usual_mps2 * step_s <= allowed:
        return None
    too_fast = allowed < speed_mps - usual_mps2 * step_s
    needed = (speed_mps**2 - final_mps**2) / (2 * max(left_m, SHORTEST_M)) if too_fast else 0.0
    slowest = max(speed_mps - min(max(needed, usual_mps2), HARDEST_BRAKING_MPS2) * step_s, 0.0)
    return max(min(allowed, speed_mps), slowest)
