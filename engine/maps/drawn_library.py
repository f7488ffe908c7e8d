"""Draws the built-in maps: invented towns in the open sea, one for each kind of site.

Roads drawn in metres become OpenStreetMap XML.

``python -m plannerforge.engine.maps.drawn_library`` draws the maps again and writes the catalogue of their content.
"""

import math
from dataclasses import dataclass, field
from pathlib import Path

from lxml import etree

from .osm import EARTH_RADIUS_M, OsmNode, append_node, append_object

Point = tuple[float, float]


@dataclass
class Sketch:
    """A map being drawn; points are metres east and north of the origin, which is given in degrees.

    Roads that share a point meet there. Ids count from 1 in the order of drawing.
    """

    place: str
    latitude: float
    longitude: float
    nodes: dict[Point, dict[str, str]] = field(default_factory=dict)
    ways: list[tuple[list[Point], dict[str, str]]] = field(default_factory=list)

    def road(self, points: list[Point], highway: str, name: str = "", **tags: str | int) -> None:
        """Draw a road along the points; tag names use ``_`` for ``:``."""
        rounded = [(round(x, 2), round(y, 2)) for x, y in points]
        line = [point for index, point in enumerate(rounded) if index == 0 or point != rounded[index - 1]]
        for point in line:
            self.nodes.setdefault(point, {})
        tagged = {"highway": highway, **{key.replace("_", ":"): str(value) for key, value in tags.items()}}
        self.ways.append((line, tagged | ({"name": name} if name else {})))

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
        latitudes, longitudes = zip(*(self._degrees(point) for point in self.nodes), strict=True)
        box = {"minlat": min(latitudes), "minlon": min(longitudes), "maxlat": max(latitudes), "maxlon": max(longitudes)}
        etree.SubElement(root, "bounds", {key: f"{value:.7f}" for key, value in box.items()})
        middle = {"place": "town", "name": self.place, "addr:country": "ZAM"}
        ids = {point: number for number, point in enumerate(self.nodes, start=2)}
        append_node(root, OsmNode(1, *self._degrees((0.0, 0.0)), middle))
        for point, tags in self.nodes.items():
            append_node(root, OsmNode(ids[point], *self._degrees(point), tags))
        for number, (line, tags) in enumerate(self.ways, start=1):
            append_object(root, "way", number, tags, parts=[("nd", {"ref": str(ids[point])}) for point in line])
        etree.indent(root, space=" ")
        path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")

    def _degrees(self, point: Point) -> tuple[float, float]:
        latitude = self.latitude + math.degrees(point[1] / EARTH_RADIUS_M)
        east = math.degrees(point[0] / (EARTH_RADIUS_M * math.cos(math.radians(self.latitude))))
        return latitude, self.longitude + east


def _arc(center: Point, radius: float, start_deg: float, end_deg: float, step_deg: float = 15.0) -> list[Point]:
    """Return points on a circle from one angle to another (counter-clockwise if it increases; 0° is east)."""
    count = max(2, round(abs(end_deg - start_deg) / step_deg) + 1)
    angles = [math.radians(start_deg + (end_deg - start_deg) * index / (count - 1)) for index in range(count)]
    return [(center[0] + radius * math.cos(angle), center[1] + radius * math.sin(angle)) for angle in angles]


def _curve(*corners: Point, step_m: float = 12.0) -> list[Point]:
    """Return a smooth line through the corners (Catmull–Rom, tension ½; almost evenly spaced)."""
    padded = [_beyond(corners[0], corners[1]), *corners, _beyond(corners[-1], corners[-2])]
    points = [corners[0]]
    for index in range(1, len(padded) - 2):
        before, start, end, after = padded[index - 1 : index + 3]
        count = max(2, round(math.dist(start, end) / step_m))
        points += [_catmull_rom(before, start, end, after, step / count) for step in range(1, count + 1)]
    return points


def _beyond(end: Point, inner: Point) -> Point:
    return 2 * end[0] - inner[0], 2 * end[1] - inner[1]


def _catmull_rom(before: Point, start: Point, end: Point, after: Point, t: float) -> Point:
    def along(a: float, b: float, c: float, d: float) -> float:
        return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))

    return along(before[0], start[0], end[0], after[0]), along(before[1], start[1], end[1], after[1])


def _shifted(line: list[Point], distance: float) -> list[Point]:
    """Return the line shifted to its left, or to its right if the distance is negative."""
    moved = []
    for index, point in enumerate(line):
        one, other = line[max(index - 1, 0)], line[min(index + 1, len(line) - 1)]
        length = math.dist(one, other)
        across = (-(other[1] - one[1]) / length, (other[0] - one[0]) / length)
        moved.append((point[0] + distance * across[0], point[1] + distance * across[1]))
    return moved


LIBRARY = Path(__file__).parent / "library"
NORTH_SEA = (54.60, 5.20)
"""Latitude and longitude in degrees of open sea, far from any real road."""


def _signalised_crossing() -> Sketch:
    """Draw two main streets that cross at traffic lights, with turn lanes and side streets around them."""
    town = Sketch("Musterstadt", *NORTH_SEA)
    west = _curve((-420, -36), (-300, -22), (-180, -4), (-80, 0))
    town.road(west, "secondary", "Hauptstraße", lanes=2, maxspeed=50)
    town.road([(-80, 0), (0, 0)], "secondary", "Hauptstraße", lanes=4, lanes_forward=2, lanes_backward=2, maxspeed=50)
    town.road([(0, 0), (80, 0)], "secondary", "Hauptstraße", lanes=4, lanes_forward=2, lanes_backward=2, maxspeed=50)
    town.road(_curve((80, 0), (180, 6), (300, 30), (420, 44)), "secondary", "Hauptstraße", lanes=2, maxspeed=50)
    town.road([(0, -70), (0, 0)], "secondary", "Bahnhofstraße", lanes=3, lanes_forward=2, lanes_backward=1, maxspeed=50)
    town.road([(0, 0), (0, 70)], "secondary", "Bahnhofstraße", lanes=3, lanes_forward=1, lanes_backward=2, maxspeed=50)
    town.road(_curve((0, 70), (-4, 150), (-22, 260), (-30, 380)), "secondary", "Bahnhofstraße", lanes=2, maxspeed=50)
    town.road(_curve((0, -70), (4, -150), (20, -260), (24, -380)), "secondary", "Bahnhofstraße", lanes=2, maxspeed=50)
    garden = _curve((-180, -4), (-184, 60), (-170, 130), (-100, 152), (-4, 150))
    town.road(garden, "residential", "Gartenweg", lanes=2, maxspeed=30)
    school = _curve((180, 6), (186, -70), (170, -140), (90, -156), (4, -150))
    town.road(school, "residential", "Schulstraße", lanes=2, maxspeed=30)
    town.mark((0, 0), highway="traffic_signals")
    town.area([(-300, -300), (300, -300), (300, 300), (-300, 300)], "residential")
    return town


def _t_junction() -> Sketch:
    """Draw a street that ends at a main road with priority."""
    town = Sketch("Fahrhausen", NORTH_SEA[0], NORTH_SEA[1] + 0.05)
    shore = [
        *_curve((-430, 60), (-320, 44), (-200, 12), (-90, 0), (0, 0)),
        *_curve((0, 0), (90, -4), (210, 14), (330, 60), (430, 82)),
    ]
    town.road(shore, "secondary", "Uferstraße", lanes=2, maxspeed=50)
    town.road(
        _curve((0, 0), (0, -60), (-14, -150), (-46, -260), (-50, -380)), "tertiary", "Deichweg", lanes=2, maxspeed=50
    )
    town.road(
        _curve((-200, 12), (-196, -60), (-150, -140), (-14, -150)), "residential", "Fischergasse", lanes=2, maxspeed=30
    )
    town.road(
        _curve((210, 14), (204, 90), (170, 190), (160, 300)), "residential", "Leuchtturmweg", lanes=2, maxspeed=30
    )
    town.area([(-260, -260), (260, -260), (260, 220), (-260, 220)], "residential")
    return town


def _roundabout() -> Sketch:
    """Draw a roundabout of 20 m radius with four roads."""
    town = Sketch("Kreiselheim", NORTH_SEA[0] + 0.03, NORTH_SEA[1])
    ring = _arc((0, 0), 20.0, 0, 360, 10.0)
    town.road(
        [*ring[:-1], ring[0]], "secondary", "Kreiselplatz", junction="roundabout", oneway="yes", lanes=1, maxspeed=30
    )
    arms: list[tuple[str, str, list[Point]]] = [
        ("secondary", "Ostallee", [(20, 0), (80, 2), (180, 20), (300, 62), (400, 84)]),
        ("secondary", "Nordring", [(0, 20), (0, 80), (-16, 180), (-60, 300), (-76, 400)]),
        ("secondary", "Westallee", [(-20, 0), (-80, -4), (-180, -26), (-300, -52), (-400, -60)]),
        ("tertiary", "Südstraße", [(0, -20), (2, -80), (20, -180), (66, -290), (80, -390)]),
    ]
    for highway, name, corners in arms:
        town.road(_curve(*corners), highway, name, lanes=2, maxspeed=50)
    town.road(_curve((180, 20), (196, -60), (140, -160), (20, -180)), "residential", "Mühlenweg", lanes=2, maxspeed=30)
    town.road(
        _curve((-180, -26), (-200, 70), (-120, 170), (-16, 180)), "residential", "Lindenhof", lanes=2, maxspeed=30
    )
    town.area([(-260, -260), (260, -260), (260, 260), (-260, 260)], "residential")
    return town


def _motorway() -> Sketch:
    """Draw a motorway in a long curve with a diamond interchange and a road that crosses above it."""
    town = Sketch("Neuland", NORTH_SEA[0] + 0.03, NORTH_SEA[1] + 0.06)
    axis = _curve((-1300, -150), (-900, -60), (-450, -8), (0, 0), (450, -8), (900, -60), (1300, -150), step_m=30.0)
    east, west = _shifted(axis, -11.0), _shifted(axis[::-1], -11.0)
    for line in (east, west):
        town.road(line, "motorway", "", ref="A 901", oneway="yes", lanes=2, maxspeed=120)
    crossing = [
        (-60.0, -420.0),
        (-40.0, -250.0),
        (-20.0, -130.0),
        (0.0, 0.0),
        (20.0, 130.0),
        (30.0, 250.0),
        (36.0, 420.0),
    ]
    over = _curve(*crossing)
    low, high = over.index(crossing[2]), over.index(crossing[4])
    tags = {"lanes": "2", "maxspeed": "70"}
    town.road(over[: low + 1], "secondary", "Neulander Straße", **tags)
    town.road(over[low : high + 1], "secondary", "Neulander Straße", bridge="yes", layer="1", **tags)
    town.road(over[high:], "secondary", "Neulander Straße", **tags)
    south, north = crossing[2], crossing[4]
    for carriageway, meeting, side in ((east, south, -1), (west, north, 1)):
        leave, join = (-470 * -side, 470 * -side)
        off, on = (_nearest(carriageway, x) for x in (leave, join))
        down = (meeting[0] + 0.4 * (off[0] - meeting[0]), meeting[1] - side * 22.0)
        up = (meeting[0] + 0.4 * (on[0] - meeting[0]), meeting[1] - side * 22.0)
        ramp = {"oneway": "yes", "lanes": "1", "maxspeed": "60"}
        town.road(_curve(off, (off[0] + side * -90, off[1] + side * 13), down, meeting), "motorway_link", "", **ramp)
        town.road(_curve(meeting, up, (on[0] + side * 90, on[1] + side * 13), on), "motorway_link", "", **ramp)
    return town


def _nearest(line: list[Point], east: float) -> Point:
    return min(line, key=lambda point: abs(point[0] - east))


def _urban_grid() -> Sketch:
    """Draw a grid of five by five streets; the two main streets have traffic lights at their intersections."""
    town = Sketch("Quadratstadt", NORTH_SEA[0], NORTH_SEA[1] + 0.10)
    lines = [-200.0, -95.0, 0.0, 90.0, 190.0]
    edge = (-280.0, 270.0)
    across = ("Ahornstraße", "Birkenstraße", "Marktstraße", "Dahlienstraße", "Eschenstraße")
    along = ("Erste Straße", "Zweite Straße", "Rathausstraße", "Vierte Straße", "Fünfte Straße")
    for index, position in enumerate(lines):
        main = index == 2
        kind, limit = ("secondary", 50) if main else ("residential", 30)
        stops = [edge[0], *lines, edge[1]] if main else lines
        town.road([(x, position) for x in stops], kind, across[index], lanes=2, maxspeed=limit)
        town.road([(position, y) for y in stops], kind, along[index], lanes=2, maxspeed=limit)
    for point in ((0.0, 0.0), (-95.0, 0.0), (0.0, 90.0)):
        town.mark(point, highway="traffic_signals")
    town.area([(-220, -220), (210, -220), (210, 210), (-220, 210)], "residential")
    return town


def _rural_road() -> Sketch:
    """Draw a winding country road through open land, with a side road and a track."""
    town = Sketch("Landmoor", NORTH_SEA[0] + 0.03, NORTH_SEA[1] + 0.14)
    bends: list[Point] = [
        (-900, -120),
        (-620, -60),
        (-380, 60),
        (-160, 70),
        (0, 0),
        (180, -80),
        (420, -60),
        (640, 60),
        (900, 110),
    ]
    town.road(_curve(*bends), "secondary", "Moorlandstraße", lanes=2, maxspeed=100, ref="L 17")
    town.road(_curve((0, 0), (40, 120), (30, 280), (90, 460), (100, 620)), "tertiary", "Torfweg", lanes=2, maxspeed=70)
    town.road(_curve((-380, 60), (-400, 180), (-440, 340)), "unclassified", "Hofstraße", lanes=2, maxspeed=50)
    town.road(_curve((420, -60), (440, -160), (400, -300)), "track", "Heideweg")
    return town


PLANS = {
    "fahrhausen": _t_junction,
    "kreiselheim": _roundabout,
    "landmoor": _rural_road,
    "musterstadt": _signalised_crossing,
    "neuland": _motorway,
    "quadratstadt": _urban_grid,
}


def draw(folder: Path) -> list[Path]:
    """Draw all maps into a folder, together with ``catalogue.json``."""
    from ...schemas.generation import MapList, ReadMapRequest
    from ..execution import silent
    from .facts import read_map

    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, plan in sorted(PLANS.items()):
        paths.append(folder / f"{name}.osm")
        plan().write(paths[-1])
    facts = tuple(read_map(ReadMapRequest(path=str(path)), silent) for path in paths)
    (folder / "catalogue.json").write_text(
        MapList(maps=facts).model_dump_json(indent=1, exclude_none=True) + "\n", encoding="utf-8"
    )
    return paths


if __name__ == "__main__":
    draw(LIBRARY)
