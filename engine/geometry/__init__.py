"""Points, polylines, curves and rectangles in the plane, as arrays in metres and radians.

``Points``: The type of arrays of points, (n, 2) or (2,), in m.
``Values``: The type of arrays of numbers, (n,).
``PathFollower``: Follows a track along a line that may return to itself, one position at a time, on the track's lap.
``project_along``: Returns stations and signed offsets (m,) of a track (m, 2), projected with continuity.
``hermite``: Returns points (n, 2) on a cubic curve between two points, with given directions at both ends.
``unit``: Scales a vector (2,) to length 1.
``arc_length``: Returns the arc length in m at each vertex, shape (n,), starting with 0.
``curvatures``: Returns arc lengths in m about ``spacing_m`` apart, and the absolute curvature there in 1/m, both (n,).
``gaussian``: Smooths values along axis 0 over sigma samples, and keeps the end values.
``headings``: Returns the unwrapped heading of every segment in radians, shape (n − 1,).
``interpolate``: Returns points (m, 2) at given arc lengths, clamped to the ends.
``length_m``: Returns the length of the polyline in metres.
``maximum_curvature``: Returns the largest curvature in 1/m after smoothing over ``sigma_m``.
``point_at``: Returns the point of shape (2,) and heading in radians at an arc length (clamped to the ends).
``project``: Returns the arc length of the nearest point and the signed lateral offset (left positive), in metres.
``project_all``: Projects many points of shape (m, 2) at once, as :func:`project` does.
``resample``: Returns ``count`` points evenly spaced along the polyline, including the ends.
``segment_lengths``: Returns the length of every segment in m, shape (n − 1,).
``without_repeats``: Returns the polyline without vertices that are nearer than the tolerance to the previous one.
``wrap_angle``: Wraps an angle to [−π, π).
``wrap_angles``: Wraps angles to [−π, π).
``Lookup``: Interpolates single values in a table, as ``np.interp`` does but faster.
``meeting_pairs``: Returns the pairs of shapely shapes that meet, up to a number of pairs that grows with the shapes.
``BoxTrack``: A rectangle (length, width in m) at every step from 0.
``first_overlaps``: Returns all pairs of tracks that overlap, each with its first step of overlap.
``oriented_rectangle``: Returns a rectangle's corners (length, width), (4, 2), counter-clockwise from the front left.
``rectangles_overlap``: Returns True if two rectangles overlap by more than ``shrink_m``.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .curves import hermite, unit
    from .following import PathFollower, project_along
    from .lookup import Lookup
    from .pairs import meeting_pairs
    from .polyline import (
        Points,
        Values,
        arc_length,
        curvatures,
        gaussian,
        headings,
        interpolate,
        length_m,
        maximum_curvature,
        point_at,
        project,
        project_all,
        resample,
        segment_lengths,
        without_repeats,
        wrap_angle,
        wrap_angles,
    )
    from .rectangles import BoxTrack, first_overlaps, oriented_rectangle, rectangles_overlap

__getattr__, __dir__ = lazy_face(__name__, __file__)
