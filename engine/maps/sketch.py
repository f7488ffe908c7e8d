"""Drawing small maps: roads in metres on paper become OpenStreetMap XML at a place in the open sea."""

import math
from dataclasses import dataclass, field
from pathlib import Path

from lxml import etree

from plannerforge.engine.maps.osm_reader import EARTH_RADIUS_M

Point = tuple[float, float]


@dataclass
class Sketch:
    """A map being drawn; points are metres east and north of the origin, given in degrees.

    Roads that name the same point meet there. Ids count from 1 in the order of drawing.
    """

    place: str
    latitude: float
    longitude: float
    nodes: dict[Point, dict[str, str]] = field(default_factory=dict)
    ways: list[tuple[list[Point], dict[str, str]]] = field(default_factory=list)

    def road(self, points: list[Point], highway: str, name: str = "", **tags: str | int) -> None:
        """Draw a road along the points; tag names are written with ``_`` for ``:``."""
        rounded = [(round(x, 2), round(y, 2)) for x, y in points]
        line = [point for index, point in enumerate(rounded) if index == 0 or point != rounded[index - 1]]
        for point in line:
            self.nodes.setdefault(point, {})
        found = {"highway": highway, **{key.replace("_", ":"): str(value) for key, value in tags.items()}}
        self.ways.append((line, found | ({"name": name} if name else {})))

    def mark(self, point: Point, **tags: str) -> None:
        """Tag a point."""
        self.nodes.setdefault((round(point[0], 2), round(point[1], 2)), {}).update(tags)

    def area(self, points: list[Point], landuse: str) -> None:
        """Draw an area; the last point closes it."""
        line = [*points, points[0]]
        for point in line:
            self.nodes.setdefault(point, {})
        self.ways.append((line, {"landuse": landuse}))

    def write(self, path: Path) -> None:
        """Write the map; the same drawing gives the same bytes."""
        attributes = {"version": "0.6", "generator": "PlannerForge", "attribution": "PlannerForge, MIT"}
        root = etree.Element("osm", attributes)
        corners = [self._degrees(point) for point in self.nodes]
        south, west = min(corner[0] for corner in corners), min(corner[1] for corner in corners)
        north, east = max(corner[0] for corner in corners), max(corner[1] for corner in corners)
        box = {"minlat": south, "minlon": west, "maxlat": north, "maxlon": east}
        etree.SubElement(root, "bounds", {key: f"{value:.7f}" for key, value in box.items()})
        middle = {"place": "town", "name": self.place, "addr:country": "ZAM"}
        ids = {point: number for number, point in enumerate(self.nodes, start=2)}
        self._write_node(root, 1, (0.0, 0.0), middle)
        for point, tags in self.nodes.items():
            self._write_node(root, ids[point], point, tags)
        for number, (line, tags) in enumerate(self.ways, start=1):
            way = etree.SubElement(root, "way", {"id": str(number), "visible": "true", "version": "1"})
            for point in line:
                etree.SubElement(way, "nd", {"ref": str(ids[point])})
            _write_tags(way, tags)
        etree.indent(root, space=" ")
        path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")

    def _degrees(self, point: Point) -> tuple[float, float]:
        latitude = self.latitude + math.degrees(point[1] / EARTH_RADIUS_M)
        east = math.degrees(point[0] / (EARTH_RADIUS_M * math.cos(math.radians(self.latitude))))
        return latitude, self.longitude + east

    def _write_node(self, root: etree._Element, number: int, point: Point, tags: dict[str, str]) -> None:
        latitude, longitude = self._degrees(point)
        position = {"id": str(number), "lat": f"{latitude:.7f}", "lon": f"{longitude:.7f}"}
        _write_tags(etree.SubElement(root, "node", {**position, "visible": "true", "version": "1"}), tags)


def _write_tags(element: etree._Element, tags: dict[str, str]) -> None:
    for key, value in sorted(tags.items()):
        etree.SubElement(element, "tag", {"k": key, "v": value})


def arc(center: Point, radius: float, start_deg: float, end_deg: float, step_deg: float = 15.0) -> list[Point]:
    """Points on a circle from one angle to another (counter-clockwise where it grows; 0° is east)."""
    count = max(2, round(abs(end_deg - start_deg) / step_deg) + 1)
    angles = [math.radians(start_deg + (end_deg - start_deg) * index / (count - 1)) for index in range(count)]
    return [(center[0] + radius * math.cos(angle), center[1] + radius * math.sin(angle)) for angle in angles]


def curve(*corners: Point, step_m: float = 12.0) -> list[Point]:
    """A smooth line through the corners (centripetal enough for even spacing: Catmull–Rom, tension ½)."""
    padded = [_beyond(corners[0], corners[1]), *corners, _beyond(corners[-1], corners[-2])]
    found = [corners[0]]
    for index in range(1, len(padded) - 2):
        before, start, end, after = padded[index - 1 : index + 3]
        count = max(2, round(math.dist(start, end) / step_m))
        found += [_catmull_rom(before, start, end, after, step / count) for step in range(1, count + 1)]
    return found


def _beyond(end: Point, inner: Point) -> Point:
    return 2 * end[0] - inner[0], 2 * end[1] - inner[1]


def _catmull_rom(before: Point, start: Point, end: Point, after: Point, t: float) -> Point:
    def along(a: float, b: float, c: float, d: float) -> float:
        return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))

    return along(before[0], start[0], end[0], after[0]), along(before[1], start[1], end[1], after[1])


def beside(line: list[Point], distance: float) -> list[Point]:
    """The line moved to its left (to its right where negative)."""
    found = []
    for index, point in enumerate(line):
        one, other = line[max(index - 1, 0)], line[min(index + 1, len(line) - 1)]
        length = math.dist(one, other)
        across = (-(other[1] - one[1]) / length, (other[0] - one[0]) / length)
        found.append((point[0] + distance * across[0], point[1] + distance * across[1]))
    return found
