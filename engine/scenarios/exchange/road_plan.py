"""Plan which OpenDRIVE roads represent the lanelets of a network, and how they join.

A joint consists of the roads that end at a point and the roads that start there. At a fork the starting roads are
connecting roads of a junction, at a merge the ending roads. ASAM requires that a connecting road has one incoming road,
which must not be a connecting road (``one_connection_element``, ``connect_road_no_incoming_road``). Therefore common
roads of almost no length, bridges, are inserted before or after some connecting roads; and if several roads end and
several start, each pair of lanes gets a connecting road of that length, a connector.

Lanes that follow each other have no gap (``contact_point_no_horizontal_gaps``): if the ends of bounds differ, all are
moved to the most frequent position.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ...commonroad import SHORTEST_M
from ...geometry import Points
from .cross_sections import LEVEL_M, Strip, strip_of

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork

SAME_M = 0.02
"""Neighbours are separate roads if their common bound differs by more, or if they do not start and end level."""


@dataclass(frozen=True, order=True)
class Joint:
    """Roads that end together, and the roads that start at that point."""

    ends: tuple[int, ...]
    starts: tuple[int, ...]

    @property
    def is_fork(self) -> bool:
        """Whether several roads start where one ends."""
        return len(self.ends) == 1 and len(self.starts) > 1

    @property
    def is_merge(self) -> bool:
        """Whether several roads end where one starts."""
        return len(self.ends) > 1 and len(self.starts) == 1

    @property
    def is_plain(self) -> bool:
        """Whether exactly one road ends and exactly one starts."""
        return len(self.ends) == 1 and len(self.starts) == 1


@dataclass(frozen=True)
class RoadPlan:
    """The roads of a lanelet network: their lanes, and how they join.

    ``roads``: by the id of its first lanelet, each road's lanelets from left to right. ``strips``: their shapes.
    ``following``: by lanelet, the drawn lanelets that follow it. ``left_out``: lanelets without an area. ``apart``:
    links between lanelets that do not meet, or where one has no width, which are not written to the file.
    """

    roads: dict[int, tuple[int, ...]]
    strips: dict[int, Strip]
    following: dict[int, tuple[int, ...]]
    left_out: tuple[int, ...] = field(default=())
    apart: tuple[tuple[int, int], ...] = field(default=())

    @classmethod
    def of(cls, network: "LaneletNetwork") -> "RoadPlan":
        """Plan the roads of a network; depends only on the network."""
        lanelets = {int(lanelet.lanelet_id): lanelet for lanelet in network.lanelets}
        links = {(key, int(after)) for key, lanelet in lanelets.items() for after in lanelet.successor}
        links |= {(int(before), key) for key, lanelet in lanelets.items() for before in lanelet.predecessor}
        links = {(key, after) for key, after in links if key in lanelets and after in lanelets and key != after}
        meeting = {pair for pair in links if _meet(lanelets[pair[0]], lanelets[pair[1]])}
        groups = _groups(lanelets)
        corners = _Corners(lanelets, meeting, groups)
        roads: dict[int, tuple[int, ...]] = {}
        strips: dict[int, Strip] = {}
        left_out: list[int] = []
        for group in groups:
            for keys in corners.level_parts(group):
                for part in _drawn(keys, corners, strips):
                    roads[part[0]] = part
                left_out += [key for key in keys if not any(key in part for part in roads.values())]
        drawn = {key for keys in roads.values() for key in keys}
        ends = {
            key: _end_widths_m(strips[road], index) for road, keys in roads.items() for index, key in enumerate(keys)
        }
        meeting = {
            (key, after)
            for key, after in meeting
            # OpenDRIVE links no lane that begins or ends at a point.
            if not drawn.issuperset((key, after)) or min(ends[key][1], ends[after][0]) >= SHORTEST_M
        }
        following: dict[int, list[int]] = {key: [] for key in sorted(drawn)}
        for key, after in sorted(meeting):
            if key in drawn and after in drawn:
                following[key].append(after)
        apart = sorted(pair for pair in links - meeting if drawn.issuperset(pair))
        rows = {key: tuple(after) for key, after in following.items()}
        return cls(roads, strips, rows, tuple(sorted(left_out)), tuple(apart))

    @cached_property
    def place(self) -> dict[int, tuple[int, int]]:
        """Each lanelet's road and the id of its lane in that road (-1 is leftmost), by lanelet id."""
        return {key: (road, -1 - index) for road, keys in self.roads.items() for index, key in enumerate(keys)}

    @cached_property
    def leading(self) -> dict[int, tuple[int, ...]]:
        """The lanelets that lead into each lanelet, by lanelet id."""
        before: dict[int, list[int]] = {key: [] for key in self.following}
        for key, after in self.following.items():
            for other in after:
                before[other].append(key)
        return {key: tuple(others) for key, others in before.items()}

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """All joints of the network."""
        joint: dict[tuple[int, bool], set[tuple[int, bool]]] = {}
        for key, following in self.following.items():
            for after in following:
                end, start = (self.place[key][0], True), (self.place[after][0], False)
                members = joint.get(end, {end}) | joint.get(start, {start})
                joint.update(dict.fromkeys(members, members))
        found = {tuple(sorted(members)) for members in joint.values()}
        return tuple(
            Joint(tuple(road for road, is_end in one if is_end), tuple(road for road, is_end in one if not is_end))
            for one in sorted(found)
        )

    @cached_property
    def end_joint(self) -> dict[int, Joint]:
        """The joint at the end of each road, by road id."""
        return {road: joint for joint in self.joints for road in joint.ends}

    @cached_property
    def start_joint(self) -> dict[int, Joint]:
        """The joint at the start of each road, by road id."""
        return {road: joint for joint in self.joints for road in joint.starts}

    @cached_property
    def connecting(self) -> frozenset[int]:
        """The connecting roads: those after a fork, and those before a merge that have a road before them."""
        behind = {road for joint in self.joints if joint.is_fork for road in joint.starts}
        return frozenset(behind | {road for joint in self.joints if joint.is_merge for road in self.merging(joint)})

    def merging(self, joint: Joint) -> tuple[int, ...]:
        """Return the roads before a merge that can be connecting roads."""
        return tuple(road for road in joint.ends if road in self.start_joint)

    @cached_property
    def junctions(self) -> dict[int, tuple[Joint, ...]]:
        """The joints of each junction, by junction id; joints linked by a connecting road form one junction."""
        joined = {joint: {joint} for joint in self.joints if not joint.is_plain}
        for road in sorted(self.connecting):
            here = [joint for joint in self._joints_connected(road) if joint in joined]
            members = set[Joint]().union(*(joined[joint] for joint in here))
            joined.update(dict.fromkeys(members, members))
        sets = {frozenset(members) for members in joined.values()}
        first = max((*self.roads, *self.following), default=0) + 1
        ordered = sorted(tuple(sorted(one)) for one in sets)
        return {first + number: one for number, one in enumerate(ordered)}

    def _joints_connected(self, road: int) -> list[Joint]:
        before, behind = self.start_joint.get(road), self.end_joint.get(road)
        found = [before] if before is not None and before.is_fork else []
        return found + ([behind] if behind is not None and behind.is_merge else [])

    @cached_property
    def junction_at(self) -> dict[Joint, int]:
        """The junction that each joint belongs to; plain joints have no junction."""
        return {joint: junction for junction, joints in self.junctions.items() for joint in joints}

    @cached_property
    def junction_of(self) -> dict[int, int]:
        """The junction of each connecting road, by road id."""
        return {road: self.junction_at[self._joints_connected(road)[0]] for road in sorted(self.connecting)}

    @cached_property
    def bridges_behind(self) -> dict[int, int]:
        """The id of the bridge after each connecting road that must not lead into another one, by road id."""
        needed = [
            road
            for road in sorted(self.connecting)
            if (joint := self.end_joint.get(road)) is not None
            and not joint.is_merge
            and (not joint.is_plain or joint.starts[0] in self.connecting)
        ]
        first = max((*self.roads, *self.following, *self.junctions), default=0) + 1
        return {road: first + number for number, road in enumerate(needed)}

    @cached_property
    def bridges_before(self) -> dict[int, int]:
        """The id of the bridge before each connecting road that several roads lead into, by road id."""
        needed = [
            road
            for road in sorted(self.connecting)
            if (joint := self.start_joint.get(road)) is not None and len(joint.ends) > 1
        ]
        first = max((*self.roads, *self.following, *self.junctions, *self.bridges_behind.values()), default=0) + 1
        return {road: first + number for number, road in enumerate(needed)}

    @cached_property
    def connectors(self) -> dict[int, tuple[int, int]]:
        """The lanelets from which and to which each connector leads, by the connector's id."""
        pairs = []
        for joint in self.joints:
            ends = set(joint.ends)
            if joint.is_plain or joint.is_fork:
                continue
            if joint.is_merge:
                ends -= set(self.merging(joint))
            pairs += [(key, after) for end in sorted(ends) for key in self.roads[end] for after in self.following[key]]
        others = (*self.bridges_behind.values(), *self.bridges_before.values())
        first = max((*self.roads, *self.following, *self.junctions, *others), default=0) + 1
        return {first + number: pair for number, pair in enumerate(pairs)}

    def exit_of(self, road: int) -> int:
        """Return the road to which others are joined at a road's end: the road's bridge, or the road itself."""
        return self.bridges_behind.get(road, road)

    def entry_of(self, road: int) -> int:
        """Return the road to which others are joined at a road's start: the road's bridge, or the road itself."""
        return self.bridges_before.get(road, road)

    def road_before(self, road: int) -> int | None:
        """Return the road that leads into a road; None if there is no such road or a junction is there."""
        joint = self.start_joint.get(road)
        if joint is None:
            return None
        if road in self.connecting:
            return self.bridges_before.get(road) or self.exit_of(joint.ends[0])
        return joint.ends[0] if joint.is_plain and joint.ends[0] not in self.connecting else None

    def road_behind(self, road: int) -> int | None:
        """Return the road that follows a road; None if there is no such road or a junction is there."""
        joint = self.end_joint.get(road)
        if joint is None:
            return None
        if road in self.connecting:
            return self.bridges_behind.get(road) or self.entry_of(joint.starts[0])
        return joint.starts[0] if joint.is_plain and joint.starts[0] not in self.connecting else None

    def junction_before(self, road: int) -> int | None:
        """Return the junction that leads into a common road, or None."""
        joint = self.start_joint.get(road)
        return None if joint is None else self.junction_at.get(joint) or self.junction_of.get(joint.ends[0])

    def junction_behind(self, road: int) -> int | None:
        """Return the junction that a common road leads into, or None."""
        joint = self.end_joint.get(road)
        return None if joint is None else self.junction_at.get(joint) or self.junction_of.get(joint.starts[0])


def _drawn(keys: tuple[int, ...], corners: "_Corners", strips: dict[int, Strip]) -> list[tuple[int, ...]]:
    """Return the roads for adjacent lanelets: one for all, or one for each; lanelets without an area are left out."""
    parts = []
    for part in (keys, *([(key,) for key in keys] if len(keys) > 1 else [])):
        try:
            strips[part[0]] = strip_of(corners.bounds(part))
        except ValueError:
            continue
        parts.append(part)
        if part == keys:
            break
    return parts


def _end_widths_m(strip: Strip, index: int) -> tuple[float, float]:
    """Return the width of a lane at the start and at the end of its road, in m."""
    widths_m = strip.offsets_m[[0, -1], index] - strip.offsets_m[[0, -1], index + 1]
    return float(widths_m[0]), float(widths_m[1])


def _meet(lanelet: "Lanelet", following: "Lanelet") -> bool:
    """Return True if a lanelet starts where another ends: corresponding corners are within half a lane's width."""
    ends = [np.asarray(line)[-1, :2] for line in (lanelet.left_vertices, lanelet.right_vertices)]
    starts = [np.asarray(line)[0, :2] for line in (following.left_vertices, following.right_vertices)]
    gap = max(float(np.linalg.norm(one - other)) for one, other in zip(ends, starts, strict=True))
    return max(gap, SAME_M) <= min(float(np.linalg.norm(left - right)) for left, right in (ends, starts)) / 2


class _Corners:
    """The corners of lanelets, where bounds start and end; corners that meet become one point, level across a road."""

    def __init__(
        self, lanelets: "Mapping[int, Lanelet]", meeting: "set[tuple[int, int]]", groups: "Sequence[tuple[int, ...]]"
    ) -> None:
        self._lines = {
            (key, side): np.asarray(line, dtype=float)[:, :2]
            for key, lanelet in lanelets.items()
            for side, line in ((_LEFT, lanelet.left_vertices), (_RIGHT, lanelet.right_vertices))
        }
        same: dict[_Corner, list[_Corner]] = {}
        pairs = [((key, side, -1), (after, side, 0)) for key, after in sorted(meeting) for side in (_LEFT, _RIGHT)]
        pairs += [
            ((left, _RIGHT, end), (right, _LEFT, end))
            for group in groups
            for left, right in pairwise(group)
            for end in (0, -1)
        ]
        for one, other in pairs:
            members = same.get(one, [one])
            if other not in members:
                members = members + same.get(other, [other])
                same.update(dict.fromkeys(members, members))
        self._place: dict[_Corner, list[Points]] = {}
        for members in same.values():
            if members[0] not in self._place:
                place = [_common(np.array([self._lines[key, side][end] for key, side, end in members]))]
                self._place.update(dict.fromkeys(members, place))
        self._level(groups)

    def _level(self, groups: "Sequence[tuple[int, ...]]") -> None:
        """Move the ends of bounds between lanes onto the straight line across their road, widest roads first."""
        settled: list[list[Points]] = []
        for group in sorted(groups, key=lambda keys: (-len(keys), keys)):
            for end in (0, -1) if len(group) > 1 else ():
                corners = self._across(group, end)
                first, last = self.at(corners[0]), self.at(corners[-1])
                for corner in corners[1:-1]:
                    place = self._place.get(corner)
                    if place is None or any(place is one for one in settled):
                        continue
                    if (foot := _foot(place[0], first, last)) is not None:
                        place[0] = foot
                settled += [self._place[corner] for corner in corners if corner in self._place]

    def _across(self, group: tuple[int, ...], end: int) -> "list[_Corner]":
        return [(group[0], _LEFT, end), *((key, _RIGHT, end) for key in group)]

    def at(self, corner: "_Corner") -> Points:
        """Return the position of a corner."""
        key, side, end = corner
        place = self._place.get(corner)
        return self._lines[key, side][end] if place is None else place[0]

    def level_parts(self, group: tuple[int, ...]) -> list[tuple[int, ...]]:
        """Return adjacent lanes, divided where they do not start and end on one straight line across the road."""
        parts = [group[:1]]
        for key in group[1:]:
            if self._is_level((*parts[-1], key)):
                parts[-1] = (*parts[-1], key)
            else:
                parts.append((key,))
        return parts

    def _is_level(self, group: tuple[int, ...]) -> bool:
        for end in (0, -1):
            first, *between, last = (self.at(corner) for corner in self._across(group, end))
            for point in between:
                foot = _foot(point, first, last)
                if foot is None or float(np.linalg.norm(foot - point)) > LEVEL_M:
                    return False
        return True

    def bounds(self, group: tuple[int, ...]) -> list[Points]:
        """Return the bounds of adjacent lanes, from left to right."""
        lines = []
        for key, side in ((group[0], _LEFT), *((key, _RIGHT) for key in group)):
            line = self._lines[key, side].copy()
            line[0], line[-1] = self.at((key, side, 0)), self.at((key, side, -1))
            lines.append(line)
        return lines


_LEFT, _RIGHT = "left", "right"
_Corner = tuple[int, str, int]
"""A lanelet, a side, and an index of its first (0) or last vertex (-1) there."""


def _common(points: Points) -> Points:
    """Return the most frequent of the points (equal to the millimetre), or their mean if there is a tie."""
    places, counts = np.unique(np.round(points, 3), axis=0, return_counts=True)
    most = np.flatnonzero(counts == counts.max())
    if len(most) > 1:
        middle: Points = points.mean(axis=0)
        return middle
    nearest: Points = points[int(np.argmin(np.linalg.norm(points - places[most[0]], axis=1)))]
    return nearest


def _foot(point: Points, first: Points, last: Points) -> Points | None:
    """Return the nearest point on the straight line across a road, or None if it is not near."""
    step = last - first
    length = float(np.linalg.norm(step))
    if length <= SAME_M:
        return None
    foot: Points = first + step * float((point - first) @ step) / length**2
    return foot if float(np.linalg.norm(foot - point)) <= SAME_M else None


def _groups(lanelets: "Mapping[int, Lanelet]") -> list[tuple[int, ...]]:
    """Return adjacent lanelets, from left to right, that share their bounds and start and end level, or nearly."""
    rights: dict[int, int] = {}
    for key, lanelet in lanelets.items():
        other = lanelet.adj_right if lanelet.adj_right_same_direction else None
        if other is not None and other in lanelets and other != key and _share_a_bound(lanelet, lanelets[other]):
            rights[key] = int(other)
    lefts = {right: left for left, right in rights.items()}
    groups, taken = [], set[int]()
    for key in sorted(lanelets):
        first, seen = key, {key}
        while first in lefts and rights[lefts[first]] == first and lefts[first] not in seen:
            first = lefts[first]
            seen.add(first)
        if first in taken:
            continue
        group = [first]
        while group[-1] in rights and lefts[rights[group[-1]]] == group[-1] and rights[group[-1]] not in group:
            group.append(rights[group[-1]])
        group = [one for one in group if one not in taken]
        taken |= set(group)
        groups.append(tuple(group))
    return groups


def _share_a_bound(left: "Lanelet", right: "Lanelet") -> bool:
    one, other = np.asarray(left.right_vertices)[:, :2], np.asarray(right.left_vertices)[:, :2]
    if len(one) != len(other) or float(np.abs(one - other).max()) > SAME_M:
        return False
    outer_left, outer_right = np.asarray(left.left_vertices)[:, :2], np.asarray(right.right_vertices)[:, :2]
    return all(_foot(one[end], outer_left[end], outer_right[end]) is not None for end in (0, -1))
