"""Unseen data, created from a seed in any number, with the same bytes for the same seed.

Figures on files that a program was developed with say little about others. A benchmark with ``--fresh SEED`` runs on
this data with a seed that was never run before:

- ``fresh_maps``: maps for generation. Boxes cut out of the shared extracts anywhere (not at sites), networks by SUMO's
  netgenerate (grids, spiders, random ones) with lights, turn lanes and traffic on either side, and random towns with
  roundabouts, ramps, lights and winding roads.
- ``mutated_maps``: maps that must be read or refused by name. The same with missing nodes, ways of one node, duplicate
  ids, long tags or tags with line breaks, coordinates at the poles and the antimeridian.
- ``fresh_recordings``: scenarios of the shared folder with altered recordings. Road users are lost and reappear under
  another id, appear late or vanish early. Positions jitter by some cm, cars drive without lanes or park in rows,
  pedestrians walk along the road, and everything is turned and moved. In one of 25 a road user misses time steps in the
  middle of its trajectory, which CommonRoad forbids: this file must be refused by name.
- ``fresh_scenarios``: alternately one of those and one generated from a fresh map with traffic of many classes.

``python -m benchmarks.symmetries.fresh_data SEED FOLDER --count 20`` writes maps into a folder; ``--mutated`` and
``--scenarios`` write the others.
"""

import argparse
import hashlib
import math
import random
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from lxml import etree

from plannerforge.engine.commonroad import derived_benchmark_id
from plannerforge.engine.execution import silent
from plannerforge.engine.generation import generate_scenario
from plannerforge.engine.geometry import Points, Values, arc_length, length_m, point_at
from plannerforge.engine.maps.drawn_library import Sketch
from plannerforge.engine.vehicles import vehicle_classes
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.generation import GenerationRequest, RequestedGoal, VehicleDemand

from ..harness import drawn, existing, scenario_files, shared_folder, shared_scenarios
from .relations import RELATIONS, read_root, write_root

Point = tuple[float, float]
"""Metres east and north of the middle of a map."""
_SMALLEST_BOX_M, _LARGEST_BOX_M = 500.0, 1_500.0
"""Sides of a box to cut out (chosen): a site and its surroundings."""
_METRES_A_DEGREE = 111_200.0
"""Metres per degree of latitude, on a sphere of the Earth's mean radius."""
_FEWEST_ROADS = 5
"""Least content of a useful box (chosen)."""
_TRIES = 20
"""Draws of a box until one has roads (chosen)."""
_MOST_CONNECTED = 0.99
"""Upper limit for random networks: netgenerate accepts no share of 0.999 or more."""
_FARTHEST_LATITUDE = 65.0
"""Latitudes of invented towns (chosen): few roads are mapped beyond them, and Mercator projections end at 80."""


def fresh_maps(seed: int, folder: Path, count: int) -> tuple[Path, ...]:
    """Write maps into a folder, kinds in turn; the same seed gives the same bytes, a larger count more maps.

    Args:
        seed: of all draws.
        folder: the target, created if missing.
        count: number of maps.

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
    """Write fresh extracts with one to three mutations each, which must be read or refused by name.

    Args:
        seed: of all draws.
        folder: the target, created if missing.
        count: number of maps.
    """
    return tuple(mutated_map(seed, folder, number) for number in range(count))


def mutated_map(seed: int, folder: Path, number: int) -> Path:
    """Write one of the maps of ``mutated_maps`` alone, by its number from 0 on."""
    folder.mkdir(parents=True, exist_ok=True)
    choice = _choice(seed, number, "mutated")
    path = folder / f"mutated_{seed}_{number:04}.osm"
    (_town if number % 2 else _cut)(choice, path)
    root = etree.parse(path).getroot()
    for mutate in choice.sample(MUTATIONS, choice.randint(1, 3)):
        mutate(choice, root)
    path.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True))
    return path


def fresh_recordings(seed: int, folder: Path, count: int) -> tuple[Path, ...]:
    """Write altered recordings of the shared folder; the same seed gives the same bytes, a larger count more files.

    Args:
        seed: of all draws.
        folder: the target, created if missing.
        count: number of files. Every source is used once before any is used again.

    Returns:
        The files, named by their benchmark ids, which no source has.
    """
    return tuple(_fresh_recording(seed, number, folder) for number in range(count))


def fresh_scenarios(seed: int, folder: Path, count: int) -> tuple[Path, ...]:
    """Write alternately a fresh recording and a scenario generated from a fresh map; a larger count gives more
    files.
    """
    return tuple(fresh_scenario(seed, number, folder) for number in range(count))


def fresh_scenario(seed: int, number: int, folder: Path) -> Path:
    """Write one of ``fresh_scenarios``, so that several processes can share the work.

    Raises:
        RuntimeError: no scenario could be generated on several fresh maps.
    """
    make = _generated if number % 2 else _fresh_recording
    return make(seed, number // 2, folder)


def _choice(seed: int, number: int, kind: str) -> random.Random:
    return random.Random(f"{seed} {number} {kind}")  # noqa: S311 - reproducible, not secret


def _cut(choice: random.Random, path: Path) -> None:
    """Cut a box anywhere out of a shared extract: its whole content, with references to what is outside."""
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
    """Return ids of the nodes in a box around one of them, in the order of the file."""
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
    connectivity = min(choice.uniform(0.8, 1.0), _MOST_CONNECTED)
    options += [f"--rand.connectivity={connectivity:.2f}", f"--seed={choice.randint(1, 10**6)}"]
    _netgenerate(choice, ["--rand", *options], path)


def _netgenerate(choice: random.Random, options: Sequence[str], path: Path) -> None:
    """Generate a network by SUMO's program, and place it on the earth, because SUMO's has no georeference."""
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
    """Draw a town: two or three of roundabout, ramp, lights and winding road, far enough apart, turned at random."""
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
    """Add an outward road that bends a little at each of its points."""
    line, count = [start], choice.randint(1, 5)
    for _ in range(count):
        x, y = line[-1]
        line.append((x + length_m / count * math.cos(angle), y + length_m / count * math.sin(angle)))
        angle += choice.uniform(-0.25, 0.25)
    return line


def _angles(choice: random.Random, count: int) -> list[float]:
    """Return directions of arms, evenly spaced except for a third of the space between them."""
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
    """Add rings of links, areas, and roads of every class, so that filters leave out other roads than usual."""
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
    """Move the whole map over the antimeridian, or to a pole."""
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
"""Mutations: each changes the tree of an extract at random places."""


# Scenarios


def _generated(seed: int, number: int, folder: Path) -> Path:
    """Generate a scenario of many classes on a fresh map, or on the next map if that is impossible."""
    for attempt in range(_TRIES):
        choice = _choice(seed, number, f"generated {attempt}")
        kind = choice.choice(list(_KINDS))
        with tempfile.TemporaryDirectory() as scratch:
            source = Path(scratch) / ("fresh.net.xml" if kind in _NETWORKS else "fresh.osm")
            _KINDS[kind](choice, source)
            try:
                generate_scenario(_request(choice, source), silent)
            except PlannerForgeError:
                continue
            return _written(read_root(Path(scratch) / "scenario.xml"), f"{seed} {number} generated", folder)
    raise RuntimeError(f"no scenario could be generated on {_TRIES} fresh maps")


def _request(choice: random.Random, source: Path) -> GenerationRequest:
    classes = list(vehicle_classes())
    return GenerationRequest(
        map_path=str(source),
        map_id=source.name,
        place="Freshtown",
        country=None,
        attribution="",
        density=choice.choice(["low", "low", "medium"]),  # at high density there are 200 road users to an edit
        vehicles=tuple(VehicleDemand(vehicle_class=name) for name in choice.sample(classes, choice.randint(2, 6))),
        duration_s=float(choice.randint(6, 12)),
        seed=choice.randrange(2**31),
        goal=RequestedGoal.of("steps:50"),
        folder=str(source.parent),
    )


def _fresh_recording(seed: int, number: int, folder: Path) -> Path:
    """Return a shared scenario with two to four disturbances, turned by any angle and moved."""
    files = {path.name: path for path in scenario_files(existing(shared_scenarios()), None)}
    order = drawn((f"{seed} {name}" for name in files), None)
    source = files[order[number % len(order)].partition(" ")[2]]
    choice = _choice(seed, number, "recording")
    root = read_root(source)
    disturbances = choice.sample(DISTURBANCES, choice.randint(2, len(DISTURBANCES) - 1))
    if choice.random() < _HOLED:
        disturbances.append(_with_a_hole)
    for disturb in disturbances:
        disturb(choice, root)
    for relation in ("turned", "moved"):
        root, _ = RELATIONS[relation].applied(root, f"{seed} {number}")
    return _written(root, f"{seed} {number} recording", folder)


def _written(root: etree._Element, key: str, folder: Path) -> Path:
    """Write the file under a benchmark id made of a key and the old one, because planners read signs by its country."""
    folder.mkdir(parents=True, exist_ok=True)
    digest = hashlib.sha256(key.encode()).hexdigest()
    root.set("benchmarkID", derived_benchmark_id(root.get("benchmarkID", ""), digest))
    path = folder / f"{root.get('benchmarkID')}.xml"
    write_root(root, path)
    return path


_HOLED = 0.04
"""Share of the recordings in which a road user misses time steps (chosen)."""
_FEWEST_STATES = 25
"""Least steps of a cut recording (chosen): both parts are long enough to be driven."""
_JITTER_M, _JITTER_KEPT = (0.005, 0.03), 0.7
"""Standard deviation of the jitter, and its correlation from one step to the next (chosen)."""
_ASIDE_M, _WAVE_M, _LATERAL_MPS2 = (0.3, 1.5), (50.0, 150.0), 1.0
"""Driving without lanes: amplitude to either side, wavelength, and highest added lateral acceleration (chosen)."""
_APART_M = 2.6
"""Distance of a parked car's centre from those of all recorded road users (chosen)."""
_ALONE_S = 10.0
"""Duration of pedestrians' walks if nothing else moves (chosen)."""
_PATHS = ("position/point/x", "position/point/y", "orientation/exact", "velocity/exact")


@dataclass(frozen=True)
class _Recording:
    """A road user of a file, with the numbers of its states: positions (n, 2), headings and speeds (n,)."""

    element: etree._Element
    states: tuple[etree._Element, ...]
    positions: Points
    headings_rad: Values
    speeds_mps: Values

    def rewrite(self, positions: Points, headings_rad: Values, speeds_mps: Values) -> None:
        """Put other numbers into the file."""
        rows = np.column_stack([positions, headings_rad, speeds_mps]).tolist()
        for state, row in zip(self.states, rows, strict=True):
            for path, value in zip(_PATHS, row, strict=True):
                field = state.find(path)
                if field is not None:
                    field.text = f"{value:.6f}"


def _recordings(root: etree._Element) -> list[_Recording]:
    """Return all moving road users, except those with regions, intervals or signals."""
    found = []
    for element in root:
        if element.find("trajectory") is None or element.find("signalSeries") is not None:
            continue
        states = (*element.iterfind("initialState"), *element.iterfind("trajectory/state"))
        texts = [[state.findtext(path) for path in _PATHS] for state in states]
        if all(text is not None for row in texts for text in row):
            rows = np.array(texts, dtype=float)
            found.append(_Recording(element, states, rows[:, :2], rows[:, 2], rows[:, 3]))
    return found


def _share(choice: random.Random, root: etree._Element, fewest_states: int = 2) -> list[_Recording]:
    """Return some of those with a long enough recording, at least one if there is one."""
    long = [one for one in _recordings(root) if len(one.states) >= fewest_states]
    return choice.sample(long, math.ceil(len(long) * choice.uniform(0.1, 0.9)))


def _cut_recordings(choice: random.Random, root: etree._Element) -> None:
    """Let road users be lost and reappear as others, appear late, or vanish early."""
    for one in _share(choice, root, 2 * _FEWEST_STATES):
        begin = choice.randint(_FEWEST_STATES, len(one.states) - _FEWEST_STATES)
        how = choice.choice(["again", "late", "early"])
        if how == "again":
            end = min(begin + choice.randint(3, 15), len(one.states) - 2)
            later = etree.fromstring(etree.tostring(one.element))
            later.set("id", str(_next_id(root)))
            _keep(later, end, None)
            one.element.addnext(later)
        _keep(one.element, *((begin, None) if how == "late" else (0, begin)))


def _keep(element: etree._Element, begin: int, end: int | None) -> None:
    """Keep only some states of a road user; the first of them becomes its initial state."""
    states = [*element.iterfind("initialState"), *element.iterfind("trajectory/state")]
    kept = states[begin:end]
    for state in states:
        parent = state.getparent()
        if parent is not None and (state not in kept or (begin and state is kept[0])):
            parent.remove(state)
    if begin:
        trajectory = element.find("trajectory")
        if trajectory is not None:
            trajectory.addprevious(kept[0])
        kept[0].tag = "initialState"


def _with_a_hole(choice: random.Random, root: etree._Element) -> None:
    """Remove time steps from the middle of a road user's trajectory."""
    for one in _share(choice, root, _FEWEST_STATES)[:1]:
        begin = choice.randint(2, len(one.states) - 10)
        for state in one.states[begin : begin + choice.randint(1, 8)]:
            one.element.find("trajectory").remove(state)  # type: ignore[union-attr]


def _jitter(choice: random.Random, root: etree._Element) -> None:
    """Shift positions by some cm, but not headings and speeds, which trackers smooth."""
    for one in _share(choice, root):
        noise = np.random.default_rng(choice.getrandbits(64)).normal(size=one.positions.shape)
        for before, here in pairwise(noise):  # rows of the array, changed in place
            here *= math.sqrt(1 - _JITTER_KEPT**2)
            here += _JITTER_KEPT * before
        one.rewrite(one.positions + choice.uniform(*_JITTER_M) * noise, one.headings_rad, one.speeds_mps)


def _lane_less(choice: random.Random, root: etree._Element) -> None:
    """Let vehicles weave to either side of their recorded path; headings and speeds follow."""
    for one in _share(choice, root):
        if one.element.findtext("type") == "pedestrian" or length_m(one.positions) < _WAVE_M[0] / 2:
            continue
        aside_m, fastest = choice.uniform(*_ASIDE_M), float(one.speeds_mps.max())
        wave_m = max(choice.uniform(*_WAVE_M), 2 * math.pi * fastest * math.sqrt(aside_m / _LATERAL_MPS2))
        phase = choice.uniform(-math.pi, math.pi) + 2 * math.pi * arc_length(one.positions) / wave_m
        slope = aside_m * 2 * math.pi / wave_m * np.cos(phase)
        left = np.column_stack([-np.sin(one.headings_rad), np.cos(one.headings_rad)])
        one.rewrite(
            one.positions + (aside_m * np.sin(phase))[:, None] * left,
            one.headings_rad + np.arctan(slope),
            one.speeds_mps * np.hypot(1.0, slope),
        )


def _parked_row(choice: random.Random, root: etree._Element) -> None:
    """Add a row of cars next to a road, not on a lanelet or in the path of a road user."""
    lanes = [shapely.Polygon(np.vstack([_bound(one, "left"), _bound(one, "right")[::-1]])) for one in _lanelets(root)]
    area = shapely.union_all([shapely.make_valid(lane) for lane in lanes])
    there = shapely.MultiPoint(np.vstack([_starts(root), *(one.positions for one in _recordings(root))]))
    for line, side in _kerbs(choice, root, choice.randint(1, 3)):
        station, turned = choice.uniform(2.0, 10.0), choice.random() < 0.2
        for _ in range(choice.randint(3, 10)):
            size = choice.uniform(4.0, 5.0), choice.uniform(1.65, 1.95)
            station += size[0] / 2
            point, heading = point_at(line, station)
            place = shapely.Point(_shifted(point, heading, side * (size[1] / 2 + choice.uniform(0.2, 0.6))))
            if station < length_m(line) and not area.intersects(place) and there.distance(place) > _APART_M:
                way = heading + math.pi if turned else heading
                state = (place.x, place.y, math.remainder(way, 2 * math.pi), 0.0)
                _add_road_user(root, "parkedVehicle", size, [state])
            station += size[0] / 2 + choice.uniform(0.6, 1.8)


def _pedestrians(choice: random.Random, root: etree._Element) -> None:
    """Add pedestrians that walk along the road on either side, in either direction, until the last step or the
    road's end.
    """
    step_s = float(root.get("timeStepSize", "0.1"))
    lasts = (one.states[-1].findtext("time/exact") for one in _recordings(root))
    steps = max((int(text) for text in lasts if text), default=round(_ALONE_S / step_s))
    for line, side in _kerbs(choice, root, choice.randint(1, 5)):
        way = line if choice.random() < 0.5 else line[::-1]
        outside = side if way is line else -side
        speed, aside = choice.uniform(0.9, 1.7), choice.uniform(0.8, 2.0)
        begin = choice.uniform(0.0, length_m(way) / 2)
        stations = begin + speed * step_s * np.arange(steps + 1)
        places = [point_at(way, float(station)) for station in stations[stations < length_m(way)]]
        states = [(*_shifted(point, heading, outside * aside).tolist(), heading, speed) for point, heading in places]
        if len(states) > _FEWEST_STATES:
            _add_road_user(root, "pedestrian", (0.5, 0.6), states)


def _lanelets(root: etree._Element) -> list[etree._Element]:
    return root.findall("lanelet")


def _bound(lanelet: etree._Element, side: str) -> Points:
    points = lanelet.iterfind(f"{side}Bound/point")
    return np.array([[float(point.findtext("x", "nan")), float(point.findtext("y", "nan"))] for point in points])


def _starts(root: etree._Element) -> Points:
    """Return the starts of egos."""
    points = root.iterfind("planningProblem/initialState/position/point")
    starts = [[float(point.findtext("x", "nan")), float(point.findtext("y", "nan"))] for point in points]
    return np.array(starts, dtype=float).reshape(-1, 2)


def _kerbs(choice: random.Random, root: etree._Element, count: int) -> Iterator[tuple[Points, float]]:
    """Return bounds of lanelets without a neighbour, and the free side: 1 left, -1 right."""
    sides = {"left": 1.0, "right": -1.0}
    outer = [
        (lanelet, side)
        for lanelet in _lanelets(root)
        for side in sides
        if lanelet.find(f"adjacent{side.title()}") is None and length_m(_bound(lanelet, side)) > 2 * _FEWEST_STATES
    ]
    for lanelet, side in choice.sample(outer, min(count, len(outer))):
        yield _bound(lanelet, side), sides[side]


def _shifted(point: Points, heading_rad: float, left_m: float) -> Points:
    return np.asarray(point + left_m * np.array([-math.sin(heading_rad), math.cos(heading_rad)]))


def _next_id(root: etree._Element) -> int:
    return 1 + max(int(element.get("id", "0")) for element in root.iter("*") if element.get("id", "0").isdecimal())


def _add_road_user(
    root: etree._Element, kind: str, size: tuple[float, float], states: Sequence[tuple[float, ...]]
) -> None:
    """Add an obstacle before the first moving one; with one state it stands. ``states``: x, y, heading, speed."""
    role = "static" if len(states) == 1 else "dynamic"
    is_old = root.get("commonRoadVersion") == "2018b"
    obstacle = etree.Element("obstacle" if is_old else f"{role}Obstacle", id=str(_next_id(root)))
    if is_old:
        etree.SubElement(obstacle, "role").text = role
    etree.SubElement(obstacle, "type").text = kind
    rectangle = etree.SubElement(etree.SubElement(obstacle, "shape"), "rectangle")
    for name, value in zip(("length", "width"), size, strict=True):
        etree.SubElement(rectangle, name).text = f"{value:.3f}"
    trajectory = etree.Element("trajectory")
    for step, row in enumerate(states):
        state = etree.SubElement(trajectory if step else obstacle, "state" if step else "initialState")
        point = etree.SubElement(etree.SubElement(state, "position"), "point")
        for name, value in zip(("x", "y"), row[:2], strict=True):
            etree.SubElement(point, name).text = f"{value:.6f}"
        values = {"orientation": f"{row[2]:.6f}", "time": str(step)}
        for name, text in (values | ({} if role == "static" else {"velocity": f"{row[3]:.6f}"})).items():
            etree.SubElement(etree.SubElement(state, name), "exact").text = text
    if role == "dynamic":
        obstacle.append(trajectory)
    next(element for element in root if element.find("trajectory") is not None).addprevious(obstacle)


DISTURBANCES: tuple[Callable[[random.Random, etree._Element], None], ...] = (
    _cut_recordings,
    _jitter,
    _lane_less,
    _parked_row,
    _pedestrians,
)
"""Each changes some random road users of a scenario's tree."""


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seed", type=int)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--mutated", action="store_true", help="write maps that must be read or refused")
    parser.add_argument("--scenarios", action="store_true", help="write scenarios")
    given = parser.parse_args()
    make = mutated_maps if given.mutated else fresh_scenarios if given.scenarios else fresh_maps
    make(given.seed, given.folder, given.count)
