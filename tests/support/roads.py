"""Road networks for tests: a good CommonRoad file with one of everything, tools to break it, and streets.

Three arms meet: 1 (with its left neighbour 2, and 3 oncoming beyond it) leads east into the junction, 4 goes straight
on to 6, 5 turns right to 7. Lanelet 1 has a stop line, a light and a speed limit. The streets are lanelets of a
generated network, for tests without a SUMO network.
"""

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from lxml import etree

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.network.road_network import RoadLanelet, RoadNetwork

Point = tuple[float, float]
WIDTH_M = 3.5


def good_road() -> etree._Element:
    """Return the root element of the good network."""
    root = etree.Element("commonRoad", {"commonRoadVersion": "2020a", "benchmarkID": "DEU_Good-1_1_T-1"})
    add_lanelet(root, 1, [(0, 0), (50, 0), (100, 0)], successors=(4, 5), left=(2, "same"))
    add_lanelet(root, 2, [(0, 3.5), (50, 3.5), (100, 3.5)], left=(3, "opposite"), right=(1, "same"))
    add_lanelet(root, 3, [(100, 7), (50, 7), (0, 7)], left=(2, "opposite"))
    add_lanelet(root, 4, [(100, 0), (110, 0), (120, 0)], predecessors=(1,), successors=(6,))
    bend = [(100 + 10 * math.sin(a), -10 + 10 * math.cos(a)) for a in (0, 0.39, 0.79, 1.18, math.pi / 2)]
    add_lanelet(root, 5, bend, predecessors=(1,), successors=(7,))
    add_lanelet(root, 6, [(120, 0), (150, 0), (180, 0)], predecessors=(4,))
    add_lanelet(root, 7, [(110, -10), (110, -40), (110, -70)], predecessors=(5,))
    first = lanelet(root, 1)
    types = first.find("laneletType")
    assert types is not None
    line = etree.Element("stopLine")
    _points(line, [(100, 1.75), (100, -1.75)])
    etree.SubElement(line, "lineMarking").text = "solid"
    types.addprevious(line)
    etree.SubElement(first, "userOneWay").text = "car"
    etree.SubElement(first, "trafficSignRef", ref="20")
    etree.SubElement(first, "trafficLightRef", ref="30")
    _sign(root)
    _light(root)
    _intersection(root)
    return root


def add_lanelet(
    root: etree._Element,
    lanelet_id: int,
    center: list[Point],
    *,
    predecessors: Iterable[int] = (),
    successors: Iterable[int] = (),
    left: tuple[int, str] | None = None,
    right: tuple[int, str] | None = None,
) -> etree._Element:
    """Append a lanelet of ``WIDTH_M`` around a centre line."""
    element = etree.SubElement(root, "lanelet", id=str(lanelet_id))
    for tag, side in (("leftBound", 1), ("rightBound", -1)):
        bound = etree.SubElement(element, tag)
        _points(bound, _beside(center, side * WIDTH_M / 2))
        etree.SubElement(bound, "lineMarking").text = "solid"
    for tag, keys in (("predecessor", predecessors), ("successor", successors)):
        for key in keys:
            etree.SubElement(element, tag, ref=str(key))
    for tag, beside in (("adjacentLeft", left), ("adjacentRight", right)):
        if beside is not None:
            etree.SubElement(element, tag, ref=str(beside[0]), drivingDir=beside[1])
    etree.SubElement(element, "laneletType").text = "urban"
    return element


def lanelet(root: etree._Element, lanelet_id: int) -> etree._Element:
    """Return a lanelet by its id."""
    return at(root, f"lanelet[@id='{lanelet_id}']")


def at(root: etree._Element, path: str) -> etree._Element:
    """Return the first element of a path, which must exist."""
    found = root.find(path)
    assert found is not None, path
    return found


def redraw(element: etree._Element, left: list[Point], right: list[Point]) -> None:
    """Give a lanelet other bounds."""
    for tag, points in (("leftBound", left), ("rightBound", right)):
        bound = at(element, tag)
        for point in bound.findall("point"):
            bound.remove(point)
        marking = bound.find("lineMarking")
        _points(bound, points)
        if marking is not None:
            bound.append(marking)


def write(root: etree._Element, folder: Path) -> Path:
    """Write the network to a file and return its path."""
    path = folder / "road.xml"
    path.write_bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8"))
    return path


def _beside(center: list[Point], offset: float) -> list[Point]:
    found = []
    for index, (x, y) in enumerate(center):
        before, after = center[max(index - 1, 0)], center[min(index + 1, len(center) - 1)]
        angle = math.atan2(after[1] - before[1], after[0] - before[0])
        found.append((x - math.sin(angle) * offset, y + math.cos(angle) * offset))
    return found


def _points(parent: etree._Element, points: Iterable[Point]) -> None:
    for x, y in points:
        point = etree.SubElement(parent, "point")
        etree.SubElement(point, "x").text = f"{x:.4f}"
        etree.SubElement(point, "y").text = f"{y:.4f}"


def _sign(root: etree._Element) -> None:
    sign = etree.SubElement(root, "trafficSign", id="20")
    plate = etree.SubElement(sign, "trafficSignElement")
    etree.SubElement(plate, "trafficSignID").text = "274"
    etree.SubElement(plate, "additionalValue").text = "13.89"
    _points(etree.SubElement(sign, "position"), [(0, -2)])


def _light(root: etree._Element) -> None:
    light = etree.SubElement(root, "trafficLight", id="30")
    cycle = etree.SubElement(light, "cycle")
    for steps, colour in ((300, "green"), (30, "yellow"), (270, "red")):
        phase = etree.SubElement(cycle, "cycleElement")
        etree.SubElement(phase, "duration").text = str(steps)
        etree.SubElement(phase, "color").text = colour
    _points(etree.SubElement(light, "position"), [(100, -2)])
    etree.SubElement(light, "active").text = "true"


def _intersection(root: etree._Element) -> None:
    intersection = etree.SubElement(root, "intersection", id="40")
    incoming = etree.SubElement(intersection, "incoming", id="41")
    etree.SubElement(incoming, "incomingLanelet", ref="1")
    etree.SubElement(incoming, "successorsRight", ref="5")
    etree.SubElement(incoming, "successorsStraight", ref="4")


HALF_WIDTH_M = np.array([0.0, 1.75])


def street(key: int, center: Points, successors: tuple[int, ...] = ()) -> RoadLanelet:
    """Return a town lanelet that leads east about a centre line (n, 2), without neighbours."""
    return RoadLanelet(
        lanelet_id=key,
        lane_id=f"e{key}_0",
        edge_id=f"e{key}",
        left=center + HALF_WIDTH_M,
        right=center - HALF_WIDTH_M,
        successors=successors,
        predecessors=(),
        left_neighbour=None,
        left_same_direction=False,
        right_neighbour=None,
        right_same_direction=False,
        internal=False,
        types=("urban",),
        users=("car",),
        allowed=frozenset({"passenger"}),
        speed_mps=13.9,
        street="",
    )


def network_of_streets(*lanelets: RoadLanelet) -> RoadNetwork:
    """Return a network of only these: no signs, lights or intersections."""
    return RoadNetwork({one.lanelet_id: one for one in lanelets}, (), (), (), ())
