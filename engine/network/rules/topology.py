"""Rules on the connections of lanelets: succession, adjacency, and overlap."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ...commonroad import LaneletElement, RoadDocument
from ...geometry import headings, length_m, meeting_pairs, wrap_angle
from .rule import Defect, rule


@rule("error", why="Routes end nowhere, or the reader silently drops the connection.")
def unknown_successor(document: RoadDocument) -> Iterator[Defect]:
    """A predecessor or successor is not in the file."""
    known = document.by_id.keys()
    for lanelet in document.lanelets:
        for role, keys in (("successor", lanelet.successors), ("predecessor", lanelet.predecessors)):
            for key in sorted(key for key in set(keys) if key not in known):
                yield Defect(f"{role} {key} is not in the file", (lanelet.lanelet_id, key))


@rule("error", why="A lane change leads nowhere.")
def unknown_neighbour(document: RoadDocument) -> Iterator[Defect]:
    """A neighbour on the left or right is not in the file."""
    for lanelet in document.lanelets:
        for side, adjoining in lanelet.neighbours.items():
            if adjoining.lanelet_id not in document.by_id:
                message = f"neighbour {adjoining.lanelet_id} on the {side} is not in the file"
                yield Defect(message, (lanelet.lanelet_id, adjoining.lanelet_id))


@rule("error", why="Searching forwards and backwards gives different routes.")
def one_way_succession(document: RoadDocument) -> Iterator[Defect]:
    """A lanelet has a successor that does not list it as predecessor, or the reverse."""
    known = document.by_id
    for lanelet in document.lanelets:
        for key in lanelet.successors:
            if key in known and lanelet.lanelet_id not in known[key].predecessors:
                yield Defect(f"successor {key} does not list it as predecessor", (lanelet.lanelet_id, key))
        for key in lanelet.predecessors:
            if key in known and lanelet.lanelet_id not in known[key].successors:
                yield Defect(f"predecessor {key} does not list it as successor", (lanelet.lanelet_id, key))


_LARGEST_GAP_M = 1.0
"""Chosen: about what a car travels in a time step; drawn lanelets meet to centimetres."""


@rule("warning", why="Reference paths jump there, which no vehicle can follow.")
def gap_at_join(document: RoadDocument) -> Iterator[Defect]:
    """The end and the beginning of two consecutive lanelets are more than 1 m apart."""
    for before, after in document.joins:
        gap = float(np.linalg.norm(after.center[0] - before.center[-1]))
        if gap > _LARGEST_GAP_M:
            message = f"{gap:.2f} m between its end and the beginning of {after.lanelet_id}"
            yield Defect(message, (before.lanelet_id, after.lanelet_id), before.center[-1])


_LARGEST_HEADING_JUMP_RAD = np.radians(45)
"""Chosen: coarse lanelets in tight turns have jumps of up to 45°."""


@rule("warning", why="No vehicle can turn on the spot: the reference path has a corner.")
def heading_jump(document: RoadDocument) -> Iterator[Defect]:
    """The heading changes by more than 45° from the end of a lanelet to the beginning of its successor."""
    for before, after in document.joins:
        end, beginning = before.path[-2:], after.path[:2]
        if len(end) < 2 or len(beginning) < 2:
            continue
        turn = abs(wrap_angle(float(headings(beginning)[0] - headings(end)[0])))
        if turn > _LARGEST_HEADING_JUMP_RAD:
            message = f"turns by {np.degrees(turn):.0f}° into {after.lanelet_id}"
            yield Defect(message, (before.lanelet_id, after.lanelet_id), before.center[-1])


@rule("error", why="A search for a route can run in a circle without progress.")
def follows_itself(document: RoadDocument) -> Iterator[Defect]:
    """A lanelet is its own successor, predecessor or neighbour."""
    for lanelet in document.lanelets:
        roles = {
            "successor": lanelet.successors,
            "predecessor": lanelet.predecessors,
            "neighbour": lanelet.neighbour_ids,
        }
        named = [role for role, keys in roles.items() if lanelet.lanelet_id in keys]
        if named:
            yield Defect(f"is its own {' and '.join(named)}", (lanelet.lanelet_id,))


@rule("error", why="One of the two is wrong: a lanelet ahead cannot be adjacent.")
def follows_and_lies_beside(document: RoadDocument) -> Iterator[Defect]:
    """A lanelet is both the successor or predecessor and the neighbour of another lanelet."""
    for lanelet in document.lanelets:
        in_line = {*lanelet.successors, *lanelet.predecessors} - {lanelet.lanelet_id}
        for key in sorted(in_line.intersection(lanelet.neighbour_ids)):
            yield Defect(f"{key} is both in line with it and adjacent to it", (lanelet.lanelet_id, key))


@rule("error", why="A lane change is possible in one direction only, or back into another lane.")
def one_way_neighbour(document: RoadDocument) -> Iterator[Defect]:
    """A lanelet's neighbour does not list that lanelet as its own neighbour on the facing side."""
    known = document.by_id
    for lanelet in document.lanelets:
        for side, adjoining in lanelet.neighbours.items():
            other = known.get(adjoining.lanelet_id)
            if other is None:
                continue
            facing = other.neighbours.get("left" if (side == "left") != adjoining.same_direction else "right")
            if facing is None or facing.lanelet_id != lanelet.lanelet_id:
                message = f"{adjoining.lanelet_id} on its {side} does not list it as neighbour on the side where it is"
                yield Defect(message, (lanelet.lanelet_id, adjoining.lanelet_id))


@rule("error", why="A planner changes into oncoming traffic, or avoids a lane that it may use.")
def neighbour_direction(document: RoadDocument) -> Iterator[Defect]:
    """A neighbour leads in the opposite direction to the one that the file states."""
    for lanelet in document.drawn:
        for adjoining in lanelet.neighbours.values():
            other = document.by_id.get(adjoining.lanelet_id)
            if other is None or not other.is_drawn:
                continue
            ahead, ahead_there = (each.center[-1] - each.center[0] for each in (lanelet, other))
            if float(ahead @ ahead_there) * (1 if adjoining.same_direction else -1) < 0:
                stated = "same" if adjoining.same_direction else "opposite"
                message = f"neighbour {other.lanelet_id} does not lead the {stated} way"
                yield Defect(message, (lanelet.lanelet_id, other.lanelet_id), lanelet.center[0])


_LARGEST_DISTANCE_TO_NEIGHBOUR_M = 2.0
"""Chosen: more than markings and kerbs are wide."""


@rule("warning", why="A lane change crosses an area outside all lanelets, or the lanelets overlap.")
def neighbour_apart(document: RoadDocument) -> Iterator[Defect]:
    """The bounds of two neighbours that should coincide are more than 2 m apart over most of their length."""
    from shapely import LineString, distance, points

    for lanelet in document.drawn:
        for side, adjoining in lanelet.neighbours.items():
            other = document.by_id.get(adjoining.lanelet_id)
            if other is None or not other.is_drawn:
                continue
            bound = lanelet.left if side == "left" else lanelet.right
            facing = other.right if (side == "left") == adjoining.same_direction else other.left
            apart = float(np.median(distance(points(bound), LineString(facing))))
            if apart > _LARGEST_DISTANCE_TO_NEIGHBOUR_M:
                message = f"its {side} bound and that of neighbour {other.lanelet_id} are {apart:.1f} m apart"
                yield Defect(message, (lanelet.lanelet_id, other.lanelet_id), bound[len(bound) // 2])


@rule("error", why="One of the two sides is wrong, and a lane change to it leads to the other side.")
def neighbour_on_both_sides(document: RoadDocument) -> Iterator[Defect]:
    """A lanelet has the same neighbour on its left and on its right."""
    for lanelet in document.lanelets:
        keys = lanelet.neighbour_ids
        if len(keys) == 2 and keys[0] == keys[1]:
            yield Defect(f"neighbour {keys[0]} is listed on both sides", (lanelet.lanelet_id, keys[0]))


_LARGEST_OVERLAP_SHARE = 0.9
_SHORTEST_OVERLAP_M = 2.0
"""Shorter pieces inside a junction overlap their neighbours by nature."""


@rule("warning", why="A position belongs to both, so a vehicle's lanelet and the traffic that it meets are arbitrary.")
def overlapping_lanelets(document: RoadDocument) -> Iterator[Defect]:
    """Two lanelets of one direction with different beginnings and ends overlap by nine tenths."""
    from shapely import area, intersection

    lanelets = [lanelet for lanelet in document.drawn if length_m(lanelet.center) >= _SHORTEST_OVERLAP_M]
    areas = np.array([lanelet.polygon for lanelet in lanelets], dtype=np.object_)
    meeting = meeting_pairs(areas, "intersects")
    pairs = _unrelated(lanelets, meeting.pairs)
    first, second = areas[pairs[:, 0]], areas[pairs[:, 1]]
    shared = intersection(first, second)
    shares = area(shared) / np.maximum(np.minimum(area(first), area(second)), 1e-9)
    for index in np.flatnonzero(shares > _LARGEST_OVERLAP_SHARE):
        one, other = (lanelets[number].lanelet_id for number in pairs[index])
        place = shared[index].centroid
        message = f"{shares[index]:.0%} of the smaller one is on lanelet {other}"
        yield Defect(message, (one, other), np.array([place.x, place.y]))
    if not meeting.is_whole:
        message = f"it and those after it were not compared: more than {meeting.most:,} pairs of lanelets meet"
        yield Defect(message, (lanelets[meeting.pairs[-1, 0]].lanelet_id,))


def _unrelated(lanelets: list[LaneletElement], pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the pairs (n, 2) of lanelets, by number, that lead in the same direction and are unrelated."""
    unrelated = [
        not _are_related(lanelets[i], lanelets[j]) and _same_direction(lanelets[i], lanelets[j])
        for i, j in pairs.tolist()
    ]
    kept: NDArray[np.int64] = pairs[np.array(unrelated, dtype=bool)]
    return kept


def _are_related(lanelet: LaneletElement, other: LaneletElement) -> bool:
    """Return whether two lanelets fork from or merge into the same lanelet, or one follows the other."""
    fork = set(lanelet.predecessors) & set(other.predecessors) or set(lanelet.successors) & set(other.successors)
    in_line = other.lanelet_id in lanelet.successors + lanelet.predecessors
    return bool(fork) or in_line


def _same_direction(lanelet: LaneletElement, other: LaneletElement) -> bool:
    """Return whether two lanelets lead in the same direction, to within about 45°."""
    ahead, ahead_there = (each.center[-1] - each.center[0] for each in (lanelet, other))
    return float(ahead @ ahead_there) > 0.7 * float(np.linalg.norm(ahead) * np.linalg.norm(ahead_there))


_LONGEST_ISOLATED_M = 50.0
"""A longer one may be a road of its own that was cut at both ends."""


@rule("warning", why="No vehicle can enter or leave it; usually a connection is missing.")
def isolated_lanelet(document: RoadDocument) -> Iterator[Defect]:
    """In a network of several lanelets, a lanelet shorter than 50 m has no predecessor, successor or neighbour.

    Footways need none of these, because pedestrians walk in any direction.
    """
    for lanelet in document.lanelets if len(document.lanelets) > 1 else ():
        connected = lanelet.predecessors or lanelet.successors or lanelet.neighbours
        if lanelet.is_footway:
            continue
        if not connected and lanelet.is_drawn and length_m(lanelet.center) < _LONGEST_ISOLATED_M:
            yield Defect("has neither predecessor, successor nor neighbour", (lanelet.lanelet_id,), lanelet.center[0])
