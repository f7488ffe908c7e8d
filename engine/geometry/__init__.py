"""Points, polylines and rectangles in the plane, as arrays in metres and radians.

``Points``: TODO.
``Values``: TODO.
``arc_length``: Distance travelled at each vertex, shape (n,), beginning with 0.
``curvatures``: Arc lengths in m about ``spacing_m`` apart, and the size of the curvature there in 1/m, both (n,).
``gaussian``: Gaussian filter along axis 0 with point reflection at the ends, so that the end values stay.
``headings``: Unwrapped heading of every segment in radians, shape (n − 1,).
``interpolate``: Points at the wanted stations (clamped to the ends), shape (m, 2).
``length_m``: Length of the polyline in metres.
``maximum_curvature``: Largest curvature in 1/m after smoothing over ``sigma_m``.
``oriented_rectangle``: Corners of a rectangle (length, width), shape (4, 2), counter-clockwise from the front left.
``point_at``: Point of shape (2,) and heading in radians at an arc length (clamped to the ends).
``project``: Arc length of the nearest point and signed lateral offset (left positive), both in metres.
``project_all``: As :func:`project` for many points of shape (m, 2) at once.
``rectangles_overlap``: Whether two convex quadrilaterals overlap (separating axes), touching by less than
    ``shrink_m`` not counted.
``resample``: ``count`` points evenly spaced along the polyline, ends included.
``without_repeats``: The polyline without vertices that lie closer than the tolerance to the one before.
``wrap_angle``: The angle in [−π, π).
``wrap_angles``: The angles in [−π, π).
``Body``: A vehicle from step 0 on.
``overlaps``: All overlapping pairs, each once, in order.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .polyline import Points as Points
    from .polyline import Values as Values
    from .polyline import arc_length as arc_length
    from .polyline import curvatures as curvatures
    from .polyline import gaussian as gaussian
    from .polyline import headings as headings
    from .polyline import interpolate as interpolate
    from .polyline import length_m as length_m
    from .polyline import maximum_curvature as maximum_curvature
    from .polyline import oriented_rectangle as oriented_rectangle
    from .polyline import point_at as point_at
    from .polyline import project as project
    from .polyline import project_all as project_all
    from .polyline import rectangles_overlap as rectangles_overlap
    from .polyline import resample as resample
    from .polyline import without_repeats as without_repeats
    from .polyline import wrap_angle as wrap_angle
    from .polyline import wrap_angles as wrap_angles
    from .rectangles import Body as Body
    from .rectangles import overlaps as overlaps

__getattr__, __dir__ = lazy_face(__name__, __file__)
