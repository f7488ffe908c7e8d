"""The maps that we draw ourselves: invented towns in the open sea, one for each kind of site.

``python -m plannerforge.engine.maps.draw_library`` draws them anew, with the catalogue of what they show.
"""

from pathlib import Path

from plannerforge.engine.maps.sketch import Point, Sketch, arc, beside, curve

LIBRARY = Path(__file__).parent / "library"
NORTH_SEA = (54.60, 5.20)


def signalised_crossing() -> Sketch:
    """Two main streets cross at traffic lights, with turn lanes; side streets around."""
    town = Sketch("Musterstadt", *NORTH_SEA)
    west = curve((-420, -36), (-300, -22), (-180, -4), (-80, 0))
    town.road(west, "secondary", "Hauptstraße", lanes=2, maxspeed=50)
    town.road([(-80, 0), (0, 0)], "secondary", "Hauptstraße", lanes=4, lanes_forward=2, lanes_backward=2, maxspeed=50)
    town.road([(0, 0), (80, 0)], "secondary", "Hauptstraße", lanes=4, lanes_forward=2, lanes_backward=2, maxspeed=50)
    town.road(curve((80, 0), (180, 6), (300, 30), (420, 44)), "secondary", "Hauptstraße", lanes=2, maxspeed=50)
    town.road([(0, -70), (0, 0)], "secondary", "Bahnhofstraße", lanes=3, lanes_forward=2, lanes_backward=1, maxspeed=50)
    town.road([(0, 0), (0, 70)], "secondary", "Bahnhofstraße", lanes=3, lanes_forward=1, lanes_backward=2, maxspeed=50)
    town.road(curve((0, 70), (-4, 150), (-22, 260), (-30, 380)), "secondary", "Bahnhofstraße", lanes=2, maxspeed=50)
    town.road(curve((0, -70), (4, -150), (20, -260), (24, -380)), "secondary", "Bahnhofstraße", lanes=2, maxspeed=50)
    garden = curve((-180, -4), (-184, 60), (-170, 130), (-100, 152), (-4, 150))
    town.road(garden, "residential", "Gartenweg", lanes=2, maxspeed=30)
    school = curve((180, 6), (186, -70), (170, -140), (90, -156), (4, -150))
    town.road(school, "residential", "Schulstraße", lanes=2, maxspeed=30)
    town.mark((0, 0), highway="traffic_signals")
    town.area([(-300, -300), (300, -300), (300, 300), (-300, 300)], "residential")
    return town


def t_junction() -> Sketch:
    """A street ends at a main road that has priority."""
    town = Sketch("Fahrhausen", NORTH_SEA[0], NORTH_SEA[1] + 0.05)
    shore = [
        *curve((-430, 60), (-320, 44), (-200, 12), (-90, 0), (0, 0)),
        *curve((0, 0), (90, -4), (210, 14), (330, 60), (430, 82)),
    ]
    town.road(shore, "secondary", "Uferstraße", lanes=2, maxspeed=50)
    town.road(
        curve((0, 0), (0, -60), (-14, -150), (-46, -260), (-50, -380)), "tertiary", "Deichweg", lanes=2, maxspeed=50
    )
    town.road(
        curve((-200, 12), (-196, -60), (-150, -140), (-14, -150)), "residential", "Fischergasse", lanes=2, maxspeed=30
    )
    town.road(curve((210, 14), (204, 90), (170, 190), (160, 300)), "residential", "Leuchtturmweg", lanes=2, maxspeed=30)
    town.area([(-260, -260), (260, -260), (260, 220), (-260, 220)], "residential")
    return town


def roundabout() -> Sketch:
    """Four roads meet at a roundabout of 20 m radius."""
    town = Sketch("Kreiselheim", NORTH_SEA[0] + 0.03, NORTH_SEA[1])
    ring = arc((0, 0), 20.0, 0, 360, 10.0)
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
        town.road(curve(*corners), highway, name, lanes=2, maxspeed=50)
    town.road(curve((180, 20), (196, -60), (140, -160), (20, -180)), "residential", "Mühlenweg", lanes=2, maxspeed=30)
    town.road(curve((-180, -26), (-200, 70), (-120, 170), (-16, 180)), "residential", "Lindenhof", lanes=2, maxspeed=30)
    town.area([(-260, -260), (260, -260), (260, 260), (-260, 260)], "residential")
    return town


def motorway() -> Sketch:
    """A motorway in a long bend with a diamond interchange and the road that crosses above it."""
    town = Sketch("Neuland", NORTH_SEA[0] + 0.03, NORTH_SEA[1] + 0.06)
    axis = curve((-1300, -150), (-900, -60), (-450, -8), (0, 0), (450, -8), (900, -60), (1300, -150), step_m=30.0)
    east, west = beside(axis, -11.0), beside(axis[::-1], -11.0)
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
    over = curve(*crossing)
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
        town.road(curve(off, (off[0] + side * -90, off[1] + side * 13), down, meeting), "motorway_link", "", **ramp)
        town.road(curve(meeting, up, (on[0] + side * 90, on[1] + side * 13), on), "motorway_link", "", **ramp)
    return town


def _nearest(line: list[Point], east: float) -> Point:
    return min(line, key=lambda point: abs(point[0] - east))


def urban_grid() -> Sketch:
    """Five by five streets; the two main ones carry traffic lights at their crossings."""
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


def rural_road() -> Sketch:
    """A country road in bends through open land, with a side road and a track."""
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
    town.road(curve(*bends), "secondary", "Moorlandstraße", lanes=2, maxspeed=100, ref="L 17")
    town.road(curve((0, 0), (40, 120), (30, 280), (90, 460), (100, 620)), "tertiary", "Torfweg", lanes=2, maxspeed=70)
    town.road(curve((-380, 60), (-400, 180), (-440, 340)), "unclassified", "Hofstraße", lanes=2, maxspeed=50)
    town.road(curve((420, -60), (440, -160), (400, -300)), "track", "Heideweg")
    return town


PLANS = {
    "fahrhausen": t_junction,
    "kreiselheim": roundabout,
    "landmoor": rural_road,
    "musterstadt": signalised_crossing,
    "neuland": motorway,
    "quadratstadt": urban_grid,
}


def draw(folder: Path) -> list[Path]:
    """Draw all maps into a folder, with ``catalogue.json`` beside them."""
    from plannerforge.engine.execution.progress import silent
    from plannerforge.engine.maps.facts import read_map
    from plannerforge.schemas.generation import MapList, ReadMapRequest

    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, plan in sorted(PLANS.items()):
        paths.append(folder / f"{name}.osm")
        plan().write(paths[-1])
    facts = tuple(read_map(ReadMapRequest(path=str(path)), silent) for path in paths)
    (folder / "catalogue.json").write_text(MapList(maps=facts).model_dump_json(indent=1) + "\n", encoding="utf-8")
    return paths


if __name__ == "__main__":
    draw(LIBRARY)
