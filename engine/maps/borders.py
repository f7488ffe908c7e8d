"""Which country a map lies in, from a table of borders: Natural Earth 1:10m, public domain, simplified to about 2 km.

The table is coarse, so the answer is cautious: near a border, where it could be wrong, there is none.
"""

import gzip
import json
import math
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING

from plannerforge.engine.maps.osm_reader import ground_distance_m

if TYPE_CHECKING:
    from shapely import Polygon, STRtree

TABLE = Path(__file__).parent / "borders.json.gz"
UNITS_PER_DEG = 250
DOUBT_M = 6000.0
"""The table may be off by so much: its simplification, its grid and the scale of its source together."""


def country_of(bounds: tuple[float, float, float, float]) -> str | None:
    """ISO 3166-1 alpha-3 code of the only country within ``DOUBT_M`` of a box (south, west, north, east) in degrees.

    None at sea, near a border, and in areas that several countries claim.
    """
    near = countries_near(bounds)
    return near[0] if len(near) == 1 else None


def countries_near(bounds: tuple[float, float, float, float]) -> tuple[str, ...]:
    """Codes of all countries within ``DOUBT_M`` of a box, sorted; none at sea and in areas that several claim."""
    from shapely import box

    south, west, north, east = bounds
    up = DOUBT_M / ground_distance_m((0.0, 0.0), (1.0, 0.0))
    aside = up / max(math.cos(math.radians(max(abs(south), abs(north)))), 0.05)
    tree, codes = _table()
    near = tree.query(box(west - aside, south - up, east + aside, north + up), predicate="intersects")
    found = {codes[index] for index in near.tolist()}
    return () if "" in found else tuple(sorted(found))


@lru_cache(maxsize=1)
def _table() -> tuple["STRtree", tuple[str, ...]]:
    """A tree of all areas with the code of each."""
    from shapely import STRtree

    rows = json.loads(gzip.decompress(TABLE.read_bytes()))
    areas = [(code, _polygon(rings)) for code, polygons in rows for rings in polygons]
    return STRtree([area for _, area in areas]), tuple(code for code, _ in areas)


def _polygon(rings: list[list[int]]) -> "Polygon":
    """The area inside the first ring and outside the others; a ring is steps (east, north) from (0, 0) in units."""
    from shapely import Polygon

    lines = [list(zip(_summed(steps[::2]), _summed(steps[1::2]), strict=True)) for steps in rings]
    area: Polygon = Polygon(lines[0], lines[1:])
    return area if area.is_valid else area.buffer(0)


def _summed(steps: list[int]) -> list[float]:
    return [units / UNITS_PER_DEG for units in accumulate(steps)]
