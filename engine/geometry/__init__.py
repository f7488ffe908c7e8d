"""Points, polylines, curves and rectangles in the plane, as arrays in metres and radians.

``Points``: Type of arrays of points, (n, 2) or (2,), in m.
``Values``: Type of arrays of numbers, (n,).
``PathFollower``: Follows a track along a line that may come back to itself, one position at a time, on its own lap.
``project_along``: Stations and signed offsets (m,) of a track (m, 2), each followed from the one before on its lap.
``hermite``: Points (n, 2) on a cubic curve between two points, in given directions at both ends.
``unit``: A vector (2,) scaled to length 1.
``arc_length``: Arc length in m at each vertex, shape (n,), beginning with 0.
``curvatures``: Arc lengths in m about ``spacing_m`` apart, and the absolute curvature there in 1/m, both (n,).
``gaussian``: Values smoothed along axis 0 over sigma samples, the end values kept.
``headings``: Unwrapped heading of every segment in radians, shape (n − 1,).
``interpolate``: Points (m, 2) at the wanted arc lengths, clamped to the ends.
``length_m``: Length of the polyline in metres.
``maximum_curvature``: Largest curvature in 1/m after smoothing over ``sigma_m``.
``point_at``: Point of shape (2,) and heading in radians at an arc length (clamped to the ends).
``project``: Arc length of the nearest point and signed lateral offset (left positive), both in metres.
``project_all``: As :func:`project` for many points of shape (m, 2) at once.
``resample``: ``count`` points evenly spaced along the polyline, ends included.
``segment_lengths``: Length of every segment in m, shape (n − 1,).
``without_repeats``: The polyline without vertices that lie closer than the tolerance to the one before.
``wrap_angle``: The angle in [−π, π).
``wrap_angles``: The angles in [−π, π).
``meeting_pairs``: Which of many shapes of shapely meet, up to a number of pairs that grows as they do.
``BoxTrack``: A rectangle (length, width in m) at every step from 0 on.
``first_overlaps``: All pairs of tracks that overlap, each with the first step at which they do.
``oriented_rectangle``: Corners of a rectangle (length, width), shape (4, 2), counter-clockwise from the front left.
``rectangles_overlap``: Whether two rectangles overlap by more than ``shrink_m``.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .curves import hermite, unit
    from .following import PathFollower, project_along
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
