"""What the recorded traffic does on the ego's way: it cuts in or out, merges, overtakes, brakes hard ahead, crosses.

Everything is measured along the line that the ego follows: its lane from its start, along its route to the goal. The
ego is where its own recording has it, where the file holds one; else it keeps its initial speed. A vehicle is close
ahead within a headway of 3 s, below which the Highway Capacity Manual (2010, chapter 15) counts it as followed.
Angles in rad, lengths in m.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...schemas.scenarios import EgoFacts
from ..commonroad import Track, has_light
from ..geometry import Points, Values, arc_length, point_at, project, wrap_angle, wrap_angles
from ..network import LaneletGraph
from ..scene import NOT_DRIVEN, TURN_RAD, EgoRoute, center_line, lanelets_at
from .features import NEAR_M, along_line, may_be_beside

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

HEADWAY_S = 3.0
"""Closer vehicles follow each other (Highway Capacity Manual 2010, chapter 15)."""
STANDING_GAP_M = 10.0
"""For an ego that stands or crawls, what is within two lengths of a car is close ahead (chosen)."""
HARD_BRAKING_MPS2 = 3.4
"""Most drivers brake by more only in need (AASHTO, A Policy on Geometric Design, 2011: stopping sight distance)."""
BRAKED_FOR_S = 0.5
"""A speed's noise averages out over this time (chosen)."""
SAME_RAD, OPPOSITE_RAD = math.radians(45.0), math.radians(135.0)
"""Headings turned by less drive the same way, by more the other way, and between them across (quarters of a circle)."""
MOVING_MPS = 0.5
"""A slower road user's direction of travel says nothing (chosen; people walk faster)."""
REACH_M = 12.0
"""Vehicles farther beside the ego's way do nothing on it (chosen: three lanes)."""
SEEN_EVERY_S = 0.2
"""Between two looks at a vehicle (chosen; a change of lane takes seconds)."""
OUTSIDE, INSIDE = 0.6, 0.25
"""In widths of the lane: a centre farther beside its middle is in another lane, a nearer one has come in (chosen)."""
LINE_END_M = 0.5
"""Beside the ends of the line a place may as well lie beyond it (chosen)."""
JOINS_WITHIN = 4
"""Lanelets between a vehicle and the ego's way over which it joins, at most: inside junctions they are short."""
APPROACH_M = 25.0
"""So far before the lane that it crosses, an ego that turns still has the heading of its approach (chosen)."""


def unprotected_left(network: "LaneletNetwork", route: EgoRoute | None, way: tuple[Points, tuple[int, ...]]) -> bool:
    """Whether the ego turns left on its route across a lane of the other direction, and no light protects it.

    Args:
        way: the line that the ego follows and its lanelets.
    """
    from shapely import LineString

    line = way[0]
    if route is None or "left" not in route.turns or has_light(network, route.lanelets[:-1]) or len(line) < 2:
        return False
    own = [key for key in way[1] if key in route.lanelets]
    turning = [LineString(center_line(network, key)) for key in own if len(center_line(network, key)) > 1]
    for lane in network.lanelets:
        other = center_line(network, lane.lanelet_id)
        if lane.lanelet_id in route.lanelets or len(other) < 2:
            continue
        shape = LineString(other)
        for crossed in (one for one in turning if one.crosses(shape)):
            crossing = np.asarray(crossed.intersection(shape).centroid.coords[0])
            approach = point_at(line, max(project(line, crossing)[0] - APPROACH_M, 0.0))[1]
            against = point_at(other, project(other, crossing)[0])[1]
            if abs(wrap_angle(against - approach)) > OPPOSITE_RAD:
                return True
    return False


@dataclass(frozen=True)
class _Ego:
    """The ego on its line (n, 2): lanelets, width of its lane, length, and station and speed at every step."""

    line: Points
    lanelets: frozenset[int]
    width_m: float
    length_m: float
    stations: Values
    speeds: Values

    @property
    def reach_m(self) -> float:
        """How far along its line it comes within the recording, or sees where it stands or crawls."""
        return max(float(self.stations[-1]), float(self.stations[0]) + NEAR_M)

    def gap_m(self, seen: "_Seen", index: int) -> float:
        """From the ego's front to a vehicle's rear when it is seen; negative where it is not ahead."""
        step = min(int(seen.steps[index]), len(self.stations) - 1)
        return float(seen.stations[index] - self.stations[step]) - (seen.track.length_m + self.length_m) / 2

    def is_close(self, seen: "_Seen", index: int) -> bool:
        """Whether a vehicle is ahead of the ego within the headway."""
        step = min(int(seen.steps[index]), len(self.stations) - 1)
        return 0.0 < self.gap_m(seen, index) <= max(HEADWAY_S * float(self.speeds[step]), STANDING_GAP_M)


@dataclass(frozen=True)
class _Seen:
    """A road user on or beside the ego's line: each time it is seen, its step since the ego's start and its place."""

    track: Track
    steps: NDArray[np.int_]
    positions: Points
    stations: Values
    offsets: Values
    turned: Values
    headings: Values
    speeds: Values


def manoeuvres(
    network: "LaneletNetwork",
    graph: LaneletGraph,
    tracks: dict[int, Track],
    ego: EgoFacts,
    length_m: float,
    way: tuple[Points, tuple[int, ...]],
    start_step: int,
    step_s: float,
) -> tuple[str, ...]:
    """What vehicles do on the ego's way, each as ``manoeuvre:type`` with CommonRoad's obstacle type; sorted.

    Args:
        length_m: the ego's.
        way: the line that the ego follows and its lanelets, as ``path_ahead`` gives them.
    """
    if len(way[0]) < 2:
        return ()
    own = next((track for track in tracks.values() if _is_own(track, ego, start_step)), None)
    steps = max((track.last_step for track in tracks.values()), default=start_step) - start_step
    driver = _driver(network, way, ego, own, length_m, max(steps, 0), start_step, step_s)
    every = max(round(SEEN_EVERY_S / step_s), 1)
    found: set[tuple[str, str]] = set()
    driving: list[_Seen] = []
    for track in tracks.values():
        seen = _seen(driver.line, track, start_step, every)
        if seen is None:
            continue
        if track.kind not in NOT_DRIVEN:
            driving.append(seen)
        if track is own:
            continue
        names = _crossings(driver, seen)
        if track.kind not in NOT_DRIVEN:
            names |= _changes(network, graph, driver, seen) | _braking(driver, seen, every * step_s)
        found.update((name, track.kind) for name in names)
    found.update(("overtaking", kind) for kind in _overtakers(driving, driver.width_m))
    return tuple(sorted(f"{name}:{kind}" for name, kind in found))


def _is_own(track: Track, ego: EgoFacts, start_step: int) -> bool:
    """Whether a track begins where the ego does, as fast: the ego's own recording."""
    index = track.index_at(start_step)
    if index is None:
        return False
    away = math.dist(track.positions[index].tolist(), (ego.x_m, ego.y_m))
    return away < 0.5 and abs(float(track.speeds_mps[index]) - ego.speed_mps) < 1.0


def _driver(
    network: "LaneletNetwork",
    way: tuple[Points, tuple[int, ...]],
    ego: EgoFacts,
    own: Track | None,
    length_m: float,
    steps: int,
    start_step: int,
    step_s: float,
) -> _Ego:
    line, lanelets = way
    here = project(line, np.array([ego.x_m, ego.y_m]))[0]
    speeds = np.full(steps + 1, ego.speed_mps)
    if own is not None:
        recorded = own.speeds_mps[start_step - own.first_step :]
        speeds = np.concatenate([recorded, np.full(max(steps + 1 - len(recorded), 0), recorded[-1])])[: steps + 1]
    stations = here + np.concatenate([[0.0], np.cumsum((speeds[1:] + speeds[:-1]) / 2 * step_s)])
    lane = network.find_lanelet_by_id(lanelets[0])
    width = float(np.median(np.linalg.norm(lane.left_vertices - lane.right_vertices, axis=1)))
    return _Ego(line, frozenset(lanelets), width, length_m, stations, speeds)


def _seen(line: Points, track: Track, start_step: int, every: int) -> _Seen | None:
    """A road user at its looks on or beside the line from the ego's start on; None where it has fewer than two."""
    begin = max(start_step - track.first_step, 0)
    indices = np.arange(begin, len(track.positions), every)
    indices = indices[may_be_beside(line, track.positions[indices], REACH_M)]
    if len(indices) < 2:
        return None
    stations, offsets, turned = along_line(line, track.positions[indices], track.headings_rad[indices])
    beside = (np.abs(offsets) <= REACH_M) & (stations > LINE_END_M) & (stations < arc_length(line)[-1] - LINE_END_M)
    if np.count_nonzero(beside) < 2:
        return None
    kept = indices[beside]
    return _Seen(
        track,
        kept + track.first_step - start_step,
        track.positions[kept],
        stations[beside],
        offsets[beside],
        np.abs(wrap_angles(turned[beside])),
        track.headings_rad[kept],
        track.speeds_mps[kept],
    )


def _changes(network: "LaneletNetwork", graph: LaneletGraph, ego: _Ego, seen: _Seen) -> set[str]:
    """``cut_in``, ``merging`` and ``cut_out`` close ahead of the ego, in the direction of its lane."""
    found: set[str] = set()
    along = seen.turned < SAME_RAD
    place = np.where(np.abs(seen.offsets) <= INSIDE * ego.width_m, 1, 0)
    place[np.abs(seen.offsets) >= OUTSIDE * ego.width_m] = -1
    decided = np.flatnonzero(along & (place != 0))
    for before, after in pairwise(decided.tolist()):
        if place[before] == place[after]:
            continue
        comes_in = place[after] == 1
        between = np.arange(before, after + 1)
        nearer = np.abs(seen.offsets[between]) <= ego.width_m / 2
        at = int(between[np.argmax(nearer if comes_in else ~nearer)])  # when its centre passes the lane's edge
        if not ego.is_close(seen, at):
            continue
        other = lanelets_at(network, seen.positions[before if comes_in else after])
        beside = bool(graph.beside(other) & ego.lanelets) if other else True
        if comes_in:
            found.add("cut_in" if beside else "merging" if _joins(graph, other, ego.lanelets) else "cut_in")
        elif beside:
            found.add("cut_out")
    return found


def _joins(graph: LaneletGraph, lanelets: Sequence[int], onto: frozenset[int]) -> bool:
    """Whether lanelets lead onto a way within a few steps."""
    reached = set(lanelets)
    for _ in range(JOINS_WITHIN):
        reached = {after for key in reached for after in graph.successors[key]}
        if reached & onto:
            return True
    return False


def _braking(ego: _Ego, seen: _Seen, look_s: float) -> set[str]:
    """``lead_brakes_hard`` for a vehicle in the ego's lane, close ahead."""
    looks = max(math.ceil(BRAKED_FOR_S / look_s), 1)
    if len(seen.speeds) <= looks:
        return set()
    lasted = np.diff(seen.steps)[: len(seen.speeds) - looks]
    braked = (seen.speeds[:-looks] - seen.speeds[looks:]) / (looks * look_s)
    in_lane = (np.abs(seen.offsets) <= ego.width_m / 2) & (seen.turned < SAME_RAD)
    hard = np.flatnonzero((braked > HARD_BRAKING_MPS2) & in_lane[:-looks] & (lasted > 0))
    return {"lead_brakes_hard"} if any(ego.is_close(seen, int(index)) for index in hard) else set()


def _crossings(ego: _Ego, seen: _Seen) -> set[str]:
    """``crossing`` and ``oncoming_turns``: from one side of the ego's lane to the other, before the ego is there."""
    moving = seen.speeds >= MOVING_MPS
    across = (seen.turned >= SAME_RAD) & (seen.turned <= OPPOSITE_RAD) & moving
    outside = np.flatnonzero(np.abs(seen.offsets) > ego.width_m / 2)
    for before, after in pairwise(outside.tolist()):
        if seen.offsets[before] * seen.offsets[after] > 0 or not across[before : after + 1].any():
            continue
        if seen.stations[after] > ego.reach_m or ego.gap_m(seen, after) <= -ego.length_m:
            continue
        came = np.flatnonzero((seen.turned[:after] > OPPOSITE_RAD) & moving[:after])
        turned = abs(wrap_angle(float(seen.headings[after] - seen.headings[came[0]]))) if len(came) else 0.0
        return {"oncoming_turns"} if turned > TURN_RAD else {"crossing"}
    return set()


def _overtakers(driving: Sequence[_Seen], width_m: float) -> Iterator[str]:
    """The types of vehicles that come up behind another in its lane, move beside it and are ahead of it later."""
    for one in driving:
        if float(np.ptp(one.offsets)) < OUTSIDE * width_m:
            continue
        if any(other is not one and _overtakes(one, other, width_m) for other in driving):
            yield one.track.kind


def _overtakes(one: _Seen, other: _Seen, width_m: float) -> bool:
    _, mine, theirs = np.intersect1d(one.steps, other.steps, return_indices=True)
    alike = (one.turned[mine] < SAME_RAD) & (other.turned[theirs] < SAME_RAD) & (other.speeds[theirs] >= MOVING_MPS)
    mine, theirs = mine[alike], theirs[alike]
    ahead = one.stations[mine] - other.stations[theirs]
    apart = np.abs(one.offsets[mine] - other.offsets[theirs])
    length_m = (one.track.length_m + other.track.length_m) / 2
    behind = np.flatnonzero((ahead < -length_m) & (apart < width_m / 2))
    beside = np.flatnonzero((np.abs(ahead) < length_m) & (apart >= width_m / 2))
    passed = np.flatnonzero(ahead > length_m)
    return bool(len(behind) and np.any(later := beside > behind[0]) and np.any(passed > beside[np.argmax(later)]))
