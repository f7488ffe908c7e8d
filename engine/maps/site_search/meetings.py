"""Finds where streets meet without sharing a junction: across a short road that connects them.

A street may reach another one only by a slip road, by a stub without a name, or by a name's last metres, which another
street already has. Maps also split one junction into several nodes, for example if a carriageway forks before it.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from itertools import pairwise

from ..osm import OsmMap, OsmWay, ground_distance_m
from ..road_classes import LINKS
from .rings import RING_TAGS


@dataclass(frozen=True)
class Meeting:
    """A place where streets meet: the nodes on the way from one to the other, and the roads at these nodes."""

    nodes: tuple[int, ...]
    roads: tuple[OsmWay, ...]


def meetings_of(
    osm: OsmMap,
    roads: Iterable[OsmWay],
    one: Callable[[OsmWay], bool],
    other: Callable[[OsmWay], bool],
    within_m: float,
) -> list[Meeting]:
    """Return where the roads of one street meet those of another one, the nearest first.

    The way between them is at most ``within_m`` long and uses only links, rings and roads without a name: a named road
    that crosses both is a street of its own.
    """
    at: dict[int, list[OsmWay]] = {}
    for road in roads:
        for key in dict.fromkeys(road.node_ids):
            at.setdefault(key, []).append(road)
    starts = [key for key, ways in at.items() if any(map(one, ways))]
    ends = {key for key, ways in at.items() if any(map(other, ways))}
    return [Meeting(path, _roads_at(path, at)) for path in _paths(osm, at, starts, ends, within_m)]


def _paths(
    osm: OsmMap, at: Mapping[int, Sequence[OsmWay]], starts: Sequence[int], ends: set[int], within_m: float
) -> list[tuple[int, ...]]:
    """Return the shortest path to each of the ends that can be reached, in the order of their lengths."""
    waiting: list[tuple[float, int, tuple[int, ...]]] = [(0.0, key, (key,)) for key in starts]
    heapify(waiting)
    seen: set[int] = set()
    paths: list[tuple[int, ...]] = []
    while waiting:
        gone_m, key, path = heappop(waiting)
        if key in seen:
            continue
        seen.add(key)
        if key in ends:
            paths.append(path)
            continue
        for way in at[key]:
            if not _connects(way):
                continue
            for before, after in pairwise(way.node_ids):
                if key not in (before, after):
                    continue
                onward = after if key == before else before
                further_m = gone_m + ground_distance_m(osm.nodes[key].position, osm.nodes[onward].position)
                if onward not in seen and further_m <= within_m:
                    heappush(waiting, (further_m, onward, (*path, onward)))
    return paths


def _connects(way: OsmWay) -> bool:
    """Return whether a road may connect two streets without being a street of its own."""
    return way.road_class in LINKS or "name" not in way.tags or way.tags.get("junction") in RING_TAGS


def _roads_at(path: Sequence[int], at: Mapping[int, Sequence[OsmWay]]) -> tuple[OsmWay, ...]:
    found = {way.way_id: way for key in path for way in at[key]}
    return tuple(found.values())
