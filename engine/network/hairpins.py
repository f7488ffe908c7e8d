"""Connections so tight that no lanelet can follow them are taken out of the net too, so that both stay the same."""

from pathlib import Path

from plannerforge.engine.network.lanelet_builder import build_road_network
from plannerforge.engine.network.net_parser import Connection, SumoNet, read_net
from plannerforge.engine.network.netconvert import remove_connections
from plannerforge.engine.network.road_network import RoadNetwork

MAXIMUM_ROUNDS = 3


def remove_hairpins(net_path: Path, scratch: Path) -> tuple[int, tuple[str, ...]]:
    """Delete the connections of all lanes without a valid ribbon, in place; how many, and what netconvert warned of."""
    removed = 0
    warnings: list[str] = []
    for _ in range(MAXIMUM_ROUNDS):
        net = read_net(net_path)
        network = build_road_network(net, step_s=0.1, elapsed_s=0.0)
        connections = _owners(net, network)
        if not connections:
            break
        removed += len(connections)
        warnings += remove_connections(net_path, connections, scratch).warnings
    return removed, tuple(warnings)


def _owners(net: SumoNet, network: RoadNetwork) -> list[tuple[str, str, int, int]]:
    """The connections between normal edges whose internal lanes were dropped, in order."""
    following = {c.from_lane: c.via for c in net.connections if c.from_edge.startswith(":") and c.via is not None}
    owner: dict[str, Connection] = {}
    for connection in net.connections:
        inside = None if connection.from_edge.startswith(":") else connection.via
        while inside is not None:
            owner[inside] = connection
            inside = following.get(inside)
    found = {owner[lane] for lane in network.dropped_lanes if lane in owner}
    keys = [(c.from_edge, c.to_edge, _index(c.from_lane), _index(c.to_lane)) for c in found]
    return sorted(keys)


def _index(lane_id: str) -> int:
    return int(lane_id.rsplit("_", 1)[1])
