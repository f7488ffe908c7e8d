"""Converts OpenDRIVE files to SUMO networks with netconvert; reports their location and what is lost."""

import math
import re
from collections import Counter
from pathlib import Path

import numpy as np
from lxml import etree

from ....schemas.errors import NotPossible, UnsafeInput
from ....schemas.text import cited, counted, shown_name
from ....schemas.vocabulary import LEAST_FRICTION, MOST_FRICTION
from ...commonroad import XmlLimits, scan_xml
from ...network import run_netconvert
from ..unpacking import LARGEST_BYTES
from .drive_repair import LEFT, mirror, repair, traffic_rule, without_namespaces, y_range
from .lanelet_map import NOWHERE
from .net_map import PROJECTION, untraced_links

LIMITS = XmlLimits(size_bytes=LARGEST_BYTES, depth=24)
MOST_LANES, MOST_ROADS, MOST_GEOMETRIES = 50_000, 10_000, 200_000
"""Maximum number of elements of a file (chosen): a town has some hundred roads; netconvert takes seconds for
thousands.
"""
MOST_AT_ONCE = 64
"""Maximum number of lanes of one cross-section (chosen)."""
FARTHEST_M, LONGEST_M = 1e8, 1e6
"""Maximum of coordinates and of the length of one piece of a reference line (chosen)."""
STEEPEST = 1e30
"""Maximum of polynomial coefficients (chosen): only those valid over a micrometre are larger; values stay finite."""
DRIVEN = frozenset({"driving", "bidirectional", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "bus", "taxi"})
"""Types of lanes for SUMO's vehicles; bicycles also use lanes of type biking."""
_LOST_FRICTION = (
    f"friction, which differs between lanes for vehicles, or is not from {LEAST_FRICTION:g} to {MOST_FRICTION:g} "
    "(a scenario's roads have one: set_weather with friction=… states it)"
)
_VERTICAL = re.compile(r"\+(geoidgrids|nadgrids|vunits|vto_meter|to_meter)=\S*")
"""Parts of a PROJ string that define heights, or refer to files."""


def convert_opendrive(source: Path, target: Path, scratch: Path) -> tuple[str, ...]:
    """Write the roads of an OpenDRIVE file as a SUMO network; return descriptions of what is lost.

    Raises:
        UnsafeInput: the file is hostile, broken, not OpenDRIVE, without roads or too large, or netconvert rejects it.
    """
    root = _checked(source)
    lost = _lost(root)
    axis_m = None
    if traffic_rule(source.name, root) == LEFT:
        axis_m = min(y_range(root))
        mirror(root, axis_m)
    repair(source.name, root)
    frictions = _frictions(root)
    friction = next(iter(frictions)) if len(frictions) == 1 else None
    if friction is None and frictions - {None}:
        lost.append(_LOST_FRICTION)
    reference = root.find("header/geoReference")
    text = "" if reference is None else " ".join(_VERTICAL.sub("", reference.text or "").split())
    located = PROJECTION.fullmatch(text) is not None and "+proj=" in text
    if reference is not None:
        reference.clear()
        if located:
            reference.text = etree.CDATA(text)
        else:
            root.find("header").remove(reference)  # type: ignore[union-attr]  # it was found there
    cleaned = scratch / "cleaned.xodr"
    cleaned.write_bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True))
    options = ["--opendrive-files", str(cleaned), "--opendrive.curve-resolution", "1", "--output.street-names", "true"]
    try:
        warnings = run_netconvert(options, target)
    except NotPossible as refusal:
        raise UnsafeInput(
            f"{shown_name(source.name)}: {refusal.message}", next_step="correct the file, or use another one"
        ) from refusal
    if axis_m is not None:
        _mirror_back(target, axis_m)
    if friction is not None:
        _state_friction(target, friction)
    lost += untraced_links(target)
    if warnings:
        lost.append(f"netconvert warned {counted(len(warnings), 'time')}, first: {warnings[0]}")
    if not _has_location(target):
        why = "no readable georeference" if reference is None or not located else "an unknown georeference"
        _set_artificial_place(target)
        lost.insert(0, f"it has {why}, so its roads get an artificial place near 0°, 0°")
    return tuple(lost)


def _frictions(root: etree._Element) -> frozenset[float | None]:
    """Return the friction coefficients of lanes for vehicles; None for a lane without a valid coefficient."""
    lanes = [lane for lane in root.iter("lane") if lane.get("type") in DRIVEN]
    stated = {one.get("friction") for lane in lanes for one in lane.iterfind("material")}
    stated |= {None for lane in lanes if lane.find("material") is None}
    return frozenset(_possible(text) for text in stated)


def _possible(text: str | None) -> float | None:
    """Return a friction coefficient that a road can have, or None for any other text."""
    try:
        friction = float(text or "nan")
    except ValueError:
        return None
    return friction if LEAST_FRICTION <= friction <= MOST_FRICTION else None


def _state_friction(net: Path, friction: float) -> None:
    """Write the friction into all lanes of a network, as in SUMO's own networks."""
    tree = etree.parse(net)
    for lane in tree.getroot().iter("lane"):
        lane.set("friction", f"{friction:g}")
    tree.write(net, encoding="UTF-8", xml_declaration=True)


def _checked(path: Path) -> etree._Element:
    name = scan_xml(path, LIMITS).name
    if name != "OpenDRIVE":
        raise UnsafeInput(
            f"{shown_name(path.name)} is not OpenDRIVE: its root element is <{shown_name(name)}>, not <OpenDRIVE>"
        )
    try:
        root = etree.parse(path, etree.XMLParser(resolve_entities=False, no_network=True)).getroot()
    except etree.LxmlError as error:
        raise UnsafeInput(f"{shown_name(path.name)} is not readable as OpenDRIVE: {cited(error)}") from error
    without_namespaces(root)
    roads = list(root.iterfind("road"))
    if not roads:
        raise UnsafeInput(f"{shown_name(path.name)} has no road", next_step="use a file with roads in it")
    counts = {
        "roads": (len(roads), MOST_ROADS),
        "lanes": (sum(1 for _ in root.iter("lane")), MOST_LANES),
        "pieces of reference lines": (sum(1 for _ in root.iter("geometry")), MOST_GEOMETRIES),
        "lanes side by side": (
            max((_lane_count(section) for section in root.iter("laneSection")), default=0),
            MOST_AT_ONCE,
        ),
    }
    for what, (count, most) in counts.items():
        if count > most:
            raise UnsafeInput(f"{shown_name(path.name)} has {count:,} {what}", valid=[f"at most {most:,}"])
    for piece in root.iter("geometry"):
        for key in ("x", "y", "hdg"):
            _number(path, piece, key, FARTHEST_M)
        _number(path, piece, "length", LONGEST_M)
    for element in root.iter(*_MEASURED):
        for key in _MEASURED[str(element.tag)]:
            _number(path, element, key, STEEPEST if key[0] in "bcd" else FARTHEST_M)
    for element in root.iter("lane", "laneLink"):
        for key in ("id",) if element.tag == "lane" else ("from", "to"):
            _whole(path, element, key)
    for element in root.iterfind("road/lanes/laneSection/*/lane/link/*"):
        _whole(path, element, "id")
    return root


_MEASURED = {
    **dict.fromkeys(("laneOffset", "poly3", "superelevation"), ("a", "b", "c", "d")),
    **dict.fromkeys(("width", "border"), ("sOffset", "a", "b", "c", "d")),
    "paramPoly3": ("aU", "bU", "cU", "dU", "aV", "bV", "cV", "dV"),
    "arc": ("curvature",),
    "spiral": ("curvStart", "curvEnd"),
    "laneSection": ("s",),
    "road": ("length",),
    "signal": ("t",),
    "object": ("t",),
}
"""Numbers, by element, that computations here use."""


def _lane_count(section: etree._Element) -> int:
    return sum(1 for _ in section.iter("lane"))


def _number(path: Path, element: etree._Element, key: str, most: float) -> None:
    text = element.get(key, "0")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= most:
        raise UnsafeInput(
            f"{shown_name(path.name)}: {key} of a {element.tag} is {cited(text)}", valid=[f"numbers up to {most:g}"]
        )


def _whole(path: Path, element: etree._Element, key: str) -> None:
    text = element.get(key, "0")
    if _WHOLE.fullmatch(text) is None:
        raise UnsafeInput(
            f"{shown_name(path.name)}: {key} of a {element.tag} is {cited(text)}", valid=["whole numbers"]
        )


_WHOLE = re.compile(r"[+-]?[0-9]{1,6}")


def _lost(root: etree._Element) -> list[str]:
    """Describe the content of the file that the network lacks."""
    signals, objects = (sum(1 for _ in root.iter(tag)) for tag in ("signal", "object"))
    heights = any(
        float(one.get(key, "0") or 0)
        for one in root.iter("elevation", "superelevation")
        for key in ("a", "b", "c", "d")
    )
    kinds = Counter(one.get("type", "none") for one in root.iter("lane") if one.get("id") != "0")
    others = [f"{kind} {count}" for kind, count in kinds.most_common() if kind not in DRIVEN and kind != "none"]
    lost = [f"{counted(signals, 'signal')} (lights may remain, signs do not)"] if signals else []
    lost += [counted(objects, "object")] if objects else []
    lost += ["heights"] if heights else []
    lost += [f"the types of lanes that cars do not use: {', '.join(others[:5])}"] if others else []
    return lost


_OTHER_TURN = {"l": "r", "r": "l", "L": "R", "R": "L"}
"""SUMO's letters for the direction of a connection, mirrored."""


def _mirror_back(net: Path, axis_m: float) -> None:
    """Mirror a network at the line y = ``axis_m`` of its file: right-hand traffic becomes left-hand traffic."""
    tree = etree.parse(net)
    root = tree.getroot()
    root.set("lefthand", "true")
    location = root.find("location")
    offset_y = 0.0 if location is None else float(location.get("netOffset", "0,0").split(",")[1])
    twice = 2 * (axis_m + offset_y)
    for element in root.iter("edge", "lane", "junction"):
        if (shape := element.get("shape")) is not None:
            points = [point.split(",") for point in shape.split()]
            element.set("shape", " ".join(",".join([x, f"{twice - float(y):.3f}", *z]) for x, y, *z in points))
        if (y := element.get("y")) is not None:
            element.set("y", f"{twice - float(y):.3f}")
    for link in root.iterfind("connection"):
        link.set("dir", _OTHER_TURN.get(link.get("dir", ""), link.get("dir", "")))
    if location is not None:
        west, south, east, north = (float(part) for part in location.get("convBoundary", "0,0,0,0").split(","))
        location.set("convBoundary", f"{west:.2f},{twice - north:.2f},{east:.2f},{twice - south:.2f}")
    tree.write(net, encoding="UTF-8", xml_declaration=True)


def _has_location(net: Path) -> bool:
    location = etree.parse(net).getroot().find("location")
    return location is not None and location.get("projParameter", "!") != "!"


def _set_artificial_place(net: Path) -> None:
    """Give a network the artificial location, at its middle."""
    tree = etree.parse(net)
    location = tree.getroot().find("location")
    if location is None:
        raise UnsafeInput("netconvert wrote a network without a location")
    box = np.array([float(part) for part in location.get("convBoundary", "0,0,0,0").split(",")])
    x, y = (box[:2] + box[2:]) / 2
    location.set("projParameter", NOWHERE.projection)
    location.set("netOffset", f"{x:.2f},{y:.2f}")
    tree.write(net, encoding="UTF-8", xml_declaration=True)
