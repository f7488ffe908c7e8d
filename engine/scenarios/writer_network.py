"""The road network's part of a CommonRoad file: lanelets, signs, lights, intersections."""

from collections.abc import Iterable

from lxml import etree

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.network.road_network import (
    Incoming,
    RoadLanelet,
    RoadNetwork,
    SpeedSign,
    TrafficLight,
)


def write_network(root: etree._Element, network: RoadNetwork, speed_sign: str | None) -> None:
    """Append all elements of the network in the order of CommonRoad's schema.

    ``speed_sign``: the country's sign for a speed limit; None leaves the signs out.
    """
    signs: dict[int, list[int]] = {}
    for sign in network.signs if speed_sign is not None else ():
        for key in sign.lanelet_ids:
            signs.setdefault(key, []).append(sign.sign_id)
    lights: dict[int, list[int]] = {}
    for light in network.lights:
        lights.setdefault(light.lanelet_id, []).append(light.light_id)
    for key, lanelet in network.lanelets.items():
        _write_lanelet(root, lanelet, signs.get(key, []), lights.get(key, []))
    if speed_sign is not None:
        for sign in network.signs:
            _write_sign(root, sign, speed_sign)
    for light in network.lights:
        _write_light(root, light)
    for intersection in network.intersections:
        element = etree.SubElement(root, "intersection", {"id": str(intersection.intersection_id)})
        for incoming in intersection.incomings:
            _write_incoming(element, incoming)


def write_point(parent: etree._Element, point: Points, decimals: int = 4) -> None:
    """Append a point (2,) in metres."""
    element = etree.SubElement(parent, "point")
    etree.SubElement(element, "x").text = f"{point[0]:.{decimals}f}"
    etree.SubElement(element, "y").text = f"{point[1]:.{decimals}f}"


def _references(parent: etree._Element, tag: str, ids: Iterable[int]) -> None:
    for key in ids:
        etree.SubElement(parent, tag, {"ref": str(key)})


def _write_lanelet(root: etree._Element, lanelet: RoadLanelet, signs: list[int], lights: list[int]) -> None:
    element = etree.SubElement(root, "lanelet", {"id": str(lanelet.lanelet_id)})
    sides = (
        ("leftBound", lanelet.left, lanelet.left_neighbour, lanelet.left_same_direction),
        ("rightBound", lanelet.right, lanelet.right_neighbour, lanelet.right_same_direction),
    )
    for tag, line, neighbour, _same in sides:
        bound = etree.SubElement(element, tag)
        for point in line:
            write_point(bound, point)
        marking = "no_marking" if lanelet.internal else ("dashed" if neighbour is not None else "solid")
        etree.SubElement(bound, "lineMarking").text = marking
    _references(element, "predecessor", lanelet.predecessors)
    _references(element, "successor", lanelet.successors)
    for tag, (_, _, neighbour, same) in zip(("adjacentLeft", "adjacentRight"), sides, strict=True):
        if neighbour is not None:
            direction = "same" if same else "opposite"
            etree.SubElement(element, tag, {"ref": str(neighbour), "drivingDir": direction})
    if lights:
        line_element = etree.SubElement(element, "stopLine")
        write_point(line_element, lanelet.left[-1])
        write_point(line_element, lanelet.right[-1])
        etree.SubElement(line_element, "lineMarking").text = "solid"
        _references(line_element, "trafficLightRef", lights)
    for word in lanelet.types:
        etree.SubElement(element, "laneletType").text = word
    for word in lanelet.users:
        etree.SubElement(element, "userOneWay").text = word
    _references(element, "trafficSignRef", signs)
    _references(element, "trafficLightRef", lights)


def _write_sign(root: etree._Element, sign: SpeedSign, speed_sign: str) -> None:
    element = etree.SubElement(root, "trafficSign", {"id": str(sign.sign_id)})
    inside = etree.SubElement(element, "trafficSignElement")
    etree.SubElement(inside, "trafficSignID").text = speed_sign
    etree.SubElement(inside, "additionalValue").text = f"{sign.speed_mps:.4f}"
    write_point(etree.SubElement(element, "position"), sign.position)
    etree.SubElement(element, "virtual").text = "true"


def _write_light(root: etree._Element, light: TrafficLight) -> None:
    element = etree.SubElement(root, "trafficLight", {"id": str(light.light_id)})
    cycle = etree.SubElement(element, "cycle")
    for steps, colour in light.cycle:
        phase = etree.SubElement(cycle, "cycleElement")
        etree.SubElement(phase, "duration").text = str(steps)
        etree.SubElement(phase, "color").text = colour
    if light.offset_steps:
        etree.SubElement(cycle, "timeOffset").text = str(light.offset_steps)
    write_point(etree.SubElement(element, "position"), light.position)
    etree.SubElement(element, "direction").text = light.direction
    etree.SubElement(element, "active").text = "true"


def _write_incoming(intersection: etree._Element, incoming: Incoming) -> None:
    element = etree.SubElement(intersection, "incoming", {"id": str(incoming.incoming_id)})
    _references(element, "incomingLanelet", incoming.lanelet_ids)
    _references(element, "successorsRight", incoming.right)
    _references(element, "successorsStraight", incoming.straight)
    _references(element, "successorsLeft", incoming.left)
