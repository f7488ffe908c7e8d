"""Curves of a lanelet route: whether a vehicle can slow down enough for them, and how fast it may enter one.

A curve is a piece of 20 m of a lanelet with a curved centre line; the curve's position is the start of the piece,
because a long lanelet may curve only at its far end. Speeds in m/s, arc lengths in m, curvatures in 1/m.
"""

import math
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from ..geometry import Points, arc_length, curvatures, interpolate, project
from ..scene import Scene
from ..vehicles import comfortable_mps2, hardest_braking_mps2

SMOOTHING_M = 4.0
"""Curvatures are those of a centre line smoothed over this length (chosen): vertices of a map are corners."""
SHORTEST_REST_M = 0.1
"""Least remainder of a first lanelet, so that it is still a line (chosen)."""
_LOOK_M = 700.0
"""A driver at 50 m/s brakes comfortably within this distance (chosen): farther curves do not slow an entry."""
PIECE_M = 20.0
"""Length of the pieces (chosen): long enough for a curvature, short enough to locate a curve on a long lanelet."""


def first_curve_too_tight(
    scene: Scene, route: tuple[int, ...], position: Points, speed_mps: float, known: Collection[int] = ()
) -> str | None:
    """Return why a vehicle at a position (2,) cannot brake enough for a curve of a route, or None.

    The first of these curves counts. ``known``: lanelets that are not checked for curves.
    """
    hardest = hardest_braking_mps2(scene.friction)
    speed_mps, here_m = max(speed_mps, 0.0), project(scene.layout.table.lanes[route[0]].center, position)[0]
    for key, ahead_m, curvature in _curves_ahead(scene, route, here_m):
        at_best = math.sqrt(max(speed_mps**2 - 2 * hardest * ahead_m, 0.0))
        highest = math.sqrt(hardest / curvature)
        if key not in known and at_best > highest:
            where = f"{ahead_m:.0f} m before" if ahead_m > 0.0 else "in"
            return (
                f"drives at {speed_mps:.1f} m/s {where} a curve of lanelet {key} that allows at most {highest:.1f} "
                "m/s: it cannot brake enough"
            )
    return None


def highest_entry_speed(scene: Scene, route: tuple[int, ...], station_m: float) -> float:
    """Return the highest speed at a station of a route's first lanelet that allows comfortable braking for all curves.

    After its end, the route continues straight ahead. The speed is infinite if there are no curves.
    """
    onwards = list(route)
    while sum(scene.layout.table.lanes[key].length_m for key in onwards) < station_m + _LOOK_M:
        following = scene.edge_graph.straight_on(onwards[-1])
        if not following or not set(onwards).isdisjoint(following):
            break
        onwards += following
    curves, comfortable = _curves_ahead(scene, onwards, station_m), comfortable_mps2(scene.friction)
    return min(
        (math.sqrt(comfortable / curvature + 2 * comfortable * ahead_m) for _, ahead_m, curvature in curves),
        default=math.inf,
    )


def _curves_ahead(scene: Scene, route: Sequence[int], here_m: float) -> Iterator[tuple[int, float, float]]:
    """Yield every curved piece of a route: its lanelet, how far ahead it starts, and its largest curvature.

    ``here_m``: the arc length on the first lanelet from which distances are measured. Adjacent lanelets start equally
    far ahead; a piece that has started is 0 m ahead.
    """
    lanes, successors, ahead_m = scene.layout.table.lanes, scene.layout.table.successors, -here_m
    for before, key in zip((None, *route), route, strict=False):
        if before is not None and key in successors[before]:
            ahead_m += lanes[before].length_m
        line = lanes[key].center if before is not None else _from(lanes[key].center, here_m)
        for begin_m, curvature in _curves_of(line):
            away_m = begin_m + (0.0 if before is None else ahead_m)
            if away_m > -PIECE_M:
                yield key, max(away_m, 0.0), curvature


def _curves_of(line: Points) -> Iterator[tuple[float, float]]:
    """Yield the arc length at which each curved piece of a line starts, and its largest curvature."""
    stations, curvature = curvatures(line, SMOOTHING_M)
    if len(stations):
        begins = np.arange(0.0, float(stations[-1]), PIECE_M)
        largest = np.maximum.reduceat(curvature, np.searchsorted(stations, begins))
        yield from ((begin, most) for begin, most in zip(begins.tolist(), largest.tolist(), strict=True) if most > 0.0)


def _from(line: Points, station_m: float) -> Points:
    """Return the part of a line beyond an arc length, or its end if nothing is left."""
    stations = arc_length(line)
    begin = min(station_m, float(stations[-1]) - SHORTEST_REST_M)
    return interpolate(line, stations, np.array([begin, *stations[stations > begin]]))
