"""How fast a path can be driven so that its bends stay comfortable."""

import numpy as np

from plannerforge.engine.geometry.polyline import Values, gaussian

SMOOTHING_M = 3.0
STRAIGHT_PER_M = 1e-4
"""Curvature in 1/m below which a path counts as straight."""


def bend_speeds_mps(
    stations_m: Values,
    headings_rad: Values,
    lateral_acceleration_mps2: float,
    deceleration_mps2: float,
    smoothing_m: float = SMOOTHING_M,
) -> Values:
    """The highest speeds along a path, shape (n,), at which no bend needs a larger lateral acceleration v² · curvature.

    ``stations_m`` and ``headings_rad`` of shape (n,). Before a bend the speed falls by the deceleration, so that
    v² = v_next² + 2 · deceleration · distance. The curvature is smoothed over ``smoothing_m``.
    """
    spacing_m = float(np.mean(np.diff(stations_m)))
    curvature = np.abs(gaussian(np.gradient(headings_rad, stations_m), smoothing_m / spacing_m))
    squared = lateral_acceleration_mps2 / np.maximum(curvature, STRAIGHT_PER_M)
    # with E = v² + 2·b·s the condition is that no later E is smaller
    energy = squared + 2.0 * deceleration_mps2 * stations_m
    least = np.minimum.accumulate(energy[::-1])[::-1]
    speeds: Values = np.sqrt(least - 2.0 * deceleration_mps2 * stations_m)
    return speeds
