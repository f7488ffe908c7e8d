"""One way to break the good road for every rule."""

import math
from collections.abc import Callable

from lxml import etree

from support.roads import add_lanelet, at, lanelet, redraw

Break = Callable[[etree._Element], None]


def _text(path: str, text: str) -> Break:
    def change(root: etree._Element) -> None:
        at(root, path).text = text

    return change


def _attribute(path: str, name: str, value: str) -> Break:
    def change(root: etree._Element) -> None:
        at(root, path).set(name, value)

    return change


def _remove(path: str) -> Break:
    def change(root: etree._Element) -> None:
        element = at(root, path)
        parent = element.getparent()
        assert parent is not None
        parent.remove(element)

    return change


def _add(path: str, tag: str, **attributes: str) -> Break:
    def change(root: etree._Element) -> None:
        etree.SubElement(at(root, path), tag, attributes)

    return change


def _bounds(number: int, left: list[tuple[float, float]], right: list[tuple[float, float]]) -> Break:
    def change(root: etree._Element) -> None:
        redraw(lanelet(root, number), left, right)

    return change


def _one_after_another(*changes: Break) -> Break:
    def change(root: etree._Element) -> None:
        for one in changes:
            one(root)

    return change


def _lone_piece(root: etree._Element) -> None:
    add_lanelet(root, 8, [(0, 50), (5, 50), (10, 50)])


def _second_arm(root: etree._Element) -> None:
    arm = etree.SubElement(at(root, "intersection"), "incoming", id="42")
    etree.SubElement(arm, "incomingLanelet", ref="1")
    etree.SubElement(arm, "successorsRight", ref="5")


def _double(root: etree._Element) -> None:
    add_lanelet(root, 8, [(120, 0.1), (150, 0.1), (180, 0.1)], successors=(9,))
    add_lanelet(root, 9, [(180, 0.1), (200, 0.1), (220, 0.1)], predecessors=(8,))


def _tight_bend(root: etree._Element) -> None:
    angles = [math.radians(-90 + 15 * step) for step in range(9)]
    inner, outer = ([(122 + r * math.cos(a), 0.9 + r * math.sin(a)) for a in angles] for r in (0.05, 1.75))
    redraw(lanelet(root, 6), [(120, 0.85), *inner], [(120, -0.85), *outer])


def _far_sign(root: etree._Element) -> None:
    _text("trafficSign/trafficSignElement/trafficSignID", "205")(root)
    _text("trafficSign/position/point/y", "-90")(root)


TENTHS = range(120, 181, 12)
RIGHT_6 = [(120.0, -1.75), (150.0, -1.75), (180.0, -1.75)]
LEFT_6 = [(120.0, 1.75), (150.0, 1.75), (180.0, 1.75)]
ARM = "intersection/incoming"

DEFECTS: dict[str, Break] = {
    "unequal_bounds": _remove("lanelet[@id='6']/leftBound/point"),
    "too_few_points": _bounds(6, LEFT_6[:1], RIGHT_6[:1]),
    "coordinate_not_finite": _text("lanelet[@id='6']/leftBound/point/x", "nan"),
    "repeated_points": _bounds(6, [*LEFT_6[:2], *LEFT_6[1:]], [*RIGHT_6[:2], *RIGHT_6[1:]]),
    "bound_crosses_itself": _bounds(
        6, [(120, 1.75), (150, 1.75), (151, 3), (149, 3), (151, 1.5), (180, 1.75)], [(x, -1.75) for x in TENTHS]
    ),
    "bounds_cross": _bounds(6, [(120, 1.75), (150, 1.75), (180, -1.75)], [(120, -1.75), (150, -1.75), (180, 1.75)]),
    "bounds_swapped": _bounds(6, RIGHT_6, LEFT_6),
    "too_short": _bounds(6, [(120, 1.75), (120.05, 1.75)], [(120, -1.75), (120.05, -1.75)]),
    "too_narrow": _bounds(6, [(x, 0.5) for x, _ in LEFT_6], [(x, -0.5) for x, _ in LEFT_6]),
    "too_wide": _bounds(6, [(x, 7.0) for x, _ in LEFT_6], [(x, -7.0) for x, _ in LEFT_6]),
    "folds_back": _bounds(6, [(120, 1.75), (150, 1.75), (140, 3.75)], [(120, -1.75), (150, -1.75), (140, -3.7)]),
    "too_tight": _tight_bend,
    "unknown_successor": _add("lanelet[@id='6']", "successor", ref="99"),
    "unknown_neighbour": _add("lanelet[@id='6']", "adjacentLeft", ref="99", drivingDir="same"),
    "one_way_succession": _remove("lanelet[@id='6']/predecessor"),
    "gap_at_join": _bounds(6, [(x + 3, y) for x, y in LEFT_6], [(x + 3, y) for x, y in RIGHT_6]),
    "heading_jump": _bounds(6, [(118.25, 0), (118.25, 60)], [(121.75, 0), (121.75, 60)]),
    "follows_itself": _one_after_another(
        _add("lanelet[@id='6']", "successor", ref="6"), _add("lanelet[@id='6']", "predecessor", ref="6")
    ),
    "follows_and_lies_beside": _one_after_another(
        _add("lanelet[@id='6']", "adjacentLeft", ref="4", drivingDir="same"),
        _add("lanelet[@id='4']", "adjacentRight", ref="6", drivingDir="same"),
    ),
    "one_way_neighbour": _remove("lanelet[@id='2']/adjacentRight"),
    "neighbour_direction": _one_after_another(
        _attribute("lanelet[@id='2']/adjacentLeft", "drivingDir", "same"),
        _remove("lanelet[@id='3']/adjacentLeft"),
        _add("lanelet[@id='3']", "adjacentRight", ref="2", drivingDir="same"),
    ),
    "neighbour_apart": _bounds(3, [(100, 10), (50, 10), (0, 10)], [(100, 13.5), (50, 13.5), (0, 13.5)]),
    "neighbour_on_both_sides": _add("lanelet[@id='1']", "adjacentRight", ref="2", drivingDir="same"),
    "overlapping_lanelets": _double,
    "isolated_lanelet": _lone_piece,
    "repeated_id": _attribute(ARM, "id", "30"),
    "unknown_sign": _add("lanelet[@id='6']", "trafficSignRef", ref="99"),
    "unknown_light": _add("lanelet[@id='6']", "trafficLightRef", ref="99"),
    "unused_sign": _remove("lanelet[@id='1']/trafficSignRef"),
    "unused_light": _remove("lanelet[@id='1']/trafficLightRef"),
    "sign_without_plate": _remove("trafficSign/trafficSignElement"),
    "unknown_sign_number": _text("trafficSign/trafficSignElement/trafficSignID", "9999"),
    "implausible_speed_limit": _text("trafficSign/trafficSignElement/additionalValue", "120"),
    "light_without_cycle": _remove("trafficLight/cycle"),
    "phase_without_duration": _text("trafficLight/cycle/cycleElement/duration", "0"),
    "light_never_green": _text("trafficLight/cycle/cycleElement/color", "red"),
    "unknown_colour": _text("trafficLight/cycle/cycleElement[2]/color", "blue"),
    "sign_far_away": _far_sign,
    "stop_line_misplaced": _one_after_another(
        _text("lanelet/stopLine/point[1]/x", "112"), _text("lanelet/stopLine/point[2]/x", "112")
    ),
    "stop_line_at_beginning": _one_after_another(
        _text("lanelet/stopLine/point[1]/x", "5"), _text("lanelet/stopLine/point[2]/x", "5")
    ),
    "unknown_lanelet_at_intersection": _add(ARM, "successorsLeft", ref="99"),
    "intersection_without_incoming": _remove(ARM),
    "incoming_without_lanelet": _one_after_another(
        _remove(f"{ARM}/incomingLanelet"), _remove(f"{ARM}/successorsRight"), _remove(f"{ARM}/successorsStraight")
    ),
    "incoming_without_exit": _one_after_another(
        _remove(f"{ARM}/successorsRight"), _remove(f"{ARM}/successorsStraight")
    ),
    "exit_not_behind_incoming": _add(ARM, "successorsLeft", ref="7"),
    "lanelet_in_two_incomings": _second_arm,
    "unknown_lanelet_type": _text("lanelet[@id='6']/laneletType", "motorway"),
    "unknown_user": _add("lanelet[@id='6']", "userOneWay"),
    "unknown_line_marking": _text("lanelet[@id='6']/leftBound/lineMarking", "wavy"),
}
"""The smallest change that a rule has to catch, by the rule's id."""

COMPANIONS: dict[str, set[str]] = {
    "neighbour_direction": {"neighbour_apart"},
    "neighbour_on_both_sides": {"one_way_neighbour", "neighbour_apart"},
    "follows_and_lies_beside": {"neighbour_apart"},
}
"""Rules that the same change breaks too, rightly."""
