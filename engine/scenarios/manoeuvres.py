"""Manoeuvres of recorded traffic on the ego's path: cut-ins, cut-outs, merging, overtaking, braking, crossing.

Everything is measured along the line that the ego follows, from its start along its route to the goal. If the file
contains a recording of the ego, the ego follows it; otherwise it keeps its initial speed. A vehicle is close ahead
within a headway of 3 s: the Highway Capacity Manual (2010, chapter 15) counts a vehicle at this headway as followed.
Angles are in rad, lengths in m.
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
from .features import AHEAD_OF_START_M, along_line, is_near_line

if TYPE_CHECKING:
    from commonroad.scenario.lanelet import LaneletNetwork

HEADWAY_S = 3.0
"""Closer vehicles follow each other (Highway Capacity Manual 2010, chapter 15)."""
STANDING_GAP_M = 10.0
"""If the ego stands or crawls, a vehicle within two car lengths is close ahead (chosen)."""
HARD_BRAKING_MPS2 = 3.4
"""Most drivers brake harder only if they must (AASHTO, A Policy on Geometric Design, 2011: stopping sight distance)."""
BRAKED_FOR_S = 0.5
"""Noise of the recorded speeds averages out over this time (chosen)."""
SAME_RAD, OPPOSITE_RAD = math.radians(45.0), math.radians(135.0)
"""Below the first angle a vehicle drives in the ego's direction, above the second it is oncoming, in between it
crosses.
"""
MOVING_MPS = 0.5
"""Below this speed the heading of a road user is not a direction of travel (chosen; people walk faster)."""
REACH_M = 12.0
"""Vehicles farther to the side do not affect the ego's path (chosen: three lanes)."""
SEEN_EVERY_S = 0.2
"""Tracks are sampled at this interval (chosen; a lane change takes seconds)."""
OUTSIDE, INSIDE = 0.6, 0.25
"""Offsets from the centre line in lane widths: beyond the first a vehicle is in another lane, within the second it is
in the ego's (chosen)."""
LINE_END_M = 0.5
"""Points that project this close to an end of the line may be beyond it, so they are left out (chosen)."""
JOINS_WITHIN = 4
"""A merging vehicle reaches the ego's path, or the end of its own lane next to it, over at most this many lanelets;
they are short inside junctions.
"""
APPROACH_M = 25.0
"""A turning ego still has the heading of its approach this far before the lane that it crosses (chosen)."""


def unprotected_left(network: "LaneletNetwork", route: EgoRoute | None, path: tuple[Points, tuple[int, ...]]) -> bool:
    """Return True if the ego turns left across an oncoming lane without a traffic light.

    Args:
        path: the line that the ego follows and its lanelets.
    """
    from shapely import LineString

    line = path[0]
    if route is None or "left" not in route.turns or has_light(network, route.lanelets[:-1]) or len(line) < 2:
        return False
    own = [key for key in path[1] if key in route.lanelets]
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
    """The ego on its line (n, 2): its lanelets, lane width and length, and its station and speed at every step."""

    line: Points
    lanelets: frozenset[int]
    width_m: float
    length_m: float
    stations: Values
    speeds: Values

    @property
    def reach_m(self) -> float:
        """The station that the ego reaches within the recording, at least ``AHEAD_OF_START_M`` past its start."""
        return max(float(self.stations[-1]), float(self.stations[0]) + AHEAD_OF_START_M)

    def gap_m(self, seen: "_Seen", index: int) -> float:
        """Return the gap from the ego's front to a vehicle's rear at a sample; negative unless it is ahead."""
        step = min(int(seen.steps[index]), len(self.stations) - 1)
        return float(seen.stations[index] - self.stations[step]) - (seen.track.length_m + self.length_m) / 2

    def is_close(self, seen: "_Seen", index: int) -> bool:
        """Return True if a vehicle is ahead of the ego within the headway."""
        step = min(int(seen.steps[index]), len(self.stations) - 1)
        return 0.0 < self.gap_m(seen, index) <= max(HEADWAY_S * float(self.speeds[step]), STANDING_GAP_M)


@dataclass(frozen=True)
class _Seen:
    """A road user's samples near the ego's line: steps since the ego's start, positions, headings and speeds."""

    track: Track
    steps: NDArray[np.int_]
    positions: Points
    stations: Values
    offsets: Values
    turned: Values
    headings: Values
    speeds: Values


@dataclass(frozen=True, order=True)
class Manoeuvre:
    """A manoeuvre of the vocabulary that a road user makes: CommonRoad's type, its id, and its step.

    Steps count from the ego's start. Manoeuvres are ordered by name, type, step and id.
    """

    name: str
    kind: str
    step: int
    obstacle_id: int

    def __str__(self) -> str:
        return f"{self.name}:{self.kind}"


def manoeuvres(
    network: "LaneletNetwork",
    graph: LaneletGraph,
    tracks: dict[int, Track],
    ego: EgoFacts,
    length_m: float,
    path: tuple[Points, tuple[int, ...]],
    start_step: int,
    step_s: float,
) -> tuple[Manoeuvre, ...]:
    """Return the manoeuvres on the ego's path, sorted; of each road user, the first manoeuvre of each name.

    Args:
        network: the lanelets.
        graph: the lanelets as a graph.
        tracks: the recorded road users by id.
        ego: the ego at its start.
        length_m: the ego's length.
        path: the line that the ego follows and its lanelets, as ``path_ahead`` returns them.
        start_step: the ego's first step.
        step_s: the length of a step.
    """
    if len(path[0]) < 2:
        return ()
    own = next((track for track in tracks.values() if _is_own(track, ego, start_step)), None)
    steps = max((track.last_step for track in tracks.values()), default=start_step) - start_step
    driver = _driver(network, path, ego, own, length_m, max(steps, 0), start_step, step_s)
    every = max(round(SEEN_EVERY_S / step_s), 1)
    found: list[Manoeuvre] = []
    driving: list[_Seen] = []
    for track in tracks.values():
        seen = _seen(driver.line, track, start_step, every)
        if seen is None:
            continue
        if track.kind not in NOT_DRIVEN:
            driving.append(seen)
        if track is own:
            continue
        samples = _crossings(driver, seen)
        if track.kind not in NOT_DRIVEN:
            samples |= _changes(network, graph, driver, seen) | _braking(driver, seen, every * step_s)
        steps_of = {name: int(seen.steps[sample]) for name, sample in samples.items()}
        found += [Manoeuvre(name, track.kind, step, track.obstacle_id) for name, step in steps_of.items()]
    found += _overtaking(driving, driver.width_m)
    return tuple(sorted(found))


def _is_own(track: Track, ego: EgoFacts, start_step: int) -> bool:
    """Return True if a track starts at the ego's position and speed, and so is the ego's own recording."""
    index = track.index_at(start_step)
    if index is None:
        return False
    away = math.dist(track.positions[index].tolist(), (ego.x_m, ego.y_m))
    return away < 0.5 and abs(float(track.speeds_mps[index]) - ego.speed_mps) < 1.0


def _driver(
    network: "LaneletNetwork",
    path: tuple[Points, tuple[int, ...]],
    ego: EgoFacts,
    own: Track | None,
    length_m: float,
    steps: int,
    start_step: int,
    step_s: float,
) -> _Ego:
    line, lanelets = path
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
    """Return a road user's samples near the line after the ego's start; None if there are fewer than two."""
    begin = max(start_step - track.first_step, 0)
    indices = np.arange(begin, len(track.positions), every)
    indices = indices[is_near_line(line, track.positions[indices], REACH_M)]
    if len(indices) < 2:
        return None
    stations, offsets, turned = along_line(line, track.positions[indices], track.headings_rad[indices])
    near = (np.abs(offsets) <= REACH_M) & (stations > LINE_END_M) & (stations < arc_length(line)[-1] - LINE_END_M)
    if np.count_nonzero(near) < 2:
        return None
    kept = indices[near]
    return _Seen(
        track,
        kept + track.first_step - start_step,
        track.positions[kept],
        stations[near],
        offsets[near],
        np.abs(wrap_angles(turned[near])),
        track.headings_rad[kept],
        track.speeds_mps[kept],
    )


def _changes(network: "LaneletNetwork", graph: LaneletGraph, ego: _Ego, seen: _Seen) -> dict[str, int]:
    """Find ``cut_in``, ``merging`` and ``cut_out`` close ahead of the ego; return the first sample of each, by name."""
    found: dict[str, int] = {}
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
        outside = range(before, -1, -1) if comes_in else range(after, len(seen.positions))
        others = (lanelets_at(network, seen.positions[index]) for index in outside)
        other = next((lanelets for lanelets in others if lanelets), ())  # beyond the end of a lane it may be on no lane
        is_next_lane = bool(graph.parallel_lanes(other) & ego.lanelets) if other else True
        if comes_in:
            joins = not is_next_lane and _joins(graph, other, ego.lanelets)
            merges = joins or _must_change_lane(graph, other, ego.lanelets)
            found.setdefault("merging" if merges else "cut_in", at)
        elif is_next_lane:
            found.setdefault("cut_out", at)
    return found


def _joins(graph: LaneletGraph, lanelets: Sequence[int], onto: frozenset[int]) -> bool:
    """Return True if lanelets lead onto a path within a few successors."""
    reached = set(lanelets)
    for _ in range(JOINS_WITHIN):
        reached = {after for key in reached for after in graph.successors[key]}
        if reached & onto:
            return True
    return False


def _must_change_lane(graph: LaneletGraph, lanelets: Sequence[int], onto: frozenset[int]) -> bool:
    """Return True if lanelets lead only to lanes that end next to a path, as an acceleration lane does.

    A lane counts as ending if the adjacent lane continues. Where the map ends, all lanes stop, but none of them counts
    as ending.
    """

    def ends(key: int, within: int) -> bool:
        after = graph.successors[key]
        if after:
            return within > 0 and all(ends(one, within - 1) for one in after)
        row = graph.parallel_lanes((key,)) - {key}
        return bool(row & onto) and any(graph.successors[one] for one in row)

    others = [key for key in lanelets if key not in onto]
    return bool(others) and all(ends(key, JOINS_WITHIN) for key in others)


def _braking(ego: _Ego, seen: _Seen, look_s: float) -> dict[str, int]:
    """Find ``lead_brakes_hard`` of a vehicle close ahead in the ego's lane; return its first sample, by name."""
    looks = max(math.ceil(BRAKED_FOR_S / look_s), 1)
    if len(seen.speeds) <= looks:
        return {}
    lasted = np.diff(seen.steps)[: len(seen.speeds) - looks]
    braked = (seen.speeds[:-looks] - seen.speeds[looks:]) / (looks * look_s)
    in_lane = (np.abs(seen.offsets) <= ego.width_m / 2) & (seen.turned < SAME_RAD)
    hard = np.flatnonzero((braked > HARD_BRAKING_MPS2) & in_lane[:-looks] & (lasted > 0))
    first = next((index for index in hard.tolist() if ego.is_close(seen, index)), None)
    return {} if first is None else {"lead_brakes_hard": first}


def _crossings(ego: _Ego, seen: _Seen) -> dict[str, int]:
    """Find ``crossing`` or ``oncoming_turns``: a road user passes the ego's lane from side to side ahead of the ego."""
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
        return {"oncoming_turns" if turned > TURN_RAD else "crossing": after}
    return {}


def _overtaking(driving: Sequence[_Seen], width_m: float) -> Iterator[Manoeuvre]:
    """Yield vehicles that approach another from behind in its lane, move into the next lane and end up ahead.

    A vehicle that passes another one which leaves the lane for it does not overtake.
    """
    for one in driving:
        if float(np.ptp(one.offsets)) < OUTSIDE * width_m:
            continue
        passes = (_overtakes(one, other, width_m) for other in driving if other is not one)
        step = next((step for step in passes if step is not None), None)
        if step is not None:
            yield Manoeuvre("overtaking", one.track.kind, step, one.track.obstacle_id)


def _overtakes(one: _Seen, other: _Seen, width_m: float) -> int | None:
    """Return the step at which one vehicle is level with another that it overtakes, or None if it does not."""
    steps, mine, theirs = np.intersect1d(one.steps, other.steps, return_indices=True)
    alike = (one.turned[mine] < SAME_RAD) & (other.turned[theirs] < SAME_RAD) & (other.speeds[theirs] >= MOVING_MPS)
    steps, mine, theirs = steps[alike], mine[alike], theirs[alike]
    ahead = one.stations[mine] - other.stations[theirs]
    apart = np.abs(one.offsets[mine] - other.offsets[theirs])
    length_m = (one.track.length_m + other.track.length_m) / 2
    behind = np.flatnonzero((ahead < -length_m) & (apart < width_m / 2))
    level = np.flatnonzero((np.abs(ahead) < length_m) & (apart >= width_m / 2))
    passed = np.flatnonzero(ahead > length_m)
    own = one.offsets[mine]
    later = [at for at in level.tolist() if np.any(np.abs(own[behind[behind < at]] - own[at]) >= width_m / 2)]
    if not len(later) or not np.any(passed > later[0]):
        return None
    return int(steps[later[0]])
