"""Writes a SUMO network straight from a lanelet network, lanelet centre lines being the shapes of the lanes.

Nothing passes through netconvert, which would move 99.9 % of the lanes by more than half a metre and refuse loops.
Format: SUMO network file, version 1.20 (https://sumo.dlr.de/docs/Networks/SUMO_Road_Networks.html).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from ...geometry import Points, length_m, wrap_angle
from .layout import JunctionPath, NetLayout, crossing_of
from .speeds import curve_speed, lane_speeds

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork
    from commonroad.scenario.traffic_light import TrafficLight

# ---------- sumo_net_right_of_way
# Who yields to whom where ways through a junction meet: turn rule for oncoming traffic, else right before left.

Table = NDArray[np.bool_]
_TURN_RANK = {"s": 0, "r": 0, "l": 1, "t": 2}
ONCOMING_COSINE = -0.7


@dataclass(frozen=True)
class Link:
    """A way through a junction with its shape (n, 2) in m and SUMO's direction letter."""

    path: JunctionPath
    shape: Points
    direction: str

    @cached_property
    def box(self) -> tuple[float, float, float, float]:
        """Least and greatest coordinates of the shape: x, y, x, y in m."""
        low, high = self.shape.min(axis=0), self.shape.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def may_cross(self, other: "Link") -> bool:
        """Whether the boxes around both shapes overlap, without which the shapes cannot cross."""
        mine, theirs = self.box, other.box
        return mine[0] <= theirs[2] and theirs[0] <= mine[2] and mine[1] <= theirs[3] and theirs[1] <= mine[3]


@dataclass(frozen=True)
class _RightOfWay:
    """For the links of one junction: ``foes`` meet (symmetric), ``yields[i, j]``: link i lets link j go first."""

    foes: Table
    yields: Table


def _direction_letter(shape: Points) -> str:
    """SUMO's letter for the turn along a way: s(traight), l(eft), r(ight) or t(urn around)."""
    first, last = shape[1] - shape[0], shape[-1] - shape[-2]
    turn = math.degrees(wrap_angle(math.atan2(last[1], last[0]) - math.atan2(first[1], first[0])))
    if abs(turn) > 150:
        return "t"
    if abs(turn) < 25:
        return "s"
    return "l" if turn > 0 else "r"


def _decide_right_of_way(layout: NetLayout, links: list[Link]) -> _RightOfWay:
    """Foes and priorities among the links of one junction."""
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
    if bool(first.path.through) != bool(second.path.through):
        return bool(first.path.through)
    one, two = first.shape[1] - first.shape[0], second.shape[1] - second.shape[0]
    cosine = float(one @ two) / (float(np.linalg.norm(one) * np.linalg.norm(two)) + 1e-9)
    ranks = _TURN_RANK[first.direction], _TURN_RANK[second.direction]
    if ranks[0] != ranks[1] and cosine < ONCOMING_COSINE:
        return ranks[0] > ranks[1]
    comes_from_right = float(one[0] * two[1] - one[1] * two[0])
    if abs(comes_from_right) < 1e-6:
        return first.path.entry > second.path.entry
    return comes_from_right > 0


# ---------- sumo_net_signals
# Traffic lights of a lanelet network as programs of a SUMO network.
#
# A light of a lanelet holds for the ways that leave it in the light's directions. Format: ``tlLogic`` elements
# (https://sumo.dlr.de/docs/Simulation/Traffic_Lights.html), with the phase of time step 0 first and no offset.

_LETTERS = {"red": "r", "yellow": "y", "redYellow": "u", "green": "G", "inactive": "O"}
_TURNS = {
    "left": "lt",
    "straight": "s",
    "right": "r",
    "leftStraight": "lts",
    "straightRight": "sr",
    "leftRight": "ltr",
    "all": "ltsr",
}
ROUNDING_S = 1e-6
"""A phase that begins at a time holds at it, however times and durations are rounded."""


@dataclass(frozen=True)
class Signal:
    """One traffic light: its phases as (seconds, SUMO's letter) from time step 0 on, and the lanelets it stands at.

    ``turns``: SUMO's direction letters that it holds for.
    """

    key: int
    phases: tuple[tuple[float, str], ...]
    lanelets: frozenset[int]
    turns: str

    @property
    def program(self) -> str:
        """SUMO's id of the light."""
        return f"tl{self.key}"

    def letter_at(self, time_s: float) -> str:
        """SUMO's letter of the phase at a time after time step 0."""
        left_s = (time_s + ROUNDING_S) % sum(seconds for seconds, _ in self.phases)
        for seconds, letter in self.phases:
            if left_s < seconds:
                return letter
            left_s -= seconds
        return self.phases[-1][1]


@dataclass(frozen=True)
class _Signalling:
    """Which way through a junction obeys which light: index of the way → (light, place in the light's states)."""

    signals: tuple[Signal, ...]
    places: Mapping[int, tuple[Signal, int]]

    @classmethod
    def of(cls, signals: tuple[Signal, ...], layout: NetLayout, links: Mapping[int, Link]) -> "_Signalling":
        """Give every way its light: where several hold, the one for the fewest directions."""
        places: dict[int, tuple[Signal, int]] = {}
        taken: dict[int, int] = {}
        for index, path in enumerate(layout.paths):
            turn = links[index].direction if path.through else _direction_letter(layout.table.lanes[path.exit].center)
            holding = [one for one in signals if path.entry in one.lanelets and turn in one.turns]
            if holding:
                light = min(holding, key=lambda one: (len(one.turns), one.key))
                places[index] = light, taken.get(light.key, 0)
                taken[light.key] = taken.get(light.key, 0) + 1
        return cls(tuple(one for one in signals if one.key in taken), places)

    def junctions(self, layout: NetLayout) -> frozenset[str]:
        """Junctions with at least one light."""
        return frozenset(junction for junction, ways in layout.links.items() if any(way in self.places for way in ways))

    def elements(self, yielding: Mapping[int, bool]) -> list[str]:
        """The ``tlLogic`` elements; a way that yields to others has a green that says so."""
        lines = []
        for light in self.signals:
            ways = sorted((place, way) for way, (signal, place) in self.places.items() if signal.key == light.key)
            lines.append(f'<tlLogic id="{light.program}" type="static" programID="0" offset="0">')
            for seconds, letter in light.phases:
                states = "".join("g" if letter == "G" and yielding[way] else letter for _, way in ways)
                lines.append(f'<phase duration="{seconds:g}" state="{states}"/>')
            lines.append("</tlLogic>")
        return lines


def signals_of(network: "LaneletNetwork", step_s: float) -> tuple[Signal, ...]:
    """The working lights of a lanelet network that stand at a lanelet and have a cycle, by ascending id."""
    places: dict[int, set[int]] = {}
    for lanelet in network.lanelets:
        for key in lanelet.traffic_lights or ():
            places.setdefault(int(key), set()).add(int(lanelet.lanelet_id))
    found = [(light, _phases(light, step_s)) for light in network.traffic_lights if light.traffic_light_id in places]
    return tuple(
        Signal(
            int(light.traffic_light_id),
            phases,
            frozenset(places[light.traffic_light_id]),
            _TURNS[str(light.direction.value)],
        )
        for light, phases in sorted(found, key=lambda one: int(one[0].traffic_light_id))
        if phases
    )


def _phases(light: "TrafficLight", step_s: float) -> tuple[tuple[float, str], ...]:
    """The cycle begun at time step 0, which may lie inside one of its elements."""
    cycle = light.traffic_light_cycle
    elements = [one for one in (cycle.cycle_elements or ()) if one.duration > 0] if cycle and light.active else []
    if not elements:
        return ()
    phases = [(int(one.duration), _LETTERS[str(one.state.value)]) for one in elements]
    passed = -int(cycle.time_offset) % sum(steps for steps, _ in phases)
    while passed >= phases[0][0]:
        passed -= phases[0][0]
        phases.append(phases.pop(0))
    first, letter = phases[0]
    begun = [(first - passed, letter), *phases[1:], *([(passed, letter)] if passed else [])]
    return tuple((steps * step_s, state) for steps, state in begun)


# ---------- sumo_net_writer
# Writes a SUMO network straight from a lanelet network, lanelet centre lines being the shapes of the lanes.
#
# Nothing passes through netconvert, which would move 99.9 % of the lanes by more than half a metre and refuse loops.
# Format: SUMO network file, version 1.20 (https://sumo.dlr.de/docs/Networks/SUMO_Road_Networks.html).

SHORTEST_INTERNAL_LANE_M = 0.12


def write_network(network: "LaneletNetwork", path: Path) -> NetLayout:
    """Lay out and write a lanelet network with usual speeds; the layout maps lanelets to edges and lanes."""
    layout = NetLayout.of(network)
    write_sumo_net(layout, lane_speeds(layout, {}), path)
    return layout


def write_sumo_net(
    layout: NetLayout, speeds_mps: Mapping[int, float], path: Path, signals: tuple[Signal, ...] = ()
) -> None:
    """Write the ``.net.xml`` of a layout with its traffic lights."""
    path.write_text(sumo_net(layout, speeds_mps, signals), encoding="utf-8")


def sumo_net(layout: NetLayout, speeds_mps: Mapping[int, float], signals: tuple[Signal, ...] = ()) -> str:
    """The text of a ``.net.xml``; the same input gives the same text."""
    links = {
        index: Link(way, shape, _direction_letter(shape))
        for index, way in enumerate(layout.paths)
        for shape in (_path_shape(layout, way),)
    }
    rules = {
        junction: _decide_right_of_way(layout, [links[index] for index in indices])
        for junction, indices in layout.links.items()
    }
    yielding = {
        index: bool(rules[junction].yields[order].any())
        for junction, indices in layout.links.items()
        for order, index in enumerate(indices)
    }
    signalling = _Signalling.of(signals, layout, links)
    lines = ['<?xml version="1.0" encoding="UTF-8"?>']
    lines.append('<net version="1.20" junctionCornerDetail="5" limitTurnSpeed="-1">')
    lines.append(_location(layout))
    lines += _internal_edges(layout, links, speeds_mps)
    lines += _edges(layout, speeds_mps)
    lines += signalling.elements(yielding)
    lines += _junctions(layout, links, rules, signalling.junctions(layout))
    lines += _connections(layout, links, yielding, signalling)
    lines.append("</net>\n")
    return "\n".join(lines)


def _path_shape(layout: NetLayout, path: JunctionPath) -> Points:
    """From the end of the lane that is left to the beginning of the one that is entered."""
    lanes = layout.table.lanes
    entry, exit_ = lanes[path.entry].center, lanes[path.exit].center
    points = [entry[-1]]
    for candidate in [*(point for key in path.through for point in lanes[key].center), exit_[0]]:
        if float(np.linalg.norm(candidate - points[-1])) > 0.01:
            points.append(candidate)
    shape = np.array(points)
    if len(shape) < 2 or length_m(shape) < SHORTEST_INTERNAL_LANE_M:
        step = entry[-1] - entry[-2]
        step = step / float(np.linalg.norm(step)) * SHORTEST_INTERNAL_LANE_M
        shape = np.array([exit_[0] - step, exit_[0]])
    return shape


def _path_speed(path: JunctionPath, shape: Points, speeds_mps: Mapping[int, float]) -> float:
    ends = speeds_mps[path.entry], speeds_mps[path.exit]
    if not path.through:
        return max(ends)
    return min(max(min(ends), *(speeds_mps[key] for key in path.through)), curve_speed(shape, 3.0))


def _location(layout: NetLayout) -> str:
    points = np.concatenate([lane.center for lane in layout.table.lanes.values()] or [np.zeros((1, 2))])
    low, high = points.min(axis=0), points.max(axis=0)
    box = f"{low[0]:.2f},{low[1]:.2f},{high[0]:.2f},{high[1]:.2f}"
    return f'<location netOffset="0.00,0.00" convBoundary="{box}" origBoundary="{box}" projParameter="!"/>'


def _lane(lane_id: str, index: int, speed_mps: float, lane_length_m: float, width_m: float, shape: Points) -> str:
    return (
        f"<lane id={quoteattr(lane_id)} index={quoteattr(str(index))} speed={quoteattr(f'{speed_mps:.2f}')} "
        f"length={quoteattr(f'{lane_length_m:.3f}')} width={quoteattr(f'{width_m:.2f}')} "
        f"shape={quoteattr(_points(shape))}/>"
    )


def _points(shape: Points) -> str:
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in shape)


def _internal_edges(layout: NetLayout, links: Mapping[int, Link], speeds_mps: Mapping[int, float]) -> list[str]:
    lines = []
    for index, edge in layout.internal_edge_of_path.items():
        path, shape = layout.paths[index], links[index].shape
        width = layout.table.lanes[path.through[0] if path.through else path.exit].width_m
        lane = _lane(f"{edge}_0", 0, _path_speed(path, shape, speeds_mps), length_m(shape), width, shape)
        lines.append(f'<edge id="{edge}" function="internal">{lane}</edge>')
    return lines


def _edges(layout: NetLayout, speeds_mps: Mapping[int, float]) -> list[str]:
    lines = []
    for edge, keys in layout.edges.items():
        start, end = layout.ends[edge]
        lanes = [layout.table.lanes[key] for key in keys]
        mean_length = float(np.mean([lane.length_m for lane in lanes]))
        lines.append(f'<edge id="{edge}" from="{start}" to="{end}" priority="{len(keys)}">')
        for index, lane in enumerate(lanes):
            speed = speeds_mps[lane.lanelet_id]
            lines.append(_lane(f"{edge}_{index}", index, speed, mean_length, lane.width_m, lane.center))
        lines.append("</edge>")
    return lines


def _junctions(
    layout: NetLayout, links: Mapping[int, Link], rules: Mapping[str, _RightOfWay], signalled: frozenset[str]
) -> list[str]:
    starts: dict[str, list[Points]] = {junction: [] for junction in layout.links}
    for edge, (start, _) in layout.ends.items():
        starts[start].append(layout.table.lanes[layout.edges[edge][0]].center[0])
    lines = []
    for junction, indices in layout.links.items():
        incoming = layout.incoming_lanes[junction]
        ends = [layout.table.lanes[layout.edges[edge][lane]].center[-1] for edge, lane in incoming] + starts[junction]
        corners = ends + [point for index in indices for point in links[index].shape[[0, -1]]]
        center = np.mean(ends, axis=0)
        internal = " ".join(f"{layout.internal_edge_of_path[index]}_0" for index in indices)
        kind = "traffic_light" if junction in signalled else "priority" if indices else "dead_end"
        head = (
            f'<junction id="{junction}" type="{kind}" x="{center[0]:.2f}" '
            f'y="{center[1]:.2f}" incLanes="{" ".join(f"{edge}_{lane}" for edge, lane in incoming)}" '
            f'intLanes="{internal}" shape="{_points(_hull(corners) if indices else np.array(ends[:1]))}"'
        )
        if not indices:
            lines.append(f"{head}/>")
            continue
        lines += [f"{head}>", *_requests(rules[junction]), "</junction>"]
    return lines


def _requests(rule: _RightOfWay) -> list[str]:
    """SUMO's bit strings, the first link being the last bit."""
    return [
        f'<request index="{index}" response="{_bits(rule.yields[index])}" foes="{_bits(rule.foes[index])}" cont="0"/>'
        for index in range(len(rule.foes))
    ]


def _bits(row: "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]") -> str:
    return "".join("1" if value else "0" for value in row[::-1])


def _connections(
    layout: NetLayout, links: Mapping[int, Link], yielding: Mapping[int, bool], signalling: _Signalling
) -> list[str]:
    lines = []
    for indices in layout.links.values():
        for index in indices:
            path, via = layout.paths[index], layout.internal_edge_of_path[index]
            (edge, lane), (next_edge, next_lane) = layout.lane_of[path.entry], layout.lane_of[path.exit]
            turn, state, light = links[index].direction, "m" if yielding[index] else "M", ""
            if index in signalling.places:
                signal, place = signalling.places[index]
                state, light = "o" if yielding[index] else "O", f'tl="{signal.program}" linkIndex="{place}" '
            lines.append(
                f'<connection from="{edge}" to="{next_edge}" fromLane="{lane}" toLane="{next_lane}" '
                f'via="{via}_0" {light}dir="{turn}" state="{state}"/>'
            )
            lines.append(
                f'<connection from="{via}" to="{next_edge}" fromLane="0" toLane="{next_lane}" dir="{turn}" state="M"/>'
            )
    return lines


def _hull(points: list[Points]) -> Points:
    """Convex hull by monotone chain; fewer than three points are given back as they are."""
    unique: Points = np.unique(np.round(np.array(points, dtype=np.float64), 3), axis=0)
    if len(unique) < 3:
        return unique
    ordered = unique[np.lexsort((unique[:, 1], unique[:, 0]))]
    return np.array(_half_hull(ordered)[:-1] + _half_hull(ordered[::-1])[:-1])


def _half_hull(ordered: Points) -> list[Points]:
    chain: list[Points] = []
    for point in ordered:
        while len(chain) > 1 and _turns_right(chain[-2], chain[-1], point):
            chain.pop()
        chain.append(point)
    return chain


def _turns_right(first: Points, second: Points, third: Points) -> bool:
    one, two = second - first, third - second
    return bool(one[0] * two[1] - one[1] * two[0] <= 0)
