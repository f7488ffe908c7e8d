"""A drive in the form that traffic rules need: vehicles ahead, the lines that it passes, and right of way.

It uses the lanelets of the scenario's network, its signs and lights, and the tracks of all road users. Lengths are in
m; arrays have one value per state of the drive.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ...schemas.runs import RunRecord, RunSteps
from ..commonroad import Track, limits_mps, signs_of
from ..criticality import ahead_of, encounters, times_to_collision_s
from ..geometry import Points, Values, arc_length, headings, project_all, wrap_angles
from .run_set import ego_track

if TYPE_CHECKING:
    from commonroad.scenario.intersection import Intersection, IntersectionIncomingElement
    from commonroad.scenario.lanelet import Lanelet, LaneletNetwork
    from commonroad.scenario.traffic_light import TrafficLight
    from shapely import STRtree
    from shapely.geometry.base import BaseGeometry

_ALIGNED_RAD = math.radians(60.0)
"""A lanelet has the same direction if it differs by less from a heading (chosen, as for planners)."""
_LANES_WITHIN_M, _ON_M = 20.0, 80.0
"""Distance within which lanelets near the drive are examined, and length of the path's continuation along lanes
(chosen).
"""
_LEAST_CONFLICT_M2 = 0.5
"""Paths that overlap less touch along a line (chosen)."""
_CROSSING_RAD = (math.radians(30.0), math.radians(150.0))
"""Incoming lanes with a difference in direction outside this range merge or are oncoming (chosen)."""
_SIGNED = {"PRIORITY": 2, "RIGHT_OF_WAY": 2, "YIELD": 0, "STOP": 0}
"""CommonRoad's names of the signs that decide priority: the higher value goes first; 1 without a sign."""
_TURNS = {
    "left": ("left", "leftStraight", "leftRight", "all"),
    "straight": ("straight", "leftStraight", "straightRight", "all"),
    "right": ("right", "straightRight", "leftRight", "all"),
    "": ("all",),
}
"""The directions of traffic lights that apply to each turn; an unknown turn is governed by lights for all."""
YieldsBy = Literal["right before left", "signs", "left turn"]
"""Why the ego gives way to another at an intersection."""


@dataclass(frozen=True)
class Ahead:
    """A road user near the ego: at each state, its gap ahead on the ego's path (infinite if not ahead), and its motion.

    ``seen``: whether it was within 60 m; ``collision_s``: time until it and the ego touch on their courses, infinite if
    never.
    """

    obstacle_id: int
    gap_m: Values
    seen: NDArray[np.bool_]
    speed_mps: Values
    acceleration_mps2: Values
    collision_s: Values

    @property
    def is_ahead(self) -> NDArray[np.bool_]:
        """The states at which the road user is ahead on the ego's path."""
        return np.isfinite(self.gap_m)


@dataclass(frozen=True)
class Line:
    """A line across the ego's path: its distance ahead of the ego's front at each state, and its lanelet."""

    lanelet: "Lanelet"
    before_m: Values
    turn: str


@dataclass(frozen=True)
class _Passage:
    """A path through an intersection: its incoming lanes, its turn, and its lanelets inside."""

    incoming_id: int
    incoming: tuple[int, ...]
    turn: str
    inside: frozenset[int]
    heading_rad: float
    left_of: int | None


@dataclass(frozen=True)
class Conflict:
    """A road user to which the ego must give way at an intersection, with the area where their paths overlap.

    The arrays have one entry per state. ``is_there``: whether the ego's body is in the area. ``until_s``, ``since_s``:
    the time until the road user's body is next in the area, and since it last was; 0 while it is in the area, infinite
    if it never is.
    """

    by: YieldsBy
    obstacle_id: int
    is_there: NDArray[np.bool_]
    until_s: Values
    since_s: Values


class RuledDrive:
    """A drive on a lanelet network, in the form that rules need; each view is computed once, on demand."""

    def __init__(
        self,
        ego: Track,
        acceleration_mps2: Values,
        others: Mapping[int, Track],
        network: "LaneletNetwork",
        step_s: float,
        onward: Points | None = None,
    ) -> None:
        """``onward``: points (n, 2) of the path after the driven end; None means along the straightest lanes."""
        self.ego, self.others, self.network, self.step_s = ego, dict(others), network, step_s
        self.acceleration_mps2, self._onward = acceleration_mps2, onward

    @classmethod
    def of(
        cls, record: RunRecord, steps: RunSteps, others: Mapping[int, Track], network: "LaneletNetwork"
    ) -> "RuledDrive":
        """Return the drive of a run."""
        accelerations_mps2 = np.asarray(steps.acceleration_mps2, dtype=float)
        return cls(ego_track(record, steps), accelerations_mps2, others, network, record.step_s)

    def steps(self, duration_s: float) -> int:
        """Return the number of steps in a duration."""
        return round(duration_s / self.step_s)

    @property
    def count(self) -> int:
        """The number of states."""
        return len(self.ego.positions)

    @cached_property
    def roads(self) -> "_Roads":
        """The lanelets near the drive."""
        from shapely import MultiPoint

        return _Roads(self.network, MultiPoint(self.ego.positions).envelope.buffer(_LANES_WITHIN_M))

    @cached_property
    def lanelets(self) -> list[tuple[int, ...]]:
        """The lanelets under the ego's centre that lead in its direction, at each state."""
        return self.roads.under(self.ego.positions, self.ego.headings_rad)

    @cached_property
    def path(self) -> Track:
        """The driven path as a track, continued along the lanes after its end."""
        ego, on = self.ego, self._onward
        if on is None:
            on = self.roads.onwards(self.lanelets[-1], ego.positions[-1])
        positions = np.concatenate([ego.positions, on])
        turned = headings(positions[-2:]) if len(on) else ego.headings_rad[-1:]
        return Track(
            obstacle_id=ego.obstacle_id,
            kind=ego.kind,
            length_m=ego.length_m,
            width_m=ego.width_m,
            first_step=ego.first_step,
            positions=positions,
            headings_rad=np.concatenate([ego.headings_rad, np.repeat(turned, len(on))]),
            speeds_mps=np.concatenate([ego.speeds_mps, np.zeros(len(on))]),
        )

    @cached_property
    def near(self) -> tuple[Ahead, ...]:
        """All road users that come within 60 m of the ego."""
        tracks = list(self.others.values())
        met = encounters(self.ego, tracks)
        if not len(met.state):
            return ()
        gaps, times = ahead_of(self.path, met).gaps_m, times_to_collision_s(met.ego, met.other)
        found = []
        for number in np.unique(met.track):
            pairs = np.flatnonzero(met.track == number)
            states, track = met.state[pairs], tracks[int(number)]
            gap, speed, collision, braking = (np.full(self.count, value) for value in (np.inf, 0.0, np.inf, 0.0))
            gap[states], collision[states] = gaps[pairs], times[pairs]
            at = states + self.ego.first_step - track.first_step
            speed[states] = met.other.speeds_mps[pairs]
            if len(track.speeds_mps) > 1:
                changes = np.diff(track.speeds_mps, prepend=track.speeds_mps[:1]) / self.step_s
                braking[states] = changes[np.clip(at, 0, len(changes) - 1)]
            seen = np.zeros(self.count, dtype=bool)
            seen[states] = True
            found.append(Ahead(track.obstacle_id, gap, seen, speed, braking, collision))
        return tuple(found)

    @cached_property
    def nearest_ahead(self) -> NDArray[np.intp]:
        """The index into ``near`` of the next vehicle ahead at each state; meaningless if no vehicle is ahead."""
        if not self.near:
            return np.zeros(self.count, dtype=np.intp)
        nearest: NDArray[np.intp] = np.argmin([other.gap_m for other in self.near], axis=0)
        return nearest

    @cached_property
    def lines(self) -> tuple[Line, ...]:
        """The stop lines of the ego's lanelets where its path meets them, except those behind its start."""
        front = self.ego.length_m / 2
        path = self.path
        along = np.stack([np.cos(path.headings_rad), np.sin(path.headings_rad)], axis=1)
        bumper_path = path.positions + front * along
        stations = arc_length(bumper_path)[: self.count]
        found = []
        for key in dict.fromkeys(lanelet for under in self.lanelets for lanelet in under):
            lanelet = self.network.find_lanelet_by_id(key)
            if not (lanelet.traffic_lights or lanelet.traffic_signs):
                continue
            station = meeting_m(bumper_path, self.roads.stop_line(lanelet))
            if station is None or station < stations[0]:
                continue
            at = min(int(np.searchsorted(stations, station)), self.count - 1)
            if key in self.lanelets[at] or key in self.lanelets[max(at - 1, 0)]:
                found.append(Line(lanelet, station - stations, self._turn_after(key)))
        return tuple(found)

    def _turn_after(self, lanelet_id: int) -> str:
        return self.turn_after(lanelet_id, Counter(key for under in self.lanelets for key in under))

    def turn_after(self, lanelet_id: int, steps_on: Counter[int]) -> str:
        """Return the direction in which a road user turns from a lanelet, or an empty string if it is unknown.

        ``steps_on``: the steps that it spent on each lanelet.
        """
        for intersection in self.network.intersections:
            for incoming in intersection.incomings:
                if lanelet_id in incoming.incoming_lanelets:
                    return _turn(incoming, steps_on)[0]
        return ""

    @cached_property
    def conflicts(self) -> tuple[Conflict, ...]:
        """The road users that the ego must give way to at the intersections of the drive."""
        found: list[Conflict] = []
        for intersection in self.network.intersections:
            own = _passage(intersection, self.lanelets, self.network)
            if own is None:
                continue
            is_lit = bool(self.lights_of(own.incoming))
            for other in self._near_intersection(own):
                under = self.roads.under(other.positions, other.headings_rad)
                theirs = _passage(intersection, under, self.network)
                by = None if theirs is None else _yields_by(own, theirs, is_lit, self.network)
                area = None if theirs is None or by is None else self.roads.conflict(own.inside, theirs.inside)
                if by is not None and area is not None:
                    found.append(self._conflict(by, other, area))
        return tuple(found)

    def lights_of(self, lanelets: Sequence[int]) -> list["TrafficLight"]:
        """Return the active lights of lanelets that have a cycle."""
        wanted = {light for key in lanelets for light in self.network.find_lanelet_by_id(key).traffic_lights}
        lights = (self.network.find_traffic_light_by_id(key) for key in sorted(wanted))
        return [light for light in lights if light is not None and light.active and light.traffic_light_cycle]

    def _near_intersection(self, own: _Passage) -> Iterator[Track]:
        """Yield moving road users that come near the ego's path through an intersection."""
        inside = self.roads.union(own.inside).buffer(_LANES_WITHIN_M).bounds
        low, high = np.array(inside[:2]), np.array(inside[2:])
        for track in self.others.values():
            if len(track.positions) > 1 and ((track.positions >= low) & (track.positions <= high)).all(axis=1).any():
                yield track

    def _conflict(self, by: YieldsBy, other: Track, area: "BaseGeometry") -> Conflict:
        steps = np.arange(self.ego.first_step, self.ego.first_step + self.count)
        theirs = _inside(other, np.arange(steps[0], max(steps[-1], other.last_step) + 1), area)
        until, since = _until(theirs), _until(theirs[::-1])[::-1]
        return Conflict(
            by=by,
            obstacle_id=other.obstacle_id,
            is_there=_inside(self.ego, steps, area),
            until_s=until[: self.count] * self.step_s,
            since_s=since[: self.count] * self.step_s,
        )

    def shown(self, light: "TrafficLight", colours: Sequence[str]) -> NDArray[np.bool_]:
        """Return a mask of the states at which a light has one of the given colours (CommonRoad's names)."""
        steps = range(self.ego.first_step, self.ego.first_step + self.count)
        return np.array([light.get_state_at_time_step(step).name in colours for step in steps])

    def lights_for(self, line: Line) -> Iterator["TrafficLight"]:
        """Yield the active lights of a line that apply to the ego's turn."""
        yield from self.lights_for_turn(line.lanelet, line.turn)

    def lights_for_turn(self, lanelet: "Lanelet", turn: str) -> Iterator["TrafficLight"]:
        """Yield the active lights of a lanelet that apply to a turn."""
        for light in self.lights_of([lanelet.lanelet_id]):
            if light.direction.value in _TURNS[turn]:
                yield light


class _Roads:
    """The lanelets in an area, with queries for those under given points and for their bounds, lines and overlaps."""

    def __init__(self, network: "LaneletNetwork", area: "BaseGeometry") -> None:
        self._network = network
        self._near = [lane for lane in network.lanelets if lane.polygon.shapely_object.intersects(area)]
        self._tree_made: STRtree | None = None
        self._inner = {
            key
            for intersection in network.intersections
            for incoming in intersection.incomings
            for key in (*incoming.successors_left, *incoming.successors_straight, *incoming.successors_right)
        }

    @property
    def _tree(self) -> "STRtree":
        from shapely import STRtree

        if self._tree_made is None:
            self._tree_made = STRtree([lane.polygon.shapely_object for lane in self._near])
        return self._tree_made

    def under(self, points: Points, headings_rad: Values) -> list[tuple[int, ...]]:
        """Return the lanelets under each point (n, 2) with a direction within 60° of its heading, ids ascending."""
        import shapely

        found: list[list[int]] = [[] for _ in points]
        at, lanes = self._tree.query(shapely.points(points), predicate="intersects")
        for number in np.unique(lanes):
            lane, mine = self._near[int(number)], at[lanes == number]
            center = np.asarray(lane.center_vertices, dtype=float)
            stations, _ = project_all(center, points[mine])
            segment = np.clip(np.searchsorted(arc_length(center), stations, side="right") - 1, 0, len(center) - 2)
            turned = np.abs(wrap_angles(headings(center)[segment] - headings_rad[mine]))
            for index in mine[turned <= _ALIGNED_RAD]:
                found[int(index)].append(int(lane.lanelet_id))
        return [tuple(sorted(keys)) for keys in found]

    def onwards(self, under: Sequence[int], position: Points) -> Points:
        """Return points of the centre lines after a position on lanelets, along the straightest successors for 80 m."""
        known = {int(lane.lanelet_id) for lane in self._network.lanelets}
        points: list[Points] = []
        reached, key, before = 0.0, under[0] if under else None, position
        visited: set[int] = set()
        while key is not None and key not in visited and reached < _ON_M:
            visited.add(key)
            lane = self._network.find_lanelet_by_id(key)
            center = np.asarray(lane.center_vertices, dtype=float)
            if not points:
                station = float(project_all(center, before[None])[0][0])
                center = center[arc_length(center) > station + 2.0]
            for point in center:
                moved = float(np.linalg.norm(point - before))
                if moved > 0.5:
                    points.append(point)
                    reached, before = reached + moved, point
            following = [one for one in lane.successor if one in known]
            key = min(
                following, key=lambda one: (_bend(lane, self._network.find_lanelet_by_id(one)), one), default=None
            )
        return np.array(points).reshape(-1, 2)

    def limit_mps(self, keys: Sequence[int]) -> float:
        """Return the highest speed limit that is posted on lanelets; infinite if there is no limit."""
        posted = [
            speed
            for key in keys
            for sign in signs_of(self._network, [key])
            for element in sign.traffic_sign_elements
            for speed in limits_mps(element)
        ]
        return max(posted, default=math.inf)

    def stop_line(self, lanelet: "Lanelet") -> Points:
        """Return the line to stop at (2, 2): a lanelet's stop line; else its end or, in an intersection, its start."""
        line = lanelet.stop_line
        if line is not None and line.start is not None and line.end is not None:
            return np.array([line.start, line.end], dtype=float)
        end = 0 if lanelet.lanelet_id in self._inner else -1
        return np.array([lanelet.left_vertices[end], lanelet.right_vertices[end]], dtype=float)

    def solid_bounds(self, key: int) -> list[tuple[Points, float]]:
        """Return the bounds of a lanelet that must not be crossed, each with the sign of offsets on its inner side."""
        lane = self._network.find_lanelet_by_id(key)
        sides = (
            (lane.left_vertices, lane.line_marking_left_vertices, -1.0),
            (lane.right_vertices, lane.line_marking_right_vertices, 1.0),
        )
        solid = ("solid", "broad_solid")
        return [(np.asarray(line, dtype=float), sign) for line, marking, sign in sides if marking.value in solid]

    def union(self, keys: frozenset[int]) -> "BaseGeometry":
        """Return the union of lanelets as one area."""
        import shapely

        parts = [self._network.find_lanelet_by_id(key).polygon.shapely_object for key in sorted(keys)]
        return shapely.union_all([shapely.make_valid(part) for part in parts])

    def conflict(self, ours: frozenset[int], theirs: frozenset[int]) -> "BaseGeometry | None":
        """Return the area in which two paths through an intersection overlap, or None if they do not."""
        area = self.union(ours).intersection(self.union(theirs))
        return area if area.area >= _LEAST_CONFLICT_M2 else None


def _bend(lane: "Lanelet", following: "Lanelet") -> float:
    """Return the change of direction in rad from the end of a lanelet to the end of the next."""
    ends = [headings(np.asarray(one.center_vertices, dtype=float)[-2:])[0] for one in (lane, following)]
    return abs(float(wrap_angles(np.array([ends[1] - ends[0]]))[0]))


def meeting_m(path: Points, line: Points) -> float | None:
    """Return the station at which a path first meets a line, or None if it does not."""
    from shapely import LineString, Point

    crossing = LineString(path).intersection(LineString(line))
    if crossing.is_empty:
        return None
    points = [Point(part.coords[0]) for part in getattr(crossing, "geoms", [crossing])]
    return min(float(LineString(path).project(point)) for point in points)


def _inside(track: Track, steps: NDArray[np.int_], area: "BaseGeometry") -> NDArray[np.bool_]:
    """Return a mask of the steps at which the body of a track overlaps an area."""
    import shapely

    at = steps - track.first_step
    there = np.flatnonzero((at >= 0) & (at < len(track.positions)))
    result = np.zeros(len(steps), dtype=bool)
    if len(there):
        corners = np.array([track.corners_at(int(index)) for index in at[there]])
        result[there] = shapely.intersects(shapely.polygons(corners), area)
    return result


def _until(condition: NDArray[np.bool_]) -> Values:
    """Return at each step the number of steps until a condition next holds: 0 if it holds, infinite if never again."""
    result, next_at = np.full(len(condition), np.inf), np.inf
    for index in range(len(condition) - 1, -1, -1):
        next_at = 0.0 if condition[index] else next_at + 1.0
        result[index] = next_at
    return result


def _turn(incoming: "IntersectionIncomingElement", steps_on: Counter[int]) -> tuple[str, frozenset[int]]:
    """Return the turn from an incoming that has the most steps, and the lanelets of that turn that were used."""
    directions = {
        "straight": incoming.successors_straight,
        "left": incoming.successors_left,
        "right": incoming.successors_right,
    }
    longest = {turn: sum(steps_on[key] for key in keys) for turn, keys in directions.items()}
    turn = max(longest, key=lambda name: longest[name])
    return (turn, frozenset(key for key in directions[turn] if steps_on[key])) if longest[turn] else ("", frozenset())


def _passage(
    intersection: "Intersection", under: Sequence[tuple[int, ...]], network: "LaneletNetwork"
) -> _Passage | None:
    """Return how a road user on these lanelets, one entry per step, passes an intersection, or None if it does not.

    If there are several incomings, the one with the most steps is chosen.
    """
    steps_on = Counter(key for keys in under for key in keys)
    found: list[tuple[int, _Passage]] = []
    for incoming in intersection.incomings:
        came = sorted(key for key in incoming.incoming_lanelets if steps_on[key])
        turn, inside = _turn(incoming, steps_on)
        if not inside:
            continue
        lane = network.find_lanelet_by_id(came[0] if came else min(incoming.incoming_lanelets))
        heading = float(headings(np.asarray(lane.center_vertices, dtype=float)[-2:])[0])
        lanes = tuple(sorted(incoming.incoming_lanelets))
        on = sum(not inside.union(came).isdisjoint(keys) for keys in under)
        found.append((on, _Passage(incoming.incoming_id, lanes, turn, inside, heading, incoming.left_of)))
    return max(found, key=lambda item: item[0])[1] if found else None


def _yields_by(own: _Passage, theirs: _Passage, is_lit: bool, network: "LaneletNetwork") -> YieldsBy | None:
    """Return why the ego must give way to another road user at an intersection, or None. Lights override all signs."""
    if own.incoming_id == theirs.incoming_id:
        return None
    turned = abs(float(wrap_angles(np.array([theirs.heading_rad - own.heading_rad]))[0]))
    ours, other = (0, 0) if is_lit else (_signed(own.incoming, network), _signed(theirs.incoming, network))
    if ours != other:
        return "signs" if other > ours else None
    if turned > _CROSSING_RAD[1]:
        return "left turn" if own.turn == "left" and theirs.turn != "left" else None
    comes_from_right = own.left_of == theirs.incoming_id and turned > _CROSSING_RAD[0]
    return "right before left" if comes_from_right and not is_lit else None


def _signed(lanelets: Sequence[int], network: "LaneletNetwork") -> int:
    """Return the priority according to the signs on incoming lanes: 2 priority, 0 give way, 1 no sign."""
    names = {
        element.traffic_sign_element_id.name
        for sign in signs_of(network, lanelets)
        for element in sign.traffic_sign_elements
    }
    ranks = [_SIGNED[name] for name in names if name in _SIGNED]
    return min(ranks, default=1)
