"""The road network of a CommonRoad file as written, including defects.

commonroad-io repairs or rejects what does not fit: it drops dangling references, and stops reading at a repeated id.
Checks on its network cannot find these defects. Here, nothing is resolved: references stay numbers. Coordinates are in
metres. A lanelet is *drawn* if its bounds form an area; its geometry is defined only then.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from ...schemas.errors import UnsafeInput
from ...schemas.text import cited, shown_name
from ..geometry import Points, without_repeats
from .reader import XmlLimits, refuse_another_root, scan_xml
from .value_limits import NUMBER_RANGES, SMALLEST, BeyondLimits, check_counts_and_ids

if TYPE_CHECKING:
    from shapely import Polygon


@dataclass(frozen=True)
class _NeighbourElement:
    """An adjacent lanelet, and whether the file states that it leads in the same direction."""

    lanelet_id: int
    same_direction: bool


@dataclass(frozen=True)
class _StopLineElement:
    """A stop line: its points (n, 2), empty if it is at the lanelet's end, and the ids that it refers to."""

    points: Points
    sign_ids: tuple[int, ...]
    light_ids: tuple[int, ...]


@dataclass(frozen=True)
class LaneletElement:
    """A lanelet as written: bounds (n, 2) in metres, of any length; ``markings`` of the left and right bound.

    ``neighbours``: the adjacent lanelets on the ``left`` and on the ``right``.
    """

    lanelet_id: int
    left: Points
    right: Points
    markings: tuple[str, ...]
    predecessors: tuple[int, ...]
    successors: tuple[int, ...]
    neighbours: dict[str, _NeighbourElement]
    stop_line: _StopLineElement
    types: tuple[str, ...]
    users: tuple[str, ...]
    sign_ids: tuple[int, ...]
    light_ids: tuple[int, ...]

    @property
    def neighbour_ids(self) -> tuple[int, ...]:
        """The ids of the adjacent lanelets, left before right."""
        return tuple(adjoining.lanelet_id for adjoining in self.neighbours.values())

    @property
    def bounds(self) -> tuple[tuple[str, Points], ...]:
        """The two bounds with the names of their sides, left before right."""
        return ("left", self.left), ("right", self.right)

    @cached_property
    def is_drawn(self) -> bool:
        """Whether the bounds form an area: two or more finite points each, with the same number left and right."""
        finite = bool(np.isfinite(self.left).all() and np.isfinite(self.right).all())
        return finite and len(self.left) == len(self.right) >= 2

    @property
    def is_footway(self) -> bool:
        """Whether the lanelet is open to pedestrians only."""
        return self.users == ("pedestrian",)

    @cached_property
    def center(self) -> Points:
        """The centre line (n, 2) of a drawn lanelet, halfway between the bounds."""
        middle: Points = (self.left + self.right) / 2
        return middle

    @cached_property
    def path(self) -> Points:
        """The centre line of a drawn lanelet without repeated points."""
        return without_repeats(self.center)

    @cached_property
    def width_m(self) -> float:
        """The width of a drawn lanelet in m: the median distance of corresponding points of the bounds."""
        return float(np.median(np.linalg.norm(self.left - self.right, axis=1)))

    @cached_property
    def polygon(self) -> "Polygon":
        """The area of a drawn lanelet, made valid if the bounds cross."""
        from shapely import Polygon

        area = Polygon(np.concatenate([self.right, self.left[::-1]]))
        return area if area.is_valid else area.buffer(0)


@dataclass(frozen=True)
class _SignElement:
    """A traffic sign: (number, additional values) of each of its plates, position (2,) or None."""

    sign_id: int
    plates: tuple[tuple[str, tuple[str, ...]], ...]
    position: Points | None


@dataclass(frozen=True)
class _LightElement:
    """A traffic light: (steps, colour) of its phases."""

    light_id: int
    phases: tuple[tuple[int, str], ...]
    position: Points | None
    active: bool


@dataclass(frozen=True)
class _IncomingElement:
    """An arm of an intersection: incoming lanelets, lanelets that follow them, and the arm to its right."""

    incoming_id: int
    lanelet_ids: tuple[int, ...]
    exit_ids: tuple[int, ...]
    left_of: int | None


@dataclass(frozen=True)
class _IntersectionElement:
    """An intersection and its arms."""

    intersection_id: int
    incomings: tuple[_IncomingElement, ...]


@dataclass(frozen=True)
class RoadDocument:
    """The network of one file in the file's order; ``country`` is that of the benchmark id.

    ``ids``: all ids of the file with the element's name, including vehicles and planning problems.
    """

    country: str
    lanelets: tuple[LaneletElement, ...]
    signs: tuple[_SignElement, ...]
    lights: tuple[_LightElement, ...]
    intersections: tuple[_IntersectionElement, ...]
    ids: tuple[tuple[int, str], ...]

    @cached_property
    def by_id(self) -> dict[int, LaneletElement]:
        """The lanelets by id; for a repeated id, the first lanelet."""
        return {lanelet.lanelet_id: lanelet for lanelet in reversed(self.lanelets)}

    @cached_property
    def drawn(self) -> tuple[LaneletElement, ...]:
        """The drawn lanelets."""
        return tuple(lanelet for lanelet in self.lanelets if lanelet.is_drawn)

    @cached_property
    def driven(self) -> tuple[LaneletElement, ...]:
        """The lanelets with bounds that form an area (``is_drawn``), except footways.

        On footways, pedestrians walk in any direction and turn on the spot.
        """
        return tuple(lanelet for lanelet in self.drawn if not lanelet.is_footway)

    @cached_property
    def joins(self) -> tuple[tuple[LaneletElement, LaneletElement], ...]:
        """Every drawn lanelet with each of its drawn successors except itself."""
        pairs = ((lanelet, self.by_id.get(key)) for lanelet in self.drawn for key in lanelet.successors)
        joined = ((before, after) for before, after in pairs if after is not None and after is not before)
        return tuple((before, after) for before, after in joined if after.is_drawn)


_EXITS = ("successorsRight", "successorsStraight", "successorsLeft")


def read_road_document(path: Path, limits: XmlLimits | None = None) -> RoadDocument:
    """Scan a CommonRoad file and read its network.

    A coordinate that is not a number or beyond its limits becomes NaN, for a rule to find.

    Raises:
        UnsafeInput: the file is hostile, broken or not a CommonRoad file, an id or a duration is not a number, or there
            are
            more elements than ``value_limits`` allows.
    """
    refuse_another_root(path, scan_xml(path, limits).name)
    try:
        root = etree.parse(path, etree.XMLParser(resolve_entities=False, no_network=True)).getroot()
        check_counts_and_ids(root)
        return road_document(root)
    except BeyondLimits as error:
        raise error.refusal(path.name, error.element.sourceline) from None
    except (etree.LxmlError, ValueError) as error:
        raise UnsafeInput(f"{shown_name(path.name)} is not readable as CommonRoad: {cited(error)}") from error


def road_document(root: etree._Element) -> RoadDocument:
    """Return the network below the root element of a CommonRoad document.

    Raises:
        ValueError: an id or a duration is not a number.
    """
    return RoadDocument(
        country=root.get("benchmarkID", "").removeprefix("C-")[:3],
        lanelets=tuple(_lanelet(element) for element in root.iterfind("lanelet")),
        signs=tuple(_sign(element) for element in root.iterfind("trafficSign")),
        lights=tuple(_light(element) for element in root.iterfind("trafficLight")),
        intersections=tuple(_intersection(element) for element in root.iterfind("intersection")),
        ids=tuple(
            (_number(element, "id"), str(element.tag))
            for child in root
            for element in (child, *child.iterfind("incoming"))
            if element.get("id") is not None
        ),
    )


def _lanelet(element: etree._Element) -> LaneletElement:
    bounds = [element.find(tag) for tag in ("leftBound", "rightBound")]
    left, right = (_points([] if bound is None else bound.iterfind("point")) for bound in bounds)
    markings = tuple(bound.findtext("lineMarking", "") for bound in bounds if bound is not None)
    return LaneletElement(
        lanelet_id=_number(element, "id"),
        left=left,
        right=right,
        markings=tuple(word for word in markings if word),
        predecessors=_references(element, "predecessor"),
        successors=_references(element, "successor"),
        neighbours={
            side: _NeighbourElement(_number(adjoining, "ref"), adjoining.get("drivingDir") == "same")
            for side, tag in (("left", "adjacentLeft"), ("right", "adjacentRight"))
            if (adjoining := element.find(tag)) is not None
        },
        stop_line=_stop_line(element.find("stopLine")),
        types=_words(element, "laneletType"),
        users=_words(element, "userOneWay") + _words(element, "userBidirectional"),
        sign_ids=_references(element, "trafficSignRef"),
        light_ids=_references(element, "trafficLightRef"),
    )


def _stop_line(element: etree._Element | None) -> _StopLineElement:
    if element is None:
        return _StopLineElement(_points([]), (), ())
    return _StopLineElement(
        points=_points(element.iterfind("point")),
        sign_ids=_references(element, "trafficSignRef"),
        light_ids=_references(element, "trafficLightRef"),
    )


def _sign(element: etree._Element) -> _SignElement:
    plates = tuple(
        (plate.findtext("trafficSignID", "").strip(), _words(plate, "additionalValue"))
        for plate in element.iterfind("trafficSignElement")
    )
    return _SignElement(_number(element, "id"), plates, _position(element))


def _light(element: etree._Element) -> _LightElement:
    phases = tuple(
        (_steps(phase.findtext("duration", "0")), phase.findtext("color", "").strip())
        for phase in element.iterfind("cycle/cycleElement")
    )
    active = element.findtext("active", "true").strip() in ("true", "1")
    return _LightElement(_number(element, "id"), phases, _position(element), active)


def _steps(text: str) -> int:
    steps = int(text)
    if steps > NUMBER_RANGES["duration"].highest:
        raise ValueError(f"a phase of a traffic light lasts more than {NUMBER_RANGES['duration'].highest:,.0f} steps")
    return steps


def _intersection(element: etree._Element) -> _IntersectionElement:
    incomings = tuple(
        _IncomingElement(
            incoming_id=_number(incoming, "id"),
            lanelet_ids=_references(incoming, "incomingLanelet"),
            exit_ids=tuple(key for tag in _EXITS for key in _references(incoming, tag)),
            left_of=next(iter(_references(incoming, "isLeftOf")), None),
        )
        for incoming in element.iterfind("incoming")
    )
    return _IntersectionElement(_number(element, "id"), incomings)


def _position(element: etree._Element) -> Points | None:
    points = _points(element.iterfind("position/point"))
    return points[0] if len(points) else None


def _points(elements: Iterable[etree._Element]) -> Points:
    numbers = [(_coordinate(element.findtext("x")), _coordinate(element.findtext("y"))) for element in elements]
    points = np.array(numbers, dtype=float).reshape(-1, 2)
    points[~(np.abs(points) <= NUMBER_RANGES["x"].highest)] = np.nan
    points[(points != 0) & (np.abs(points) < SMALLEST)] = 0.0
    return points


def _coordinate(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return float("nan")


def _references(element: etree._Element, tag: str) -> tuple[int, ...]:
    return tuple(_number(child, "ref") for child in element.iterfind(tag))


def _number(element: etree._Element, attribute: str) -> int:
    text = element.get(attribute, "")
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"<{element.tag}> has {attribute}={text!r}, which is not a whole number") from None


def _words(element: etree._Element, tag: str) -> tuple[str, ...]:
    return tuple((child.text or "").strip() for child in element.iterfind(tag))
