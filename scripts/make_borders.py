"""Write ``engine/maps/borders.json.gz``, the areas of countries, from Natural Earth 1:10m (public domain).

    python scripts/make_borders.py countries-10m.json

The input is the TopoJSON of the npm package ``world-atlas`` (2.0.2).
"""

import gzip
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from iso3166 import countries_by_numeric
from shapely import coverage_simplify, make_valid
from shapely.geometry import MultiPolygon, Polygon

TARGET = Path(__file__).parent.parent / "engine" / "maps" / "borders.json.gz"
TOLERANCE_DEG = 0.02
UNITS_PER_DEG = 250


def main(source: Path) -> None:
    """Write each country's ISO alpha-3 code (empty if there is no agreed code) and the rings of its areas."""
    topology = json.loads(source.read_bytes())
    scale, offset = topology["transform"]["scale"], topology["transform"]["translate"]
    arcs = [np.cumsum(np.array(arc), axis=0) * scale + offset for arc in topology["arcs"]]
    countries = topology["objects"]["countries"]["geometries"]
    areas = coverage_simplify([_area(country, arcs) for country in countries], TOLERANCE_DEG)
    rows = [[_code(country), _rings(area)] for country, area in zip(countries, areas, strict=True)]
    rows = sorted((row for row in rows if row[1]), key=lambda row: str(row[0]))
    TARGET.write_bytes(gzip.compress(json.dumps(rows, separators=(",", ":")).encode(), 9, mtime=0))


def _code(country: dict[str, Any]) -> str:
    return countries_by_numeric[country["id"]].alpha3 if country.get("id") else ""


def _area(country: dict[str, Any], arcs: list[Any]) -> MultiPolygon:
    outlines = [country["arcs"]] if country["type"] == "Polygon" else country["arcs"]
    rings = [[ring for numbers in outline if len(ring := _ring(numbers, arcs)) >= 4] for outline in outlines]
    valid = make_valid(MultiPolygon([Polygon(one[0], one[1:]) for one in rings if one]))
    parts = [one for part in getattr(valid, "geoms", [valid]) for one in getattr(part, "geoms", [part])]
    return MultiPolygon([one for one in parts if isinstance(one, Polygon)])


def _ring(numbers: list[int], arcs: list[Any]) -> list[list[float]]:
    points: list[list[float]] = []
    for number in numbers:
        arc = arcs[number] if number >= 0 else arcs[~number][::-1]
        points.extend(arc.tolist()[1 if points else 0 :])
    return points


def _rings(area: Any) -> list[list[list[int]]]:
    """Polygons of rings of steps (east, north) in units, the first from (0, 0).

    Rings that vanish on the grid are left out; a country that would vanish (Vatican City) becomes a box around it.
    """
    polygons = [one for one in getattr(area, "geoms", [area]) if not one.is_empty]
    rings = [[_steps(ring) for ring in (polygon.exterior, *polygon.interiors)] for polygon in polygons]
    drawn = [[ring for ring in one if len(ring) >= 8] for one in rings if len(one[0]) >= 8]
    around = area.buffer(1 / UNITS_PER_DEG).envelope
    return drawn if drawn or area.is_empty else [[_steps(around.exterior)]]


def _steps(ring: Any) -> list[int]:
    points = np.round(np.array(ring.coords) * UNITS_PER_DEG).astype(int)
    steps = np.diff(points, axis=0, prepend=0)
    kept: list[int] = steps[np.concatenate([[True], (steps[1:] != 0).any(axis=1)])].ravel().tolist()
    return kept


if __name__ == "__main__":
    main(Path(sys.argv[1]))
