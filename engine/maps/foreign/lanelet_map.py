"""The lanelet network of a CommonRoad file as a map: traffic is generated on it unchanged, with its ids.

A map is stored as a CommonRoad file with only the road network (2020a, steps of 0.1 s). Vehicles and planning problems
of a scenario are left out; signs replace the speed limits of format 2018b.
"""

import math
import tempfile
from collections import Counter
from collections.abc import Set
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from ....schemas.errors import NotPossible, UnsafeInput
from ....schemas.text import counted, one_line, shown_name
from ...commonroad import (
    LoadedScenario,
    ScenarioDocument,
    friction_of,
    parse_benchmark_id,
    read_scenario,
    schema_faults,
    set_friction,
    speed_limit_number,
)
from ...network import GeoReference, RoadNetwork, net_over_lanelets
from ..osm import OSM_ATTRIBUTION
from .net_map import PROJECTION, NetMap, read_net_map

ROAD_ELEMENTS = ("lanelet", "trafficSign", "trafficLight", "intersection")
"""Elements of a file that make up its road network, in the order of CommonRoad's schema."""
STEP_S = 0.1
"""Time step of generated scenarios; the cycles of a stored map's lights count in it."""
NOWHERE = GeoReference("+proj=tmerc +lat_0=0 +lon_0=0 +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs", (0.0, 0.0))
"""Position of a network that does not state one: about 0° N 0° E, outside all countries."""
_ARTIFICIAL = "ZAM"
"""CommonRoad's country of networks without a location; if the file states a location, it decides."""
_OSM_WORDS = ("openstreetmap", "osm")
_SHORTEST_STEP_S = 1e-3
"""Tolerance of a file's time step (chosen)."""


@dataclass(frozen=True)
class LaneletMap(NetMap):
    """A lanelet network as a map: the file at ``path`` with its lanelets, the SUMO net, and plain values of each.

    ``is_located``: whether the file states its location on earth; otherwise the map has an artificial one.
    """

    net: bytes = b""
    network: RoadNetwork | None = None
    is_located: bool = False


def read_lanelet_map(path: Path) -> LaneletMap:
    """Read the network of a CommonRoad file as a map.

    Raises:
        UnsafeInput: the file is hostile, broken or not a CommonRoad file, or none of its lanelets is a road for
            vehicles.
    """
    loaded = read_scenario(path)
    document = ScenarioDocument.read(path).root
    ground = _ground(document)
    located = ground is not None or _degrees(document) is not None
    ground = ground or _around(loaded, _degrees(document))
    try:
        net, network = net_over_lanelets(
            loaded.scenario.lanelet_network, ground, step_s=STEP_S, largest_id=_largest_id(document)
        )
    except NotPossible as refusal:
        raise UnsafeInput(f"{shown_name(path.name)}: {refusal.message}", next_step=refusal.next_step) from refusal
    with tempfile.TemporaryDirectory() as scratch:
        net_path = Path(scratch) / "over_lanelets.net.xml"
        net_path.write_bytes(net)
        roads = read_net_map(net_path)
    stated, place = parse_benchmark_id(loaded.benchmark_id)
    country = None if located and stated == _ARTIFICIAL else stated
    return LaneletMap(
        roads.nodes,
        roads.ways,
        (),
        None,
        attribution=_attribution(document, loaded.benchmark_id),
        name=place,
        country=country,
        path=path,
        edges=roads.edges,
        net=net,
        network=network,
        is_located=located,
    )


def write_network(source: Path, target: Path) -> tuple[str, ...]:
    """Write only the road network of a CommonRoad file; return descriptions of what was left out.

    Raises:
        UnsafeInput: the file is hostile, broken or not a CommonRoad file.
    """
    loaded = read_scenario(source)
    document = ScenarioDocument.read(source)
    root = document.root
    left_out = [counted(len(loaded.tracks), "recorded road user")] if loaded.tracks else []
    if document.is_2018b:
        left_out.append(_replace_limits_by_signs(root, parse_benchmark_id(loaded.benchmark_id)[0]))
    step_s = loaded.step_s
    if not _SHORTEST_STEP_S <= step_s < math.inf:
        raise UnsafeInput(f"{shown_name(source.name)} has time steps of {step_s:g} s", valid=["timeStepSize of 0.1"])
    header = {"timeStepSize": f"{STEP_S:g}", "commonRoadVersion": "2020a", "benchmarkID": loaded.benchmark_id}
    kept = {key: one_line(root.get(key, "")) for key in ("author", "affiliation", "source", "date")}
    copy = etree.Element("commonRoad", {**header, **kept})
    location, tags = root.find("location"), root.find("scenarioTags")
    set_friction(copy, loaded.friction)
    copy.append(_no_location() if location is None else location)
    copy.append(etree.Element("scenarioTags") if tags is None else tags)
    for tag in ROAD_ELEMENTS:
        copy.extend(list(root.iterfind(tag)))
    for steps in copy.iterfind("trafficLight/cycle//duration"):
        steps.text = str(max(round(int(steps.text or 0) * step_s / STEP_S), 1))
    for steps in copy.iterfind("trafficLight/cycle/timeOffset"):
        steps.text = str(round(int(steps.text or 0) * step_s / STEP_S))
    heights = list(copy.iter("z"))
    for height in heights:
        _remove(height)
    left_out += ["heights"] if heights else []
    if (count := _remove_invalid(copy)) > 0:
        left_out.append(
            f"{count} elements that CommonRoad's schema rejects (empty intersections and signs, lost references)"
        )
    if refused := _remove_rejected(copy):
        kinds = ", ".join(f"{name} {count}" for name, count in Counter(refused).most_common(_REFUSED_SHOWN))
        left_out.append(f"{counted(len(refused), 'more element')} that CommonRoad's schema rejects: {kinds}")
    target.write_bytes(etree.tostring(copy, encoding="UTF-8", xml_declaration=True) + b"\n")
    return tuple(left_out)


def _remove_invalid(root: etree._Element) -> int:
    """Remove elements that violate the schema and are not needed; return how many were removed."""
    torn = [one for one in root.iterfind("intersection") if one.find("incoming") is None]
    torn += [one for one in root.iterfind("trafficSign") if one.find("trafficSignElement") is None]
    for element in torn:
        root.remove(element)
    known = {one.get("id") for one in root.iter("*") if one.get("id") is not None}
    words = (
        "isLeftOf",
        "trafficSignRef",
        "trafficLightRef",
        "predecessor",
        "successor",
        "adjacentLeft",
        "adjacentRight",
    )
    lost = [one for tag in words for one in root.iter(tag) if one.get("ref") not in known]
    for element in lost:
        _remove(element)
    return len(torn) + len(lost)


_REFUSED_SHOWN = 4
"""Maximum number of kinds of rejected elements that are listed (chosen)."""
_MOST_ROUNDS = 20
"""Rounds of removal (chosen): removing one element may reveal another, or leave its parent incomplete."""


def _remove_rejected(root: etree._Element) -> list[str]:
    """Remove the elements of a network that the schema rejects, smallest first; return their names.

    Lanelets stay even if they are invalid: traffic needs them, and the rules for networks report their faults.
    """
    names = []
    for _ in range(_MOST_ROUNDS):
        refused: list[etree._Element] = []
        tree = etree.ElementTree(root)
        for fault in schema_faults(tree):
            found = tree.xpath(fault.path) if fault.path else []
            element = found[0] if isinstance(found, list) and found else None
            if isinstance(element, etree._Element) and element not in (root, *refused) and element.tag not in _KEPT:
                refused.append(element)
        for element in refused:
            names.append(str(element.tag))
            _remove(element)
        if not refused:
            break
    return names


_KEPT = ("lanelet", "leftBound", "rightBound", "location", "scenarioTags")


def _remove(element: etree._Element) -> None:
    parent = element.getparent()
    if parent is not None:
        parent.remove(element)


@dataclass(frozen=True)
class RoadFile:
    """The content that a scenario takes over from a stored map: elements of its roads, location, tags, friction."""

    elements: tuple[etree._Element, ...]
    location: etree._Element
    tags: tuple[str, ...]
    friction: float | None = None

    @classmethod
    def read(cls, path: Path) -> "RoadFile":
        """Read a map that :func:`write_network` wrote."""
        root = etree.parse(path, etree.XMLParser(remove_blank_text=True, remove_comments=True)).getroot()
        elements = tuple(element for tag in ROAD_ELEMENTS for element in root.iterfind(tag))
        tags = tuple(str(tag.tag) for tag in root.iterfind("scenarioTags/*"))
        location = root.find("location")
        friction = friction_of(root)
        where = _no_location() if location is None else location
        return cls(elements, where, tags, None if friction is None else float(friction))


def cut_lanelets(lanelets: LaneletMap, center: tuple[float, float], radius_m: float, target: Path) -> bool:
    """Write the lanelets of a network within a circle around (x, y) in m, with their signs and lights.

    Returns:
        True if these are not all lanelets; otherwise nothing is written.
    """
    from shapely import Point, Polygon

    known = {} if lanelets.network is None else lanelets.network.lanelets
    middle = Point(*center)
    kept = {key for key, lanelet in known.items() if Polygon(lanelet.polygon).distance(middle) <= radius_m}
    if len(kept) == len(known):
        return False
    root = etree.parse(lanelets.path).getroot()
    beyond = {element.get("id", "") for element in root.iterfind("lanelet") if int(element.get("id", "0")) not in kept}
    for element in [one for one in root.iterfind("lanelet") if one.get("id") in beyond]:
        root.remove(element)
    used = {one.get("ref") for tag in ("trafficSignRef", "trafficLightRef") for one in root.iter(tag)}
    for tag in ("trafficSign", "trafficLight"):
        for element in [one for one in root.iterfind(tag) if one.get("id") not in used]:
            root.remove(element)
    _forget(root, beyond)
    target.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n")
    return True


def _forget(root: etree._Element, beyond: Set[str]) -> None:
    """Remove references to removed lanelets, and arms and intersections that are then empty."""
    words = ("predecessor", "successor", "adjacentLeft", "adjacentRight", "incomingLanelet", "crossing")
    turns = ("successorsRight", "successorsStraight", "successorsLeft")
    for element in [one for tag in (*words, *turns) for one in root.iter(tag) if one.get("ref") in beyond]:
        parent = element.getparent()
        if parent is not None:
            parent.remove(element)
    for crossing in list(root.iterfind("intersection")):
        for arm in [arm for arm in crossing.iterfind("incoming") if arm.find("incomingLanelet") is None]:
            crossing.remove(arm)
        if crossing.find("incoming") is None:
            root.remove(crossing)


def _no_location() -> etree._Element:
    """Return CommonRoad's element for an unknown location."""
    location = etree.Element("location")
    for tag, text in (("geoNameId", "-999"), ("gpsLatitude", "999"), ("gpsLongitude", "999")):
        etree.SubElement(location, tag).text = text
    return location


def _replace_limits_by_signs(document: etree._Element, country: str) -> str:
    """Replace speed limits of format 2018b with signs, if CommonRoad has one for the country; describe the change."""
    number, next_id = speed_limit_number(country), _largest_id(document) + 1
    signs: dict[str, int] = {}
    for lanelet in document.iterfind("lanelet"):
        if lanelet.find("laneletType") is None:
            etree.SubElement(lanelet, "laneletType").text = "unknown"
        for limit in list(lanelet.iterfind("speedLimit")):
            lanelet.remove(limit)
            text = (limit.text or "").strip()
            if number is None or not text:
                continue
            if text not in signs:
                signs[text] = next_id + len(signs)
                document.append(_sign(signs[text], number, text, lanelet))
            etree.SubElement(lanelet, "trafficSignRef", {"ref": str(signs[text])})
    return "format 2018b: its speed limits are " + ("now signs" if signs or number else "left out: no such sign")


def _sign(key: int, number: str, speed_mps: str, lanelet: etree._Element) -> etree._Element:
    sign = etree.Element("trafficSign", {"id": str(key)})
    inside = etree.SubElement(sign, "trafficSignElement")
    etree.SubElement(inside, "trafficSignID").text = number
    etree.SubElement(inside, "additionalValue").text = speed_mps
    point = lanelet.find("rightBound/point")
    if point is not None:
        etree.SubElement(sign, "position").append(deepcopy(point))
    etree.SubElement(sign, "virtual").text = "true"
    return sign


def _largest_id(document: etree._Element) -> int:
    return max(int(element.get("id", "0")) for element in document.iter("*") if element.get("id", "").isdigit())


def _degrees(document: etree._Element) -> tuple[float, float] | None:
    """Return the file's latitude and longitude; None if they are missing or 999, CommonRoad's value for unknown."""
    try:
        latitude = float(document.findtext("location/gpsLatitude") or "")
        longitude = float(document.findtext("location/gpsLongitude") or "")
    except ValueError:
        return None
    is_place = -80 <= latitude <= 84 and -180 <= longitude <= 180 and (latitude, longitude) != (0.0, 0.0)
    return (latitude, longitude) if is_place else None


def _ground(document: etree._Element) -> GeoReference | None:
    """Return the file's projection if the file's coordinates are in that projection, except for a shift."""
    projection = (document.findtext("location/geoTransformation/geoReference") or "").strip()
    if PROJECTION.fullmatch(projection) is None:
        return None
    more = document.find("location/geoTransformation/additionalTransformation")
    if more is None:
        return GeoReference(projection, (0.0, 0.0))
    try:
        shift = float(more.findtext("xTranslation") or 0.0), float(more.findtext("yTranslation") or 0.0)
        turned = float(more.findtext("zRotation") or 0.0), float(more.findtext("scaling") or 1.0) - 1.0
    except ValueError:
        return None
    return GeoReference(projection, shift) if not any(turned) and np.isfinite(shift).all() else None


def _around(loaded: LoadedScenario, degrees: tuple[float, float] | None) -> GeoReference:
    """Return a georeference that puts the network's middle at ``degrees``, or at the artificial location if None."""
    points = np.concatenate([lanelet.center_vertices[:, :2] for lanelet in loaded.scenario.lanelet_network.lanelets])
    x, y = (points.min(axis=0) + points.max(axis=0)) / 2
    if degrees is None:
        return GeoReference(NOWHERE.projection, (round(float(x), 3), round(float(y), 3)))
    place = f"+lat_0={degrees[0]:.7f} +lon_0={degrees[1]:.7f}"
    projection = NOWHERE.projection.replace("+lat_0=0 +lon_0=0", place)
    return GeoReference(projection, (round(float(x), 3), round(float(y), 3)))


def _attribution(document: etree._Element, benchmark_id: str) -> str:
    """Return the attribution for scenarios on the network: the file, and OpenStreetMap if it is the source."""
    origin = f"{document.get('source', '')} {document.get('affiliation', '')}".lower().replace(",", " ").split()
    osm = f"; {OSM_ATTRIBUTION}" if any(word.strip(".;()") in _OSM_WORDS for word in origin) else ""
    return f"road network of CommonRoad {one_line(benchmark_id)}{osm}"
