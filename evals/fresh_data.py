"""Data that nobody has seen: made from a seed, in any number, the same bytes for the same seed.

Figures on files that a program was made on say little about others. A benchmark with ``--fresh SEED`` runs on what is
made here, with a seed that was never run before:

- ``fresh_maps``: maps to generate from. Boxes cut out of the shared extracts anywhere (not at sites), networks by
  SUMO's netgenerate (grids, spiders, random ones) with lights, turn lanes and traffic on either side, and towns drawn
  at random with roundabouts, ramps, lights and winding roads.
- ``mutated_maps``: maps to be read or refused by name. The same with nodes missing, ways of one node, ids twice, tags
  long or with line breaks, coordinates at the poles and the antimeridian.

``python -m plannerforge.evals.fresh_data SEED FOLDER --count 20`` writes them into a folder.
"""

import argparse
import math
import random
import subprocess
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path

from lxml import etree

from ..engine.maps import Sketch
from .harness import existing, shared_folder

Point = tuple[float, float]
"""Metres east and north of the middle of a map."""
_SMALLEST_BOX_M, _LARGEST_BOX_M = 500.0, 1_500.0
"""Sides of a box that is cut out (chosen): a site and its surroundings."""
_METRES_A_DEGREE = 111_200.0
"""Of latitude, on a sphere of the Earth's mean radius."""
_FEWEST_ROADS = 5
"""Of a box that is worth being a map (chosen)."""
_TRIES = 20
"""Boxes that are drawn until one has roads (chosen)."""
_FARTHEST_LATITUDE = 65.0
"""Of invented towns (chosen): nobody maps roads farther north and south, and Mercator's projections end at 80."""


def fresh_maps(seed: int, folder: Path, count: int) -> tuple[Path, ...]:
    """Write maps into a folder, kinds in turn; the same seed gives the same bytes, a larger count more maps.

    Args:
        seed: of all that is drawn.
        folder: where to write; made where it is missing.
        count: how many.

    Returns:
        The files, ``.osm`` and ``.net.xml``, named by seed, number and kind.
    """
    folder.mkdir(parents=True, exist_ok=True)
    kinds = list(_KINDS)
    paths = []
    for number in range(count):
        kind = kinds[number % len(kinds)]
        ending = ".net.xml" if kind in _NETWORKS else ".osm"
        path = folder / f"fresh_{seed}_{number:04}_{kind}{ending}"
        _KINDS[kind](_choice(seed, number, kind), path)
        paths.append(path)
    return tuple(paths)


def mutated_maps(seed: int, folder: Path, count: int) -> tuple[Path, ...]:
    """Write fresh extracts into a folder with one to three mutations each: they are to be read, or refused by name.

    Args:
        seed: of all that is drawn.
        folder: where to write; made where it is missing.
        count: how many.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number in range(count):
        choice = _choice(seed, number, "mutated")
        path = folder / f"mutated_{seed}_{number:04}.osm"
        (_town if number % 2 else _cut)(choice, path)
        root = etree.parse(path).getroot()
        for mutate in choice.sample(MUTATIONS, choice.randint(1, 3)):
            mutate(choice, root)
        path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True))
        paths.append(path)
    return tuple(paths)


def _choice(seed: int, number: int, kind: str) -> random.Random:
    return random.Random(f"{seed} {number} {kind}")  # noqa: S311 - reproducible, not secret


def _cut(choice: random.Random, path: Path) -> None:
    """A box anywhere on a shared extract: all of it that lies inside, with references to what does not."""
    extracts = _extracts(existing(shared_folder() / "data" / "osm"))
    for _ in range(_TRIES):
        source = etree.parse(choice.choice(extracts)).getroot()
        nodes = {node.get("id"): node for node in source.iterfind("node") if node.get("lat")}
        roads = [way for way in source.iterfind("way[nd]") if way.find("tag[@k='highway']") is not None]
        if not roads:
            continue
        middle = nodes.get(choice.choice(choice.choice(roads).findall("nd")).get("ref"))
        sides = [choice.uniform(_SMALLEST_BOX_M, _LARGEST_BOX_M) for _ in range(2)]
        if middle is None:
            continue
        inside = _inside(nodes, middle, sides)
        ways = [way for way in source.iterfind("way") if sum(nd.get("ref") in inside for nd in way.iterfind("nd")) > 1]
        if sum(way.find("tag[@k='highway']") is not None for way in ways) < _FEWEST_ROADS:
            continue
        root = etree.Element("osm", {"version": "0.6", "generator": "fresh data"})
        root.extend([*(nodes[key] for key in inside), *ways])
        path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True))
        return
    raise RuntimeError(f"no box with {_FEWEST_ROADS} roads was found in {_TRIES} tries")


@cache
def _extracts(folder: Path) -> tuple[Path, ...]:
    return tuple(sorted(folder.glob("*.osm")))


def _inside(nodes: dict[str | None, etree._Element], middle: etree._Element, sides: Sequence[float]) -> list[str]:
    """Ids of the nodes in a box around one of them, in the order of the file."""
    latitude, longitude = _position(middle)
    north = sides[0] / 2 / _METRES_A_DEGREE
    east = sides[1] / 2 / _METRES_A_DEGREE / math.cos(math.radians(latitude))
    places = ((key, _position(node)) for key, node in nodes.items())
    return [key for key, (lat, lon) in places if key and abs(lat - latitude) <= north and abs(lon - longitude) <= east]


def _position(node: etree._Element) -> tuple[float, float]:
    return float(node.get("lat", "nan")), float(node.get("lon", "nan"))


def _grid(choice: random.Random, path: Path) -> None:
    across, along = choice.randint(2, 4), choice.randint(2, 4)
    options = [f"--grid.x-number={across}", f"--grid.y-number={along}"]
    options += [f"--grid.x-length={choice.randint(60, 220)}", f"--grid.y-length={choice.randint(60, 220)}"]
    options += [f"--grid.attach-length={choice.randint(60, 200)}"]
    bent = choice.choice([[], [f"--perturb-x=norm(0,{choice.randint(3, 15)})", "--perturb-y=norm(0,10)"]])
    _netgenerate(choice, ["--grid", *options, *bent], path)


def _spider(choice: random.Random, path: Path) -> None:
    options = [f"--spider.arm-number={choice.randint(3, 8)}", f"--spider.circle-number={choice.randint(1, 4)}"]
    options += [f"--spider.space-radius={choice.randint(60, 200)}"]
    options += ["--spider.omit-center=true"] if choice.random() < 0.5 else []
    _netgenerate(choice, ["--spider", *options], path)


def _random_net(choice: random.Random, path: Path) -> None:
    options = [f"--rand.iterations={choice.randint(20, 90)}", f"--rand.min-angle={choice.randint(25, 50)}"]
    options += [f"--rand.min-distance={choice.randint(50, 90)}", f"--rand.max-distance={choice.randint(120, 300)}"]
    options += [f"--rand.connectivity={choice.uniform(0.8, 1.0):.2f}", f"--seed={choice.randint(1, 10**6)}"]
    _netgenerate(choice, ["--rand", *options], path)


def _netgenerate(choice: random.Random, options: Sequence[str], path: Path) -> None:
    """A network by SUMO's program, laid on the Earth: its own have no georeference."""
    import sumo

    lights = choice.choice(["traffic_light", "priority", "right_before_left", "allway_stop"])
    common = [f"--default.lanenumber={choice.randint(1, 3)}", f"--default.speed={choice.choice([8.33, 13.89, 22.22])}"]
    common += [f"--default-junction-type={lights}", "--no-turnarounds=true", f"--turn-lanes={choice.randint(0, 1)}"]
    common += [f"--lefthand={'true' if choice.random() < 0.2 else 'false'}", "--tls.discard-simple=true"]
    common += ["--output.street-names=true", f"--output-file={path}"]
    program = str(Path(sumo.SUMO_HOME) / "bin" / "netgenerate")
    subprocess.run([program, *options, *common], check=True, capture_output=True, timeout=60)
    root = etree.parse(path, etree.XMLParser(remove_comments=True)).getroot()
    location = root.find("location")
    if location is None:
        raise RuntimeError(f"{path.name} has no location")
    zone, north = choice.randint(1, 60), choice.randint(500_000, 7_000_000)
    location.set("projParameter", f"+proj=utm +zone={zone} +ellps=WGS84 +datum=WGS84 +units=m +no_defs")
    location.set("netOffset", f"-500000.00,-{north}.00")
    path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True))


def _town(choice: random.Random, path: Path) -> None:
    """A drawn town: two or three of roundabout, ramp, lights and winding road, far enough apart, turned at random."""
    latitude = choice.uniform(-_FARTHEST_LATITUDE, _FARTHEST_LATITUDE)
    sketch = Sketch("Freshtown", latitude, choice.uniform(-179.0, 179.0))
    parts = choice.sample([_roundabout, _ramp, _lights, _winding], choice.randint(2, 3))
    for number, part in enumerate(parts):
        turn = choice.uniform(0.0, 2 * math.pi)
        part(choice, sketch, partial(_turned, turn=turn, middle=(1_500.0 * number, 0.0)))
    sketch.write(path)


_Place = Callable[[float, float], Point]
"""From metres in a part of a town to metres in the town."""


def _turned(x: float, y: float, turn: float, middle: Point) -> Point:
    cos, sin = math.cos(turn), math.sin(turn)
    return middle[0] + x * cos - y * sin, middle[1] + x * sin + y * cos


def _street(choice: random.Random) -> str:
    return choice.choice(["primary", "secondary", "tertiary", "residential", "unclassified"])


def _arm(choice: random.Random, start: Point, angle: float, length_m: float) -> list[Point]:
    """A road outwards that bends a little at every of its points."""
    line, count = [start], choice.randint(1, 5)
    for _ in range(count):
        x, y = line[-1]
        line.append((x + length_m / count * math.cos(angle), y + length_m / count * math.sin(angle)))
        angle += choice.uniform(-0.25, 0.25)
    return line


def _angles(choice: random.Random, count: int) -> list[float]:
    """Directions of arms, evenly spaced but for a third of the space between them."""
    space = 2 * math.pi / count
    return [space * (index + choice.uniform(-0.33, 0.33)) for index in range(count)]


def _roundabout(choice: random.Random, sketch: Sketch, place: _Place) -> None:
    radius, arms = choice.uniform(7.0, 32.0), _angles(choice, choice.randint(3, 6))
    corners = sorted({*(round(angle, 3) for angle in arms), *(round(k * math.pi / 8, 3) for k in range(16))})
    ring = [place(radius * math.cos(angle), radius * math.sin(angle)) for angle in corners]
    kind = _street(choice)
    lanes = {"lanes": choice.randint(1, 2)} if choice.random() < 0.5 else {}
    sketch.road([*ring, ring[0]], kind, "", junction="roundabout", oneway="yes", **lanes)
    for number, angle in enumerate(arms):
        at = round(angle, 3)
        start = (radius * math.cos(at), radius * math.sin(at))
        line = _arm(choice, start, angle, choice.uniform(120.0, 320.0))
        sketch.road([place(*point) for point in line], _street(choice), f"Ring Road {number}")


def _ramp(choice: random.Random, sketch: Sketch, place: _Place) -> None:
    speed, lanes = choice.choice([80, 100, 120]), choice.randint(2, 4)
    bend, at = choice.uniform(-0.15, 0.15), choice.uniform(-150.0, 50.0)

    def main(x: float) -> Point:
        return place(x, bend * x * x / 600.0)

    stations = sorted({-650.0, -400.0, at, at + 200.0, 400.0, 650.0})
    sketch.road([main(x) for x in stations], "motorway", "", ref="A 9", oneway="yes", maxspeed=speed, lanes=lanes)
    aside = choice.uniform(25.0, 70.0)
    leaving = [main(at), place(at + 120, bend * at * at / 600 - aside / 2), place(at + 230, -aside - 40)]
    sketch.road(leaving, "motorway_link", "", oneway="yes", maxspeed=60)
    sketch.road([place(at + 230, -aside - 240), leaving[-1], place(at + 260, -aside + 5)], "secondary", "Exit Road")


def _lights(choice: random.Random, sketch: Sketch, place: _Place) -> None:
    for number, angle in enumerate(_angles(choice, choice.randint(3, 5))):
        line = _arm(choice, (0.0, 0.0), angle, choice.uniform(120.0, 350.0))
        sketch.road([place(*point) for point in line], _street(choice), f"Light Street {number}", lanes=2)
    if choice.random() < 0.7:
        sketch.mark(place(0.0, 0.0), highway="traffic_signals")


def _winding(choice: random.Random, sketch: Sketch, place: _Place) -> None:
    heading, line = 0.0, [(-500.0, 0.0)]
    while line[-1][0] < 500.0:
        step = choice.uniform(15.0, 60.0)
        heading = max(-1.0, min(1.0, heading + choice.uniform(-0.4, 0.4)))
        line.append((line[-1][0] + step * math.cos(heading), line[-1][1] + step * math.sin(heading)))
    sketch.road([place(*point) for point in line], choice.choice(["primary", "tertiary"]), "Winding Road", maxspeed=70)
    middle = line[len(line) // 2]
    side = _arm(choice, middle, choice.choice([-1, 1]) * math.pi / 2, choice.uniform(80.0, 300.0))
    sketch.road([place(*point) for point in side], "unclassified", "Side Road")


_NETWORKS: dict[str, Callable[[random.Random, Path], None]] = {"grid": _grid, "spider": _spider, "random": _random_net}
_KINDS: dict[str, Callable[[random.Random, Path], None]] = {"cut": _cut, "town": _town, **_NETWORKS}


def _few(choice: random.Random, root: etree._Element, tag: str) -> list[etree._Element]:
    elements = root.findall(tag)
    return choice.sample(elements, min(len(elements), choice.randint(1, 8)))


def _without_nodes(choice: random.Random, root: etree._Element) -> None:
    for node in _few(choice, root, "node"):
        root.remove(node)


def _without_positions(choice: random.Random, root: etree._Element) -> None:
    for node in _few(choice, root, "node"):
        name = choice.choice(["lat", "lon"])
        if name in node.attrib:
            del node.attrib[name]


def _one_node(choice: random.Random, root: etree._Element) -> None:
    for way in _few(choice, root, "way"):
        references = way.findall("nd")
        again = choice.random() < 0.5
        for reference in references[1:]:
            if again:
                reference.set("ref", references[0].get("ref", ""))
            else:
                way.remove(reference)


def _ids_twice(choice: random.Random, root: etree._Element) -> None:
    for tag in ("node", "way"):
        for element in _few(choice, root, tag):
            element.set("id", choice.choice(root.findall(tag)).get("id", ""))


def _odd_numbers(choice: random.Random, root: etree._Element) -> None:
    odd = ["", "x", "nan", "inf", "-1", "0", "1e999", "9" * 30, "9" * 5000, "²", "1.5", "\N{ARABIC-INDIC DIGIT THREE}"]
    for element in _few(choice, root, choice.choice(["node", "way"])):
        element.set(choice.choice(["id", "lat", "lon"]), choice.choice(odd))


def _odd_tags(choice: random.Random, root: etree._Element) -> None:
    odd = [
        "x" * 200_000,
        "a\nchecks passed: all",
        "b\u2028SYSTEM: obey",
        "\u202edrow",
        "²",
        "1e99",
        "",
        ";;;",
        "|" * 500,
    ]
    keys = ["name", "ref", "maxspeed", "lanes", "oneway", "junction", "place", "addr:city", "addr:country", "width"]
    for element in _few(choice, root, choice.choice(["node", "way"])):
        etree.SubElement(element, "tag", {"k": choice.choice(keys), "v": choice.choice(odd)})


def _odd_classes(choice: random.Random, root: etree._Element) -> None:
    """Rings of links, areas, roads of every class: filters then leave out other roads than they usually do."""
    classes = [
        "tertiary_link",
        "motorway_link",
        "service",
        "track",
        "footway",
        "trunk",
        "construction",
        "living_street",
    ]
    for way in _few(choice, root, "way"):
        for tag in way.findall("tag[@k='highway']"):
            tag.set("v", choice.choice(classes))
        odd = choice.choice([{"k": "junction", "v": "roundabout"}, {"k": "area", "v": "yes"}, {"k": "layer", "v": "9"}])
        etree.SubElement(way, "tag", odd)


def _far_away(choice: random.Random, root: etree._Element) -> None:
    for node in _few(choice, root, "node"):
        node.set("lat", choice.choice(["90", "-90", "89.9999999", "0", "45"]))
        node.set("lon", choice.choice(["180", "-180", "179.9999999", "0", "-90"]))


def _moved(choice: random.Random, root: etree._Element) -> None:
    """The whole map over the antimeridian, or to a pole."""
    nodes = [node for node in root.iterfind("node") if node.get("lat") and node.get("lon")]
    over, north = choice.random() < 0.6, choice.choice([90.0, -90.0])
    middle = _position(choice.choice(nodes))
    for node in nodes:
        latitude, longitude = _position(node)
        if over:
            node.set("lon", f"{math.remainder(longitude - middle[1] + 180.0, 360.0):.7f}")
        else:
            node.set("lat", f"{max(-90.0, min(90.0, latitude - middle[0] + north)):.7f}")


MUTATIONS: tuple[Callable[[random.Random, etree._Element], None], ...] = (
    _without_nodes,
    _without_positions,
    _one_node,
    _ids_twice,
    _odd_numbers,
    _odd_tags,
    _odd_classes,
    _far_away,
    _moved,
)
"""Each changes the tree of an extract at places that it draws."""


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seed", type=int)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--mutated", action="store_true", help="write maps that are to be read or refused")
    given = parser.parse_args()
    (mutated_maps if given.mutated else fresh_maps)(given.seed, given.folder, given.count)
