"""Reading the road network of a CommonRoad file (2018b or 2020a) as it stands there."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from lxml import etree

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.network.road_document import (
    IncomingElement,
    IntersectionElement,
    LaneletElement,
    LightElement,
    NeighbourElement,
    RoadDocument,
    SignElement,
    StopLineElement,
)
from plannerforge.engine.scenarios.reader import XmlLimits, scan_root
from plannerforge.schemas.errors import UnsafeInput

EXITS = ("successorsRight", "successorsStraight", "successorsLeft")


def read_road_document(path: Path, limits: XmlLimits | None = None) -> RoadDocument:
    """Scan a CommonRoad file and read its network.

    A coordinate that is no number becomes NaN, for a rule to find.

    Raises:
        UnsafeInput: the file is hostile, broken or not a CommonRoad file, or an id or a duration is no number.
    """
    name = scan_root(path, limits).name
    if name != "commonRoad":
        raise UnsafeInput(f"{path.name} is no CommonRoad file: its root element is <{name}>, not <commonRoad>")
    try:
        root = etree.parse(path, etree.XMLParser(resolve_entities=False, no_network=True)).getroot()
        return road_document(root)
    except (etree.LxmlError, ValueError) as error:
        raise UnsafeInput(f"{path.name} is not readable as CommonRoad: {error}") from error


def road_document(root: etree._Element) -> RoadDocument:
    """The network below the root element of a CommonRoad document.

    Raises:
        ValueError: an id or a duration is no number.
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
        left_neighbour=_neighbour(element.find("adjacentLeft")),
        right_neighbour=_neighbour(element.find("adjacentRight")),
        stop_line=_stop_line(element.find("stopLine")),
        types=_words(element, "laneletType"),
        users=_words(element, "userOneWay") + _words(element, "userBidirectional"),
        sign_ids=_references(element, "trafficSignRef"),
        light_ids=_references(element, "trafficLightRef"),
    )


def _neighbour(element: etree._Element | None) -> NeighbourElement | None:
    return None if element is None else NeighbourElement(_number(element, "ref"), element.get("drivingDir") == "same")


def _stop_line(element: etree._Element | None) -> StopLineElement | None:
    if element is None:
        return None
    return StopLineElement(
        points=_points(element.iterfind("point")),
        sign_ids=_references(element, "trafficSignRef"),
        light_ids=_references(element, "trafficLightRef"),
    )


def _sign(element: etree._Element) -> SignElement:
    plates = tuple(
        (plate.findtext("trafficSignID", "").strip(), _words(plate, "additionalValue"))
        for plate in element.iterfind("trafficSignElement")
    )
    return SignElement(_number(element, "id"), plates, _position(element))


def _light(element: etree._Element) -> LightElement:
    phases = tuple(
        (int(phase.findtext("duration", "0")), phase.findtext("color", "").strip())
        for phase in element.iterfind("cycle/cycleElement")
    )
    active = element.findtext("active", "true").strip() in ("true", "1")
    return LightElement(_number(element, "id"), phases, _position(element), active)


def _intersection(element: etree._Element) -> IntersectionElement:
    incomings = tuple(
        IncomingElement(
            incoming_id=_number(incoming, "id"),
            lanelet_ids=_references(incoming, "incomingLanelet"),
            exit_ids=tuple(key for tag in EXITS for key in _references(incoming, tag)),
            left_of=next(iter(_references(incoming, "isLeftOf")), None),
        )
        for incoming in element.iterfind("incoming")
    )
    return IntersectionElement(_number(element, "id"), incomings)


def _position(element: etree._Element) -> Points | None:
    points = _points(element.iterfind("position/point"))
    return points[0] if len(points) else None


def _points(elements: Iterable[etree._Element]) -> Points:
    numbers = [(_coordinate(element.findtext("x")), _coordinate(element.findtext("y"))) for element in elements]
    return np.array(numbers, dtype=float).reshape(-1, 2)


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
        raise ValueError(f"<{element.tag}> has {attribute}={text!r}, which is no whole number") from None


def _words(element: etree._Element, tag: str) -> tuple[str, ...]:
    return tuple((child.text or "").strip() for child in element.iterfind(tag))
