"""Writes a SUMO network straight from a lanelet network, lanelet centre lines being the shapes of the lanes.

Nothing passes through netconvert, which would move 99.9 % of the lanes by more than half a metre and refuse loops.
Format: SUMO network file, version 1.20 (https://sumo.dlr.de/docs/Networks/SUMO_Road_Networks.html).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from plannerforge.engine.geometry.polyline import Points, length_m
from plannerforge.engine.network.sumo_net_junctions import JunctionPath
from plannerforge.engine.network.sumo_net_layout import NetLayout
from plannerforge.engine.network.sumo_net_right_of_way import Link, RightOfWay, decide_right_of_way, direction_letter
from plannerforge.engine.network.sumo_net_signals import Signal, Signalling
from plannerforge.engine.network.sumo_net_speeds import bend_speed, lane_speeds

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

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
        index: Link(way, shape, direction_letter(shape))
        for index, way in enumerate(layout.paths)
        for shape in (_path_shape(layout, way),)
    }
    rules = {
        junction: decide_right_of_way(layout, [links[index] for index in indices])
        for junction, indices in layout.links.items()
    }
    yielding = {
        index: bool(rules[junction].yields[order].any())
        for junction, indices in layout.links.items()
        for order, index in enumerate(indices)
    }
    signalling = Signalling.of(signals, layout, links)
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
    return min(max(min(ends), *(speeds_mps[key] for key in path.through)), bend_speed(shape, 3.0))


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
    layout: NetLayout, links: Mapping[int, Link], rules: Mapping[str, RightOfWay], signalled: frozenset[str]
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


def _requests(rule: RightOfWay) -> list[str]:
    """SUMO's bit strings, the first link being the last bit."""
    return [
        f'<request index="{index}" response="{_bits(rule.yields[index])}" foes="{_bits(rule.foes[index])}" cont="0"/>'
        for index in range(len(rule.foes))
    ]


def _bits(row: "np.ndarray[tuple[int, ...], np.dtype[np.bool_]]") -> str:
    return "".join("1" if value else "0" for value in row[::-1])


def _connections(
    layout: NetLayout, links: Mapping[int, Link], yielding: Mapping[int, bool], signalling: Signalling
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
