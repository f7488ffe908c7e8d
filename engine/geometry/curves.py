"""Cubic curves between two points with given directions at both ends.

They draw paths across junctions, bounds of lanelets, and lane changes of reference paths. The formula does not use
``scipy.interpolate.CubicHermiteSpline``, which evaluates powers of the distance from a knot. Its result differs in the
last bits, so the paths that planners follow, and their recorded runs, would change.
"""

import numpy as np

from .polyline import Points, Values


def hermite(
    start: Points,
    start_direction: Points,
    end: Points,
    end_direction: Points,
    shares: Values,
    reaches_m: tuple[float, float] | tuple[Values, Values] | None = None,
) -> Points:
    """Return points (n, 2) on the cubic Hermite curve between two points (2,), in metres.

    Args:
        start: The start of the curve.
        start_direction: Unit vector (2,) of its direction at the start.
        end: The end of the curve.
        end_direction: Unit vector (2,) of its direction at the end.
        shares: Parameters (n,) of the points, from 0 at the start to 1 at the end.
        reaches_m: Lengths of the tangents at both ends: the larger, the longer the curve keeps its direction at that
            end. The default is the distance between the ends. A Bézier curve has tangents of three times the distance
            of its inner control points from the ends. Arrays (k, 1, 1) of lengths give k curves, shape (k, n, 2).
    """
    leave, arrive = reaches_m or (float(np.linalg.norm(end - start)),) * 2
    u = shares[:, None]
    curve: Points = (
        (2 * u**3 - 3 * u**2 + 1) * start
        + (u**3 - 2 * u**2 + u) * start_direction * leave
        + (3 * u**2 - 2 * u**3) * end
        + (u**3 - u**2) * end_direction * arrive
    )
    return curve


def unit(vector: Points) -> Points:
    """Return a vector (2,) scaled to length 1; a vector of almost zero length stays unchanged."""
    scaled: Points = vector / max(float(np.linalg.norm(vector)), 1e-9)
    return scaled
