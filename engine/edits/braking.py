"""How a driven vehicle brakes to a stand: with its driver's own deceleration, harder only where that comes too late."""

import math

from plannerforge.engine.edits.turn_speed import HARDEST_BRAKING_MPS2

SHORTEST_M = 0.5


def next_speed_mps(speed_mps: float, usual_mps2: float, step_s: float, room_m: float, left_m: float) -> float | None:
    """The speed after the next step of one that shall stand within some room, and has to within all that is left.

    None while it may drive as it likes. ``usual_mps2``: the driver's own deceleration.
    """
    allowed = math.sqrt(2 * usual_mps2 * max(room_m - speed_mps * step_s, 0.0))
    if speed_mps + usual_mps2 * step_s <= allowed:
        return None
    needed = 0.0 if allowed >= speed_mps - usual_mps2 * step_s else speed_mps**2 / (2 * max(left_m, SHORTEST_M))
    slowest = max(speed_mps - min(max(needed, usual_mps2), HARDEST_BRAKING_MPS2) * step_s, 0.0)
    return max(min(allowed, speed_mps), slowest)
