"""Speed limit signs and traffic lights of a SUMO net, attached to lanelets."""

from collections.abc import Sequence

from plannerforge.engine.network.net_parser import SignalProgram, SumoNet
from plannerforge.engine.network.road_network import RoadLanelet, SpeedSign, TrafficLight

COLOURS = {"r": "red", "R": "red", "y": "yellow", "Y": "yellow", "g": "green", "G": "green", "s": "green"}
COLOURS |= {"u": "redYellow", "o": "inactive", "O": "inactive"}
TURNS = {"l": "l", "L": "l", "t": "l", "r": "r", "R": "r"}
DIRECTIONS = {
    "l": "left",
    "r": "right",
    "s": "straight",
    "ls": "leftStraight",
    "rs": "straightRight",
    "lr": "leftRight",
}


def speed_signs(net: SumoNet, lanelets: dict[int, RoadLanelet], first_id: int) -> tuple[SpeedSign, ...]:
    """One sign for every normal edge, with its lanes' limit in m/s, at the right of its beginning."""
    by_lane = {lanelet.lane_id: lanelet for lanelet in lanelets.values()}
    found: list[SpeedSign] = []
    for edge in net.edges.values():
        beside = [by_lane[key] for key in edge.lane_ids if key in by_lane]
        if edge.internal or not beside:
            continue
        position = beside[0].left[0] if net.lefthand else beside[0].right[0]
        numbers = tuple(lanelet.lanelet_id for lanelet in beside)
        found.append(SpeedSign(first_id + len(found), beside[0].speed_mps, position, numbers))
    return tuple(found)


def traffic_lights(
    net: SumoNet, lanelets: dict[int, RoadLanelet], first_id: int, *, step_s: float, elapsed_s: float
) -> tuple[TrafficLight, ...]:
    """A light for every lane and group of directions that are switched alike.

    CommonRoad's state at step k is that of SUMO at ``elapsed_s + k · step_s`` (one step off at a phase's change).
    """
    by_lane = {lanelet.lane_id: lanelet for lanelet in lanelets.values()}
    links: dict[tuple[str, str], list[tuple[int, str]]] = {}
    for connection in net.connections:
        known = connection.signal in net.signals and connection.from_lane in by_lane
        if known and connection.signal is not None and not connection.from_edge.startswith(":"):
            turn = TURNS.get(connection.direction, "s")
            links.setdefault((connection.from_lane, connection.signal), []).append((connection.link, turn))
    found: list[TrafficLight] = []
    for (lane_id, signal), turns in links.items():
        cycles = _cycles(net.signals[signal], turns, step_s)
        for cycle, directions in cycles.items():
            lanelet = by_lane[lane_id]
            total = sum(steps for steps, _ in cycle)
            offset = round((net.signals[signal].offset_s - elapsed_s) / step_s) % total
            one_for_all = len(cycles) == 1
            direction = "all" if one_for_all else DIRECTIONS.get("".join(sorted(directions)), "all")
            found.append(
                TrafficLight(
                    light_id=first_id + len(found),
                    lanelet_id=lanelet.lanelet_id,
                    position=lanelet.right[-1],
                    cycle=cycle,
                    offset_steps=offset,
                    direction=direction,
                )
            )
    return tuple(found)


def _cycles(
    program: SignalProgram, turns: Sequence[tuple[int, str]], step_s: float
) -> dict[tuple[tuple[int, str], ...], set[str]]:
    """The different colour sequences of a lane's links, and the turns that each holds for."""
    found: dict[tuple[tuple[int, str], ...], set[str]] = {}
    for link, turn in turns:
        merged: list[tuple[int, str]] = []
        for duration_s, state in program.phases:
            colour = COLOURS.get(state[link], "inactive")
            steps = max(round(duration_s / step_s), 1)
            if merged and merged[-1][1] == colour:
                merged[-1] = (merged[-1][0] + steps, colour)
            else:
                merged.append((steps, colour))
        found.setdefault(tuple(merged), set()).add(turn)
    return found
