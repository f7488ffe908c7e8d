"""Sets the speed of each lane: from posted limits, recorded speeds, and curves.

A lane has the posted speed limit, or 50 km/h without one, and more if a vehicle was recorded faster. Curves
lower it, because SUMO slows down for turns inside junctions only (otherwise a quarter of its cars exceed the friction
circle in the curves of edges). On a long lanelet with one curve, that is far too slow for the rest. For such lanelets,
``slow_places`` returns where to slow down. A co-simulation that sets SUMO's speeds step by step uses the result.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...commonroad import limits_mps
from ...geometry import Points, Values, curvatures, length_m, maximum_curvature, unit, without_repeats
from ...vehicles import comfortable_mps2, hardest_braking_mps2
from .layout import NetLayout

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

USUAL_SPEED_MPS = 13.89
"""SUMO's default for a lane: 50 km/h."""
_SLOWEST_CURVE_MPS = 3.0
"""Chosen: kinks of a coarse line have a curvature that no vehicle drives."""
LONG_LANELET_M = 60.0
"""Chosen: on a lanelet no longer than this, slowing down only for its curve gains little."""
_SMOOTHING_M = 4.0
"""Chosen: as in ``geometry.curvatures``."""
_KERNEL = 3.0
"""Standard deviations to either side at which the smoothing kernel ends."""
_RECORDED_NEAR_M = 10.0
"""Chosen: a vehicle recorded within these distances drove through the place at that speed."""


def posted_speeds(network: "LaneletNetwork") -> dict[int, float]:
    """Return the lowest posted speed limit in m/s of each lanelet that has one."""
    limits = {
        int(sign.traffic_sign_id): speeds[0]
        for sign in network.traffic_signs
        for element in sign.traffic_sign_elements
        if (speeds := limits_mps(element))
    }
    posted = {
        int(lanelet.lanelet_id): [limits[sign] for sign in sorted(lanelet.traffic_signs or ()) if sign in limits]
        for lanelet in network.lanelets
    }
    return {key: min(speeds) for key, speeds in posted.items() if speeds}


@dataclass(frozen=True)
class SlowPlaces:
    """Arc lengths (n,) in m on a lane, ascending, and the speed in m/s (n,) in its curve there.

    ``hardest_mps``: the highest speeds (n,) at which tyres hold in these curves.
    """

    stations_m: Values
    speeds_mps: Values
    hardest_mps: Values


def lowered_by_curves(
    layout: NetLayout, straight_mps: Mapping[int, float], friction: float | None = None
) -> dict[int, float]:
    """Return speeds in m/s by lanelet, each at most what its sharpest curve allows on a road with this friction."""
    lanes = layout.table.lanes
    return {key: min(speed, curve_speed(lanes[key].center, friction=friction)) for key, speed in straight_mps.items()}


def straight_speeds(
    layout: NetLayout, recorded_mps: Mapping[int, float], posted_mps: Mapping[int, float] | None = None
) -> dict[int, float]:
    """Return the speed of every lanelet in m/s as if it were straight: equal within an edge.

    Args:
        layout: the network.
        recorded_mps: the fastest speed recorded on each lanelet; a lanelet without one counts as slow.
        posted_mps: the speed limit of each lanelet that has one.
    """
    wanted = {}
    for key in layout.table.lanes:
        limit, recorded = (posted_mps or {}).get(key, USUAL_SPEED_MPS), recorded_mps.get(key, 0.0)
        wanted[key] = recorded * 1.05 if recorded > limit else limit
    for keys in layout.edges.values():
        wanted.update(dict.fromkeys(keys, max(wanted[key] for key in keys)))
    return wanted


def curve_speed(shape: Points, sigma_m: float = _SMOOTHING_M, friction: float | None = None) -> float:
    """Return the speed in m/s at which a polyline's sharpest curve is comfortable; it may be infinite.

    At this speed the curve gives the comfortable lateral acceleration.

    A line shorter than the smoothing kernel loses most of its turn when it is smoothed alone. Its curvature between
    straight extensions therefore counts, too.
    """
    curvature = maximum_curvature(shape, sigma_m)
    if length_m(shape) < 2 * _KERNEL * sigma_m:
        curvature = max(curvature, maximum_curvature(_between_straights(shape, _KERNEL * sigma_m), sigma_m))
    if curvature <= 0.0:
        return math.inf
    return max(_SLOWEST_CURVE_MPS, math.sqrt(comfortable_mps2(friction) / curvature))


def _between_straights(shape: Points, extension_m: float) -> Points:
    """Return a polyline with a straight extension at each end."""
    points = without_repeats(shape)
    if len(points) < 2:
        return points
    before, behind = (extension_m * unit(end) for end in (points[1] - points[0], points[-1] - points[-2]))
    return np.vstack([points[0] - before, points, points[-1] + behind])


def slow_places(
    shape: Points, straight_mps: float, recorded: Sequence[tuple[float, float]] = (), friction: float | None = None
) -> SlowPlaces:
    """Return the points where a polyline's curves require less than a speed, and the speeds there.

    If a vehicle was recorded faster, the speed is higher, up to the limit of the tyres, because an apparent curve may
    be a kink in a coarse line. ``recorded``: arc lengths in m on the polyline, and the recorded speeds at these points.
    """
    stations, curvature = curvatures(shape, _SMOOTHING_M)
    comfortable = comfortable_mps2(friction)
    curved = curvature * straight_mps**2 > comfortable
    at = stations[curved]
    easy = np.maximum(np.sqrt(comfortable / curvature[curved]), _SLOWEST_CURVE_MPS)
    hardest = easy * math.sqrt(hardest_braking_mps2(friction) / comfortable)
    fastest = np.zeros(len(at))
    for station_m, speed_mps in recorded:
        near = np.abs(at - station_m) <= _RECORDED_NEAR_M
        fastest[near] = np.maximum(fastest[near], speed_mps)
    speeds = np.clip(fastest, easy, hardest)
    slow = speeds < straight_mps
    return SlowPlaces(at[slow], speeds[slow], hardest[slow])
