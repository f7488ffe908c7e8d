"""Intersections of a road network: junctions with a choice, their arms and where each arm leads."""

from dataclasses import dataclass, field

from plannerforge.engine.network.net_parser import SumoNet
from plannerforge.engine.network.road_network import Incoming, Intersection

SIDES = {"r": "right", "R": "right", "l": "left", "L": "left", "t": "left"}


@dataclass
class _Arm:
    lanelets: set[int] = field(default_factory=set)
    behind: dict[str, set[int]] = field(default_factory=lambda: {"right": set(), "straight": set(), "left": set()})


def find_intersections(net: SumoNet, ids: dict[str, int], first_id: int) -> tuple[Intersection, ...]:
    """Junctions with at least two arms in and two out, three on one side; ``ids``: lanelet id by SUMO lane."""
    arms: dict[str, dict[str, _Arm]] = {}
    exits: dict[str, set[str]] = {}
    for connection in net.connections:
        if connection.from_edge.startswith(":"):
            continue
        junction = net.edges[connection.from_edge].to_junction
        exits.setdefault(junction, set()).add(connection.to_edge)
        if connection.from_lane in ids and connection.via in ids:
            arm = arms.setdefault(junction, {}).setdefault(connection.from_edge, _Arm())
            arm.lanelets.add(ids[connection.from_lane])
            arm.behind[SIDES.get(connection.direction, "straight")].add(ids[connection.via])
    found: list[Intersection] = []
    for junction, by_edge in arms.items():
        ways_in, ways_out = len(by_edge), len(exits[junction])
        if min(ways_in, ways_out) < 2 or max(ways_in, ways_out) < 3:
            continue
        incomings = tuple(_incoming(first_id + 1 + i, arm) for i, arm in enumerate(by_edge.values()))
        found.append(Intersection(first_id, incomings))
        first_id += 1 + len(incomings)
    return tuple(found)


def _incoming(incoming_id: int, arm: _Arm) -> Incoming:
    return Incoming(
        incoming_id=incoming_id,
        lanelet_ids=tuple(sorted(arm.lanelets)),
        right=tuple(sorted(arm.behind["right"])),
        straight=tuple(sorted(arm.behind["straight"])),
        left=tuple(sorted(arm.behind["left"])),
    )
