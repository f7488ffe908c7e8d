"""What the numbers, counts and texts of a scenario file may be: one table with sources, held before anything reads on.

commonroad-io takes any number: an angle of 1e300 turns its loops for ever, vertices at 1e7 m fill the memory of
whatever samples them, a step of 1e-30 s ends in SUMO. So every number of a file is looked at once, in the parsed
document, and refused by the name of its element, the id of what it belongs to and its line. ``docs/limits.md`` shows
the table to users.
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
    """What a number may be, both ends included; ``source`` says whose limit it is."""

    lowest: float
    highest: float
    unit: str
    source: str
    is_whole: bool = False

    @property
    def text(self) -> str:
        """The range in words: ``0.001 to 10 s``."""
        whole = "whole numbers " if self.is_whole else ""
        return f"{whole}{_digits(self.lowest)} to {_digits(self.highest)} {self.unit}".rstrip()


LAST_STEP = 100_000
_TIME = NumberRange(0, LAST_STEP, "steps", "schema: not negative; chosen: 2.8 hours at 0.1 s", is_whole=True)
_FARTHEST_M = 25e6
_COORDINATE = NumberRange(
    -_FARTHEST_M, _FARTHEST_M, "m", "beyond the edge of Web Mercator (20,037,508 m) and of UTM (10,000,000 m)"
)
_HEIGHT = NumberRange(-1e5, 1e5, "m", "physics: road traffic is on the ground")
_ANGLE = NumberRange(-1000, 1000, "rad", "159 turns, for headings that are not wrapped; commonroad-io unwinds by loops")
_SPEED = NumberRange(-1000, 1000, "m/s", "physics: the fastest vehicle on land had 341 m/s")
_ACCELERATION = NumberRange(-1e4, 1e4, "m/s²", "physics: a crash has about 1,000 m/s²")
_OTHER = NumberRange(-1e6, 1e6, "", "chosen: a number of a state that nothing here reads")
_OBSTACLE_SIZE = NumberRange(0.001, 1000, "m", "schema: above 0; chosen: longer than any train or ship")
_REGION_SIZE = NumberRange(0.001, 1e5, "m", "schema: above 0; no larger than a road network may be")
_STEP_SIZE = NumberRange(0.001, 10, "s", "SUMO counts time in whole milliseconds; beyond 10 s no motion can be told")
_ID = NumberRange(
    0, _EXACT_IN_JSON, "", "schema: whole; exact in JSON, whose numbers many clients hold as doubles", True
)
_VALUE_OF_SIGN = NumberRange(-1e6, 1e6, "", "chosen: where the value of a sign is a number, it is a finite one")

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
    "geoNameId": NumberRange(-(2**31), 2**31 - 1, "", "GeoNames: 32 bits; -999 is not known", is_whole=True),
    "gpsLatitude": NumberRange(-1000, 1000, "°", "CommonRoad: 999 is not known"),
    "gpsLongitude": NumberRange(-1000, 1000, "°", "CommonRoad: 999 is not known"),
    "xTranslation": NumberRange(-1e8, 1e8, "m", "more than twice around the earth"),
    "yTranslation": NumberRange(-1e8, 1e8, "m", "more than twice around the earth"),
    "zRotation": _ANGLE,
    "scaling": NumberRange(1e-6, 1e6, "", "schema: above 0"),
}
"""By the name of an attribute, of an element that holds a number, or of a value of a state; sizes are those of regions.

Of the 195 files of CommonRoad measured, coordinates reach 12,761 m, speeds 50 m/s, angles 11 rad, accelerations 10.5
m/s², steps 200, ids 136,389, and all have steps of 0.1 s.
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
"""Elements directly below one of this name; all others have ``MOST_OTHER_CHILDREN`` at most.

Measured: 464 below the root, 1,998 points in a bound, 200 states in a trajectory.
"""
MOST_OTHER_CHILDREN = 1000
MOST_OF_A_KIND: Mapping[str, int] = {"lanelet": 50_000, "planningProblem": 100}
"""Elements of this name in a file: commonroad-io makes a polygon of each lanelet, and each planning problem is an entry
of the catalogue. Measured: 368 lanelets, 8 planning problems."""
MOST_OCCUPIED_STEPS = LAST_STEP
"""Steps that the occupancies of one obstacle cover, each as often as its shape has parts."""
LONGEST_TEXT = 2000
"""Characters of an attribute or element; chosen: coordinate reference systems have a few hundred."""
WIDEST_M = 100_000.0
"""Chosen: sides of the box around a road network, and how far beyond it anything may be; measured: 12,448 m."""

SMALLEST = 1e-150
"""What is smaller and not 0 has a square that is 0, by which geometry would divide."""
SHORTEST_M = 0.001
"""Lengths and widths of what is drawn, as near as files with three digits tell points apart."""
_PLANE = ("x", "y")
_INTERVAL = ("intervalStart", "intervalEnd")
_VALUES = ("exact", *_INTERVAL)
_NOT_LEAVES = ("time", "id", "ref", "timeStepSize")
_NUMBERS = {name: allowed for name, allowed in NUMBER_RANGES.items() if name not in _NOT_LEAVES}
"""Of elements that hold a number as their text; a time of a state holds elements, that of a day is no number."""
_FOREIGN = "<location>"
"""Holds what other programs write there, with ids of their own."""
_OBSTACLES = ("obstacle", "staticObstacle", "dynamicObstacle", "environmentObstacle", "phantomObstacle")
_PLACED = ("lanelet", "planningProblem", *_OBSTACLES)
"""Elements whose points are places in the network; signs and lights may have a placeholder as theirs."""


class BeyondLimits(Exception):
    """A number, count or text that is refused, with its element, of which the reader tells the line."""

    def __init__(self, element: Any, what: str, valid: str, next_step: str = "correct it in the file") -> None:
        self.element, self.what, self.valid, self.next_step = element, what, valid, next_step
        super().__init__(what)

    def refusal(self, file: str, line: int | None) -> UnsafeInput:
        """What a caller is told."""
        place = f"{shown_name(file)}, line {line:,}" if line else shown_name(file)
        return UnsafeInput(f"{place}: {self.what}", valid=[self.valid], next_step=self.next_step)


def check_document(root: Any, taken: Collection[int] = ()) -> None:
    """Look at every number, count and text of a parsed CommonRoad document (ElementTree).

    Args:
        root: of the document.
        taken: ids of obstacles whose states were taken out, because they are known to be plain and without a gap.

    Raises:
        BeyondLimits: one is no number or beyond its limit.
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
            what = f"it holds {kinds[kind]:,} elements <{kind}>"
            raise BeyondLimits(root, what, f"at most {most:,}", "split the file, or take some of them out")
    _check_count(root)


def _check_count(element: Any) -> None:
    most = MOST_CHILDREN.get(element.tag, MOST_OTHER_CHILDREN)
    if len(element) > most:
        what = f"an element <{shown_name(element.tag)}> holds {len(element):,} elements"
        raise BeyondLimits(element, what, f"at most {most:,}", "split the file, or take some of them out")


def is_within(name: str, values: Values | Sequence[int]) -> bool:
    """Whether finite values of states are all within the limits of the one with this name."""
    allowed, given = NUMBER_RANGES.get(name, _OTHER), np.asarray(values, dtype=float)
    sizes = np.abs(given)
    return bool(
        allowed.lowest <= given.min()
        and given.max() <= allowed.highest
        and not ((sizes > 0.0) & (sizes < SMALLEST)).any()
    )


def check_counts_and_ids(root: Any) -> None:
    """Look at how many elements a document (of lxml) has, and at its ids and references.

    Raises:
        BeyondLimits: there are more elements than the limits, or an id is no whole number within its own.
    """
    _check_kinds(root)
    for element in root.iter("*"):
        _check_count(element)
        _check_attributes(element, f"<{element.tag}>")


_Places = list[tuple[float, float]]


def _check_below(top: Any, owner: str, relative: Iterable[Any]) -> _Places:
    """Check all elements below one of the first level; returns the x and y of its points in m."""
    skipped = frozenset(map(id, relative))
    places: _Places = []
    for parent in top.iter():
        if not len(parent):
            continue
        _check_count(parent)
        values = {}
        for leaf in parent:
            tag, text = leaf.tag, leaf.text
            if tag in _PLANE and text and (value := _usual_coordinate(text)) is not None:  # most of a file
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
    """Check the sizes of an obstacle's shape; returns its elements: their points are beside the obstacle's place."""
    elements = list(shape.iter())
    for element in elements:
        if element.tag in ("length", "width", "radius"):
            _number(element, element.text, _OBSTACLE_SIZE, element.tag, owner)
    return elements


def _check_occupancies(top: Any, owner: str) -> None:
    """Check how many steps the occupancies of an obstacle cover in all, each as often as it has parts."""
    covered = 0
    for occupancy in top.iterfind("occupancySet/occupancy"):
        begin, end = (occupancy.findtext(f"time/{name}") for name in _INTERVAL)
        steps = int(end) - int(begin) + 1 if begin and end else 1
        covered += steps * max(1, len(occupancy.findall("shape/*")))
    if covered > MOST_OCCUPIED_STEPS:
        what = f"the occupancies of {owner} cover {covered:,} steps, each counted once for every part of its shape"
        raise BeyondLimits(top, what, f"at most {MOST_OCCUPIED_STEPS:,}")


def _check_steps(top: Any, owner: str) -> None:
    """Check that a trajectory has a state for every step: whatever reads it counts them (CommonRoad: no gaps)."""
    states = [state for part in ("initialState", "trajectory/state") for state in top.iterfind(part)]
    steps = [state.findtext("time/exact") for state in states]
    for number, (before, here) in enumerate(pairwise(steps)):
        if before is None or here is None:
            continue
        apart = int(here) - int(before)
        if apart != 1 and not (number == 0 and apart == 0):  # some give the initial state twice
            what = f"the states of {owner} go from step {int(before):,} to step {int(here):,}"
            next_step = "fill the gap, or make an obstacle with an id of its own of what comes after it"
            raise BeyondLimits(states[number + 1], what, "one state for every step, in their order", next_step)


def _check_drawn(top: Any, owner: str) -> None:
    """Check that a lanelet and all polygons cover an area, and that a lanelet's centre line leads somewhere."""
    next_step = "correct its points in the file"
    if top.tag == "lanelet":
        left, right = (_points_of(top.find(bound)) for bound in ("leftBound", "rightBound"))
        centers = [((x + u) / 2, (y + v) / 2) for (x, y), (u, v) in zip(left, right, strict=False)]
        if not _is_apart(centers):
            raise BeyondLimits(
                top, f"the centre line of {owner} has no length", f"{SHORTEST_M:g} m and more", next_step
            )
        if _is_on_a_line(left + right):
            raise BeyondLimits(top, f"{owner} covers no area", f"{SHORTEST_M:g} m wide and more", next_step)
    for polygon in top.iter("polygon"):
        if _is_on_a_line(_points_of(polygon)):
            what = f"a polygon of {owner} covers no area"
            raise BeyondLimits(polygon, what, f"{SHORTEST_M:g} m wide and more", next_step)


def _points_of(element: Any) -> _Places:
    if element is None:
        return []
    points = ((point.findtext("x"), point.findtext("y")) for point in element.iterfind("point"))
    return [(float(x), float(y)) for x, y in points if x and y]


def _is_apart(points: _Places) -> bool:
    return any(math.dist(points[0], point) >= SHORTEST_M for point in points)


def _is_on_a_line(points: _Places) -> bool:
    """Whether all points are within a millimetre of the line from the first to the one farthest from it."""
    if not points:
        return True
    (x, y), far = points[0], max(points, key=lambda point: math.dist(points[0], point))
    length, along_x, along_y = math.dist(points[0], far), far[0] - x, far[1] - y
    return all(abs(along_x * (v - y) - along_y * (u - x)) < SHORTEST_M * length for u, v in points) or length == 0.0


def _check_extent(boxes: list[tuple[Any, str, _Places]]) -> None:
    """Check that the network is no wider than the limit, and that everything else is no farther away."""
    spans = [(top, owner, *_span(places)) for top, owner, places in boxes]
    road = [(low, high) for top, _, low, high in spans if top.tag == "lanelet"]
    if not road:
        return
    lowest = [min(low[axis] for low, _ in road) for axis in (0, 1)]
    highest = [max(high[axis] for _, high in road) for axis in (0, 1)]
    for axis, name in ((0, "x"), (1, "y")):
        if highest[axis] - lowest[axis] > WIDEST_M:
            top, owner = _farthest(spans, axis)
            what = f"the lanelets reach over {highest[axis] - lowest[axis]:,.0f} m along {name}, as far as {owner}"
            raise BeyondLimits(top, what, f"at most {WIDEST_M:,.0f} m", "cut the network to the place that matters")
        for top, owner, low, high in spans:
            if low[axis] < lowest[axis] - WIDEST_M or high[axis] > highest[axis] + WIDEST_M:
                what = f"{owner} is more than {WIDEST_M:,.0f} m away from all lanelets along {name}"
                raise BeyondLimits(top, what, f"at most {WIDEST_M:,.0f} m from the lanelets")


def _farthest(spans: list[tuple[Any, str, list[float], list[float]]], axis: int) -> tuple[Any, str]:
    """The lanelet whose middle is farthest from the middle one."""
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
            element, f"{name} of {owner} is {cited(text or '', 40)}, which is no {kind}", allowed.text
        ) from None
    if allowed.is_whole:
        given = f"{value:,}" if abs(value) < _PRINTED else "a number of too many digits"
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
