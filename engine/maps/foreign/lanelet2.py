"""Converts Lanelet2 maps (OpenStreetMap's XML with other tags) to CommonRoad road networks.

Format: https://github.com/fzi-forschungszentrum-informatik/Lanelet2 (LaneletPrimitives, LinestringTagging). A lanelet
is a relation of two ways, its bounds, which may be stored in either direction. Shared nodes determine successors,
shared ways determine neighbours. The reader is our own, because the library would parse foreign files in native code.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from lxml import etree

from ....schemas.errors import UnsafeInput
from ....schemas.text import cited, counted, shown_name
from ...commonroad import scan_xml, speed_limit_number
from ...geometry import Points, arc_length, without_repeats
from ..osm import LIMITS

LARGEST_ID = 2**31
SAME_PLACE_M = 0.01
"""Nodes no farther apart than this are one (chosen): many files give degrees with 7 decimals, which is 1 cm."""
MOST_LANELETS = 10_000
"""Chosen, as for all CommonRoad files."""
USERS = {
    "road": "vehicle",
    "highway": "vehicle",
    "play_street": "vehicle",
    "emergency_lane": "priorityVehicle",
    "bus_lane": "bus",
    "bicycle_lane": "bicycle",
    "walkway": "pedestrian",
    "crosswalk": "pedestrian",
    "stairs": "pedestrian",
    "shared_walkway": "pedestrian",
}
"""CommonRoad's user of a lanelet by its subtype."""
KINDS = {"highway": "highway", "crosswalk": "crosswalk", "walkway": "sidewalk", "stairs": "sidewalk"}
KINDS |= {"shared_walkway": "sidewalk", "bicycle_lane": "bicycleLane", "bus_lane": "busLane"}
"""CommonRoad's type of a lanelet by its subtype."""
PARTICIPANTS = {
    "vehicle:car": "car",
    "vehicle:truck": "truck",
    "vehicle:bus": "bus",
    "vehicle:motorcycle": "motorcycle",
    "vehicle:taxi": "taxi",
    "vehicle:emergency": "priorityVehicle",
    "bicycle": "bicycle",
    "pedestrian": "pedestrian",
}
"""CommonRoad's user by Lanelet2's participant."""
PARTICIPANT = "participant:"
"""Prefix of a participant in the key of a tag that states whether it may use a lanelet."""
_NO = ("no", "false", "0")
MPS_OF = {"km/h": 1 / 3.6, "kmh": 1 / 3.6, "mph": 0.44704, "m/s": 1.0, "mps": 1.0, "": 1 / 3.6}
_PLANE = "+proj=tmerc +lat_0={:.7f} +lon_0={:.7f} +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"
_SPEED = re.compile(r"\s*(\d{1,3}(?:\.\d{1,3})?)\s*([a-z/]*)\s*")


@dataclass(frozen=True)
class _Relation:
    key: int
    left: tuple[int, ...]
    right: tuple[int, ...]
    rules: tuple[int, ...]
    tags: Mapping[str, str]


@dataclass(frozen=True)
class _Lane:
    """A lanelet: the nodes of its bounds in driving direction, the ways that form the bounds, and its points."""

    key: int
    left_nodes: tuple[int, ...]
    right_nodes: tuple[int, ...]
    left_ways: frozenset[int]
    right_ways: frozenset[int]
    left: Points
    right: Points
    subtype: str
    speed_mps: float | None
    users: tuple[str, ...]


@dataclass(frozen=True)
class _Plane:
    """Positions of nodes (x, y) in m by id; ``projection`` is empty if the file has no positions in degrees."""

    positions: Mapping[int, tuple[float, float]]
    projection: str
    degrees: tuple[float, float]

    @cached_property
    def same(self) -> dict[int, int]:
        """The id of the first node near each node, by id; some programs write a node for every line's end."""
        from scipy.spatial import cKDTree

        keys = list(self.positions)
        if not keys:
            return {}
        tree = cKDTree(np.array(list(self.positions.values())))
        first = list(range(len(keys)))
        for one, other in sorted(tree.query_pairs(SAME_PLACE_M)):
            first[other] = min(first[other], first[one])
        return {key: keys[first[number]] for number, key in enumerate(keys)}


def convert_lanelet2(source: Path, target: Path) -> tuple[str, ...]:
    """Write the lanelets of a Lanelet2 map as a CommonRoad road network; return descriptions of what is lost.

    Raises:
        UnsafeInput: the file is hostile, broken, or has no lanelet with two bounds.
    """
    name = scan_xml(source, LIMITS).name
    if name != "osm":
        raise UnsafeInput(
            f"{shown_name(source.name)} is not a Lanelet2 map: its root element is <{shown_name(name)}>, not <osm>"
        )
    try:
        root = etree.parse(source, etree.XMLParser(resolve_entities=False, no_network=True)).getroot()
        plane = _plane(root)
        ways = {_id(way): tuple(int(node.attrib["ref"]) for node in way.iterfind("nd")) for way in root.iterfind("way")}
        relations = [_relation(one) for one in root.iterfind("relation")]
    except (KeyError, ValueError, ArithmeticError, etree.LxmlError) as error:
        raise UnsafeInput(f"{shown_name(source.name)} is not readable as Lanelet2: {cited(error)}") from error
    wanted = [one for one in relations if one.tags.get("type") == "lanelet"]
    if len(wanted) > MOST_LANELETS:
        raise UnsafeInput(
            f"{shown_name(source.name)} has {len(wanted):,} lanelets", valid=[f"at most {MOST_LANELETS:,}"]
        )
    limits = _limits(relations)
    lanes = [lane for one in wanted if (lane := _lane(one, ways, plane, limits)) is not None]
    if not lanes:
        raise UnsafeInput(
            f"{shown_name(source.name)} has no lanelet with two bounds", next_step="use a map with lanelets in it"
        )
    closed = [lane for lane in lanes if not lane.users]
    lost = _lost(root, relations, wanted, lanes)
    lanes = [lane for lane in lanes if lane.users]
    if closed:
        lost.append(f"{counted(len(closed), 'lanelet')} that no participant may use")
    if not lanes:
        raise UnsafeInput(
            f"no participant may use any lanelet of {shown_name(source.name)} (tags participant:…)",
            next_step="use a map with open lanelets in it",
        )
    if len({lane.key for lane in lanes}) < len(lanes) or any(not 0 < lane.key < LARGEST_ID for lane in lanes):
        lanes = [replace(lane, key=number) for number, lane in enumerate(lanes, start=1)]
        lost.append("ids of lanelets that CommonRoad cannot store: they are renumbered")
    if not plane.projection:
        lost.append("no positions in degrees: its roads get an artificial place near 0°, 0°")
    target.write_bytes(etree.tostring(_document(source, plane, lanes), encoding="UTF-8", xml_declaration=True) + b"\n")
    return tuple(lost)


def _id(element: etree._Element) -> int:
    return int(element.attrib["id"])


def _tags(element: etree._Element) -> dict[str, str]:
    return {tag.get("k", ""): tag.get("v", "") for tag in element.iterfind("tag")}


def _relation(element: etree._Element) -> _Relation:
    members: dict[str, list[int]] = {}
    for member in element.iterfind("member"):
        members.setdefault(member.get("role", ""), []).append(int(member.attrib["ref"]))
    return _Relation(
        _id(element),
        tuple(members.get("left", ())),
        tuple(members.get("right", ())),
        tuple(members.get("regulatory_element", ())),
        _tags(element),
    )


def _plane(root: etree._Element) -> _Plane:
    """Return every node in metres, projected around the middle of all nodes or given by tags as plane coordinates."""
    from pyproj import Proj

    nodes = list(root.iterfind("node"))
    degrees = {_id(node): (_float(node.get("lat", "nan")), _float(node.get("lon", "nan"))) for node in nodes}
    table = np.array(list(degrees.values()), dtype=float).reshape(-1, 2)
    usable = len(table) > 0 and bool(np.isfinite(table).all()) and bool((np.abs(table) <= (84.0, 180.0)).all())
    if usable and bool((np.ptp(table, axis=0) > 0).any()):
        latitude, longitude = np.round((table.min(axis=0) + table.max(axis=0)) / 2, 7).tolist()
        projection = _PLANE.format(latitude, longitude)
        x, y = Proj(projection)(table[:, 1], table[:, 0])
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise ValueError("its nodes are too far apart for one map")
        return _Plane(
            dict(zip(degrees, zip(x.tolist(), y.tolist(), strict=True), strict=True)), projection, (latitude, longitude)
        )
    positions = {}
    for node in nodes:
        tags = _tags(node)
        positions[_id(node)] = _float(tags.get("local_x", "nan")), _float(tags.get("local_y", "nan"))
    if not np.isfinite(np.array(list(positions.values()))).all():
        raise ValueError("a node has no position: neither lat and lon nor local_x and local_y are numbers")
    return _Plane(positions, "", (999.0, 999.0))


def _float(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _limits(relations: list[_Relation]) -> dict[int, float]:
    """Return speed limits in m/s by the regulatory element that states them."""
    found = {}
    for one in relations:
        if one.tags.get("subtype") == "speed_limit":
            speed = _speed(one.tags.get("sign_type", "")) or _speed(one.tags.get("limit", ""))
            if speed is not None:
                found[one.key] = speed
    return found


def _speed(text: str) -> float | None:
    match = _SPEED.fullmatch(text.lower())
    if match is None or match[2] not in MPS_OF:
        return None
    speed_mps = float(match[1]) * MPS_OF[match[2]]
    return speed_mps if speed_mps > 0 else None


def _lane(
    relation: _Relation, ways: Mapping[int, tuple[int, ...]], plane: _Plane, limits: Mapping[int, float]
) -> _Lane | None:
    left, right = _chain(relation.left, ways), _chain(relation.right, ways)
    if not all(key in plane.positions for key in (*left, *right)) or len(left) < 2 or len(right) < 2:
        return None
    lines = [np.array([plane.positions[key] for key in keys]) for keys in (left, right)]
    straight = np.linalg.norm(lines[0][[0, -1]] - lines[1][[0, -1]], axis=1).sum()
    crossed = np.linalg.norm(lines[0][[0, -1]] - lines[1][[-1, 0]], axis=1).sum()
    if crossed < straight:
        right, lines[1] = right[::-1], lines[1][::-1]
    if _area(np.vstack([lines[1], lines[0][::-1]])) < 0:
        left, right = left[::-1], right[::-1]
        lines = [line[::-1] for line in lines]
    if any(len(without_repeats(line)) < 2 for line in lines):
        return None
    left_line, right_line = _level(without_repeats(lines[0]), without_repeats(lines[1]))
    own = _speed(relation.tags.get("speed_limit", ""))
    posted = own or next((limits[rule] for rule in relation.rules if rule in limits), None)
    subtype = relation.tags.get("subtype", "")
    ways_of = frozenset(relation.left), frozenset(relation.right)
    users = users_of(relation.tags)
    left, right = (tuple(plane.same[key] for key in keys) for keys in (left, right))
    return _Lane(relation.key, left, right, *ways_of, left_line, right_line, subtype, posted, users)


def users_of(tags: Mapping[str, str]) -> tuple[str, ...]:
    """Return CommonRoad's users of a lanelet with these tags.

    As in Lanelet2's traffic rules, the subtype decides if there is no tag ``participant:…``. Otherwise a participant
    may use the lanelet if the longest matching tag allows it, and no other participant may.
    """
    overrides = {key.removeprefix(PARTICIPANT): value for key, value in tags.items() if key.startswith(PARTICIPANT)}
    if not overrides:
        return (USERS.get(tags.get("subtype", ""), "vehicle"),)
    allowed = []
    for participant, user in PARTICIPANTS.items():
        fitting = [key for key in overrides if participant == key or participant.startswith(f"{key}:")]
        if fitting and overrides[max(fitting, key=len)].strip().lower() not in _NO:
            allowed.append(user)
    vehicles = [user for participant, user in PARTICIPANTS.items() if participant.startswith("vehicle:")]
    others = [user for user in allowed if user not in vehicles]
    return ("vehicle", *others) if set(vehicles) <= set(allowed) else tuple(allowed)


def _chain(keys: tuple[int, ...], ways: Mapping[int, tuple[int, ...]]) -> tuple[int, ...]:
    """Return the nodes of a bound in sequence; it may consist of several ways, each in either direction."""
    parts = [ways[key] for key in keys if ways.get(key)]
    if not parts:
        return ()
    line = list(parts[0])
    if len(parts) > 1 and line[-1] not in (parts[1][0], parts[1][-1]):
        line.reverse()
    for part in parts[1:]:
        line += part[1:] if part[0] == line[-1] else part[-2::-1] if part[-1] == line[-1] else part
    return tuple(line)


def _area(ring: Points) -> float:
    """Return twice the signed area of a ring (n, 2): positive if it runs counter-clockwise."""
    x, y = ring.T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def _level(left: Points, right: Points) -> tuple[Points, Points]:
    """Return the two bounds with equally many points: each keeps its points and gets one for each point of the
    other.
    """
    shares = [arc_length(line) / arc_length(line)[-1] for line in (left, right)]
    every = np.unique(np.concatenate(shares))
    kept = every[np.concatenate([[True], np.diff(every) > 1e-9])]
    kept[-1] = 1.0
    one, other = (
        np.column_stack([np.interp(kept, share, line[:, axis]) for axis in (0, 1)])
        for share, line in zip(shares, (left, right), strict=True)
    )
    return one, other


def _lost(root: etree._Element, relations: list[_Relation], wanted: list[_Relation], lanes: list[_Lane]) -> list[str]:
    lights = sum(one.tags.get("subtype") == "traffic_light" for one in relations)
    areas = sum(one.tags.get("type") == "multipolygon" for one in relations)
    rules = sum(one.tags.get("subtype") in ("right_of_way", "all_way_stop") for one in relations)
    both_ways = sum(one.tags.get("one_way", "") in ("no", "false") for one in wanted)
    heights = any(tag.get("k") == "ele" and _float(tag.get("v", "0")) for tag in root.iterfind("node/tag"))
    counts = (
        (len(wanted) - len(lanes), "lanelet", "without two bounds"),
        (lights, "traffic light", "(the format has no programmes of lights)"),
        (rules, "right-of-way rule", "(right before left and turn directions apply)"),
        (areas, "area", ""),
        (both_ways, "lanelet", "for both directions (only the stored direction is used)"),
    )
    lost = [f"{counted(count, what)} {more}".strip() for count, what, more in counts if count]
    return lost + ["heights"] * heights


def _document(source: Path, plane: _Plane, lanes: list[_Lane]) -> etree._Element:
    place = "".join(word.capitalize() for word in re.findall(r"[A-Za-z0-9]+", source.stem))[:40] or "Lanelets"
    root = etree.Element(
        "commonRoad",
        {
            "timeStepSize": "0.1",
            "commonRoadVersion": "2020a",
            "benchmarkID": f"ZAM_{place}-1_1_T-1",
            "author": "PlannerForge",
            "affiliation": "",
            "source": "Lanelet2",
            "date": "2025-01-01",
        },
    )
    location = _add(root, "location")
    _add(location, "geoNameId", "-999")
    _add(location, "gpsLatitude", f"{plane.degrees[0]:.7f}")
    _add(location, "gpsLongitude", f"{plane.degrees[1]:.7f}")
    if plane.projection:
        transformation = _add(location, "geoTransformation")
        _add(transformation, "geoReference", plane.projection)
        additional = _add(transformation, "additionalTransformation")
        for tag, text in (("xTranslation", "0.0"), ("yTranslation", "0.0"), ("zRotation", "0.0"), ("scaling", "1.0")):
            _add(additional, tag, text)
    _add(root, "scenarioTags")
    first_sign = max(lane.key for lane in lanes) + 1
    speeds = sorted({lane.speed_mps for lane in lanes if lane.speed_mps is not None})
    signs = {speed: first_sign + number for number, speed in enumerate(speeds)}
    following, before, adjoining = _relations(lanes)
    for lane in lanes:
        _write(root, lane, before[lane.key], following[lane.key], adjoining[lane.key], signs)
    for speed, key in signs.items():
        sign = etree.SubElement(root, "trafficSign", {"id": str(key)})
        inside = _add(sign, "trafficSignElement")
        _add(inside, "trafficSignID", speed_limit_number("ZAM") or "274")
        _add(inside, "additionalValue", f"{speed:.4f}")
        point = next(lane.right[0] for lane in lanes if lane.speed_mps == speed)
        _point(_add(sign, "position"), point)
        _add(sign, "virtual", "true")
    return root


_Adjoining = dict[str, tuple[int, str]]


def _relations(lanes: list[_Lane]) -> tuple[dict[int, list[int]], dict[int, list[int]], dict[int, _Adjoining]]:
    """Return successors, predecessors, and neighbours (side → id and driving direction) of each lanelet."""
    starts: dict[tuple[int, int], list[int]] = {}
    on_right: dict[frozenset[int], list[_Lane]] = {}
    on_left: dict[frozenset[int], list[_Lane]] = {}
    for lane in lanes:
        starts.setdefault((lane.left_nodes[0], lane.right_nodes[0]), []).append(lane.key)
        on_left.setdefault(lane.left_ways, []).append(lane)
        on_right.setdefault(lane.right_ways, []).append(lane)
    following = {lane.key: starts.get((lane.left_nodes[-1], lane.right_nodes[-1]), []) for lane in lanes}
    before: dict[int, list[int]] = {lane.key: [] for lane in lanes}
    for key, after in following.items():
        for one in after:
            before[one].append(key)
    adjoining: dict[int, _Adjoining] = {lane.key: {} for lane in lanes}
    for lane in lanes:
        for side, ways, nodes, same, opposite in (
            ("adjacentLeft", lane.left_ways, lane.left_nodes, on_right, on_left),
            ("adjacentRight", lane.right_ways, lane.right_nodes, on_left, on_right),
        ):
            for other in same.get(ways, []):
                shared = other.right_nodes if side == "adjacentLeft" else other.left_nodes
                if other is not lane and shared == nodes:
                    adjoining[lane.key].setdefault(side, (other.key, "same"))
            for other in opposite.get(ways, []):
                shared = other.left_nodes if side == "adjacentLeft" else other.right_nodes
                if other is not lane and shared == nodes[::-1]:
                    adjoining[lane.key].setdefault(side, (other.key, "opposite"))
    return following, before, adjoining


def _write(
    root: etree._Element,
    lane: _Lane,
    before: list[int],
    after: list[int],
    adjoining: _Adjoining,
    signs: Mapping[float, int],
) -> None:
    element = etree.SubElement(root, "lanelet", {"id": str(lane.key)})
    for tag, line in (("leftBound", lane.left), ("rightBound", lane.right)):
        bound = _add(element, tag)
        for point in line:
            _point(bound, point)
    for tag, keys in (("predecessor", before), ("successor", after)):
        for key in keys:
            etree.SubElement(element, tag, {"ref": str(key)})
    for side in ("adjacentLeft", "adjacentRight"):
        if side in adjoining:
            key, direction = adjoining[side]
            etree.SubElement(element, side, {"ref": str(key), "drivingDir": direction})
    _add(element, "laneletType", KINDS.get(lane.subtype, "urban" if lane.subtype == "road" else "unknown"))
    for user in lane.users:
        _add(element, "userOneWay", user)
    if lane.speed_mps is not None:
        etree.SubElement(element, "trafficSignRef", {"ref": str(signs[lane.speed_mps])})


def _point(parent: etree._Element, point: Points) -> None:
    element = _add(parent, "point")
    _add(element, "x", f"{point[0]:.4f}")
    _add(element, "y", f"{point[1]:.4f}")


def _add(parent: etree._Element, tag: str, text: str | None = None) -> etree._Element:
    element = etree.SubElement(parent, tag)
    element.text = text
    return element
