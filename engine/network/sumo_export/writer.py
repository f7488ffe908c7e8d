"""Writes a SUMO network directly from a lanelet network; the lanelets' centre lines are the shapes of the lanes.

netconvert is not involved: it would move 99.9% of the lanes by more than half a metre and reject loops. Format: SUMO
network file, version 1.20 (https://sumo.dlr.de/docs/Networks/SUMO_Road_Networks.html). The same input gives the same
bytes. Lengths are in metres, speeds in m/s.

Where paths through a junction meet, right of way follows the turn rule for oncoming traffic, else right before left. A
traffic light of a lanelet applies to the paths that leave it in the light's directions. Its programme is a ``tlLogic``
(https://sumo.dlr.de/docs/Simulation/Traffic_Lights.html) with the phase of time step 0 first and no offset.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from ....schemas.errors import NotPossible
from ...geometry import Points, length_m, wrap_angle
from .layout import JunctionPath, NetLayout, crossing_of
from .speeds import curve_speed

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork
    from commonroad.scenario.traffic_light import TrafficLight

Element = etree._Element
_SHORTEST_INTERNAL_LANE_M = 0.12
"""Chosen: SUMO requires internal lanes of at least 0.1 m, after rounding."""
_PATH_SMOOTHING_M = 3.0
"""Chosen: paths through junctions are shorter than roads, and their kinks closer together."""


_MOST_LINKS = 256
"""Maximum number of paths through one junction: SUMO_MAX_CONNECTIONS in SUMO's StdDefs.h, the bits of its right-of-way
tables.
"""


def sumo_net(layout: NetLayout, speeds_mps: Mapping[int, float], signals: "tuple[Signal, ...]" = ()) -> str:
    """Return the text of the ``.net.xml`` of a layout with its traffic lights; ``speeds_mps``: speed limit by lanelet.

    Raises:
        NotPossible: more paths lead through a junction than SUMO supports.
    """
    most = max(layout.links.values(), key=len, default=())
    if len(most) > _MOST_LINKS:
        raise NotPossible(
            f"{len(most):,} paths lead through the junction after lanelet {layout.paths[most[0]].entry}",
            valid=[f"at most {_MOST_LINKS} paths, SUMO's limit"],
            next_step="split the junction, or remove some of its lanelets from the file",
        )
    net = etree.tostring(_NetWriter(layout, speeds_mps, signals).net(), encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{net}\n'


class _NetWriter:
    """The elements of one network, in SUMO's order."""

    def __init__(self, layout: NetLayout, speeds_mps: Mapping[int, float], signals: "tuple[Signal, ...]") -> None:
        self._layout, self._lanes, self._speeds_mps = layout, layout.table.lanes, speeds_mps
        shapes = [_path_shape(layout, path) for path in layout.paths]
        self._links = {
            index: Link(path, shape, _direction_letter(shape))
            for index, (path, shape) in enumerate(zip(layout.paths, shapes, strict=True))
        }
        self._rules = {
            junction: _decide_right_of_way(layout, [self._links[index] for index in indices])
            for junction, indices in layout.links.items()
        }
        self._yielding = {
            index: bool(self._rules[junction].yields[order].any())
            for junction, indices in layout.links.items()
            for order, index in enumerate(indices)
        }
        self._signalling = _Signalling.of(signals, layout, self._links)

    def net(self) -> Element:
        """Return the root element."""
        net = etree.Element("net", version="1.20", junctionCornerDetail="5", limitTurnSpeed="-1")
        self._add_location(net)
        self._add_internal_edges(net)
        self._add_edges(net)
        self._signalling.add_programmes(net, self._yielding)
        self._add_junctions(net)
        self._add_connections(net)
        return net

    def _add_location(self, net: Element) -> None:
        points = np.concatenate([lane.center for lane in self._lanes.values()] or [np.zeros((1, 2))])
        low, high = points.min(axis=0), points.max(axis=0)
        box = f"{low[0]:.2f},{low[1]:.2f},{high[0]:.2f},{high[1]:.2f}"
        _add(net, "location", netOffset="0.00,0.00", convBoundary=box, origBoundary=box, projParameter="!")

    def _add_internal_edges(self, net: Element) -> None:
        for index, edge_id in self._layout.internal_edge_of_path.items():
            path, shape = self._layout.paths[index], self._links[index].shape
            width_m = self._lanes[path.through[0] if path.through else path.exit].width_m
            lane = _lane_attributes(f"{edge_id}_0", 0, self._speed_on(path, shape), length_m(shape), width_m, shape)
            etree.SubElement(_add(net, "edge", id=edge_id, function="internal"), "lane", lane)

    def _speed_on(self, path: JunctionPath, shape: Points) -> float:
        ends = self._speeds_mps[path.entry], self._speeds_mps[path.exit]
        if not path.through:
            return max(ends)
        inside = max(min(ends), *(self._speeds_mps[key] for key in path.through))
        return min(inside, curve_speed(shape, _PATH_SMOOTHING_M))

    def _add_edges(self, net: Element) -> None:
        for edge_id, keys in self._layout.edges.items():
            start, end = self._layout.ends[edge_id]
            lanes = [self._lanes[key] for key in keys]
            mean_length_m = float(np.mean([lane.length_m for lane in lanes]))
            edge = _add(net, "edge", {"id": edge_id, "from": start, "to": end, "priority": str(len(keys))})
            for index, lane in enumerate(lanes):
                speed_mps, name = self._speeds_mps[lane.lanelet_id], f"{edge_id}_{index}"
                _add(edge, "lane", _lane_attributes(name, index, speed_mps, mean_length_m, lane.width_m, lane.center))

    def _add_junctions(self, net: Element) -> None:
        layout, signalled = self._layout, self._signalling.junctions(self._layout)
        starts: dict[str, list[Points]] = {junction: [] for junction in layout.links}
        for edge, (start, _) in layout.ends.items():
            starts[start].append(self._lanes[layout.edges[edge][0]].center[0])
        for junction, indices in layout.links.items():
            incoming = layout.incoming_lanes[junction]
            ends = [self._lanes[layout.edges[edge][lane]].center[-1] for edge, lane in incoming] + starts[junction]
            corners = ends + [point for index in indices for point in self._links[index].shape[[0, -1]]]
            x, y = np.mean(ends, axis=0)
            element = _add(
                net,
                "junction",
                id=junction,
                type="traffic_light" if junction in signalled else "priority" if indices else "dead_end",
                x=f"{x:.2f}",
                y=f"{y:.2f}",
                incLanes=" ".join(f"{edge}_{lane}" for edge, lane in incoming),
                intLanes=" ".join(f"{layout.internal_edge_of_path[index]}_0" for index in indices),
                shape=_points(_hull(corners) if indices else np.array(ends[:1])),
            )
            rule = self._rules[junction]
            for index in range(len(indices)):
                response, foes = _bits(rule.yields[index]), _bits(rule.foes[index])
                _add(element, "request", index=str(index), response=response, foes=foes, cont="0")

    def _add_connections(self, net: Element) -> None:
        layout = self._layout
        for index in (index for indices in layout.links.values() for index in indices):
            path, via, turn = layout.paths[index], layout.internal_edge_of_path[index], self._links[index].direction
            (edge, lane), (next_edge, next_lane) = layout.lane_of[path.entry], layout.lane_of[path.exit]
            ends = {"from": edge, "to": next_edge, "fromLane": str(lane), "toLane": str(next_lane), "via": f"{via}_0"}
            state, light = "m" if self._yielding[index] else "M", {}
            if index in self._signalling.places:
                signal, place = self._signalling.places[index]
                state, light = (
                    state.replace("m", "o").replace("M", "O"),
                    {"tl": signal.program, "linkIndex": str(place)},
                )
            _add(net, "connection", {**ends, **light, "dir": turn, "state": state})
            behind = {"from": via, "to": next_edge, "fromLane": "0", "toLane": str(next_lane)}
            _add(net, "connection", {**behind, "dir": turn, "state": "M"})


def _add(parent: Element, tag: str, attributes: Mapping[str, str] | None = None, **more: str) -> Element:
    """Append an element on its own line."""
    parent.text = "\n"
    element = etree.SubElement(parent, tag, {**(attributes or {}), **more})
    element.tail = "\n"
    return element


def _lane_attributes(
    lane_id: str, index: int, speed_mps: float, lane_length_m: float, width_m: float, shape: Points
) -> dict[str, str]:
    return {
        "id": lane_id,
        "index": str(index),
        "speed": f"{speed_mps:.2f}",
        "length": f"{lane_length_m:.3f}",
        "width": f"{width_m:.2f}",
        "shape": _points(shape),
    }


def _points(shape: Points) -> str:
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in shape)


def _bits(row: "_Table") -> str:
    """Return the links as SUMO's bit string, in which the first link is the last bit."""
    return "".join("1" if value else "0" for value in row[::-1])


def _path_shape(layout: NetLayout, path: JunctionPath) -> Points:
    """Return the shape of a path from the end of the lane before it to the beginning of the lane after it."""
    lanes = layout.table.lanes
    entry, exit_ = lanes[path.entry].center, lanes[path.exit].center
    points = [entry[-1]]
    for candidate in [*(point for key in path.through for point in lanes[key].center), exit_[0]]:
        if float(np.linalg.norm(candidate - points[-1])) > 0.01:
            points.append(candidate)
    shape = np.array(points)
    if len(shape) < 2 or length_m(shape) < _SHORTEST_INTERNAL_LANE_M:
        step = entry[-1] - entry[-2]
        step = step / float(np.linalg.norm(step)) * _SHORTEST_INTERNAL_LANE_M
        shape = np.array([exit_[0] - step, exit_[0]])
    return shape


def _hull(points: list[Points]) -> Points:
    """Return the corners of the convex hull, counter-clockwise from the leftmost; at least one point."""
    from shapely import MultiPoint, get_coordinates

    corners: Points = get_coordinates(MultiPoint(np.round(points, 3)).convex_hull.normalize())
    return corners[:0:-1] if len(corners) > 2 else corners


_Table = NDArray[np.bool_]
_TURN_RANK = {"s": 0, "r": 0, "l": 1, "t": 2}
"""By SUMO's letter of the turn: of oncoming traffic, the higher rank yields."""
_TURN_AROUND_DEG, _STRAIGHT_DEG = 150.0, 25.0
"""Chosen: a path with a larger turn turns around; one with a smaller turn than the second leads straight on."""
_ONCOMING_COSINE = -0.7
"""Chosen: paths that begin at more than about 135° to each other are oncoming."""


@dataclass(frozen=True)
class Link:
    """A path through a junction with its shape (n, 2) in m and SUMO's direction letter."""

    path: JunctionPath
    shape: Points
    direction: str

    @cached_property
    def box(self) -> tuple[float, float, float, float]:
        """The smallest and largest coordinates of the shape: x, y, x, y in m."""
        low, high = self.shape.min(axis=0), self.shape.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def may_cross(self, other: "Link") -> bool:
        """Return whether the boxes around the two shapes overlap; otherwise the shapes cannot cross."""
        mine, theirs = self.box, other.box
        return mine[0] <= theirs[2] and theirs[0] <= mine[2] and mine[1] <= theirs[3] and theirs[1] <= mine[3]


@dataclass(frozen=True)
class _RightOfWay:
    """The right of way among the links of a junction: ``foes[i, j]``: they meet; ``yields[i, j]``: i gives way to j."""

    foes: _Table
    yields: _Table


def _direction_letter(shape: Points) -> str:
    """Return SUMO's direction letter for a path: s(traight), l(eft), r(ight) or t(urn around)."""
    first, last = shape[1] - shape[0], shape[-1] - shape[-2]
    turn = math.degrees(wrap_angle(math.atan2(last[1], last[0]) - math.atan2(first[1], first[0])))
    if abs(turn) > _TURN_AROUND_DEG:
        return "t"
    if abs(turn) < _STRAIGHT_DEG:
        return "s"
    return "l" if turn > 0 else "r"


def _decide_right_of_way(layout: NetLayout, links: list[Link]) -> _RightOfWay:
    """Return foes and priorities among the links of one junction."""
    count = len(links)
    foes, yields = np.zeros((count, count), dtype=bool), np.zeros((count, count), dtype=bool)
    for i in range(count):
        for j in range(i + 1, count):
            if _meet(layout, links[i], links[j]):
                foes[i, j] = foes[j, i] = True
                first_yields = _first_yields(links[i], links[j])
                yields[i, j], yields[j, i] = first_yields, not first_yields
    return _RightOfWay(foes, yields)


def _meet(layout: NetLayout, first: Link, second: Link) -> bool:
    """Return whether vehicles on two paths can conflict."""
    one, two = first.path, second.path
    if one.entry == two.entry:
        return False
    if one.exit == two.exit:
        return True
    if not (one.through and two.through):
        return False
    if set(one.through) & set(two.through):
        return True
    crossings = layout.interior.crossings
    if any(key in crossings.get(other, ()) for other in one.through for key in two.through):
        return True
    return first.may_cross(second) and crossing_of(first.shape, second.shape) is not None


def _first_yields(first: Link, second: Link) -> bool:
    """Return whether the first of two conflicting paths yields to the second.

    A path with lanelets of its own yields to a mere joint of two edges. Between parallel paths, the lanelets' ids
    decide.
    """
    if bool(first.path.through) != bool(second.path.through):
        return bool(first.path.through)
    one, two = first.shape[1] - first.shape[0], second.shape[1] - second.shape[0]
    cosine = float(one @ two) / (float(np.linalg.norm(one) * np.linalg.norm(two)) + 1e-9)
    ranks = _TURN_RANK[first.direction], _TURN_RANK[second.direction]
    if ranks[0] != ranks[1] and cosine < _ONCOMING_COSINE:
        return ranks[0] > ranks[1]
    comes_from_right = float(one[0] * two[1] - one[1] * two[0])
    if abs(comes_from_right) < 1e-6:
        return first.path.entry > second.path.entry
    return comes_from_right > 0


_LETTERS = {"red": "r", "yellow": "y", "redYellow": "u", "green": "G", "inactive": "O"}
"""SUMO's letter for the state of a link by CommonRoad's colour."""
_TURNS = {
    "left": "lt",
    "straight": "s",
    "right": "r",
    "leftStraight": "lts",
    "straightRight": "sr",
    "leftRight": "ltr",
    "all": "ltsr",
}
"""SUMO's direction letters that a light of CommonRoad's direction applies to."""
_ROUNDING_S = 1e-6
"""A phase that begins at a time includes it, regardless of rounding."""


@dataclass(frozen=True)
class Signal:
    """One traffic light: its phases as (seconds, SUMO's letter) from time step 0, and its lanelets.

    ``turns``: SUMO's direction letters that it applies to.
    """

    key: int
    phases: tuple[tuple[float, str], ...]
    lanelets: frozenset[int]
    turns: str

    @property
    def program(self) -> str:
        """The light's SUMO id."""
        return f"tl{self.key}"

    def letter_at(self, time_s: float) -> str:
        """Return SUMO's letter for the light's state at a time after time step 0."""
        left_s = (time_s + _ROUNDING_S) % sum(seconds for seconds, _ in self.phases)
        for seconds, letter in self.phases:
            if left_s < seconds:
                return letter
            left_s -= seconds
        return self.phases[-1][1]


@dataclass(frozen=True)
class _Signalling:
    """The light of each path in a junction: maps the path's index to the light and the position in its states."""

    signals: tuple[Signal, ...]
    places: Mapping[int, tuple[Signal, int]]

    @classmethod
    def of(cls, signals: tuple[Signal, ...], layout: NetLayout, links: Mapping[int, Link]) -> "_Signalling":
        """Assign every path its light: if there are several, the light for the fewest directions.

        A light inside a junction applies at the entry of its paths, because SUMO's vehicles stop only there.
        """
        standing: dict[int, list[Signal]] = {}
        for signal in signals:
            for key in signal.lanelets:
                standing.setdefault(key, []).append(signal)
        places: dict[int, tuple[Signal, int]] = {}
        taken: dict[int, int] = {}
        for index, path in enumerate(layout.paths):
            turn = links[index].direction if path.through else _direction_letter(layout.table.lanes[path.exit].center)
            at_each = (standing.get(key, ()) for key in (path.entry, *path.through))
            applying = ([signal for signal in there if turn in signal.turns] for there in at_each)
            holding = next(filter(None, applying), None)
            if holding:
                light = min(holding, key=lambda signal: (len(signal.turns), signal.key))
                places[index] = light, taken.get(light.key, 0)
                taken[light.key] = taken.get(light.key, 0) + 1
        return cls(tuple(signal for signal in signals if signal.key in taken), places)

    def junctions(self, layout: NetLayout) -> frozenset[str]:
        """Return junctions with at least one light."""
        return frozenset(
            junction for junction, paths in layout.links.items() if any(path in self.places for path in paths)
        )

    def add_programmes(self, net: Element, yielding: Mapping[int, bool]) -> None:
        """Append the ``tlLogic`` elements; a path that yields to others gets SUMO's yielding green."""
        paths_of: dict[int, list[tuple[int, int]]] = {}
        for path, (signal, place) in self.places.items():
            paths_of.setdefault(signal.key, []).append((place, path))
        for light in self.signals:
            paths = sorted(paths_of[light.key])
            logic = _add(net, "tlLogic", id=light.program, type="static", programID="0", offset="0")
            for seconds, letter in light.phases:
                states = "".join("g" if letter == "G" and yielding[path] else letter for _, path in paths)
                _add(logic, "phase", duration=f"{seconds:g}", state=states)


def signals_of(network: "LaneletNetwork", step_s: float, first_step: int = 0) -> tuple[Signal, ...]:
    """Return the working lights of a lanelet network that belong to a lanelet and have a cycle, by ascending id.

    ``first_step``: the time step at which their phases begin, for a simulation that starts at that step.
    """
    places: dict[int, set[int]] = {}
    for lanelet in network.lanelets:
        for key in lanelet.traffic_lights or ():
            places.setdefault(int(key), set()).add(int(lanelet.lanelet_id))
    working = [
        (light, _phases(light, step_s, first_step))
        for light in network.traffic_lights
        if light.traffic_light_id in places
    ]
    return tuple(
        Signal(
            int(light.traffic_light_id),
            phases,
            frozenset(places[light.traffic_light_id]),
            _TURNS[str(light.direction.value)],
        )
        for light, phases in sorted(working, key=lambda entry: int(entry[0].traffic_light_id))
        if phases
    )


def _phases(light: "TrafficLight", step_s: float, first_step: int) -> tuple[tuple[float, str], ...]:
    """Return the cycle starting at a time step, which may be inside one of the cycle's elements."""
    cycle = light.traffic_light_cycle
    elements = [phase for phase in (cycle.cycle_elements or ()) if phase.duration > 0] if cycle and light.active else []
    if not elements:
        return ()
    phases = [(int(phase.duration), _LETTERS[str(phase.state.value)]) for phase in elements]
    passed = (first_step - int(cycle.time_offset)) % sum(steps for steps, _ in phases)
    while passed >= phases[0][0]:
        passed -= phases[0][0]
        phases.append(phases.pop(0))
    first, letter = phases[0]
    begun = [(first - passed, letter), *phases[1:], *([(passed, letter)] if passed else [])]
    return tuple((steps * step_s, state) for steps, state in begun)
