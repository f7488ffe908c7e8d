"""Finds what is nearby on a map in n log n time, even in crowded areas.

A long line is examined in short pieces, because its distance to a point costs as much as it has nodes.
"""

import math
from collections.abc import Iterable, Sequence

from ..osm import EARTH_RADIUS_M, ground_distance_m

Place = tuple[float, float]
"""Latitude and longitude in degrees."""
_PIECE_NODES = 32
"""Nodes of a piece of a line (chosen)."""


class Gathering:
    """A set of positions at least ``reach_m`` apart.

    Positions are sorted into cubes with an edge length of ``reach_m``, in Earth-centred coordinates. A chord is never
    longer than the distance on the ground, so a position within reach is in the same cube or in an adjacent one.
    """

    def __init__(self, reach_m: float) -> None:
        self._reach_m = reach_m
        self._cubes: dict[tuple[int, int, int], list[int]] = {}
        self.positions: list[Place] = []

    def near(self, position: Place) -> int | None:
        """Return the number (from 0) of the first position closer than the reach, or None if there is none."""
        x, y, z = self._cube(position)
        around = (
            self._cubes.get((x + i, y + j, z + k), ()) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)
        )
        found = (
            number
            for numbers in around
            for number in numbers
            if ground_distance_m(position, self.positions[number]) < self._reach_m
        )
        return min(found, default=None)

    def add(self, position: Place) -> int:
        """Add a position that is not near any other position; return its number."""
        self.positions.append(position)
        self._cubes.setdefault(self._cube(position), []).append(len(self.positions) - 1)
        return len(self.positions) - 1

    def _cube(self, position: Place) -> tuple[int, int, int]:
        latitude, longitude = (math.radians(angle) for angle in position)
        aside = EARTH_RADIUS_M * math.cos(latitude)
        x, y, z = aside * math.cos(longitude), aside * math.sin(longitude), EARTH_RADIUS_M * math.sin(latitude)
        return math.floor(x / self._reach_m), math.floor(y / self._reach_m), math.floor(z / self._reach_m)


class Surroundings:
    """Points, lines and areas in metres, searched by distance from a point.

    Args:
        lines: each a sequence of (x, y); a line with a single vertex is a point.
        areas: outlines of areas, closed or not.
    """

    def __init__(
        self, lines: Sequence[Sequence[tuple[float, float]]], areas: Iterable[Sequence[tuple[float, float]]] = ()
    ) -> None:
        from shapely import LineString, Point, Polygon, STRtree

        shapes: list[Point | LineString | Polygon] = []
        self._owners: list[int] = []
        for number, line in enumerate(lines):
            pieces = [line[begin : begin + _PIECE_NODES + 1] for begin in range(0, max(len(line) - 1, 1), _PIECE_NODES)]
            shapes += [LineString(piece) if len(piece) > 1 else Point(piece[0]) for piece in pieces]
            self._owners += [number] * len(pieces)
        shapes += [Polygon(outline) for outline in areas]
        self._tree = STRtree(shapes)

    @property
    def is_empty(self) -> bool:
        """Whether there are no points, lines or areas."""
        return len(self._tree) == 0

    def any_within(self, point: tuple[float, float], distance_m: float) -> bool:
        """Return whether any point, line or area is within a distance of a point."""
        from shapely import Point

        nearest = self._tree.query_nearest(Point(*point), max_distance=distance_m, all_matches=False)
        return len(nearest) > 0

    def lines_within(self, point: tuple[float, float], distance_m: float) -> list[int]:
        """Return the numbers (from 0) of the lines within a distance of a point, in ascending order."""
        from shapely import Point

        pieces = self._tree.query(Point(*point), "dwithin", distance_m)
        return sorted({self._owners[piece] for piece in pieces if piece < len(self._owners)})
