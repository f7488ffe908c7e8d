"""Cubic curves between two points with given directions at both ends.

They draw ways over junctions, bounds of lanelets and lane changes of reference paths. The formula stands here and not
in ``scipy.interpolate.CubicHermiteSpline``, whose result differs in the last bits: it evaluates powers of the distance
from a knot, and paths that planners follow, so also their recorded runs, would change.
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
    """Points (n, 2) on the cubic Hermite curve between two points (2,), in metres.

    Args:
        start: where the curve begins.
        start_direction: unit vector (2,) in which it leaves.
        end: where the curve ends.
        end_direction: unit vector (2,) in which it arrives.
        shares: parameters (n,) of the points, from 0 at the start to 1 at the end.
        reaches_m: lengths of the tangents at both ends: the larger, the longer the curve keeps its direction there.
            The distance between the ends where not given. A Bézier curve has tangents of three times the distance of
            its inner control points from the ends. Arrays (k, 1, 1) of them give as many curves, shape (k, n, 2).
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
    """A vector (2,) scaled to length 1; one that is nearly zero stays so."""
    scaled: Points = vector / max(float(np.linalg.norm(vector)), 1e-9)
    return scaled
