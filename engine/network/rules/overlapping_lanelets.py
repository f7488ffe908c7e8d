"""Two lanelets lie on top of each other."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from plannerforge.engine.geometry.polyline import length_m
from plannerforge.engine.network.road_document import LaneletElement, RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

LARGEST_SHARE = 0.9
SHORTEST_M = 2.0
"""Shorter pieces inside a junction lie within their neighbours by nature."""


def _find(document: RoadDocument) -> Iterator[Defect]:
    from shapely import area, intersection

    lanelets = [lanelet for lanelet in document.drawn if length_m(lanelet.center) >= SHORTEST_M]
    areas = np.array([lanelet.polygon for lanelet in lanelets])
    pairs = _unrelated_pairs(lanelets, areas)
    if not len(pairs):
        return
    first, second = areas[pairs[:, 0]], areas[pairs[:, 1]]
    shared = intersection(first, second)
    shares = area(shared) / np.maximum(np.minimum(area(first), area(second)), 1e-9)
    for index in np.flatnonzero(shares > LARGEST_SHARE):
        one, other = (lanelets[number].lanelet_id for number in pairs[index])
        place = shared[index].centroid
        message = f"{shares[index]:.0%} of the smaller one lies on lanelet {other}"
        yield Defect(message, (one, other), np.array([place.x, place.y]))


def _unrelated_pairs(lanelets: list[LaneletElement], areas: NDArray[np.object_]) -> NDArray[np.int64]:
    """Numbers of the lanelets (n, 2) that meet, lead the same way and do not belong together."""
    from shapely import STRtree

    first, second = STRtree(areas).query(areas, predicate="intersects")
    found = [
        (i, j)
        for i, j in sorted(zip(first.tolist(), second.tolist(), strict=True))
        if i < j and not _belong_together(lanelets[i], lanelets[j]) and _same_way(lanelets[i], lanelets[j])
    ]
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _belong_together(one: LaneletElement, other: LaneletElement) -> bool:
    """Whether both begin or end at one lanelet (a fork, a merge), or one follows the other."""
    fork = set(one.predecessors) & set(other.predecessors) or set(one.successors) & set(other.successors)
    in_line = other.lanelet_id in one.successors + one.predecessors
    return bool(fork) or in_line


def _same_way(one: LaneletElement, other: LaneletElement) -> bool:
    ahead, ahead_there = (lanelet.center[-1] - lanelet.center[0] for lanelet in (one, other))
    return float(ahead @ ahead_there) > 0.7 * float(np.linalg.norm(ahead) * np.linalg.norm(ahead_there))


RULE = Rule(
    rule_id="overlapping_lanelets",
    severity="warning",
    meaning="Two lanelets of one direction that neither begin nor end together cover each other by nine tenths.",
    why="A position belongs to both; which one a vehicle is on, and what traffic it meets there, is chance.",
    find=_find,
)
