"""Checks whether a vehicle arrives at its target, had enough time to, and could have been sent there at all.

Everything is computed from the lanelets and the written motion, without the report or the editing code.
"""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np
import shapely

from plannerforge.engine.commonroad import Track
from plannerforge.engine.geometry import Points, length_m, project
from plannerforge.evals.ground_truth.reach import (
    HARD_BRAKING_MPS2,
    LATERAL_MPS2,
    adjacent_lanelets,
    all_after,
    changes_to,
    distances_m,
    lanelets_at_first,
    speed_limit_mps,
    ways_to_m,
)

from ..tracks import ahead_and_left_m, directions, fronts

if TYPE_CHECKING:
    from collections.abc import Mapping

    from commonroad.scenario.lanelet import LaneletNetwork

MARGIN_M, ON_ROUTE_SHARE = 1.0, 0.95
"""A vehicle follows lanelets if this share of its positions is on them or at most this far from them."""
LINE_M = 0.5
"""A vehicle with its bumper at most this far past the end of a lanelet stands at the end."""
SLOW_MPS, EASY_MPS2, EASY_LATERAL_MPS2, SLOW_SHARE = 6.0, 1.5, 3.0, 0.5
"""A slow driver: the speed in the turns of a crossing, or half of the vehicle's own speed if that is more;
deceleration, acceleration and turning.
"""
DETOUR_SHARE, ROOM_M = 0.7, 15.0
"""The remaining distance shrinks by at least this share of the driven one, except for this distance."""
STANDING_MPS, LAST_S, SLOWED_SHARE = 0.5, 1.0, 0.7
"""A vehicle stands below this speed; it slowed if its speed in the last second is at this share of its highest."""
GAP_M, GAP_S = 10.0, 2.0
"""A road user within these ahead holds a vehicle up."""
NARROWEST_TURN_M = 5.0
"""Radius of the narrowest circle in which the front of a usual car turns."""
SIDE_M = 0.5
"""Lateral gap within which a road user ahead is in the corridor."""
LOOK_S, LANE_CHANGE_S = 1.0, 3.0
LANE_FROM_M, LANE_TO_M = 1.5, 5.5
LEAST_GAP_M, HEADWAY_S = 2.5, 1.0
"""A driver changes lanes if no vehicle in the next one is nearer than in ordinary traffic; looking and changing take
this long. The next lane is within these distances to the side.
"""


def arrives_on(network: "LaneletNetwork", track: Track, targets: Collection[int]) -> bool:
    """Return True if the vehicle's front half gets onto one of the lanelets, and then stays there or drives on from it.

    A bumper over the line is no arrival: more than half a metre of the front half (or half the length of a shorter
    lanelet) must be on the lanelet or on those that only it leads to. A vehicle does not vanish on arrival: if it is
    early, it drives on along what follows the target.
    """
    there, centres = fronts(track), track.positions
    # A lanelet may be shorter than one step of the way, so that the way between the steps counts and not their ends.
    steps = shapely.linestrings(np.stack([np.vstack([there[:1], there[:-1]]), there, centres], axis=1))
    halves = shapely.linestrings(np.stack([there, centres], axis=1))
    for key in sorted(targets):
        touching = np.flatnonzero(shapely.intersects(_area(network, (key,)), steps))
        if not len(touching):
            continue
        first = int(touching[0])
        least_m = min(LINE_M, length_m(network.find_lanelet_by_id(key).center_vertices) / 2)
        over_m = shapely.length(shapely.intersection(_area(network, _only_through(network, key)), halves[first:]))
        if (over_m > least_m).any() and follows(network, _onwards(network, key), there[first:]):
            return True
    return False


def follows(network: "LaneletNetwork", lanelets: Collection[int], positions: Points) -> bool:
    """Return True if positions (n, 2) are on the lanelets or on their neighbours of the same direction."""
    every = {
        *lanelets,
        *(key for lanelet in lanelets for key in adjacent_lanelets(network.find_lanelet_by_id(lanelet))),
    }
    areas = [network.find_lanelet_by_id(key).polygon.shapely_object.buffer(MARGIN_M) for key in sorted(every)]
    area = shapely.union_all(areas)
    return float(np.mean(shapely.contains_xy(area, positions[:, 0], positions[:, 1]))) >= ON_ROUTE_SHARE


def handover_errors(old: Track, new: Track, from_step: int, step_s: float) -> tuple[float, float] | None:
    """Return the error of the hand-over: m beyond v·dt, and m/s; None if nothing was written after it.

    The state at the hand-over is compared with the recording, and the next one with that state.
    """
    before, here = old.index_at(from_step), new.index_at(from_step)
    if before is None or here is None or here + 1 >= len(new.positions):
        return None
    speeds, moved = new.speeds_mps[here : here + 2], np.diff(new.positions[here : here + 2], axis=0)[0]
    jumps = (
        float(np.linalg.norm(new.positions[here] - old.positions[before])),
        float(np.linalg.norm(moved)) - float(speeds.max()) * step_s,
    )
    steps = abs(float(speeds[0] - old.speeds_mps[before])), abs(float(speeds[1] - speeds[0]))
    return max(*jumps, 0.0), max(steps)


def _area(network: "LaneletNetwork", lanelets: Collection[int]) -> shapely.Geometry:
    areas = [network.find_lanelet_by_id(key).polygon.shapely_object for key in lanelets]
    return shapely.union_all([shapely.make_valid(area) for area in areas])


def _only_through(network: "LaneletNetwork", key: int) -> list[int]:
    """Return a lanelet and those after it that can only be reached over it."""
    only = [key]
    for known in only:  # which grows meanwhile
        after = [network.find_lanelet_by_id(one) for one in network.find_lanelet_by_id(known).successor]
        more = [int(one.lanelet_id) for one in after if set(one.predecessor) <= set(only)]
        only += [one for one in more if one not in only]
    return only


def _onwards(network: "LaneletNetwork", key: int) -> frozenset[int]:
    """Return a lanelet and all that follow it; at an end without a successor, those that follow its neighbours."""

    def following(key: int) -> list[int]:
        lanelet = network.find_lanelet_by_id(key)
        ends = (
            [lanelet] if lanelet.successor else [network.find_lanelet_by_id(one) for one in adjacent_lanelets(lanelet)]
        )
        return [one for end in ends for one in end.successor]

    return all_after([key], following)


@dataclass(frozen=True)
class Journey:
    """A vehicle's path as written, to any of some lanelets, among all others."""

    network: "LaneletNetwork"
    track: Track
    targets: frozenset[int]
    others: "Mapping[int, Track]"
    step_s: float

    def is_late_with_reason(self) -> bool:
        """Return True if a vehicle that does not arrive is on its route at the end, and lacked time or was held up.

        It must not drive past or take another route: the remaining distance shrinks by most of the driven one.
        """
        begin = lanelets_at_first(self.network, self.track)
        before = _route_length_m(self.network, self.track, 0, self.targets, begin)
        if not math.isfinite(before):
            before = _route_length_m(self.network, self.track, 0, self.targets)
        left = _route_length_m(self.network, self.track, -1, self.targets)
        if not (math.isfinite(before) and math.isfinite(left)):
            return False
        if left > before - DETOUR_SHARE * length_m(self.track.positions) + ROOM_M:
            return False
        return before + LINE_M > self._slow_reach_m() or self._lacks_time_to_change() or self._finds_no_gap()

    def _slow_reach_m(self) -> float:
        """Return how far a slow driver gets in the time that the vehicle exists.

        While the vehicle is held up, or brakes until it is, that driver has its speed; from there on it returns to its
        own speed.
        """
        first_mps = max(float(self.track.speeds_mps[0]), 0.0)
        aim_mps = self._allowed_mps(max(SLOW_MPS, SLOW_SHARE * first_mps))
        reached_m, speed_mps = 0.0, first_mps
        for is_held, driven_mps in zip(self._is_held_up, self.track.speeds_mps[1:].tolist(), strict=True):
            gain_mps = float(np.clip(aim_mps - speed_mps, -EASY_MPS2 * self.step_s, EASY_MPS2 * self.step_s))
            before_mps, speed_mps = speed_mps, min(driven_mps, speed_mps) if is_held else speed_mps + gain_mps
            reached_m += (before_mps + speed_mps) / 2 * self.step_s
        return reached_m

    def _allowed_mps(self, speed_mps: float) -> float:
        """Return a speed limited by the signs on the vehicle's route, on average over its time."""
        under = self.network.find_lanelet_by_position(list(self.track.positions))
        limits = [max((speed_limit_mps(self.network, int(key)) for key in keys), default=math.inf) for keys in under]
        return float(np.minimum(limits, speed_mps).mean())

    @cached_property
    def _is_held_up(self) -> list[bool]:
        """Return for every step whether other road users, the end of its lane or a curve hold it up.

        If they do for a second or longer, its braking before that counts too.
        """
        holds = (self._is_behind_another, self._waits_at_end, self._has_no_gap, self._brakes_for_a_curve)
        held = [any(is_held(index) for is_held in holds) for index in range(len(self.track.positions) - 1)]
        slows, steps_held = np.diff(self.track.speeds_mps) < 0.0, 0
        for index in reversed(range(len(held))):
            if held[index]:
                steps_held += 1
            elif steps_held * self.step_s < LAST_S or not slows[index]:
                steps_held = 0
            held[index] = steps_held > 0
        return held

    def _lacks_time_to_change(self) -> bool:
        """Return True if the lane changes alone take longer than the vehicle exists."""
        begin = lanelets_at_first(self.network, self.track)
        changes = min((self._changes[key] for key in begin if key in self._changes), default=math.inf)
        return (len(self.track.positions) - 1) * self.step_s < changes * (LOOK_S + LANE_CHANGE_S)

    def _finds_no_gap(self) -> bool:
        """Return True if a vehicle that still has to change lanes slows or waits for it, or never had a gap for
        long.
        """
        side = self._side_to_change_to(-1)
        if side is None:
            return False
        last = float(self.track.speeds_mps[-round(LAST_S / self.step_s) :].mean())
        slowed = last <= max(SLOWED_SHARE * float(self.track.speeds_mps.max()), STANDING_MPS)
        return slowed or self._longest_gap_s(side) < LOOK_S + LANE_CHANGE_S

    def _has_no_gap(self, index: int) -> bool:
        """Return True if it has to change lanes and another road user is alongside."""
        side = self._side_to_change_to(index)
        return side is not None and not self._is_free_on_side(index, side)

    def _others_at(self, index: int) -> Iterator[tuple[float, float, Track, int]]:
        """Return every other road user present: its centre's distance ahead and to the left, itself and its own
        index.
        """
        for key, other in self.others.items():
            there = other.index_at(self.track.first_step + index)
            if key != self.track.obstacle_id and there is not None:
                heading_rad = float(self.track.headings_rad[index])
                yield *ahead_and_left_m(other.positions[there], self.track.positions[index], heading_rad), other, there

    def _is_behind_another(self, index: int) -> bool:
        """Return True if a road user is in the corridor close ahead."""
        close_m = max(GAP_M, GAP_S * float(self.track.speeds_mps[index]))
        return any(
            -other.length_m < ahead_m - (self.track.length_m + other.length_m) / 2 <= close_m
            and abs(left_m) - (self.track.width_m + other.width_m) / 2 <= SIDE_M
            for ahead_m, left_m, other, _ in self._others_at(index)
        )

    def _waits_at_end(self, index: int) -> bool:
        """Return True if it stands just before a lanelet's end: a stop line, a junction, or the last place to
        change.
        """
        if float(self.track.speeds_mps[index]) > STANDING_MPS:
            return False
        front = fronts(self.track)[index]
        points = [front, front - LINE_M * directions(self.track.headings_rad)[index]]
        under = zip(points, self.network.find_lanelet_by_position(points), strict=True)
        lines = [(point, self.network.find_lanelet_by_id(key).center_vertices) for point, keys in under for key in keys]
        return any(length_m(line) - project(line, point)[0] <= ROOM_M for point, line in lines)

    def _brakes_for_a_curve(self, index: int) -> bool:
        """Return True if it slows, and a slow driver slows there or earlier for a curve, on every route ahead."""
        speeds, heading_rad = self.track.speeds_mps, float(self.track.headings_rad[index])
        if speeds[index + 1] >= speeds[index]:
            return False
        here = _inside(self.network, self.track, index)
        slowed = distances_m(
            self.network, here, heading_rad, float(speeds[index]), hardest_mps2=(EASY_MPS2, EASY_LATERAL_MPS2)
        )
        return self.targets.isdisjoint(slowed)

    def _side_to_change_to(self, index: int) -> int | None:
        """Return 1 if the lanelet requires a change to the left, -1 to the right, None if neither."""
        sides = (self._side_from(key) for key in _lanelets_at(self.network, self.track, index))
        return next((side for side in sides if side is not None), None)

    def _side_from(self, key: int) -> int | None:
        lanelet, changes = self.network.find_lanelet_by_id(key), self._changes
        for side, other in ((1, lanelet.adj_left), (-1, lanelet.adj_right)):
            if other in adjacent_lanelets(lanelet) and changes.get(int(other), math.inf) < changes.get(key, math.inf):
                return side
        return None

    @cached_property
    def _changes(self) -> dict[int, float]:
        return changes_to(self.network, self.targets)

    def _longest_gap_s(self, side: int) -> float:
        """Return the longest time for which the neighbouring lane was free enough for a change."""
        free = (self._is_free_on_side(index, side) for index in range(len(self.track.positions)))
        return max(len(list(run)) if is_free else 0 for is_free, run in groupby(free)) * self.step_s

    def _is_free_on_side(self, index: int, side: int) -> bool:
        """Return True if no vehicle is alongside or so close ahead or behind there that a driver would not change
        lanes.
        """
        for ahead_m, left_m, other, there in self._others_at(index):
            behind_mps = float(self.track.speeds_mps[index] if ahead_m > 0 else other.speeds_mps[there])
            gap_m = abs(ahead_m) - (self.track.length_m + other.length_m) / 2
            if LANE_FROM_M <= left_m * side <= LANE_TO_M and gap_m < LEAST_GAP_M + HEADWAY_S * behind_mps:
                return False
        return True


def refusal_is_right(
    network: "LaneletNetwork", track: Track, targets: frozenset[int], farthest_m: float = math.inf
) -> bool:
    """Return True if physics prevents sending a recorded vehicle to any of some lanelets from its first state on.

    Either no route leads there, or every route has a curve that it reaches too fast. Or it can neither change lanes nor
    stop in the remaining distance v² / (2 · 8 m/s²), or that is too short to steer over however it brakes. A detour
    longer than ``farthest_m`` does not count.
    """
    speed, heading = max(float(track.speeds_mps[0]), 0.0), float(track.headings_rad[0])
    begin = lanelets_at_first(network, track)
    if begin and not targets & set(distances_m(network, track.positions[0], heading, speed, begin)):
        return True
    room = _remaining_distance_m(network, track, targets, farthest_m)
    return speed**2 / (2 * HARD_BRAKING_MPS2) > room or _shortest_crossing_m(network, track, targets, speed) > room


def _shortest_crossing_m(network: "LaneletNetwork", track: Track, targets: frozenset[int], speed_mps: float) -> float:
    """Return the shortest distance in m in which the front gets onto any lanelet that leads straight on to a target.

    Braked to some speed, the vehicle turns in the narrowest circle of radius r that grip and steering allow, by 45° at
    most: an arc moves y sideways on √(2 r y - y²), and it drives the rest diagonally.
    """
    front = shapely.Point(fronts(track)[0])
    over = [one for one in network.lanelets if _straight_on(network, int(one.lanelet_id)) & targets]
    aside = min(front.distance(one.polygon.shapely_object) for one in over)
    speeds = np.linspace(0.0, speed_mps, 51)
    braking = (speed_mps**2 - speeds**2) / (2 * HARD_BRAKING_MPS2)
    radius = np.maximum(speeds**2 / LATERAL_MPS2, NARROWEST_TURN_M)
    turned = np.minimum(aside, radius * (1 - math.sqrt(0.5)))
    return float((braking + np.sqrt(2 * radius * turned - turned**2) + aside - turned).min())


def _remaining_distance_m(network: "LaneletNetwork", track: Track, targets: frozenset[int], farthest_m: float) -> float:
    """Return the distance in m from the front to the last place from which a target can be reached; infinite if
    straight on.

    Routes longer than the shortest one and than ``farthest_m`` are left out.
    """
    ways, front, room_m = ways_to_m(network, targets), fronts(track)[0], 0.0
    for key in _lanelets_at(network, track, 0):
        if _straight_on(network, key) & targets:
            return math.inf
        line = network.find_lanelet_by_id(key).center_vertices
        past_m = 0.0 if project(line, front)[0] < length_m(line) else float(np.linalg.norm(front - line[-1]))
        station_m = project(line, front)[0] + past_m
        limit_m = max(station_m + farthest_m, ways.get(key, 0.0))
        room_m = max(room_m, _longest_m(network, key, ways, limit_m) - station_m)
    return room_m


def _longest_m(network: "LaneletNetwork", key: int, ways: "Mapping[int, float]", limit_m: float) -> float:
    """Return the longest route straight on from a lanelet's start over lanelets that lead to a target within a
    limit.
    """
    if key not in ways or ways[key] > limit_m:
        return 0.0
    lanelet, others = network.find_lanelet_by_id(key), {one: way_m for one, way_m in ways.items() if one != key}
    own_m = length_m(lanelet.center_vertices)
    after = (_longest_m(network, int(one), others, limit_m - own_m) for one in lanelet.successor)
    return own_m + max(after, default=0.0)


def _straight_on(network: "LaneletNetwork", key: int) -> frozenset[int]:
    """Return a lanelet and all that follow it without a lane change."""
    return all_after([key], lambda one: network.find_lanelet_by_id(one).successor)


def _lanelets_at(network: "LaneletNetwork", track: Track, index: int) -> list[int]:
    """Return the lanelets under a vehicle that do not oppose its heading."""
    here = _inside(network, track, index)
    onward = distances_m(network, here, float(track.headings_rad[index]))
    return sorted(int(key) for key in set(network.find_lanelet_by_position([here])[0]) & set(onward))


def _route_length_m(
    network: "LaneletNetwork", track: Track, index: int, targets: frozenset[int], among: Collection[int] | None = None
) -> float:
    """Return the shortest route to a target for a vehicle that may drive slightly off its lanelet in turns.

    ``among``: the lanelets on which it begins; all lanelets under it if None or empty.
    """
    heading_rad = float(track.headings_rad[index])
    aside = np.array([-math.sin(heading_rad), math.cos(heading_rad)]) * MARGIN_M
    here = _inside(network, track, index)
    points = (here, here + aside, here - aside, fronts(track)[index])
    reached = [distances_m(network, point, heading_rad, among=among or None) for point in points]
    return min((ways[key] for ways in reached for key in targets & set(ways)), default=math.inf)


def _inside(network: "LaneletNetwork", track: Track, index: int) -> Points:
    """Return the centre, the front if the centre is on no lanelet, or otherwise the nearest point of any lanelet."""
    points = [track.positions[index], fronts(track)[index]]
    for point in points:
        if network.find_lanelet_by_position([point])[0]:
            return np.asarray(point)
    here = shapely.Point(points[0])
    near = min(network.lanelets, key=lambda one: here.distance(one.polygon.shapely_object))
    inner = near.polygon.shapely_object.buffer(-0.1)
    return np.asarray(shapely.shortest_line(inner, here).coords[0])
