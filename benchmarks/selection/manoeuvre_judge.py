"""Reads and measures the events of a CommonRoad file independently of the product: lanes as areas, and three answers.

A road user is in the ego's lane if its centre is in the area of the lanelets that the ego follows. The ego keeps its
initial speed unless the file holds its recording. A value near a threshold of the vocabulary's definitions (3 s of
headway, 3.4 m/s², half a lane) is undecided, so that no figure depends on rounding.

- A turn is a change of direction at a junction, where the ego's way shares ground with other roads. A bend of a road
  elsewhere is not a turn. Two junctions are two turns.
- The turn at a roundabout is that from its entry arm to its exit arm.
- A vehicle changes from the lane that it leaves at the edge of the ego's lane. A vehicle that follows its own lane
  until this joins the ego's lane merges; it does not cut in.
- A vehicle overtakes if it moves into the next lane itself; if the slower one leaves the lane for it, it only passes.
- A vehicle that comes across the ego's road and turns into its lane neither merges nor cuts in: it drives along the
  ego's lane already when it is outside of it.
"""

import heapq
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from lxml import etree
from numpy.typing import NDArray

Values = NDArray[np.float64]
OTHERS = ("cut_in", "cut_out", "merging", "overtaking", "lead_brakes_hard", "crossing", "oncoming_turns")
EGO = ("ego_turns_left", "ego_turns_right", "ego_turns_back", "ego_changes_lane", "unprotected_left")
_EGO_LENGTH_M = 4.5
_NOT_DRIVEN = ("pedestrian", "bicycle", "pillar", "buildings", "constructionZone", "roadBoundary", "unknown")
_NEAR_M, _AROUND_M = 100.0, 14.0
_READINGS = ((9, 3, 15.0), (45, 3, 30.0), (9, 20, 45.0))
"""Three readings of a turn, in m: junctions at most so far apart are one, so much of the approach and the exit belongs
to the turn, and so far from a roundabout its arms have their direction. In law, roadways 30 feet or more apart form
two junctions (Uniform Vehicle Code 1-132)."""
_RING_ARM_M = 25.0


class Answer(Enum):
    """Whether something happens; ``OPEN`` means too near to a threshold."""

    NO = 0
    OPEN = 1
    YES = 2


@dataclass(frozen=True)
class _Lanelet:
    left: Values
    right: Values
    successors: tuple[int, ...]
    beside: tuple[int, ...]
    opposite: tuple[int, ...]
    has_light: bool

    @cached_property
    def center(self) -> Values:
        return (_even(self.left) + _even(self.right)) / 2

    @cached_property
    def area(self) -> shapely.Polygon:
        return shapely.make_valid(shapely.Polygon(np.concatenate([self.left, self.right[::-1]])))

    @property
    def length_m(self) -> float:
        return float(np.linalg.norm(np.diff(self.center, axis=0), axis=1).sum())


@dataclass(frozen=True)
class _Track:
    kind: str
    length_m: float
    steps: NDArray[np.int_]
    places: Values
    headings: Values
    speeds: Values


@dataclass(frozen=True)
class _Start:
    place: Values
    heading: float
    speed: float
    step: int
    goals: tuple[int, ...]
    goal_places: tuple[Values, ...]


def _even(line: Values, count: int = 40) -> Values:
    """Return a line with evenly spaced points."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(at, along, line[:, 0]), np.interp(at, along, line[:, 1])])


def _number(node: Any) -> float:
    if node is None:
        return 0.0
    exact = node.findtext("exact")
    if exact is not None:
        return float(exact)
    return (float(str(node.findtext("intervalStart"))) + float(str(node.findtext("intervalEnd")))) / 2


def _point(node: Any) -> Values:
    return np.array([float(str(node.findtext("x"))), float(str(node.findtext("y")))])


def _turned(angle: Values) -> Values:
    """Return angles between -π and π."""
    wrapped: Values = (angle + math.pi) % (2 * math.pi) - math.pi
    return wrapped


class Judge:
    """A judge of the manoeuvres in one file."""

    def __init__(self, path: Path) -> None:
        root: Any = etree.parse(path, etree.XMLParser(huge_tree=True)).getroot()
        self._dt = float(root.get("timeStepSize"))
        self._lanelets = {int(node.get("id")): _lanelet(node) for node in root.iterfind("lanelet")}
        self._tracks = [track for node in root if (track := _track(node)) is not None]
        problem = min(root.iterfind("planningProblem"), key=lambda node: int(node.get("id")), default=None)
        self._start = None if problem is None else _start(problem)

    def answers(self) -> Mapping[str, Answer]:
        """Return for each manoeuvre whether it happens."""
        if self._start is None or not (route := self._route(self._start)):
            return dict.fromkeys((*OTHERS, *EGO), Answer.OPEN)
        changes = any(after not in self._lanelets[before].successors for before, after in pairwise(route))
        found = dict.fromkeys((*OTHERS, *EGO), Answer.NO)
        found["ego_changes_lane"] = Answer.YES if changes else Answer.NO
        if not self._start.goals and not self._start.goal_places:
            found |= dict.fromkeys(EGO, Answer.OPEN)
        elif changes:
            found |= dict.fromkeys(set(EGO) - {"ego_changes_lane"}, Answer.OPEN)
        else:
            found |= self._ego_turns(route, self._start)
        if changes:  # when it is in which lane is not said
            return found | dict.fromkeys(OTHERS, Answer.OPEN)
        for name, answer in self._others(route, self._start):
            found[name] = max(found[name], answer, key=lambda one: one.value)
        return found

    def _at(self, place: Values) -> list[int]:
        point = shapely.Point(place)
        return [key for key, lane in self._lanelets.items() if lane.area.covers(point)]

    def _fits(self, key: int, place: Values, heading: float) -> float:
        return float(abs(_turned(np.array(_direction(self._lanelets[key].center, place) - heading))))

    def _route(self, start: _Start) -> list[int]:
        here = [key for key in self._at(start.place) if self._fits(key, start.place, start.heading) < math.pi / 3]
        here.sort(key=lambda key: self._fits(key, start.place, start.heading))
        goals = set(start.goals) or {key for place in start.goal_places for key in self._at(place)}
        if not goals:
            return here[:1]
        waiting = [(0.0, [key]) for key in here]
        seen: set[int] = set()
        while waiting:
            cost, way = heapq.heappop(waiting)
            key = way[-1]
            if key in goals:
                return way
            if key in seen:
                continue
            seen.add(key)
            lane = self._lanelets[key]
            for other in lane.successors:
                if other in self._lanelets:
                    heapq.heappush(waiting, (cost + lane.length_m, [*way, other]))
            for other in lane.beside:
                if other in self._lanelets:
                    heapq.heappush(waiting, (cost + 20.0, [*way, other]))
        return []

    def _onward(self, route: list[int], least_m: float) -> list[int]:
        way = list(route)
        while sum(self._lanelets[key].length_m for key in way) < least_m:
            line = self._lanelets[way[-1]].center
            heading = math.atan2(*(line[-1] - line[-2])[::-1])
            after = [key for key in self._lanelets[way[-1]].successors if key in self._lanelets and key not in way]
            if not after:
                break
            way.append(
                min(after, key=lambda key: abs(_turned(np.array(_bearing(self._lanelets[key].center) - heading))))
            )
        return way

    def _ego_turns(self, route: list[int], start: _Start) -> dict[str, Answer]:
        line = np.concatenate([self._lanelets[key].center for key in route])
        line = line[np.concatenate([[True], np.linalg.norm(np.diff(line, axis=0), axis=1) > 0.05])]
        whole = shapely.LineString(line)
        begin = whole.project(shapely.Point(start.place))
        ends = [whole.project(shapely.Point(place)) for place in start.goal_places]
        end = ends[0] if ends and not start.goals else whole.length
        at = np.arange(begin, end, 1.0)
        passages = self._rings_passed(route, whole)
        names = ("ego_turns_left", "ego_turns_right", "ego_turns_back", "unprotected_left")
        if len(at) < 12 or passages is None:
            return dict.fromkeys(names, Answer.OPEN)
        points = shapely.get_coordinates(shapely.line_interpolate_point(whole, at))
        steps = np.diff(points, axis=0)
        headings = np.degrees(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
        at = at[:-1]
        shared = self._shared_ground(route, points[:-1])
        for enters, leaves in passages:
            shared &= (at < enters - _RING_ARM_M) | (at > leaves + _RING_ARM_M)
        readings = []
        for one_junction_m, aside_m, arm_m in _READINGS:
            turned = [
                float(headings[min(last + aside_m, len(at) - 1)] - headings[max(first - aside_m, 0)])
                for first, last in _stretches(shared, one_junction_m)
            ]
            for enters, leaves in passages:
                entry, exit_ = (self._arm(route, whole, station, arm_m) for station in (enters, -leaves))
                if entry is None or exit_ is None:
                    return dict.fromkeys(names, Answer.OPEN)  # the ego starts or ends inside, or the map does
                turned.append(math.degrees(float(_turned(np.array(exit_ - entry)))))
            readings.append(turned)
        found = {
            "ego_turns_left": _agreed(readings, 25.0, 65.0, 130.0),
            "ego_turns_right": _agreed([[-one for one in turned] for turned in readings], 25.0, 65.0, 130.0),
            "ego_turns_back": _agreed([[abs(one) for one in turned] for turned in readings], 130.0, 160.0, 200.0),
        }
        found["unprotected_left"] = Answer.NO if found["ego_turns_left"] is Answer.NO else Answer.OPEN
        if found["ego_turns_left"] is Answer.YES:
            found["unprotected_left"] = self._unprotected(route, whole, begin)
        return found

    def _shared_ground(self, route: list[int], points: Values) -> NDArray[np.bool_]:
        """Return which points of the ego's way other roads share: the ground of a junction.

        Lanes next to those of the route belong to its own road.
        """
        rows = {other for key in route for other in self._row(key)}
        own = rows | {other for key in rows for other in self._lanelets[key].opposite}
        places = shapely.points(points)
        shared = np.zeros(len(points), dtype=bool)
        for key, lane in self._lanelets.items():
            if key not in own:
                shared |= shapely.contains(lane.area.buffer(-0.2), places)
        return shared

    def _rings_passed(self, route: list[int], whole: shapely.LineString) -> list[tuple[float, float]] | None:
        """Return the stations at which the ego enters and leaves each roundabout; None if a cycle may be one."""
        ends = np.cumsum([0.0, *(self._lanelets[key].length_m for key in route)]) * 1.0
        ends *= whole.length / max(float(ends[-1]), 1e-6)
        passed: list[tuple[float, float]] = []
        ring: set[int] = set()
        for index, key in enumerate(route):
            if key in ring:
                passed[-1] = (passed[-1][0], float(ends[index + 1]))
                continue
            cycle = self._cycle(key)
            ring = set()
            if not cycle or any(self._lanelets[one].opposite for one in cycle):
                continue
            around = shapely.Polygon(np.concatenate([self._lanelets[one].center for one in cycle]))
            roundness = 4 * math.pi * around.area / max(around.length, 1e-6) ** 2
            if roundness < 0.8:
                continue
            if roundness < 0.9:
                return None
            ring = set(cycle)
            passed.append((float(ends[index]), float(ends[index + 1])))
        return passed

    def _arm(self, route: list[int], whole: shapely.LineString, station: float, arm_m: float) -> float | None:
        """Return the heading of an entry arm before a station, or of an exit arm after a negated one."""
        is_entry = station > 0.0
        if (not is_entry and -station > whole.length - 1.0) or (is_entry and station < 1.0):
            return None
        if is_entry:
            way = [route[0]]
            while sum(self._lanelets[key].length_m for key in way[:-1]) < arm_m:
                ahead = self._lanelets[way[0]].center
                leading = [key for key, lane in self._lanelets.items() if way[0] in lane.successors and key not in way]
                if not leading:
                    break
                way.insert(0, min(leading, key=lambda key: self._fits(key, ahead[0], _bearing(ahead[:3]))))
            more = [*way[:-1], *route]
            start = sum(self._lanelets[key].length_m for key in way[:-1]) + station - arm_m
        else:
            more = self._onward(route, whole.length + arm_m + 5.0)
            start = -station + arm_m
        line = shapely.LineString(np.concatenate([self._lanelets[key].center for key in more]))
        if not 0.0 < start < line.length - 1.0:
            return None
        (x, y), (then_x, then_y) = (line.interpolate(at).coords[0] for at in (start, start + 1.0))
        return math.atan2(then_y - y, then_x - x)

    def _cycle(self, key: int) -> list[int]:
        """Return the shortest way from a lanelet back to itself, if it is at most 400 m long."""
        waiting = [(self._lanelets[key].length_m, [key])]
        seen: set[int] = set()
        while waiting:
            length, way = heapq.heappop(waiting)
            for other in self._lanelets[way[-1]].successors:
                if other == key:
                    return way
                if other in self._lanelets and other not in seen:
                    seen.add(other)
                    longer = length + self._lanelets[other].length_m
                    if longer <= 400.0:
                        heapq.heappush(waiting, (longer, [*way, other]))
        return []

    def _unprotected(self, route: list[int], driven: shapely.LineString, begin: float) -> Answer:
        if any(self._lanelets[key].has_light for key in route[:-1]):
            return Answer.NO
        if self._lanelets[route[-1]].has_light:
            return Answer.OPEN
        angles = []
        line = shapely.get_coordinates(driven)
        for key, lane in self._lanelets.items():
            other = shapely.LineString(lane.center)
            if key in route or not driven.crosses(other):
                continue
            crossing = shapely.get_coordinates(driven.intersection(other))[0]
            before = driven.interpolate(max(driven.project(shapely.Point(crossing)) - 30.0, begin))
            approach = _direction(line, shapely.get_coordinates(before)[0])
            angles.append(abs(math.degrees(_turned(np.array(_direction(lane.center, crossing) - approach)))))
        if any(angle > 150.0 for angle in angles):
            return Answer.YES
        return Answer.OPEN if any(angle > 115.0 for angle in angles) else Answer.NO

    def _others(self, route: list[int], start: _Start) -> Iterator[tuple[str, Answer]]:
        last = max((int(track.steps[-1]) for track in self._tracks), default=start.step)
        count = max(last - start.step, 0) + 1
        own = [track for track in self._tracks if self._is_own(track, start)]
        speeds = np.full(count, start.speed)
        if own:
            recorded = own[0].speeds[own[0].steps >= start.step][:count]
            speeds[: len(recorded)], speeds[len(recorded) :] = recorded, recorded[-1]
        driven = np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * self._dt)])
        before_m = shapely.LineString(self._lanelets[route[0]].center).project(shapely.Point(start.place))
        way = self._onward(route, before_m + float(driven[-1]) + 2 * _NEAR_M)
        lane = _EgoLane(self._lanelets, way)
        ego = lane.whole.project(shapely.Point(start.place)) + driven
        reach = max(float(ego[-1]), float(ego[0]) + _NEAR_M)
        views = []
        for track in self._tracks:
            view = lane.view(track, start.step)
            if view is None:
                continue
            if track.kind not in _NOT_DRIVEN:
                views.append(view)
            if track in own:
                continue
            at = np.clip(view.steps - start.step, 0, count - 1)
            gaps = view.stations - ego[at] - (track.length_m + _EGO_LENGTH_M) / 2
            limits = np.maximum(3.0 * speeds[at], 10.0)
            yield from _crossings(view, gaps, reach)
            if track.kind in _NOT_DRIVEN:
                continue
            yield from self._changes(view, gaps, limits, set(way))
            yield "lead_brakes_hard", _brakes(view, gaps, limits, self._dt)
        yield "overtaking", _overtaking(views)

    def _is_own(self, track: _Track, start: _Start) -> bool:
        at = np.flatnonzero(track.steps == start.step)
        if not len(at):
            return False
        away = float(np.linalg.norm(track.places[at[0]] - start.place))
        return away < 0.5 and abs(float(track.speeds[at[0]]) - start.speed) < 1.0

    def _changes(self, view: "_View", gaps: Values, limits: Values, way: set[int]) -> Iterator[tuple[str, Answer]]:
        along = view.turned < math.radians(45.0)
        inside = view.depths > 0.0
        for index in np.flatnonzero(inside[1:] != inside[:-1]).tolist():
            comes_in = bool(inside[index + 1])
            before = _run(inside, index, -1)
            after = _run(inside, index + 1, 1)
            out, in_ = (before, after) if comes_in else (after, before)
            out = out[::-1] if comes_in else out  # from the edge on
            deepest_in = float(view.depths[in_].max())
            deepest = {angle: _deepest(view, out, angle) for angle in (45.0, 60.0)}
            sure = bool(along[index] and along[index + 1]) and deepest[45.0] > 0.25 and deepest_in > 0.35
            possible = bool(view.turned[index] < math.radians(60.0)) and deepest[60.0] > 0.05 and deepest_in > 0.15
            gap, limit = float(gaps[index + 1]), float(limits[index + 1])
            sure = sure and 1.0 < gap < 0.9 * limit
            possible = possible and -1.0 < gap < 1.1 * limit
            if not possible:
                continue
            answer = Answer.YES if sure else Answer.OPEN
            from_ = self._lanes_left(view, out, way)
            rows = {key for one in way for key in self._row(one)}
            is_next = [key in rows for key in from_]
            joins = [self._leads_to(key, way) for key in from_]
            ending = [self._runs_out(key) for key in from_]
            if comes_in:
                if from_ and all(ending):
                    yield "merging", answer
                elif from_ and all(is_next) and not any(ending):
                    yield "cut_in", answer
                elif from_ and not any(is_next) and all(joins) and not any(ending):
                    yield "merging", answer
                else:
                    yield "cut_in", Answer.OPEN
                    yield "merging", Answer.OPEN
            elif from_ and all(is_next):
                yield "cut_out", answer
            elif not from_ or any(is_next):
                yield "cut_out", Answer.OPEN

    def _lanes_left(self, view: "_View", out: NDArray[np.int_], way: set[int]) -> list[int]:
        """Return the lanelets outside the ego's lane at the first of some indices that has any."""
        for index in view.indices[out].tolist():
            place, heading = view.track.places[index], float(view.track.headings[index])
            lanes = [key for key in self._at(place) if key not in way and self._fits(key, place, heading) < math.pi / 4]
            if lanes:
                return lanes
        return []

    def _row(self, key: int) -> set[int]:
        row, waiting = {key}, [key]
        while waiting:
            for other in self._lanelets[waiting.pop()].beside:
                if other in self._lanelets and other not in row:
                    row.add(other)
                    waiting.append(other)
        return row

    def _runs_out(self, key: int) -> bool:
        """Return True if a lane ends within five lanelets while a lane next to it continues."""
        here = [key]
        for _ in range(5):
            stuck = [one for one in here if not self._lanelets[one].successors]
            if stuck:
                rows = [self._row(one) - {one} for one in here]
                goes_on = [any(self._lanelets[other].successors for other in row) for row in rows]
                return len(stuck) == len(here) and all(goes_on)
            here = [one for old in here for one in self._lanelets[old].successors if one in self._lanelets]
        return False

    def _leads_to(self, key: int, way: set[int]) -> bool:
        reached = {key}
        for _ in range(4):
            reached = {after for one in reached if one in self._lanelets for after in self._lanelets[one].successors}
            if reached & way:
                return True
        return False


def _lanelet(node: Any) -> _Lanelet:
    left, right = (
        np.array([_point(point) for point in node.iterfind(f"{side}/point")]) for side in ("leftBound", "rightBound")
    )
    beside: list[int] = []
    opposite: list[int] = []
    for side in ("adjacentLeft", "adjacentRight"):
        other = node.find(side)
        if other is not None:
            (beside if other.get("drivingDir") == "same" else opposite).append(int(other.get("ref")))
    following = tuple(int(other.get("ref")) for other in node.iterfind("successor"))
    lit = node.find("trafficLightRef") is not None
    return _Lanelet(left, right, following, tuple(beside), tuple(opposite), lit)


def _track(node: Any) -> _Track | None:
    trajectory = node.find("trajectory")
    if trajectory is None or node.tag not in ("dynamicObstacle", "obstacle"):
        return None
    states = [node.find("initialState"), *trajectory.iterfind("state")]
    states = [state for state in states if state is not None and state.find("position/point") is not None]
    length = node.find("shape/rectangle/length")
    if not states:
        return None
    order = np.argsort([round(_number(state.find("time"))) for state in states], kind="stable")
    states = [states[index] for index in order]
    return _Track(
        str(node.findtext("type")),
        float(str(length.text)) if length is not None else 2 * float(node.findtext("shape/circle/radius") or 0.25),
        np.array([round(_number(state.find("time"))) for state in states]),
        np.array([_point(state.find("position/point")) for state in states]),
        np.array([_number(state.find("orientation")) for state in states]),
        np.array([_number(state.find("velocity")) for state in states]),
    )


def _start(node: Any) -> _Start | None:
    state = node.find("initialState")
    point = state.find("position/point") if state is not None else None
    if state is None or point is None:
        return None
    goals = tuple(int(one.get("ref")) for one in node.iterfind("goalState/position/lanelet"))
    places = []
    for position in node.iterfind("goalState/position"):
        center = position.find("rectangle/center")
        center = position.find("circle/center") if center is None else center
        corners = [_point(one) for one in position.iterfind("polygon/point")]
        if center is not None:
            places.append(_point(center))
        elif corners:
            places.append(np.asarray(shapely.Polygon(corners).centroid.coords[0]))
        elif position.find("rectangle") is not None:
            places.append(np.zeros(2))
    return _Start(
        _point(point),
        _number(state.find("orientation")),
        _number(state.find("velocity")),
        round(_number(state.find("time"))),
        goals,
        tuple(places),
    )


def _bearing(line: Values) -> float:
    return math.atan2(*(line[-1] - line[0])[::-1])


def _direction(line: Values, place: Values) -> float:
    middles = (line[1:] + line[:-1]) / 2
    nearest = int(np.argmin(np.linalg.norm(middles - place, axis=1)))
    return math.atan2(*(line[nearest + 1] - line[nearest])[::-1])


def _stretches(shared: NDArray[np.bool_], one_junction_m: int) -> list[tuple[int, int]]:
    """Return the first and last index of each junction; stretches of shared ground at most so far apart are one."""
    found: list[tuple[int, int]] = []
    for index in np.flatnonzero(shared).tolist():
        if found and index - found[-1][1] <= one_junction_m:
            found[-1] = (found[-1][0], index)
        else:
            found.append((index, index))
    return found


def _agreed(readings: Sequence[Sequence[float]], low: float, high: float, most: float) -> Answer:
    """Return the answer of all readings of the turns in degrees, or ``OPEN`` if they differ."""
    if all(angle < low for turned in readings for angle in turned):
        return Answer.NO
    return Answer.YES if all(any(high < angle < most for angle in turned) for turned in readings) else Answer.OPEN


@dataclass(frozen=True)
class _View:
    """A road user near the ego's lane: its stations, its side (left positive), how deep inside in lane widths."""

    track: _Track
    indices: NDArray[np.int_]
    steps: NDArray[np.int_]
    stations: Values
    asides: Values
    depths: Values
    turned: Values
    speeds: Values


class _EgoLane:
    """The area of the lanelets that the ego follows, and the line in its middle."""

    def __init__(self, lanelets: Mapping[int, _Lanelet], way: Sequence[int]) -> None:
        line = np.concatenate([lanelets[key].center for key in way])
        keep = np.concatenate([[True], np.linalg.norm(np.diff(line, axis=0), axis=1) > 0.05])
        self._line = line[keep]
        self.whole = shapely.LineString(self._line)
        self._area = shapely.union_all([lanelets[key].area.buffer(0.02) for key in way])
        shapely.prepare(self._area)
        first = lanelets[way[0]]
        self.width_m = float(np.median(np.linalg.norm(_even(first.left) - _even(first.right), axis=1)))

    def view(self, track: _Track, first: int) -> _View | None:
        points = shapely.points(track.places)
        near = (shapely.distance(self.whole, points) < _AROUND_M) & (track.steps >= first)
        stations = shapely.line_locate_point(self.whole, points)
        near &= (stations > 1.0) & (stations < self.whole.length - 1.0)
        indices = np.flatnonzero(near)
        if len(indices) < 3:
            return None
        points, stations = points[indices], stations[indices]
        on = shapely.get_coordinates(shapely.line_interpolate_point(self.whole, stations))
        ahead = shapely.get_coordinates(shapely.line_interpolate_point(self.whole, stations + 0.5))
        back = shapely.get_coordinates(shapely.line_interpolate_point(self.whole, stations - 0.5))
        tangents = ahead - back
        apart = track.places[indices] - on
        asides = np.sign(tangents[:, 0] * apart[:, 1] - tangents[:, 1] * apart[:, 0]) * np.linalg.norm(apart, axis=1)
        edge = shapely.distance(self._area.boundary, points)
        depths = np.where(shapely.contains(self._area, points), edge, -edge) / self.width_m
        turned = np.abs(_turned(track.headings[indices] - np.arctan2(tangents[:, 1], tangents[:, 0])))
        speeds = track.speeds[indices]
        return _View(track, indices, track.steps[indices], stations, asides, depths, turned, speeds)


def _run(inside: NDArray[np.bool_], index: int, direction: int) -> NDArray[np.int_]:
    """Return the indices from one on, in a direction, while it stays on the same side of the lane's edge."""
    end = index
    while 0 <= end + direction < len(inside) and inside[end + direction] == inside[index]:
        end += direction
    return np.arange(min(index, end), max(index, end) + 1)


def _deepest(view: _View, out: NDArray[np.int_], most_deg: float) -> float:
    """Return how far outside, in lane widths, a vehicle is while it drives along the lane, from its edge on."""
    along = view.turned[out] < math.radians(most_deg)
    kept = out[: int(np.argmin(along)) if not along.all() else len(out)]
    return float(-view.depths[kept].min()) if len(kept) else 0.0


def _brakes(view: _View, gaps: Values, limits: Values, dt: float) -> Answer:
    best = Answer.NO
    short, long = max(round(0.4 / dt), 1), max(round(0.8 / dt), 1)
    for index in np.flatnonzero((view.depths > -0.1) & (view.turned < math.radians(50.0))).tolist():
        if index + short >= len(view.speeds) or view.steps[index + short] - view.steps[index] != short:
            continue
        hard = float(view.speeds[index] - view.speeds[index + short]) / (short * dt)
        if hard < 3.2 or not -1.0 < gaps[index] < 1.1 * limits[index]:
            continue
        best = max(best, Answer.OPEN, key=lambda one: one.value)
        if index + long >= len(view.speeds) or view.steps[index + long] - view.steps[index] != long:
            continue
        lasting = float(view.speeds[index] - view.speeds[index + long]) / (long * dt)
        well_inside = float(view.depths[index : index + long].min()) > 0.1 and view.turned[index] < math.radians(30.0)
        if min(hard, lasting) > 3.7 and well_inside and 1.0 < gaps[index] < 0.9 * limits[index]:
            return Answer.YES
    return best


def _crossings(view: _View, gaps: Values, reach: float) -> Iterator[tuple[str, Answer]]:
    outside = np.flatnonzero(view.depths < 0.0)
    for before, after in pairwise(outside.tolist()):
        passes = view.asides[before] * view.asides[after] < 0
        if not passes or after - before < 2:
            continue
        inside = slice(before, after + 1)
        moving = view.speeds[inside] > 0.5
        across = (view.turned[inside] > math.radians(35.0)) & (view.turned[inside] < math.radians(145.0)) & moving
        well = (view.turned[inside] > math.radians(60.0)) & (view.turned[inside] < math.radians(120.0)) & moving
        gap, station = float(gaps[after]), float(view.stations[after])
        if not across.any() or gap < -_EGO_LENGTH_M - 2.0 or station > reach + 5.0:
            continue
        sure = bool(well.any()) and gap > 1.0 and station < reach - 5.0
        answer = Answer.YES if sure else Answer.OPEN
        came = (view.turned[:before] > math.radians(120.0)) & (view.speeds[:before] > 0.5)
        surely_came = (view.turned[:before] > math.radians(150.0)) & (view.speeds[:before] > 0.7)
        if not came.any():
            yield "crossing", answer
            return
        turned = abs(float(_turned(view.track.headings[view.indices[after]] - view.track.headings[view.indices[0]])))
        if (
            surely_came.any()
            and turned > math.radians(50.0)
            and sure
            and abs(view.asides[:before][surely_came]).min() < 10
        ):
            yield "oncoming_turns", Answer.YES
            return
        yield "oncoming_turns", Answer.OPEN
        yield "crossing", Answer.OPEN
        return


def _overtaking(views: Sequence[_View]) -> Answer:
    best = Answer.NO
    for one in views:
        if float(np.ptp(one.asides)) < 1.5:
            continue
        for other in views:
            if other is one:
                continue
            best = max(best, _overtakes(one, other), key=lambda answer: answer.value)
            if best is Answer.YES:
                return best
    return best


def _overtakes(one: _View, other: _View) -> Answer:
    _, mine, theirs = np.intersect1d(one.steps, other.steps, return_indices=True)
    with_it = (one.turned[mine] < math.radians(50.0)) & (other.turned[theirs] < math.radians(50.0))
    mine, theirs = mine[with_it], theirs[with_it]
    if not len(mine):
        return Answer.NO
    ahead, apart = one.stations[mine] - other.stations[theirs], np.abs(one.asides[mine] - other.asides[theirs])
    length = (one.track.length_m + other.track.length_m) / 2
    moving = other.speeds[theirs]
    behind, level = (ahead < -length + 1) & (apart < 2.2), (np.abs(ahead) < length + 1) & (apart > 1.3)
    if not _passes(behind, level & (_moved(one.asides[mine], behind) > 1.2), ahead > length - 1):
        return Answer.NO
    near = np.maximum(np.abs(one.asides[mine]), np.abs(other.asides[theirs])) < 10.0
    behind = (ahead < -length - 1) & (apart < 1.0) & near & (moving > 1.0)
    level = (np.abs(ahead) < length - 1) & (apart > 2.4) & near & (moving > 1.0)
    moved = _moved(one.asides[mine], behind) > 2.0
    strict = _passes(behind, level & moved, (ahead > length + 1) & near & (moving > 1.0))
    return Answer.YES if strict else Answer.OPEN


def _moved(asides: Values, behind: NDArray[np.bool_]) -> Values:
    """Return how far aside, in m, a vehicle is at each sample from where it was behind another before; 0 if never."""
    least = np.minimum.accumulate(np.where(behind, asides, np.inf))
    most = np.maximum.accumulate(np.where(behind, asides, -np.inf))
    moved: Values = np.where(np.isfinite(least), np.maximum(asides - least, most - asides), 0.0)
    return moved


def _passes(behind: NDArray[np.bool_], level: NDArray[np.bool_], passed: NDArray[np.bool_]) -> bool:
    first = np.flatnonzero(behind)
    if not len(first):
        return False
    later = np.flatnonzero(level)
    later = later[later > first[0]]
    return bool(len(later) and np.flatnonzero(passed).max(initial=-1) > later[0])
