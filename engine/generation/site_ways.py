"""The ways through a site's junctions or its ring, and the turn that each of them makes.

A way is an edge that leads into the site, the edges inside it, and an edge that leads out of it. Its turn is the angle
between the direction of the arm by which it enters and that of the arm by which it leaves. Roads bend just before a
ring, and split around an island, so the lanes at the ring itself do not have the direction of their arm. The direction
of an arm is therefore that of its road over one diameter of the site. If the arm has two carriageways there, it is the
direction halfway between both, because they bend to opposite sides.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property

import numpy as np

from ...schemas.generation import Turn
from ..geometry import Points, arc_length, interpolate, without_repeats, wrap_angle
from ..network import SumoNet
from ..scene import BACK_RAD, TURN_RAD
from ..traffic import OpenEdges

MOST_INSIDE = 12
"""Maximum number of edges inside a site on a route (chosen): once around a ring with as many arms."""
MOST_BETWEEN = 3
"""Maximum number of edges from one junction of a site to the next (chosen): footways may cross between them."""
BETWEEN_M = 60.0
"""Maximum length of these edges: junctions that are farther apart are different sites (``maps.site_search``)."""
ARM_RAD = math.radians(60.0)
"""An entry of a ring and the exit before it belong to one arm if their directions differ by less (chosen)."""


def turn_of(turned_rad: float) -> Turn:
    """Return the turn of a car at a junction or ring, by the change of its heading there, left positive.

    The limits are those of descriptions, so that a scenario is described as it was requested.
    """
    if abs(turned_rad) > BACK_RAD:
        return "u_turn"
    if abs(turned_rad) <= TURN_RAD:
        return "straight"
    return "left" if turned_rad > 0 else "right"


class SiteWays:
    """The ways through the junctions of a site, or through its ring if it has one.

    ``inside``: the edges of the ring, or those that lead from one of the junctions to another. ``diameter_m``: the
    largest distance between the ends of the edges that lead in and the starts of those that lead out.
    """

    def __init__(self, net: SumoNet, junctions: frozenset[str], ring: frozenset[str] = frozenset()) -> None:
        self._net, self._junctions, self._ring = net, junctions, ring
        self._after: dict[str, set[str]] = {}
        self._before: dict[str, set[str]] = {}
        for turn in net.connections:
            if not (net.edges[turn.from_edge].internal or net.edges[turn.to_edge].internal):
                self._after.setdefault(turn.from_edge, set()).add(turn.to_edge)
                self._before.setdefault(turn.to_edge, set()).add(turn.from_edge)
        self.inside = ring or frozenset(self._between())
        self.entries = frozenset(
            edge
            for edge, onward in self._after.items()
            if edge not in self.inside and (onward & ring if ring else net.edges[edge].to_junction in junctions)
        )
        self.exits = frozenset(
            edge
            for edge, leading in self._before.items()
            if edge not in self.inside and (leading & ring if ring else net.edges[edge].from_junction in junctions)
        )
        loops = frozenset(edge for exit_ in self.exits for edge in self._loop_of(exit_))
        self.entries, self.exits = self.entries - loops, self.exits - loops

    def _loop_of(self, exit_: str) -> tuple[str, ...]:
        """Return the edges that lead from an exit straight back to the site within one diameter; empty for other exits.

        They remain of two carriageways if the map ends where these come together, so they are no arm. A street that
        ends there, with one edge for each direction, is an arm.
        """
        onward = {exit_} if exit_ in self.entries else self._after.get(exit_, set())
        begins, ends = self._net.edges[exit_].from_junction, self._net.edges[exit_].to_junction
        if len(onward) != 1 or not onward <= self.entries:
            return ()
        loop = tuple(dict.fromkeys((exit_, *onward)))
        if len(loop) > 1 and (begins, ends) == (
            self._net.edges[loop[1]].to_junction,
            self._net.edges[loop[1]].from_junction,
        ):
            return ()
        return loop if sum(float(arc_length(self._line(edge))[-1]) for edge in loop) <= 2 * self.diameter_m else ()

    @cached_property
    def diameter_m(self) -> float:
        """The largest distance between an end of an entry and a start of an exit, in m; 0 if there are none."""
        ends = [self._line(edge)[-1] for edge in self.entries]
        starts = [self._line(edge)[0] for edge in self.exits]
        if not ends or not starts:
            return 0.0
        return float(np.linalg.norm(np.array(ends)[:, None] - np.array(starts)[None], axis=2).max())

    def turn(self, entry: str, exit_: str) -> Turn:
        """Return the turn from an entry to an exit.

        A U-turn leads back to the entry's own arm, if traffic leaves the site there. Another road may bend so far
        within one diameter of the site that it leads in the same direction; this is a sharp turn into that road.
        """
        turned_rad = self.turned_rad(entry, exit_)
        if turn_of(turned_rad) == "u_turn" and self._arms.get(entry, exit_) != exit_:
            return "left" if self._leads_left(entry, exit_) else "right"
        return turn_of(turned_rad)

    def _leads_left(self, entry: str, exit_: str) -> bool:
        """Return whether a way between two arms with nearly the same direction turns left.

        At a ring, the angle between the arms may then have either sign: the way turns left if it follows most of a ring
        that turns left, or the smaller part of one that turns right.
        """
        begins, ends = self._net.edges[entry].to_junction, self._net.edges[exit_].from_junction
        around = self._once_around(begins)
        lines = [self._line(edge) for edge in around]
        lengths = [float(arc_length(line)[-1]) for line in lines]
        passed = [
            sum(lengths[:number]) for number, edge in enumerate(around) if self._net.edges[edge].from_junction == ends
        ]
        if not passed:
            return self.turned_rad(entry, exit_) > 0
        steps = np.diff(without_repeats(np.concatenate(lines)), axis=0)
        headings = np.arctan2(steps[:, 1], steps[:, 0])
        is_leftwards = sum(wrap_angle(float(one)) for one in np.diff(headings)) > 0
        return (passed[0] > sum(lengths) / 2) == is_leftwards

    def _once_around(self, junction: str) -> list[str]:
        """Return the edges of the ring in the direction of travel, from a junction back to it; empty without a ring."""
        onward = {self._net.edges[edge].from_junction: edge for edge in sorted(self._ring)}
        around: list[str] = []
        while junction in onward and len(around) < len(self._ring):
            around.append(onward[junction])
            junction = self._net.edges[onward[junction]].to_junction
        return around

    def turned_rad(self, entry: str, exit_: str) -> float:
        """Return the angle from the direction of an entry's arm to that of an exit's arm, left positive."""
        return wrap_angle(self.leaves_rad(exit_) - self.arrives_rad(entry))

    def arrives_rad(self, entry: str) -> float:
        """Return the heading of a road that leads into the site, outside it."""
        return wrap_angle(self._arm_rad(entry) + math.pi)

    def leaves_rad(self, exit_: str) -> float:
        """Return the heading of a road that leads out of the site, outside it."""
        return wrap_angle(self._arm_rad(exit_))

    def through(self, edges: OpenEdges) -> Iterator[tuple[Turn, tuple[str, ...]]]:
        """Yield every way that a class of vehicles can drive, as its turn and its edges."""
        for entry in sorted(self.entries & edges.following.keys()):
            waiting: list[tuple[str, ...]] = [
                (entry, onward)
                for onward in edges.following[entry]
                if not self._ring or onward in self._ring  # and not past the ring
            ]
            while waiting:
                way = waiting.pop()
                if way[-1] in self.exits:
                    yield self.turn(entry, way[-1]), way
                elif way[-1] in self.inside and len(way) <= MOST_INSIDE:
                    waiting += [(*way, onward) for onward in edges.following[way[-1]] if onward not in way]

    @cached_property
    def _arms(self) -> Mapping[str, str]:
        """The exit of the same arm for each entry, and the entry for each exit, if the arm has both."""
        exits = {entry: exit_ for entry in sorted(self.entries) if (exit_ := self._exit_of(entry)) is not None}
        return exits | {exit_: entry for entry, exit_ in exits.items()}

    def _arm_rad(self, edge: str) -> float:
        """Return the direction from the site along the arm of an entry or exit."""
        own, other = self._outwards[edge], self._arms.get(edge)
        return own if other is None else own + wrap_angle(self._outwards[other] - own) / 2

    @cached_property
    def _outwards(self) -> Mapping[str, float]:
        """The directions from the site along each entry and each exit, measured separately over one diameter of the
        site.
        """
        towards = {edge: direction_rad(self._road(edge, self._before)[::-1], self.diameter_m) for edge in self.entries}
        return towards | {edge: direction_rad(self._road(edge, self._after), self.diameter_m) for edge in self.exits}

    def _exit_of(self, entry: str) -> str | None:
        """Return the exit that belongs to the same arm as an entry, or None if traffic only enters there.

        Entry and exit are the two directions of one road, or carriageways that come together within one diameter. At a
        ring, they may also be the entry and the last exit before it, with carriageways side by side.
        """
        net = self._net
        start, end = net.edges[entry].from_junction, net.edges[entry].to_junction
        own = self._outwards[entry]

        def aside(exit_: str) -> float:
            return abs(wrap_angle(self._outwards[exit_] - own))

        ends = {edge: (net.edges[edge].from_junction, net.edges[edge].to_junction) for edge in sorted(self.exits)}
        both_ways = [edge for edge, (begins, leads_to) in ends.items() if begins == end and leads_to == start]
        if both_ways:
            return min(both_ways, key=aside)
        passed = self._junctions_along(entry, self._before)
        meeting = [edge for edge in ends if passed & self._junctions_along(edge, self._after)]
        if meeting:
            return min(meeting, key=aside)
        last = self._last_exit_before(entry) if self._ring else None
        return last if last is not None and aside(last) < ARM_RAD else None

    def _last_exit_before(self, entry: str) -> str | None:
        """Return the last exit of a ring before an entry, unless another entry comes between them."""
        junction = self._net.edges[entry].to_junction
        coming = [edge for edge in sorted(self._ring) if self._net.edges[edge].to_junction == junction]
        for _ in range(len(self._ring)):
            if not coming:
                return None
            begins = self._net.edges[coming[0]].from_junction
            leaving = [edge for edge in sorted(self.exits) if self._net.edges[edge].from_junction == begins]
            if leaving:
                return leaving[0]
            if any(self._net.edges[edge].to_junction == begins for edge in self.entries):
                return None
            coming = [edge for edge in sorted(self._ring) if self._net.edges[edge].to_junction == begins]
        return None

    def _between(self) -> Iterator[str]:
        """Yield the edges on short ways from one of the junctions to another."""
        lengths = {
            key: float(arc_length(self._line(key))[-1]) for key in self._net.edges if self._net.edges[key].lane_ids
        }
        starts = (key for key, edge in self._net.edges.items() if not edge.internal)
        for start in starts:
            if self._net.edges[start].from_junction not in self._junctions:
                continue
            waiting: list[tuple[str, ...]] = [(start,)]
            while waiting:
                way = waiting.pop()
                if sum(lengths[edge] for edge in way) > BETWEEN_M:
                    continue
                end = self._net.edges[way[-1]].to_junction
                if end in self._junctions:
                    if end != self._net.edges[start].from_junction:
                        yield from way
                elif len(way) < MOST_BETWEEN:
                    waiting += [(*way, onward) for onward in sorted(self._after.get(way[-1], ())) if onward not in way]

    def _line(self, edge: str) -> Points:
        return self._net.lanes[self._net.edges[edge].lane_ids[0]].shape

    def _road(self, edge: str, neighbours: Mapping[str, Iterable[str]]) -> Points:
        """Return the line of a road to or from the site, up to one diameter long or to the next fork."""
        is_ahead = neighbours is self._after
        chain = self._chain(edge, neighbours)
        lines = [self._line(one) for one in (chain if is_ahead else chain[::-1])]
        return without_repeats(np.concatenate(lines))

    def _chain(self, edge: str, neighbours: Mapping[str, Iterable[str]]) -> list[str]:
        """Return an edge and its only followers or predecessors, together at least one diameter long if possible.

        A way back around the island of an arm is left out.
        """
        turned_back = self.entries if neighbours is self._after else self.exits
        chain, length_m = [edge], float(arc_length(self._line(edge))[-1])
        while length_m < self.diameter_m:
            back = self._net.edges[chain[-1]].from_junction, self._net.edges[chain[-1]].to_junction
            onward = [
                other
                for other in neighbours.get(chain[-1], ())
                if (self._net.edges[other].to_junction, self._net.edges[other].from_junction) != back
                and other not in turned_back
            ]
            if len(onward) != 1 or onward[0] in chain:
                break
            chain.append(onward[0])
            length_m += float(arc_length(self._line(onward[0]))[-1])
        return chain

    def _junctions_along(self, edge: str, neighbours: Mapping[str, Iterable[str]]) -> set[str]:
        """Return the junctions at the outer ends of the edges of a road, within about one diameter of the site."""
        chain = self._chain(edge, neighbours)
        ends = (self._net.edges[one] for one in chain)
        return {end.to_junction if neighbours is self._after else end.from_junction for end in ends}


def direction_rad(line: Points, length_m: float) -> float:
    """Return the direction of a line from its start to the point ``length_m`` along it, or to its end."""
    stations = arc_length(line)
    point = interpolate(line, stations, np.array([min(max(length_m, 1.0), float(stations[-1]))]))[0]
    step = point - line[0]
    return float(np.arctan2(step[1], step[0]))
