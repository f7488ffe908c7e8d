"""Rules on the shape of individual lanelets."""

from collections.abc import Iterator

import numpy as np

from ....schemas.text import counted
from ...commonroad import RoadDocument
from ...geometry import Points, arc_length, headings, length_m, segment_lengths, wrap_angles
from .rule import Defect, rule


@rule("error", why="The centre line is the middle of points with the same number; commonroad-io rejects the lanelet.")
def unequal_bounds(document: RoadDocument) -> Iterator[Defect]:
    """The left and the right bound have different numbers of points."""
    for lanelet in document.lanelets:
        left, right = len(lanelet.left), len(lanelet.right)
        if left != right:
            yield Defect(f"{left} points on the left bound, {right} on the right one", (lanelet.lanelet_id,))


@rule("error", why="A single point has no direction, so nothing can drive along the lanelet.")
def too_few_points(document: RoadDocument) -> Iterator[Defect]:
    """A bound has fewer than two points."""
    for lanelet in document.lanelets:
        for side, bound in lanelet.bounds:
            if len(bound) < 2:
                yield Defect(f"the {side} bound has {counted(len(bound), 'point')}", (lanelet.lanelet_id,))


@rule("error", why="Every length, distance and picture computed from it is undefined.")
def coordinate_not_finite(document: RoadDocument) -> Iterator[Defect]:
    """A coordinate of a bound is missing, infinite or not a number."""
    for lanelet in document.lanelets:
        for side, bound in lanelet.bounds:
            wrong = int((~np.isfinite(bound)).any(axis=1).sum())
            if wrong:
                yield Defect(
                    f"the {side} bound has {counted(wrong, 'point')} that {'is' if wrong == 1 else 'are'} not finite",
                    (lanelet.lanelet_id,),
                )


_SAME_POINT_M = 1e-3
"""Chosen: the distance between points in files with three decimals."""


@rule("warning", why="The heading between them is undefined; planners that divide by the distance fail.")
def repeated_points(document: RoadDocument) -> Iterator[Defect]:
    """Two consecutive points of the centre line are the same."""
    for lanelet in document.drawn:
        for index in np.flatnonzero(segment_lengths(lanelet.center) < _SAME_POINT_M):
            message = f"points {index + 1} and {index + 2} of the centre line are the same"
            yield Defect(message, (lanelet.lanelet_id,), lanelet.center[index])


@rule("error", why="Inside and outside of the lanelet swap, so that positions are assigned to the wrong lanelets.")
def bound_crosses_itself(document: RoadDocument) -> Iterator[Defect]:
    """A bound of a lanelet crosses itself."""
    from shapely import LineString

    for lanelet in document.drawn:
        for side, bound in lanelet.bounds:
            if not LineString(bound).is_simple:
                yield Defect(f"the {side} bound crosses itself", (lanelet.lanelet_id,), bound[0])


@rule("error", why="After the crossing, left and right are swapped: the drivable area is twisted.")
def bounds_cross(document: RoadDocument) -> Iterator[Defect]:
    """The left and the right bound cross each other."""
    from shapely import LineString

    for lanelet in document.drawn:
        left, right = LineString(lanelet.left), LineString(lanelet.right)
        if left.crosses(right):
            place = left.intersection(right).representative_point()
            yield Defect("the bounds cross", (lanelet.lanelet_id,), np.array([place.x, place.y]))


_SHORTEST_TO_COMPARE_M = 0.2
"""Shorter lanelets have hardly any direction; another rule reports them."""


@rule("error", why="The lanelet leads against its own points: vehicles drive the wrong way.")
def bounds_swapped(document: RoadDocument) -> Iterator[Defect]:
    """The left bound is on the right of the right bound, seen in driving direction."""
    for lanelet in document.drawn:
        if length_m(lanelet.center) < _SHORTEST_TO_COMPARE_M:
            continue
        ahead = np.diff(lanelet.center, axis=0)
        widths = lanelet.left - lanelet.right
        across = (widths[:-1] + widths[1:]) / 2
        turned = ahead[:, 0] * across[:, 1] - ahead[:, 1] * across[:, 0]
        if turned.sum() < 0 and (turned < 0).mean() > 0.5:
            yield Defect("the left bound is on the right", (lanelet.lanelet_id,), lanelet.center[0])


_SHORTEST_LANELET_M = 0.1
"""Chosen: shorter than any step of a vehicle."""


@rule("warning", why="Positions and headings on it are meaningless; it only splits the road.")
def too_short(document: RoadDocument) -> Iterator[Defect]:
    """The centre line is shorter than 0.1 m."""
    for lanelet in document.drawn:
        length = length_m(lanelet.center)
        if length < _SHORTEST_LANELET_M:
            yield Defect(f"{length:.3f} m long", (lanelet.lanelet_id,), lanelet.center[0])


_NARROWEST_LANELET_M = 1.5
_NOT_FOR_CARS = frozenset(
    {"sidewalk", "crosswalk", "bicycleLane", "border", "restricted", "restricted_area", "shoulder"}
)
"""Chosen: cars are at least 1.6 m wide."""


@rule("warning", why="Cars are at least 1.6 m wide and cannot stay inside: every run there leaves the road.")
def too_narrow(document: RoadDocument) -> Iterator[Defect]:
    """A lanelet that is open to motor vehicles is narrower than 1.5 m over most of its length."""
    for lanelet in document.drawn:
        width, halfway = lanelet.width_m, lanelet.center[len(lanelet.center) // 2]
        if width < _NARROWEST_LANELET_M and not set(lanelet.types) & _NOT_FOR_CARS:
            yield Defect(f"{width:.2f} m wide", (lanelet.lanelet_id,), halfway)


_WIDEST_LANELET_M = 12.0
"""Chosen: three wide lanes."""


@rule(
    "warning",
    why="Vehicles do not drive along its centre line; probably a lane in between is missing or a bound is wrong.",
)
def too_wide(document: RoadDocument) -> Iterator[Defect]:
    """A lanelet is wider than 12 m over most of its length."""
    for lanelet in document.driven:
        width, halfway = lanelet.width_m, lanelet.center[len(lanelet.center) // 2]
        if width > _WIDEST_LANELET_M:
            yield Defect(f"{width:.1f} m wide", (lanelet.lanelet_id,), halfway)


_SHARPEST_TURN_RAD = np.radians(120)
"""Chosen: more than any corner of a road."""


@rule("warning", why="No vehicle can follow it, and its arc length does not increase with the distance driven.")
def folds_back(document: RoadDocument) -> Iterator[Defect]:
    """The centre line turns by more than 120° at one point."""
    for lanelet in document.driven:
        center = lanelet.path
        turns = np.abs(wrap_angles(np.diff(headings(center)))) if len(center) > 2 else np.zeros(0)
        for index in np.flatnonzero(turns > _SHARPEST_TURN_RAD):
            turn = np.degrees(turns[index])
            yield Defect(f"turns by {turn:.0f}° at one point", (lanelet.lanelet_id,), center[index + 1])


_TIGHTEST_RADIUS_M = 1.0
"""Chosen: far below what a car can drive, so that roughly drawn corners pass."""


@rule("warning", why="Even a car that cuts the corner needs a wider turn (about 5 m at its centre).")
def too_tight(document: RoadDocument) -> Iterator[Defect]:
    """The centre line makes a quarter turn with a radius below 1 m."""
    for lanelet in document.driven:
        radius, place = _tightest_quarter_turn(lanelet.path)
        if radius < _TIGHTEST_RADIUS_M:
            yield Defect(f"a quarter turn of {radius:.1f} m radius", (lanelet.lanelet_id,), place)


def _tightest_quarter_turn(center: Points) -> tuple[float, Points]:
    """Return the radius and beginning of the shortest piece that turns by 90°; infinite if there is none."""
    best, place = float("inf"), center[0]
    if len(center) < 3:
        return best, place
    turned = np.concatenate([[0.0], np.cumsum(wrap_angles(np.diff(headings(center))))])
    if np.ptp(turned) < np.pi / 2:
        return best, place
    ends = arc_length(center)
    stations = (ends[:-1] + ends[1:]) / 2
    for begin in range(len(turned)):
        enough = np.flatnonzero(np.abs(turned[begin:] - turned[begin]) >= np.pi / 2)
        if len(enough):
            distance_m = stations[begin + enough[0]] - stations[begin]
            radius = float(distance_m / abs(turned[begin + enough[0]] - turned[begin]))
            if radius < best:
                best, place = radius, center[begin + 1]
    return best, place
