"""Checks that exported roads and scenarios match their source, and that imported ones can be driven.

Keys:

- ``opendrive_within_share``: the smaller of two shares: the points of lanelet bounds within 0.1 m of the same bound in
  the exported .xodr, and the points on that bound (every 0.5 m) within 0.1 m of the lanelet's. ``opendrive_max_m``: the
  largest distance. OpenDRIVE's formulas are evaluated here (reference line, lane offset, widths).
- ``opendrive_valid``, ``openscenario_valid``: share of the files that ASAM's schema accepts.
- ``openscenario_same_share``: share of the recorded poses with the same centre in the exported .xosc at the same time
  within 1 mm.
- ``filled_networks_ok``: share of the public road networks that could be filled with new traffic and pass all checks of
  the written file: CommonRoad's schema, unchanged lanelets, an ego and a goal, no overlap at the start.
  ``filled_networks``: number of networks tried.
- ``lanelet2_read``: share of the lanelets of public networks, written as Lanelet2 by this module, that are read with
  the same id, bounds within 0.1 m and the same successors.
"""

import math
import random
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from commonroad.common.file_reader import CommonRoadFileReader
from lxml import etree
from numpy.typing import NDArray

from plannerforge.engine.commonroad import schema_errors
from plannerforge.engine.generation import generate_scenario
from plannerforge.engine.maps import convert_roads, read_map_file
from plannerforge.engine.scenarios import write_opendrive, write_openscenario
from plannerforge.schemas.artifacts import ForeignExportRequest
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.generation import ConvertMapRequest, GenerationRequest, VehicleDemand

from ..harness import Figures
from .bench import MapsBench

Line = NDArray[np.float64]
NEAR_M, EVERY_M, SAME_NODE_M, SAME_POSE_M = 0.1, 0.5, 0.02, 1e-3
FILLED = 40
EXPORTED = 60
"""Number of exported public scenarios (chosen), in addition to those of filled networks."""


def measure(bench: MapsBench) -> Figures:
    """Export, fill and read as the module says; networks are taken evenly from the public ones."""
    files = sorted((bench.shared / "data" / "commonroad").glob("*.xml"))
    scratch = bench.folder("formats")
    figures: dict[str, float | int | str] = {}
    filled, made = _filled(_spread(files, min(FILLED, bench.limit or FILLED)), scratch)
    figures |= filled
    figures |= _exports([*_spread(files, min(EXPORTED, bench.limit or EXPORTED)), *made], scratch)
    figures |= _lanelet2(_spread(files, min(30, bench.limit or 30)), scratch)
    return figures


def _spread(files: Sequence[Path], count: int) -> list[Path]:
    return [files[index * len(files) // count] for index in range(min(count, len(files)))]


def _quiet(share: float, message: str = "") -> None:
    """Ignore the progress."""


def _network(path: Path) -> object:
    return CommonRoadFileReader(str(path)).open()[0].lanelet_network


def _exports(files: Sequence[Path], scratch: Path) -> dict[str, float | int | str]:
    near, points, back, places, farthest_m, same, poses = 0, 0, 0, 0, 0.0, 0, 0
    valid_roads, valid_plays = 0, 0
    roads_schema, play_schema = asam_schema("opendrive_17_core.xsd"), asam_schema("OpenSCENARIO_1_2.xsd")
    for path in files:
        roads, play = scratch / "roads.xodr", scratch / "play.xosc"
        request = ForeignExportRequest(scenario_path=str(path), target_path=str(roads), roads=roads.name)
        write_opendrive(request, _quiet)
        write_openscenario(request.model_copy(update={"target_path": str(play)}), _quiet)
        valid_roads += roads_schema.validate(etree.parse(roads))
        valid_plays += play_schema.validate(etree.parse(play))
        scenario = CommonRoadFileReader(str(path)).open()[0]
        drawn = bounds_of(roads)
        for lanelet in scenario.lanelet_network.lanelets:
            for side, bound in enumerate((lanelet.left_vertices, lanelet.right_vertices)):
                given, points = np.asarray(bound)[:, :2], points + len(bound)
                if lanelet.lanelet_id not in drawn:
                    continue
                read = drawn[lanelet.lanelet_id][side]
                away, there = _distances(given, read), _distances(read, given)
                near, back, places = near + _near(away), back + _near(there), places + len(read)
                farthest_m = max(farthest_m, float(away.max()), float(there.max()))
        errors = _pose_errors_m(scenario, play)
        same, poses = same + sum(error <= SAME_POSE_M for error in errors), poses + len(errors)
    return {
        "opendrive_within_share": min(near / max(points, 1), back / max(places, 1)),
        "opendrive_max_m": round(farthest_m, 3),
        "opendrive_points": points + places,
        "opendrive_valid": valid_roads / len(files),
        "openscenario_same_share": same / max(poses, 1),
        "openscenario_poses": poses,
        "openscenario_valid": valid_plays / len(files),
        "exported_scenarios": len(files),
    }


def _near(distances_m: Line) -> int:
    return int((distances_m <= NEAR_M).sum())


def asam_schema(name: str) -> etree.XMLSchema:
    """Return an ASAM schema from the package scenariogeneration."""
    import scenariogeneration

    return etree.XMLSchema(etree.parse(Path(scenariogeneration.__file__).parents[1] / "schemas" / name))


def _distances(points: Line, line: Line) -> NDArray[np.float64]:
    from shapely import LineString, distance
    from shapely import points as as_points

    found: NDArray[np.float64] = distance(as_points(points), LineString(line))
    return found


def bounds_of(path: Path) -> dict[int, tuple[Line, Line]]:
    """Return left and right bound of each lanelet in an OpenDRIVE file, by the formulas of ASAM OpenDRIVE 1.7.

    Section 7: reference line of paramPoly3 pieces with a normalised parameter; 9.4: lane offset; 9.5: widths.
    """
    found: dict[int, tuple[Line, Line]] = {}
    for road in etree.parse(path).getroot().iterfind("road"):
        lanes = sorted(road.iterfind("lanes/laneSection/right/lane"), key=lambda lane: -int(lane.get("id", "0")))
        offsets = [_numbers(one, "s") for one in road.iterfind("lanes/laneOffset")]
        widths = [[_numbers(one, "sOffset") for one in lane.iterfind("width")] for lane in lanes]
        length = float(road.get("length", "0"))
        stations = np.linspace(0.0, length, max(math.ceil(length / EVERY_M), 2) + 1)
        changes = [row[0] for rows in (offsets, *widths) for row in rows]
        stations = np.unique(np.concatenate([stations, changes]))
        lines: list[list[tuple[float, float]]] = [[] for _ in range(len(lanes) + 1)]
        for station in stations[stations <= length]:
            x, y, heading = _reference(road, float(station))
            beside = _cubic(offsets, float(station))
            for line, profile in zip(lines, [None, *widths], strict=True):
                beside -= 0.0 if profile is None else _cubic(profile, float(station))
                line.append((x - math.sin(heading) * beside, y + math.cos(heading) * beside))
        for number, lane in enumerate(lanes):
            key = next(int(note.get("value", "0")) for note in lane.iterfind("userData"))
            found[key] = np.array(lines[number]), np.array(lines[number + 1])
    return found


def _numbers(element: "etree._Element", first: str) -> tuple[float, ...]:
    return tuple(float(element.get(name, "0")) for name in (first, "a", "b", "c", "d"))


def _cubic(rows: Sequence[tuple[float, ...]], station: float) -> float:
    start, a, b, c, d = next(row for row in reversed(rows) if row[0] <= station + 1e-9)
    ds = station - start
    return a + b * ds + c * ds**2 + d * ds**3


def _reference(road: "etree._Element", station: float) -> tuple[float, float, float]:
    """Return x, y in m and heading in rad of a road's reference line."""
    piece = [one for one in road.iterfind("planView/geometry") if float(one.get("s", "0")) <= station + 1e-9][-1]
    curve = piece.find("paramPoly3")
    if curve is None or curve.get("pRange") != "normalized":
        raise ValueError("the reference line is no paramPoly3 with a normalised parameter")
    p = (station - float(piece.get("s", "0"))) / float(piece.get("length", "1"))
    u, v = ([float(curve.get(part + axis, "0")) for part in "abcd"] for axis in "UV")
    here = [sum(value * p**power for power, value in enumerate(line)) for line in (u, v)]
    ahead = [sum(power * value * p ** (power - 1) for power, value in enumerate(line) if power) for line in (u, v)]
    turn = float(piece.get("hdg", "0"))
    x = float(piece.get("x", "0")) + here[0] * math.cos(turn) - here[1] * math.sin(turn)
    y = float(piece.get("y", "0")) + here[0] * math.sin(turn) + here[1] * math.cos(turn)
    return x, y, turn + math.atan2(ahead[1], ahead[0])


def _pose_errors_m(scenario: object, path: Path) -> list[float]:
    """Return the distance of each recorded centre from the file's entity at the same time, infinite if it is
    missing.
    """
    root = ElementTree.parse(path).getroot()  # noqa: S314 - written by ourselves just now
    ahead = {
        str(one.get("name")): float(center.get("x", "0"))
        for one in root.iter("ScenarioObject")
        for center in one.iter("Center")
    }
    tracks = {
        str(actor.get("entityRef")): group for group in root.iter("ManeuverGroup") for actor in group.iter("EntityRef")
    }
    errors = []
    for obstacle in scenario.dynamic_obstacles:  # type: ignore[attr-defined]
        if obstacle.prediction is None or not hasattr(obstacle.prediction, "trajectory"):
            continue
        name = f"{obstacle.obstacle_type.value}_{obstacle.obstacle_id}"
        read = dict(_centres(tracks[name], ahead[name])) if name in tracks else {}
        for state in [obstacle.initial_state, *obstacle.prediction.trajectory.state_list]:
            x, y = read.get(round(state.time_step * scenario.dt, 6), (math.inf, math.inf))  # type: ignore[attr-defined]
            center = state.position if isinstance(state.position, np.ndarray) else state.position.center
            errors.append(math.hypot(x - center[0], y - center[1]))
    return errors


def _centres(group: ElementTree.Element, ahead_m: float) -> Iterator[tuple[float, tuple[float, float]]]:
    for vertex in group.iter("Vertex"):
        place = next(vertex.iter("WorldPosition"))
        x, y, heading = (float(place.get(key, "0")) for key in ("x", "y", "h"))
        center = x + ahead_m * math.cos(heading), y + ahead_m * math.sin(heading)
        yield round(float(vertex.get("time", "0")), 6), center


def _filled(files: Sequence[Path], scratch: Path) -> tuple[dict[str, float | int | str], list[Path]]:
    """Return the figures and the generated scenarios."""
    good, refused, made_files = 0, 0, list[Path]()
    for number, path in enumerate(files):
        try:
            made = _fill(path, number, scratch)
        except PlannerForgeError:
            refused += 1
            continue
        made_files.append(made)
        good += _is_sound(made, path)
    figures: dict[str, float | int | str] = {
        "filled_networks_ok": good / max(len(files), 1),
        "filled_networks": len(files),
        "filled_refused": refused,
        "filled_faulty": len(made_files) - good,
    }
    return figures, made_files


def _fill(path: Path, number: int, scratch: Path) -> Path:
    folder = Path(tempfile.mkdtemp(dir=scratch))
    roads = convert_roads(ConvertMapRequest(path=str(path), folder=str(folder)), _quiet).path
    found = read_map_file(Path(roads))
    choice = random.Random(number)  # noqa: S311 - reproducible, not secret
    request = GenerationRequest(
        map_path=roads,
        map_id="map_bench",
        place=found.name,
        country=found.country,
        attribution=found.attribution,
        density=choice.choice(("low", "medium", "high")),
        vehicles=(VehicleDemand(vehicle_class="truck", least=1),),
        seed=number,
        folder=str(folder),
    )
    generate_scenario(request, _quiet)
    return folder / "scenario.xml"


def _is_sound(made: Path, source: Path) -> bool:
    """Return True if the written file holds what was requested, judged without the generator."""
    scenario, problems = CommonRoadFileReader(str(made)).open()
    given = {
        lanelet.lanelet_id: lanelet for lanelet in CommonRoadFileReader(str(source)).open()[0].lanelet_network.lanelets
    }
    same = {lanelet.lanelet_id for lanelet in scenario.lanelet_network.lanelets} <= set(given) and all(
        np.allclose(lanelet.left_vertices, given[lanelet.lanelet_id].left_vertices[:, :2], atol=1e-3)
        for lanelet in scenario.lanelet_network.lanelets
    )
    problem = next(iter(problems.planning_problem_dict.values()))
    ego_on = scenario.lanelet_network.find_lanelet_by_position([problem.initial_state.position])[0]
    goal_on = scenario.lanelet_network.find_lanelet_by_position([problem.goal.state_list[0].position.center])[0]
    boxes = [obstacle.occupancy_at_time(0).shape.shapely_object for obstacle in scenario.dynamic_obstacles]
    apart = all(one.intersection(other).area < 1e-6 for index, one in enumerate(boxes) for other in boxes[index + 1 :])
    trucks = any(obstacle.obstacle_type.value == "truck" for obstacle in scenario.dynamic_obstacles)
    return same and apart and trucks and bool(ego_on) and bool(goal_on) and not schema_errors(made)


def _lanelet2(files: Sequence[Path], scratch: Path) -> dict[str, float | int | str]:
    good, total = 0, 0
    for path in files:
        lanelets = {one.lanelet_id: one for one in CommonRoadFileReader(str(path)).open()[0].lanelet_network.lanelets}
        source = scratch / "lanes.osm"
        following = write_lanelet2(lanelets, source)
        folder = Path(tempfile.mkdtemp(dir=scratch))
        made = convert_roads(ConvertMapRequest(path=str(source), folder=str(folder)), _quiet)
        read = {one.lanelet_id: one for one in CommonRoadFileReader(made.path).open()[0].lanelet_network.lanelets}
        shift = _shift(Path(made.path))
        for key, lanelet in lanelets.items():
            total += 1
            good += key in read and _is_same(read[key], lanelet, shift) and set(read[key].successor) == following[key]
    return {"lanelet2_read": good / max(total, 1), "lanelet2_lanelets": total}


def _shift(path: Path) -> tuple[float, float]:
    """Return the offset of the file's plane from the written coordinates, by the position of its middle."""
    latitude = float(etree.parse(path).findtext("location/gpsLatitude") or 0)
    longitude = float(etree.parse(path).findtext("location/gpsLongitude") or 0)
    return _metres(latitude, longitude)


_METRES_A_DEGREE = 111_000.0


def _metres(latitude: float, longitude: float) -> tuple[float, float]:
    """Return the position of :func:`write_lanelet2` in its plane, in m near the equator."""
    from pyproj import Proj

    x, y = Proj("+proj=tmerc +lat_0=0 +lon_0=0 +k=1 +ellps=WGS84")(longitude, latitude)
    return float(x), float(y)


def _is_same(read: object, given: object, shift: tuple[float, float]) -> bool:
    sides = ("left_vertices", "right_vertices")
    pairs = [
        (np.asarray(getattr(read, side))[:, :2] + shift, np.asarray(getattr(given, side))[:, :2]) for side in sides
    ]
    return all(float(_distances(one, other).max()) <= NEAR_M for one, other in pairs)


def write_lanelet2(lanelets: "dict[int, object]", path: Path) -> dict[int, set[int]]:
    """Write lanelets as a Lanelet2 map near 0° N 0° E; the lanelets that follow each by its nodes.

    Bounds that coincide are one way, and every other way runs against its lanelets.
    """
    from pyproj import Proj

    plane = Proj("+proj=tmerc +lat_0=0 +lon_0=0 +k=1 +ellps=WGS84")
    grid: dict[tuple[int, int], list[tuple[float, float, int]]] = {}
    nodes: list[tuple[float, float]] = []

    def node_at(x: float, y: float) -> int:
        column, row = round(x / SAME_NODE_M), round(y / SAME_NODE_M)
        near = [one for i in (-1, 0, 1) for j in (-1, 0, 1) for one in grid.get((column + i, row + j), ())]
        for x0, y0, key in near:
            if math.hypot(x - x0, y - y0) < SAME_NODE_M:
                return key
        nodes.append((x, y))
        grid.setdefault((column, row), []).append((x, y, 10_000_000 + len(nodes)))
        return 10_000_000 + len(nodes)

    ways: dict[tuple[int, ...], int] = {}
    ends: dict[int, tuple[tuple[int, int], tuple[int, int]]] = {}
    relations: list[etree._Element] = []
    for key, lanelet in lanelets.items():
        relation = etree.Element("relation", id=str(key))
        sides = []
        for role in ("left", "right"):
            line = np.asarray(getattr(lanelet, f"{role}_vertices"))[:, :2].tolist()
            keys = tuple(dict.fromkeys(node_at(x, y) for x, y in line))
            known = keys[::-1] if keys[::-1] in ways else keys
            ref = ways.setdefault(known, 20_000_000 + len(ways))
            etree.SubElement(relation, "member", type="way", ref=str(ref), role=role)
            sides.append(keys)
        ends[key] = (sides[0][0], sides[1][0]), (sides[0][-1], sides[1][-1])
        for name, value in (("type", "lanelet"), ("subtype", "road"), ("location", "urban"), ("one_way", "yes")):
            etree.SubElement(relation, "tag", k=name, v=value)
        relations.append(relation)
    root = etree.Element("osm", version="0.6")
    for number, (x, y) in enumerate(nodes, start=10_000_001):
        longitude, latitude = plane(x, y, inverse=True)
        etree.SubElement(root, "node", id=str(number), lat=f"{latitude:.11f}", lon=f"{longitude:.11f}")
    for number, (keys, ref) in enumerate(ways.items()):
        way = etree.SubElement(root, "way", id=str(ref))
        for one in keys[:: -1 if number % 2 else 1]:
            etree.SubElement(way, "nd", ref=str(one))
    root.extend(relations)
    path.write_bytes(etree.tostring(root))
    return {key: {other for other, (start, _) in ends.items() if start == end} for key, (_, end) in ends.items()}
