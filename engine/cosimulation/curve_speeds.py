"""Whether a vehicle can slow down enough for the curves of a lanelet route, and how fast it may enter one.

A curve is a piece of 20 m of a lanelet whose centre line bends; it counts from the beginning of the piece on, because a
long lanelet may bend at its far end only. Speeds in m/s, arc lengths in m, curvatures in 1/m.
"""

import math
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from ..geometry import Points, arc_length, curvatures, interpolate, project
from ..scene import Scene
from ..vehicles import comfortable_mps2, hardest_braking_mps2

SMOOTHING_M = 4.0
"""Curvatures are those of a centre line that is smoothed over this length: vertices of a map are corners (chosen)."""
SHORTEST_REST_M = 0.1
"""What is left of a first lanelet at least, so that it is still a line (chosen)."""
_LOOK_M = 700.0
"""A driver at 50 m/s brakes with ease within this (chosen): curves farther on slow no entry."""
PIECE_M = 20.0
"""Length of the pieces (chosen): long enough for a curvature, short enough to tell where a long lanelet bends."""


def first_curve_too_tight(
    scene: Scene, route: tuple[int, ...], position: Points, speed_mps: float, known: Collection[int] = ()
) -> str | None:
    """What is wrong with the first curve of a route that a vehicle at a position (2,) cannot brake enough for, or None.

    ``known``: lanelets whose curves are not asked about.
    """
    hardest = hardest_braking_mps2(scene.friction)
    speed_mps, here_m = max(speed_mps, 0.0), project(scene.layout.table.lanes[route[0]].center, position)[0]
    for key, ahead_m, curvature in _curves_ahead(scene, route, here_m):
        at_best = math.sqrt(max(speed_mps**2 - 2 * hardest * ahead_m, 0.0))
        highest = math.sqrt(hardest / curvature)
        if key not in known and at_best > highest:
            where = f"{ahead_m:.0f} m before" if ahead_m > 0.0 else "in"
            return (
                f"drives {speed_mps:.1f} m/s {where} a bend of lanelet {key} that takes at most {highest:.1f} m/s: "
                "it cannot brake enough"
            )
    return None


def highest_entry_speed(scene: Scene, route: tuple[int, ...], station_m: float) -> float:
    """Speed from which a driver at an arc length of a route's first lanelet brakes with ease for all curves ahead.

    Where the route ends, it is followed as a drive is led on, straight ahead. Infinite where nothing bends.
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
    """Every piece of a route that bends: its lanelet, how far ahead it begins, and its largest curvature.

    ``here_m``: the arc length of the first lanelet from which on they count. Lanelets beside each other begin equally
    far ahead; a piece that has begun is 0 m ahead.
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
    """Where on a line each piece that bends begins, and its largest curvature."""
    stations, curvature = curvatures(line, SMOOTHING_M)
    if len(stations):
        begins = np.arange(0.0, float(stations[-1]), PIECE_M)
        largest = np.maximum.reduceat(curvature, np.searchsorted(stations, begins))
        yield from ((begin, most) for begin, most in zip(begins.tolist(), largest.tolist(), strict=True) if most > 0.0)


def _from(line: Points, station_m: float) -> Points:
    """The part of a line beyond an arc length, or its end where no more is left."""
    stations = arc_length(line)
    begin = min(station_m, float(stations[-1]) - SHORTEST_REST_M)
    return interpolate(line, stations, np.array([begin, *stations[stations > begin]]))
