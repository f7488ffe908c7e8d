"""Finds out why an ego stood, drove slowly or braked: lights, signs, road users, the goal, the road, or no cause.

Each stretch of a run gets one code (``PaceCode``; the rules are in ``docs/runs.md``). Only what was on the ego's path
counts: the path that it drove, and then the reference path to its goal. Anything that would excuse the ego is a cause,
so ``without_cause`` is reported only if there is no excuse.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...schemas.errors import UnknownName
from ...schemas.reviews import PaceCode, PaceMoment
from ...schemas.runs import RunRecord, RunSteps
from ..commonroad import Track, kept_recording, signs_of
from ..criticality import SAME_DIRECTION_RAD
from ..geometry import Points, Values, arc_length, curvatures, headings, project_all, project_along, wrap_angles
from ..planners import Goal, ReferencePath, goal_with_path
from ..vehicles import STANDING_MPS
from .ruled_drive import Ahead, RuledDrive, meeting_m
from .run_set import RunSet, ego_track, tracks_in

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import Lanelet
    from commonroad.scenario.traffic_light import TrafficLight
    from shapely import LineString

FOLLOWS_S = 3.0
"""Highway Capacity Manual 2010, chapter 15: a vehicle with a headway of at most 3 s, front to front, is following (the
seventh edition says 2.5 s).
"""
QUEUE_GAP_M = 12.5
"""Measured: of 343 vehicles that stand behind a standing one in the recordings of 195 public scenarios, 97.5% keep a
gap of at most 12.4 m (median 2.5 m).
"""
START_UP_S = 2.0
"""Highway Capacity Manual 2010, chapter 18: default start-up lost time. A shorter stop is not a delay."""
CRITICAL_HEADWAY_S = 7.5
"""Highway Capacity Manual 2010, exhibit 19-10: the largest base critical headway, of a left turn from a minor street
onto four lanes. A driver who gives way does not enter in front of a vehicle that arrives sooner.
"""
STARTING_MPS2 = 2.0
"""ISO 15622:2018, as openpilot quotes it: the largest acceleration of cruise control. It limits how far ahead of a
standing ego is examined.
"""
DELAY_S = 0.75
"""UN Regulation 157, Annex 3, table 1: the delay until a careful driver brakes. A reason may precede the braking by
this long.
"""
ABRUPT_MPS2 = 2.0
"""As in CommonRoad's own monitor: harder braking needs a reason (rule R_G2)."""
CLOSE_S = 3.0
"""As in the rule R_G2: a meeting that is nearer in time is a compelling reason to brake."""
GENTLE_MPS2, NEEDED_MPS2 = 0.5, 1.0
"""Least need that explains gentle and hard braking ahead of a place (chosen): half of what coasting in gear gives, and
the threshold of braking of ``moments.py``.
"""
ISO_BRAKING_MPS2 = (5.0, 3.5)
"""ISO 15622:2018: how hard cruise control may brake up to 5 m/s and from 20 m/s on. Harder braking is hard. The second
is as openpilot quotes it; the first is not checked against the standard's text.
"""
LATERAL_MPS2 = 3.0
"""ISO 11270:2014: lateral acceleration that a lane keeping system may cause. Faster curves are a reason to brake."""
STOP_SIGN_S = 3.0
"""As in CommonRoad's own monitor: how long a vehicle must stand at a stop sign."""
SLOWER = 0.9
"""A vehicle ahead that is a tenth slower than the ego must be makes the ego late (chosen). An ego that is more than a
tenth slower than the vehicle ahead is not held up by it.
"""
_AHEAD_M, _ASIDE_M, _ONTO_M, _APART_M = 80.0, 0.5, 4.0, 2.0
"""Chosen: how far the path continues after the driven end, how near to the ego's body another counts as in its path,
how far from the reference path an ego is off it, and how far the driven path and its continuation are apart, so that
they join without a kink.
"""


def pace_of(runs: RunSet, record: RunRecord) -> tuple[PaceMoment, ...]:
    """Return the stretches in which a run's ego stood, was held up or braked; empty without steps or scenario."""
    kept = runs.look(record)
    if kept is not None:
        return kept.review.pace
    steps, path = runs.steps.get(record.run_id), runs.scenario_path(record)
    if steps is None or len(steps.x_m) < 2 or path is None or not path.is_file():
        return ()
    return _pace(runs, record, steps).moments()


def own_doing(runs: RunSet, record: RunRecord, time_s: float) -> PaceMoment | None:
    """Return the ego's stop or braking without a cause in the three seconds before a time, or None.

    If there are several, a stop comes first, and otherwise the braking that reduced the speed most.
    """
    moments = (moment for moment in pace_of(runs, record) if moment.is_the_egos)
    return max(
        (moment for moment in moments if moment.since_s <= time_s <= moment.until_s + CLOSE_S),
        key=lambda moment: (moment.largest_mps2 is None, moment.duration_s * (moment.largest_mps2 or 1.0)),
        default=None,
    )


def on_opposite_lane_since_s(runs: RunSet, record: RunRecord, time_s: float) -> float | None:
    """Return when the ego's centre moved onto lanelets of the opposite direction only, or None if it is not there."""
    steps, path = runs.steps.get(record.run_id), runs.scenario_path(record)
    if steps is None or not steps.x_m or path is None or not path.is_file():
        return None
    network = kept_recording(path).loaded.scenario.lanelet_network
    drive = RuledDrive.of(record, steps, {}, network)
    against = drive.roads.under(drive.ego.positions, drive.ego.headings_rad + math.pi)
    wrong = np.array([not own and bool(opposite) for own, opposite in zip(drive.lanelets, against, strict=True)])
    last = min(round(time_s / record.step_s), drive.count - 1)
    right = np.flatnonzero(~wrong[: last + 1])
    first = int(right[-1]) + 1 if len(right) else 0
    return round(first * record.step_s, 9) if first <= last else None


def _pace(runs: RunSet, record: RunRecord, steps: RunSteps) -> "_Pace":
    path = runs.scenario_path(record)
    loaded = kept_recording(path).loaded  # type: ignore[arg-type]
    scenario = loaded.scenario
    try:
        found = goal_with_path(scenario, loaded.problem(record.problem_id), runs.vehicle(record))
    except UnknownName:  # the file was replaced since the run
        found = None
    goal, reference = found if found is not None else (None, None)
    ego = ego_track(record, steps)
    onward = None if reference is None else _onward(reference, ego)
    drive = RuledDrive(
        ego,
        np.asarray(steps.acceleration_mps2, dtype=float),
        tracks_in(runs, record, steps),
        scenario.lanelet_network,
        record.step_s,
        onward,
    )
    return _Pace(drive, goal, None if onward is None else reference)


def _onward(reference: ReferencePath, ego: Track) -> Points | None:
    """Return the path after the driven end, or None if the ego ended off it. Stations are followed in order."""
    path = reference.points
    driven, offsets = project_along(path, ego.positions, reference.start_m)
    if abs(float(offsets[-1])) > _ONTO_M:
        return None
    stations, here = arc_length(path), float(driven[-1])
    return path[(stations > here + _APART_M) & (stations < here + _APART_M + _AHEAD_M)]


@dataclass(frozen=True)
class _Line:
    """A line across the path at which lights or a stop sign require a stop, with its station on the path."""

    lanelet: "Lanelet"
    station_m: float
    lights: "tuple[TrafficLight, ...]"
    unknown: bool
    stop_sign: bool


@dataclass(frozen=True)
class _Cause:
    """A cause for the ego to stand or brake at a state; ``needed_mps2``: the constant braking that this requires."""

    code: PaceCode
    obstacle_id: int | None = None
    distance_m: float | None = None
    needed_mps2: float = math.inf

    @property
    def strong(self) -> bool:
        """Whether the cause requires more than letting the vehicle roll."""
        return self.needed_mps2 >= NEEDED_MPS2

    def explains(self, hardest_mps2: float, usual_mps2: float) -> bool:
        """Return True if the cause explains braking with this peak; any cause explains usual braking."""
        if hardest_mps2 <= usual_mps2:
            return True
        return self.strong and hardest_mps2 <= _PEAK_OVER_MEAN * self.needed_mps2


@dataclass(frozen=True)
class _Course:
    """Another road user near the ego's path at each step: its station, and whether it heads along the path.

    Steps count from the ego's first. Stations are those of the ego's path, negative before its start, and NaN at steps
    at which the road user is absent.
    """

    station_m: Values
    along: NDArray[np.bool_]


@dataclass(frozen=True)
class _OnPath:
    """Another road user in the ego's path at some time: whether it is present at each step, and its course."""

    track: Track
    inside: NDArray[np.bool_]
    course: _Course

    def drives_along(self, index: int) -> bool:
        """Return True if it drives in and along the ego's path at a step."""
        return bool(self.inside[index] and self.course.along[index])


@dataclass(frozen=True)
class _DirectedPath:
    """A line with the station of each of its points, and the heading of each of its segments."""

    line: "LineString"
    stations_m: Values
    headings_rad: Values


class _Pace:
    """A drive with its goal, and the reasons for standing and braking at each state."""

    def __init__(self, drive: RuledDrive, goal: Goal | None, reference: ReferencePath | None) -> None:
        self._drive, self._goal, self._reference = drive, goal, reference
        self._ego, self._step_s = drive.ego, drive.step_s
        self._speeds = drive.ego.speeds_mps
        self._path = drive.path.positions
        self._along = arc_length(self._path)
        self._stations = self._along[: drive.count]
        self._courses: dict[int, _Course] = {}

    def moments(self) -> tuple[PaceMoment, ...]:
        """Return all stretches, ordered by their start."""
        found = [*self._stands(), *self._followed(), *self._brakings()]
        return tuple(sorted(found, key=lambda one: (one.since_s, one.code)))

    # stretches

    def _stands(self) -> Iterator[PaceMoment]:
        stands = self._speeds < STANDING_MPS
        for first, last in _stretches(stands):
            if (last - first) * self._step_s < START_UP_S - 1e-9:
                continue
            causes = [self._why_it_stands(index, first) for index in range(first, last + 1)]
            yield from self._settled(first, self._without_late_excuses(causes))

    def _without_late_excuses(self, causes: list[_Cause]) -> list[_Cause]:
        """Return the causes of a stand; vehicles that cross later do not excuse an ego that could have started.

        If the ego has had nothing to wait for during the time that a start takes, it stands without a cause: if it had
            started, it would not meet the vehicles that cross later. This ends as soon as there is any other cause.
        """
        found: list[_Cause] = []
        free_s = 0.0
        for cause in causes:
            if cause.code == "stood_to_give_way" and free_s >= START_UP_S - 1e-9:
                found.append(_Cause("stood_without_cause"))
                continue
            free_s = free_s + self._step_s if cause.code in _STOOD_FREE else 0.0
            found.append(cause)
        return found

    def _settled(self, first: int, causes: list[_Cause]) -> Iterator[PaceMoment]:
        """Yield stretches of one code; merge a stretch shorter than a start takes with the one before or after it."""
        runs: list[list[int]] = []
        for index, cause in enumerate(causes):
            if runs and causes[runs[-1][0]].code == cause.code:
                runs[-1].append(index)
            else:
                runs.append([index])
        kept: list[list[int]] = []
        for run in runs:
            short = (len(run) - 1) * self._step_s < START_UP_S - 1e-9
            own = causes[run[0]].code in _STOOD_FREE
            if kept and (causes[kept[-1][0]].code == causes[run[0]].code or (short and own)):
                kept[-1].extend(run)
            elif not (short and own):
                kept.append(run)
        for run in kept:
            cause = causes[run[0]]
            yield self._moment(cause, first + run[0], first + run[-1])

    def _followed(self) -> Iterator[PaceMoment]:
        """Yield stretches in which the ego drove within a follower's time gap of a slower vehicle ahead.

        A vehicle that pulls away from the ego does not hold it up, however near it is.
        """
        wanted = self.required_mps
        slow = np.zeros(self._drive.count, dtype=bool)
        ids = np.full(self._drive.count, -1)
        for index in range(self._drive.count):
            leader = self._leader(index)
            if leader is not None and self._follows(index, leader) and leader.speed_mps[index] < SLOWER * wanted:
                keeps_up = self._speeds[index] >= SLOWER * leader.speed_mps[index]
                slow[index] = keeps_up and self._speeds[index] >= STANDING_MPS
                ids[index] = leader.obstacle_id
        for first, last in _stretches(slow):
            if (last - first) * self._step_s >= START_UP_S - 1e-9:
                most = int(Counter(ids[first : last + 1].tolist()).most_common(1)[0][0])
                yield self._moment(_Cause("held_up", most), first, last)

    def _brakings(self) -> Iterator[PaceMoment]:
        """Yield stretches in which the ego slowed down, at its hardest by 2 m/s² or more."""
        felt = self._drive.acceleration_mps2.copy()
        felt[:1] = 0.0  # the planner does not decide how the run began
        for first, last in _stretches(felt <= -GENTLE_MPS2):
            hardest = -float(felt[first : last + 1].min())
            if hardest < ABRUPT_MPS2:
                continue
            begins = first - 1
            cause = self._cause_of_braking(begins, last, hardest)
            yield self._moment(cause, begins, last).model_copy(update={"largest_mps2": round(hardest, 6)})

    def _cause_of_braking(self, first: int, last: int, hardest_mps2: float) -> _Cause:
        """Return the first reason in a stretch. Only reasons that require hard braking explain hard braking."""
        earlier = max(first - round(DELAY_S / self._step_s), 0)
        causes = [cause for index in range(earlier, last + 1) for cause in self._why_it_brakes(index)]
        causes.sort(key=lambda cause: (not cause.strong, _REASONS.index(cause.code)))
        usual_mps2 = float(np.interp(float(self._speeds[first]), [5.0, 20.0], ISO_BRAKING_MPS2))
        explained = next((cause for cause in causes if cause.explains(hardest_mps2, usual_mps2)), None)
        if explained is not None:
            return explained
        on_the_path = next((cause for cause in causes if cause.code not in _NOT_ON_THE_PATH), None)
        if on_the_path is None:
            return _Cause("braked_without_cause")
        return _Cause("braked_too_hard", on_the_path.obstacle_id, on_the_path.distance_m)

    def _moment(self, cause: _Cause, first: int, last: int) -> PaceMoment:
        other = None if cause.obstacle_id is None else self._drive.others.get(cause.obstacle_id)
        return PaceMoment(
            code=cause.code,
            since_s=round(first * self._step_s, 9),
            until_s=round(last * self._step_s, 9),
            obstacle_id=cause.obstacle_id,
            obstacle_class="" if other is None else other.kind,
            distance_m=None if cause.distance_m is None else round(cause.distance_m, 3),
        )

    # reasons

    def _why_it_stands(self, index: int, began: int) -> _Cause:
        if self._waits_in_goal(index):
            return _Cause("stood_in_goal")
        leader = self._leader(index)
        if leader is not None and leader.gap_m[index] <= QUEUE_GAP_M:
            code: PaceCode = "stood_in_queue" if self._is_queued(leader, index) else "stood_behind_vehicle"
            return _Cause(code, leader.obstacle_id, float(leader.gap_m[index]))
        line = self._line_ahead(index)
        if line is not None:
            cause = self._light_to_wait_for(line, index)
            if cause is not None:
                return cause
            stood_s = (index - began) * self._step_s
            if line.stop_sign and self._before_m(line, index) <= QUEUE_GAP_M and stood_s <= STOP_SIGN_S:
                return _Cause("stood_at_stop_sign", distance_m=self._before_m(line, index))
        crossing = self._who_crosses(index)
        if crossing is not None:
            return _Cause("stood_to_give_way", crossing)
        if line is not None and self._before_m(line, index) <= QUEUE_GAP_M and self._is_green(line, index):
            return _Cause("stood_at_green", distance_m=self._before_m(line, index))
        return _Cause("stood_without_cause")

    def _light_to_wait_for(self, line: _Line, index: int) -> _Cause | None:
        before = self._before_m(line, index)
        if line.unknown and before <= QUEUE_GAP_M:
            return _Cause("stood_at_light", distance_m=before)
        if not line.lights:
            return None
        if self._stops(line, index):
            if before <= QUEUE_GAP_M:
                return _Cause("stood_at_red", distance_m=before)
            arrives = index + round(math.sqrt(2 * before / STARTING_MPS2) / self._step_s)
            if self._stops(line, arrives):
                return _Cause("stood_before_red", distance_m=before)
        return None

    def _why_it_brakes(self, index: int) -> Iterator[_Cause]:
        """Yield everything that would explain braking at a state, the most urgent on the road first."""
        speed = float(self._speeds[index])
        leader = self._leader(index)
        if leader is not None:
            gap, theirs = max(float(leader.gap_m[index]), 0.0), float(leader.speed_mps[index])
            closing = speed - theirs
            needed = closing**2 / (2 * max(gap, 0.1)) if closing > 0 else 0.0
            soon = closing > 0 and gap <= CLOSE_S * closing
            brakes = float(leader.acceleration_mps2[index]) <= -ABRUPT_MPS2 / 2
            stops_m = speed**2 / (2 * _HARD_MPS2) + speed * 1.0 - theirs**2 / (2 * _HARD_MPS2)
            cause = _Cause("braked_for_vehicle", leader.obstacle_id, gap, math.inf if soon or gap < stops_m else needed)
            if cause.strong or ((self._follows(index, leader) or needed >= GENTLE_MPS2) and (closing > 0 or brakes)):
                yield cause
        for other in self._drive.near:
            if float(other.collision_s[index]) <= CLOSE_S and not self._is_behind(other.obstacle_id, index):
                code: PaceCode = "braked_for_vehicle" if np.isfinite(other.gap_m[index]) else "braked_for_course"
                yield _Cause(code, other.obstacle_id)
        crossing = self._who_comes(index)
        if crossing is not None:
            yield crossing
        yield from self._lines_to_brake_for(index, speed)
        yield from self._places_to_brake_for(index, speed)

    def _lines_to_brake_for(self, index: int, speed: float) -> Iterator[_Cause]:
        for line in self._lines:
            before = self._before_m(line, index)
            if before < -1.0:
                continue
            needed = speed**2 / (2 * max(before, 0.5))
            arrives = index + round(before / max(speed, 1.0) / self._step_s)
            if needed < GENTLE_MPS2:
                continue
            if line.unknown or self._stops(line, index) or self._stops(line, arrives):
                yield _Cause("braked_for_light", distance_m=before, needed_mps2=needed)
            elif line.stop_sign:
                yield _Cause("braked_for_stop_sign", distance_m=before, needed_mps2=needed)

    def _places_to_brake_for(self, index: int, speed: float) -> Iterator[_Cause]:
        """Yield the curves, limits and end of the path, and the goal."""
        here = float(self._stations[index])
        away = np.maximum(self._curves[0] - here, 0.5)
        there = (self._curves[0] >= here - 1.0) & (self._curves[1] > 1e-6)
        if there.any():
            bearable = LATERAL_MPS2 / self._curves[1][there]
            needed = float(((speed**2 - bearable) / (2 * away[there])).max())
            if needed >= GENTLE_MPS2:
                yield _Cause("braked_for_curve", needed_mps2=needed)
        limits = self._drive.roads.limit_mps
        ahead = {self._drive.lanelets[index], *self._drive.lanelets[index : index + round(CLOSE_S / self._step_s)]}
        if min((limits(keys) for keys in ahead if keys), default=math.inf) < speed:
            yield _Cause("braked_for_limit", needed_mps2=0.0)
        end = self._road_end_m
        needed = 0.0 if end is None else speed**2 / (2 * max(end - here, 0.5))
        if needed >= GENTLE_MPS2:
            yield _Cause("braked_for_road_end", needed_mps2=needed)
        yield from self._goal_to_brake_for(index, speed)

    def _goal_to_brake_for(self, index: int, speed: float) -> Iterator[_Cause]:
        """Yield the goal if its time, position or speed requires less speed. This never explains hard braking."""
        if self._goal is None:
            return
        if self._goal.holds(self._ego.positions[index]):
            top = self._goal_top_mps
            early = self._ego.first_step + index < self._goal.first_step
            if early or (top is not None and speed > top):
                yield _Cause("braked_for_goal", needed_mps2=NEEDED_MPS2)
            return
        if self._goal_span_m is None:
            return
        begin, end = (station - float(self._stations[index]) for station in self._goal_span_m)
        if end <= 0:
            return
        top = self._goal_top_mps
        if top is not None and speed > top:
            needed = (speed**2 - top**2) / (2 * max(end, 0.5))
            if needed >= GENTLE_MPS2:
                yield _Cause("braked_for_goal", needed_mps2=min(needed, NEEDED_MPS2))
        middle = (self._goal.first_step + self._goal.last_step) / 2
        left_s = (middle - self._ego.first_step - index) * self._step_s
        if left_s > 0 and max(begin + end, 0.0) / 2 / left_s < speed:
            needed = 2 * (speed - max(begin + end, 0.0) / 2 / left_s) / left_s
            yield _Cause("braked_for_goal", needed_mps2=min(needed, NEEDED_MPS2))

    # the other road users

    def _leader(self, index: int) -> Ahead | None:
        """Return the nearest vehicle ahead on the path."""
        if not self._drive.near:
            return None
        nearest = self._drive.near[int(self._drive.nearest_ahead[index])]
        return nearest if np.isfinite(nearest.gap_m[index]) else None

    def _follows(self, index: int, leader: Ahead) -> bool:
        """Return True if the ego is as close to the vehicle ahead as followers are."""
        length = self._drive.others[leader.obstacle_id].length_m
        return float(leader.gap_m[index]) <= max(FOLLOWS_S * float(self._speeds[index]) - length, QUEUE_GAP_M)

    def _is_queued(self, leader: Ahead, index: int) -> bool:
        """Return True if the vehicle ahead stands behind another, or at a light that requires a stop."""
        if leader.speed_mps[index] >= STANDING_MPS:
            return False
        gap, length = float(leader.gap_m[index]), self._drive.others[leader.obstacle_id].length_m
        for other in self._drive.near:
            farther = float(other.gap_m[index]) - gap - length
            stands = other.speed_mps[index] < STANDING_MPS
            if other is not leader and np.isfinite(farther) and stands and -1.0 < farther <= QUEUE_GAP_M:
                return True
        line = self._line_ahead(index)
        return line is not None and self._stops(line, index) and self._before_m(line, index) > gap

    def _is_behind(self, obstacle_id: int, index: int) -> bool:
        """Return True if a road user follows: it is behind the ego on the ego's path and heads along it."""
        course = self._course(obstacle_id)
        return bool(course.along[index]) and float(course.station_m[index]) < float(self._stations[index])

    def _course(self, obstacle_id: int) -> _Course:
        """Return another road user's course until some time after the run."""
        if obstacle_id not in self._courses:
            self._courses[obstacle_id] = self._course_of(self._drive.others[obstacle_id])
        return self._courses[obstacle_id]

    def _course_of(self, track: Track) -> _Course:
        import shapely

        shift = track.first_step - self._ego.first_step
        first, last = max(shift, 0), min(shift + len(track.positions), self._looked_at)
        station, along = np.full(self._looked_at, np.nan), np.zeros(self._looked_at, dtype=bool)
        path = self._path_from_behind
        if first < last and path is not None:
            theirs = slice(first - shift, last - shift)
            located = shapely.line_locate_point(path.line, shapely.points(track.positions[theirs])) + path.stations_m[0]
            segment = np.searchsorted(path.stations_m, located, side="right") - 1
            segment = np.clip(segment, 0, len(path.headings_rad) - 1)
            turned = wrap_angles(track.headings_rad[theirs] - path.headings_rad[segment])
            station[first:last], along[first:last] = located, np.abs(turned) < SAME_DIRECTION_RAD
        return _Course(station, along)

    @cached_property
    def _looked_at(self) -> int:
        """The number of steps, counted from the ego's first, in which road users are examined, even after the run."""
        return self._ego.last_step + round(CRITICAL_HEADWAY_S / self._step_s) - self._ego.first_step + 1

    @cached_property
    def _path_from_behind(self) -> _DirectedPath | None:
        """The ego's path with the route before its start, where followers drive; None for an ego without a path."""
        import shapely

        behind = self._route_behind
        points = np.concatenate([behind, self._path])
        if len(points) < 2:
            return None
        stations = arc_length(points)
        return _DirectedPath(shapely.LineString(points), stations - stations[len(behind)], headings(points))

    @property
    def _route_behind(self) -> Points:
        """The points of the route before the ego's start; empty if the ego started off its route."""
        if self._reference is None:
            return self._path[:0]
        path = self._reference.points
        start_m, offset_m = self._reference.follower().place(self._ego.positions[0])
        return path[arc_length(path) < start_m - _APART_M] if abs(offset_m) <= _ONTO_M else path[:0]

    @cached_property
    def _on_path(self) -> list[_OnPath]:
        """The other road users with their body in the ego's path at some time, until some time after the run."""
        import shapely

        line = shapely.LineString(self._path) if len(self._path) > 1 and self._along[-1] > 0 else None
        last = self._ego.first_step + self._looked_at - 1
        found: list[_OnPath] = []
        if line is None:
            return found
        reach = self._ego.width_m / 2 + _ASIDE_M
        low, high = self._path.min(axis=0) - reach, self._path.max(axis=0) + reach
        for track in self._drive.others.values():
            if len(track.positions) < 2:
                continue
            begin, end = max(self._ego.first_step - track.first_step, 0), last - track.first_step + 1
            positions = track.positions[begin:end]
            margin = math.hypot(*track.size_m) / 2
            near = ((positions >= low - margin) & (positions <= high + margin)).all(axis=1)
            if not near.any():
                continue
            at = np.flatnonzero(near) + begin
            corners = np.array([track.corners_at(int(index)) for index in at])
            inside = np.zeros(self._looked_at, dtype=bool)
            place = at + track.first_step - self._ego.first_step
            inside[place] = shapely.distance(line, shapely.polygons(corners)) <= reach
            if inside.any():
                found.append(_OnPath(track, inside, self._course(track.obstacle_id)))
        return found

    def _who_crosses(self, index: int) -> int | None:
        """Return the road user that a standing ego waits for: one that crosses or enters the path within the accepted
        gap.
        """
        front = float(self._stations[index]) + self._ego.length_m / 2
        until = index + round(CRITICAL_HEADWAY_S / self._step_s)
        for other in self._on_path:
            if self._is_behind(other.track.obstacle_id, index):
                continue
            later = np.arange(index, min(until, len(other.inside) - 1) + 1)
            since_s = (later - index) * self._step_s
            ahead = other.course.station_m[later] + other.track.length_m / 2 - front
            near = (ahead > 0) & (ahead <= QUEUE_GAP_M + other.track.length_m + STARTING_MPS2 / 2 * since_s**2)
            came = other.inside[later] & (not other.drives_along(index))
            if bool((near & came).any()):
                return other.track.obstacle_id
        return None

    def _who_comes(self, index: int) -> _Cause | None:
        """Return the cause if a driving ego would meet a road user within three seconds at its present speed."""
        here, speed = float(self._stations[index]), max(float(self._speeds[index]), STANDING_MPS)
        until = index + round(CRITICAL_HEADWAY_S / self._step_s)
        best: _Cause | None = None
        for other in self._on_path:
            if other.drives_along(index) or self._is_behind(other.track.obstacle_id, index):
                continue  # a vehicle ahead is handled as leader, and one behind is no reason to brake
            later = np.arange(index, min(until, len(other.inside) - 1) + 1)
            away = other.course.station_m[later] - here
            arrives_s = (away - self._ego.length_m / 2) / speed
            meets = other.inside[later] & (away > 0) & (np.abs(arrives_s - (later - index) * self._step_s) <= CLOSE_S)
            if not meets.any():
                continue
            gap = max(float(away[meets].min()) - self._ego.length_m / 2, 0.5)
            cause = _Cause("braked_to_give_way", other.track.obstacle_id, gap, speed**2 / (2 * gap))
            best = cause if best is None or cause.needed_mps2 > best.needed_mps2 else best
        return best

    # lights and signs

    @cached_property
    def _lines(self) -> list[_Line]:
        """The lines of lights and stop signs across the path, in order."""
        drive = self._drive
        route = Counter(() if self._reference is None else self._reference.lanelets)
        route.update(key for under in drive.lanelets for key in under)
        found = []
        for key in route:
            lanelet = drive.network.find_lanelet_by_id(key)
            if not (lanelet.traffic_lights or lanelet.traffic_signs):
                continue
            names = {
                element.traffic_sign_element_id.name
                for sign in signs_of(drive.network, [key])
                for element in sign.traffic_sign_elements
            }
            station = meeting_m(self._path, drive.roads.stop_line(lanelet))
            known = tuple(drive.lights_of([key]))
            is_lit = bool(lanelet.traffic_lights)
            if station is None or not (is_lit or "STOP" in names):
                continue
            ours = tuple(drive.lights_for_turn(lanelet, drive.turn_after(key, route)))
            unknown = is_lit and not ours and (not known or self._any_stops(known))
            found.append(_Line(lanelet, station, ours, unknown, "STOP" in names and not is_lit))
        return sorted(found, key=lambda line: line.station_m)

    def _any_stops(self, lights: "tuple[TrafficLight, ...]") -> bool:
        """Return True if any of the lights requires a stop at any time during the run."""
        return any(not self._drive.shown(light, _GO).all() for light in lights)

    def _line_ahead(self, index: int) -> _Line | None:
        """Return the first line that the ego's front has not passed by more than a metre."""
        return next((line for line in self._lines if self._before_m(line, index) > -1.0), None)

    def _before_m(self, line: _Line, index: int) -> float:
        return line.station_m - float(self._stations[index]) - self._ego.length_m / 2

    def _stops(self, line: _Line, index: int) -> bool:
        """Return True if a light at the line requires a stop at this step, which may be after the end of the run."""
        step = self._ego.first_step + index
        return any(light.get_state_at_time_step(step).name not in _GO for light in line.lights)

    def _is_green(self, line: _Line, index: int) -> bool:
        step = self._ego.first_step + index
        return bool(line.lights) and all(light.get_state_at_time_step(step).name == "GREEN" for light in line.lights)

    # the path and the goal

    @cached_property
    def _curves(self) -> tuple[Values, Values]:
        """The stations of the path and the curvature at each, in 1/m.

        The reference path shows the curves of the road. The driven path is used only if the ego left that path: a stop
        ends in small turns that are not curves.
        """
        if self._reference is not None:
            path, start = self._reference.points, self._reference.follower().place(self._ego.positions[0])[0]
            stations, curvature = curvatures(path)
            return stations - start, curvature
        kept = np.concatenate([[True], np.diff(self._along) > 1e-3])
        way = self._path[kept]
        if len(way) < 4 or self._along[-1] < 4.0:
            return np.zeros(0), np.zeros(0)
        return curvatures(way, 1.0)

    @cached_property
    def _road_end_m(self) -> float | None:
        """The station at which the network ends; None if the path does not reach the end."""
        if self._reference is None:
            return None
        ends = self._reference.points
        end = ends[min(int(np.searchsorted(arc_length(ends), self._reference.network_end_m)), len(ends) - 1)]
        station, offset = project_all(self._path, end[None])
        at_end = float(station[0]) >= self._along[-1] - 1e-6
        return None if at_end or abs(float(offset[0])) > _ONTO_M else float(station[0])

    @cached_property
    def _goal_span_m(self) -> tuple[float, float] | None:
        if self._goal is None or not self._goal.has_position:
            return None
        return self._goal.stations_on(self._path)

    @cached_property
    def _goal_top_mps(self) -> float | None:
        """The highest speed that the goal allows, or None if it does not limit the speed."""
        if self._goal is None:
            return None
        speeds = [state.speeds_mps[1] for state in self._goal.states if state.speeds_mps is not None]
        return max(speeds, default=None)

    def _waits_in_goal(self, index: int) -> bool:
        goal = self._goal
        if goal is None or not goal.has_position:
            return False
        return self._ego.first_step + index < goal.first_step and goal.holds(self._ego.positions[index])

    @cached_property
    def required_mps(self) -> float:
        """The average speed that the ego needs to be on time, and at least its initial speed."""
        began = float(self._speeds[0])
        if self._goal is None or self._reference is None or not self._goal.has_position:
            return began
        start = self._reference.follower().place(self._ego.positions[0])[0]
        span = self._goal.stations_on(self._reference.points, start)
        time_s = (self._goal.last_step - self._ego.first_step) * self._step_s
        if span is None or time_s <= 0:
            return began
        return max(began, (span[0] - start) / time_s)


_REASONS: tuple[PaceCode, ...] = (
    "braked_for_vehicle",
    "braked_to_give_way",
    "braked_for_light",
    "braked_for_stop_sign",
    "braked_for_curve",
    "braked_for_road_end",
    "braked_for_course",
    "braked_for_limit",
    "braked_for_goal",
)
"""The reasons to brake, in the order in which they are reported."""
_STOOD_FREE: tuple[PaceCode, ...] = ("stood_at_green", "stood_without_cause")
"""Stands in which nothing prevents the ego from driving on."""
_NOT_ON_THE_PATH: tuple[PaceCode, ...] = ("braked_for_limit", "braked_for_goal")
_PEAK_OVER_MEAN = 2.0
"""Braking that rises and falls evenly has a peak of twice its mean."""
_GO = ("GREEN", "INACTIVE")
"""CommonRoad's names of the light states that require nothing."""
_HARD_MPS2 = 8.0
"""The hardest braking that can be relied on, as in the measures of conflicts."""


def _stretches(holds: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Yield the first and last index of every stretch in which a condition holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        yield int(first), int(end) - 1
