"""Limits of the numbers, counts and texts in a scenario file: one table with sources, checked before further reading.

commonroad-io accepts any number: an angle of 1e300 makes its loops endless, vertices at 1e7 m fill the memory of code
that samples them, a step of 1e-30 s reaches SUMO. Every number in a file is therefore checked once, in the parsed
document. The error states the element, the id of its owner and the line. ``docs/limits.md`` shows the table to users.
"""

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ...schemas.errors import UnsafeInput
from ...schemas.text import cited, shown_name
from ..geometry import Values

_EXACT_IN_JSON = 2**53 - 1
_PRINTED = 10**30


@dataclass(frozen=True)
class NumberRange:
    """The limits of a number, both inclusive; ``source`` states their origin."""

    lowest: float
    highest: float
    unit: str
    source: str
    is_whole: bool = False

    @property
    def text(self) -> str:
        """The range as text: ``0.001 to 10 s``."""
        whole = "whole numbers " if self.is_whole else ""
        return f"{whole}{_digits(self.lowest)} to {_digits(self.highest)} {self.unit}".rstrip()


LAST_STEP = 100_000
_TIME = NumberRange(0, LAST_STEP, "steps", "schema: not negative; chosen: 2.8 hours at 0.1 s", is_whole=True)
_FARTHEST_M = 25e6
_COORDINATE = NumberRange(
    -_FARTHEST_M, _FARTHEST_M, "m", "beyond the edge of Web Mercator (20,037,508 m) and of UTM (10,000,000 m)"
)
_HEIGHT = NumberRange(-1e5, 1e5, "m", "physics: road traffic is on the ground")
_ANGLE = NumberRange(-1000, 1000, "rad", "159 turns, for unwrapped headings; commonroad-io unwinds them in loops")
_SPEED = NumberRange(-1000, 1000, "m/s", "physics: the fastest vehicle on land had 341 m/s")
_ACCELERATION = NumberRange(-1e4, 1e4, "m/s²", "physics: a crash has about 1,000 m/s²")
_OTHER = NumberRange(-1e6, 1e6, "", "chosen: a number of a state that is not used here")
_OBSTACLE_SIZE = NumberRange(0.001, 1000, "m", "schema: above 0; chosen: longer than any train or ship")
_REGION_SIZE = NumberRange(0.001, 1e5, "m", "schema: above 0; no larger than a road network may be")
_STEP_SIZE = NumberRange(0.001, 10, "s", "SUMO counts time in whole milliseconds; longer steps show no motion")
_ID = NumberRange(
    0, _EXACT_IN_JSON, "", "schema: whole; exact in JSON, because many clients store its numbers as doubles", True
)
_VALUE_OF_SIGN = NumberRange(-1e6, 1e6, "", "chosen: if the value of a sign is a number, it is finite")

NUMBER_RANGES: Mapping[str, NumberRange] = {
    "timeStepSize": _STEP_SIZE,
    "id": _ID,
    "ref": _ID,
    "x": _COORDINATE,
    "y": _COORDINATE,
    "z": _HEIGHT,
    "positionZ": _HEIGHT,
    "positionZFront": _HEIGHT,
    "positionZRear": _HEIGHT,
    "length": _REGION_SIZE,
    "width": _REGION_SIZE,
    "radius": _REGION_SIZE,
    "time": _TIME,
    "orientation": _ANGLE,
    "steeringAngle": _ANGLE,
    "slipAngle": _ANGLE,
    "velocity": _SPEED,
    "velocityY": _SPEED,
    "velocityZ": _SPEED,
    "acceleration": _ACCELERATION,
    "accelerationY": _ACCELERATION,
    "speedLimit": NumberRange(0, 1000, "m/s", "schema 2018b: not negative; physics, as all speeds"),
    "additionalValue": _VALUE_OF_SIGN,
    "duration": NumberRange(0, LAST_STEP, "steps", "schema: not negative; no longer than a recording", is_whole=True),
    "timeOffset": NumberRange(
        0, 1e6, "steps", "schema: not negative; chosen: more than any cycle lasts", is_whole=True
    ),
    "geoNameId": NumberRange(-(2**31), 2**31 - 1, "", "GeoNames: 32 bits; -999 means unknown", is_whole=True),
    "gpsLatitude": NumberRange(-1000, 1000, "°", "CommonRoad: 999 means unknown"),
    "gpsLongitude": NumberRange(-1000, 1000, "°", "CommonRoad: 999 means unknown"),
    "xTranslation": NumberRange(-1e8, 1e8, "m", "more than twice around the earth"),
    "yTranslation": NumberRange(-1e8, 1e8, "m", "more than twice around the earth"),
    "zRotation": _ANGLE,
    "scaling": NumberRange(1e-6, 1e6, "", "schema: above 0"),
}
"""By the name of an attribute, of an element with a number, or of a value of a state; sizes are those of regions.

In the 195 measured files of CommonRoad, coordinates reach 12,761 m, speeds 50 m/s, angles 11 rad, accelerations 10.5
m/s², steps 200 and ids 136,389, and all have steps of 0.1 s.
"""

MOST_CHILDREN: Mapping[str, int] = {
    "commonRoad": 100_000,
    "lanelet": 128,
    "leftBound": 5_000,
    "rightBound": 5_000,
    "polygon": 5_000,
    "trajectory": LAST_STEP,
    "occupancySet": 10_000,
    "signalSeries": LAST_STEP,
}
"""Maximum elements directly below one of this name; for all others, ``MOST_OTHER_CHILDREN``.

Measured: 464 below the root, 1,998 points in a bound, 200 states in a trajectory.
"""
MOST_OTHER_CHILDREN = 1000
MOST_OF_A_KIND: Mapping[str, int] = {"lanelet": 50_000, "planningProblem": 100}
"""Maximum elements of this name in a file: commonroad-io makes a polygon of each lanelet, and each planning problem is
an entry of the catalogue. Measured: 368 lanelets, 8 planning problems.
"""
MOST_OCCUPIED_STEPS = LAST_STEP
"""Maximum steps that the occupancies of one obstacle cover, each counted once per part of its shape."""
LONGEST_TEXT = 2000
"""Maximum characters of an attribute or element; chosen: coordinate reference systems have a few hundred."""
WIDEST_M = 100_000.0
"""Chosen: sides of the box around a road network, and maximum distance of anything from it; measured: 12,448 m."""

SMALLEST = 1e-150
"""The square of a smaller nonzero value is 0, and geometry would divide by it."""
SHORTEST_M = 0.001
"""Minimum lengths and widths of drawn shapes: files with three decimals distinguish points at this distance."""
_PLANE = ("x", "y")
_INTERVAL = ("intervalStart", "intervalEnd")
_VALUES = ("exact", *_INTERVAL)
_NOT_LEAVES = ("time", "id", "ref", "timeStepSize")
_NUMBERS = {name: allowed for name, allowed in NUMBER_RANGES.items() if name not in _NOT_LEAVES}
"""Elements with a number as their text; a state's time has child elements, and a time of day is not a number."""
_FOREIGN = "<location>"
"""Contains data of other programs, with ids of their own."""
OLD_GOAL = "goalRegion"
"""A goal of the formats before 2017a, which commonroad-io ignores; its times may be in seconds."""
_OBSTACLES = ("obstacle", "staticObstacle", "dynamicObstacle", "environmentObstacle", "phantomObstacle")
_PLACED = ("lanelet", "planningProblem", *_OBSTACLES)
"""Elements with points that are places in the network; signs and lights may have a placeholder instead."""


class BeyondLimits(Exception):
    """A rejected number, count or text, with its element; the reader adds the line."""

    def __init__(self, element: Any, what: str, valid: str, next_step: str = "correct it in the file") -> None:
        self.element, self.what, self.valid, self.next_step = element, what, valid, next_step
        super().__init__(what)

    def refusal(self, file: str, line: int | None) -> UnsafeInput:
        """Return the error for the caller."""
        place = f"{shown_name(file)}, line {line:,}" if line else shown_name(file)
        return UnsafeInput(f"{place}: {self.what}", valid=[self.valid], next_step=self.next_step)


def check_document(root: Any, taken: Collection[int] = ()) -> None:
    """Check every number, count and text of a parsed CommonRoad document (ElementTree).

    Args:
        root: the document's root.
        taken: ids of obstacles without their states, which were removed because they are known to be plain and without
            a gap.

    Raises:
        BeyondLimits: a value is not a number or beyond its limit.
    """
    _check_attributes(root, "commonRoad")
    if "timeStepSize" in root.attrib:
        _number(root, root.get("timeStepSize"), NUMBER_RANGES["timeStepSize"], "timeStepSize", "commonRoad")
    _check_kinds(root)
    boxes = []
    for top in root:
        owner = f"{top.tag} {shown_name(top.get('id'))}" if top.get("id") else f"<{top.tag}>"
        own_shape = top.find("shape") if top.tag in _OBSTACLES else None
        _check_attributes(top, owner)
        relative = () if own_shape is None else _check_own_shape(own_shape, owner)
        places = _check_below(top, owner, relative)
        _check_occupancies(top, owner)
        if top.tag in _OBSTACLES and not (taken and int(top.get("id", "-1")) in taken):
            _check_steps(top, owner)
        _check_drawn(top, owner)
        if top.tag in _PLACED and places:
            boxes.append((top, owner, places))
    _check_extent(boxes)


def _check_kinds(root: Any) -> None:
    kinds = Counter(child.tag for child in root)
    for kind, most in MOST_OF_A_KIND.items():
        if kinds[kind] > most:
            what = f"it has {kinds[kind]:,} elements <{kind}>"
            raise BeyondLimits(root, what, f"at most {most:,}", "split the file, or remove some of them")
    _check_count(root)


def _check_count(element: Any) -> None:
    most = MOST_CHILDREN.get(element.tag, MOST_OTHER_CHILDREN)
    if len(element) > most:
        what = f"an element <{shown_name(element.tag)}> has {len(element):,} elements"
        raise BeyondLimits(element, what, f"at most {most:,}", "split the file, or remove some of them")


def is_within(name: str, values: Values | Sequence[int]) -> bool:
    """Return whether finite values of states are all within the limits for a name."""
    allowed, given = NUMBER_RANGES.get(name, _OTHER), np.asarray(values, dtype=float)
    sizes = np.abs(given)
    return bool(
        allowed.lowest <= given.min()
        and given.max() <= allowed.highest
        and not ((sizes > 0.0) & (sizes < SMALLEST)).any()
    )


def check_counts_and_ids(root: Any) -> None:
    """Check the number of elements in an lxml document, and its ids and references.

    Raises:
        BeyondLimits: there are more elements than the limits, or an id is not a whole number within its limits.
    """
    _check_kinds(root)
    for element in root.iter("*"):
        _check_count(element)
        _check_attributes(element, f"<{element.tag}>")


_Places = list[tuple[float, float]]


def _check_below(top: Any, owner: str, relative: Iterable[Any]) -> _Places:
    """Check all descendants of a first-level element; return the x and y of its points in m."""
    skipped = frozenset(map(id, relative))
    unread = [one for region in top.iterfind(OLD_GOAL) for one in region.iter()]
    ignored = frozenset(map(id, unread))
    places: _Places = []
    for parent in top.iter():
        if not len(parent) or id(parent) in ignored:
            continue
        _check_count(parent)
        values = {}
        for leaf in parent:
            tag, text = leaf.tag, leaf.text
            if tag in _PLANE and text and (value := _usual_coordinate(text)) is not None:  # these are most of a file
                values[tag] = value
                continue
            if leaf.attrib:
                _check_attributes(leaf, owner)
            if len(leaf):
                continue
            if text is not None and len(text) > LONGEST_TEXT:
                raise _too_long(leaf, f"<{tag}>", owner, len(text))
            if tag in _VALUES:
                values[tag] = _number(leaf, text, NUMBER_RANGES.get(parent.tag, _OTHER), parent.tag, owner)
            elif tag in _NUMBERS and (tag != "additionalValue" or _is_number(text)):
                values[tag] = _number(leaf, text, _NUMBERS[tag], tag, owner)
        if "intervalEnd" in values and values.get("intervalStart", -math.inf) > values["intervalEnd"]:
            what = f"the interval of <{parent.tag}> of {owner} ends before it begins"
            raise BeyondLimits(parent, what, "intervalStart at most as large as intervalEnd")
        if "x" in values and "y" in values and id(parent) not in skipped:
            places.append((values["x"], values["y"]))
    return places


def _check_own_shape(shape: Any, owner: str) -> list[Any]:
    """Check the sizes of an obstacle's shape; return its elements: their points are relative to the obstacle."""
    elements = list(shape.iter())
    for element in elements:
        if element.tag in ("length", "width", "radius"):
            _number(element, element.text, _OBSTACLE_SIZE, element.tag, owner)
    return elements


def _check_occupancies(top: Any, owner: str) -> None:
    """Check how many steps an obstacle's occupancies cover in total; each step counts once per part."""
    covered = 0
    for occupancy in top.iterfind("occupancySet/occupancy"):
        begin, end = (occupancy.findtext(f"time/{name}") for name in _INTERVAL)
        steps = int(end) - int(begin) + 1 if begin and end else 1
        covered += steps * max(1, len(occupancy.findall("shape/*")))
    if covered > MOST_OCCUPIED_STEPS:
        what = f"the occupancies of {owner} cover {covered:,} steps, each counted once for every part of its shape"
        raise BeyondLimits(top, what, f"at most {MOST_OCCUPIED_STEPS:,}")


def _check_steps(top: Any, owner: str) -> None:
    """Check that a trajectory has a state for every step (CommonRoad: no gaps), because readers count the states."""
    states = [state for part in ("initialState", "trajectory/state") for state in top.iterfind(part)]
    steps = [state.findtext("time/exact") for state in states]
    for number, (before, here) in enumerate(pairwise(steps)):
        if before is None or here is None:
            continue
        apart = int(here) - int(before)
        if apart != 1 and not (number == 0 and apart == 0):  # some files repeat the initial state
            what = f"the states of {owner} go from step {int(before):,} to step {int(here):,}"
            next_step = "fill the gap, or make a separate obstacle of the states after it"
            raise BeyondLimits(states[number + 1], what, "one state for every step, in their order", next_step)


def _check_drawn(top: Any, owner: str) -> None:
    """Check that lanelets and shapes cover an area, and that a lanelet's centre line has a length.

    A shape may consist of many polygons, and triangulation leaves some without an area; these add nothing to it.
    """
    next_step = "correct its points in the file"
    if top.tag == "lanelet":
        left, right = (_points_of(top.find(bound)) for bound in ("leftBound", "rightBound"))
        centers = [((x + u) / 2, (y + v) / 2) for (x, y), (u, v) in zip(left, right, strict=False)]
        if not _is_apart(centers):
            raise BeyondLimits(
                top, f"the centre line of {owner} has no length", f"at least {SHORTEST_M:g} m", next_step
            )
        if _is_on_a_line(left + right):
            raise BeyondLimits(top, f"{owner} covers no area", f"at least {SHORTEST_M:g} m wide", next_step)
    spared = {id(polygon) for _, polygon in superfluous_polygons(top)}
    for polygon in top.iter("polygon"):
        if id(polygon) in spared or not _is_on_a_line(_points_of(polygon)):
            continue
        what = f"a polygon of {owner} covers no area"
        raise BeyondLimits(polygon, what, f"at least {SHORTEST_M:g} m wide", next_step)


def superfluous_polygons(top: Any) -> list[tuple[Any, Any]]:
    """Return the polygons without an area in shapes that have other parts, each after its shape."""
    found = []
    for shape in top.iter("shape"):
        parts = list(shape)
        if len(parts) < 2:
            continue
        flat = [part for part in parts if part.tag == "polygon" and _is_on_a_line(_points_of(part))]
        found += [(shape, part) for part in flat if len(flat) < len(parts)]
    return found


def _points_of(element: Any) -> _Places:
    if element is None:
        return []
    points = ((point.findtext("x"), point.findtext("y")) for point in element.iterfind("point"))
    return [(float(x), float(y)) for x, y in points if x and y]


def _is_apart(points: _Places) -> bool:
    return any(math.dist(points[0], point) >= SHORTEST_M for point in points)


def _is_on_a_line(points: _Places) -> bool:
    """Return whether all points are within 1 mm of the line from the first point to the point farthest from it."""
    if not points:
        return True
    (x, y), far = points[0], max(points, key=lambda point: math.dist(points[0], point))
    length, along_x, along_y = math.dist(points[0], far), far[0] - x, far[1] - y
    return all(abs(along_x * (v - y) - along_y * (u - x)) < SHORTEST_M * length for u, v in points) or length == 0.0


def _check_extent(boxes: list[tuple[Any, str, _Places]]) -> None:
    """Check that the network's extent is within the limit, and that nothing else is farther away."""
    spans = [(top, owner, *_span(places)) for top, owner, places in boxes]
    road = [(low, high) for top, _, low, high in spans if top.tag == "lanelet"]
    if not road:
        return
    lowest = [min(low[axis] for low, _ in road) for axis in (0, 1)]
    highest = [max(high[axis] for _, high in road) for axis in (0, 1)]
    for axis, name in ((0, "x"), (1, "y")):
        if highest[axis] - lowest[axis] > WIDEST_M:
            top, owner = _farthest(spans, axis)
            what = f"the lanelets extend over {highest[axis] - lowest[axis]:,.0f} m along {name}, up to {owner}"
            raise BeyondLimits(top, what, f"at most {WIDEST_M:,.0f} m", "cut the network to the relevant place")
        for top, owner, low, high in spans:
            if low[axis] < lowest[axis] - WIDEST_M or high[axis] > highest[axis] + WIDEST_M:
                what = f"{owner} is more than {WIDEST_M:,.0f} m away from all lanelets along {name}"
                raise BeyondLimits(top, what, f"at most {WIDEST_M:,.0f} m from the lanelets")


def _farthest(spans: list[tuple[Any, str, list[float], list[float]]], axis: int) -> tuple[Any, str]:
    """Return the lanelet with the midpoint farthest from the median midpoint."""
    lanelets = [(low[axis] + high[axis], top, owner) for top, owner, low, high in spans if top.tag == "lanelet"]
    middle = sorted(place for place, _, _ in lanelets)[len(lanelets) // 2]
    _, top, owner = max(lanelets, key=lambda lanelet: abs(lanelet[0] - middle))
    return top, owner


def _span(places: _Places) -> tuple[list[float], list[float]]:
    xs, ys = zip(*places, strict=True)
    return [min(xs), min(ys)], [max(xs), max(ys)]


def _check_attributes(element: Any, owner: str) -> None:
    for name, text in element.attrib.items():
        if name in ("id", "ref") and owner != _FOREIGN:
            _number(element, text, NUMBER_RANGES[name], f"{name} of <{element.tag}>", owner)
        elif len(text) > LONGEST_TEXT:
            raise _too_long(element, shown_name(name), owner, len(text))


def _too_long(element: Any, name: str, owner: str, length: int) -> BeyondLimits:
    return BeyondLimits(element, f"{name} of {owner} has {length:,} characters", f"at most {LONGEST_TEXT:,}")


def _number(element: Any, text: str | None, allowed: NumberRange, name: str, owner: str) -> float:
    try:
        value = int(text or "") if allowed.is_whole else float(text or "")
        if allowed.lowest <= value <= allowed.highest and not 0 < abs(value) < SMALLEST:  # not NaN
            return value
    except ValueError:
        kind = "whole number" if allowed.is_whole else "number"
        raise BeyondLimits(
            element, f"{name} of {owner} is {cited(text or '', 40)}, which is not a {kind}", allowed.text
        ) from None
    if allowed.is_whole:
        given = f"{value:,}" if abs(value) < _PRINTED else "a number with too many digits"
    else:
        given = f"{value:g}"
    raise BeyondLimits(element, f"{name} of {owner} is {given} {allowed.unit}".rstrip(), allowed.text)


def _usual_coordinate(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if -_FARTHEST_M <= value <= _FARTHEST_M and not 0 < abs(value) < SMALLEST else None


def _is_number(text: str | None) -> bool:
    try:
        float(text or "")
    except ValueError:
        return False
    return True


def _digits(value: float) -> str:
    return f"{int(value):,}" if value == int(value) else f"{value:g}"
