"""How a recorded vehicle moves over time: speed, acceleration, lane, and the vehicle that it follows, with its gap.

Each phase of braking lists what was ahead when it started: a slower vehicle, a crossing road user, a light, a turn, or
a lower limit. This reports what the recording contains, not what a driver thought.
"""

import math
from collections.abc import Iterator

import numpy as np

from ...schemas.scenarios import DescribedMotion, MotionEvent, MotionMoment
from ..commonroad import Track, has_light, limits_kmh, signs_of
from ..geometry import Values, arc_length, gaussian, project, wrap_angle
from ..scene import NOT_DRIVEN, TURN_RAD, Scene, center_line, lanelets_at, path_ahead
from .features import along_line, is_near_line
from .manoeuvres import HEADWAY_S, SAME_RAD, STANDING_GAP_M

MOMENTS = 12
"""Largest number of reported states (chosen: a line each)."""
LOOK_M = 100.0
"""Search distance for a vehicle ahead (chosen)."""
HALF_LANE_M = 1.75
"""Half a lane of 3.5 m."""
SMOOTHED_S = 0.3
"""Standard deviation of the smoothing before speeds become accelerations (chosen: files round their speeds)."""
BRAKES_MPS2, LOST_MPS = 1.0, 1.0
"""A braking phase: smoothed deceleration above the first, with a loss of speed of at least the second (chosen)."""
ROUNDED_MPS = 0.05
"""A speed that falls by less has not begun to fall (chosen: files round their speeds)."""
AHEAD_S = 3.0
"""A vehicle brakes for what it meets within this time at its speed, or where it stops (as the headway)."""
EVENTS = 8
"""Largest number of reported events (chosen)."""


def motion_of(scene: Scene, track: Track, begin: int, *, edited: bool = False) -> DescribedMotion:
    """Return the whole recorded motion of a vehicle; a pedestrian has no leader, and no events of a driver.

    Args:
        begin: the step from which times are counted.
        edited: whether an edit changed the motion.
    """
    acceleration = _accelerations(track, scene.step_s)
    every = max(math.ceil((len(track.positions) - 1) / (MOMENTS - 1)), 1)
    indices = sorted({*range(0, len(track.positions), every), len(track.positions) - 1})
    moments = tuple(_moment(scene, track, index, begin, acceleration) for index in indices)
    walks = track.kind in NOT_DRIVEN
    braking = () if walks else _braking(scene, track, begin, acceleration, edited=edited)
    driving = (*braking, *(() if walks else _lane_changes(scene, track, begin)))
    events = sorted(driving, key=_from)
    driven_m = float(arc_length(track.positions)[-1]) if len(track.positions) > 1 else 0.0
    return DescribedMotion(moments=moments, events=tuple(events[:EVENTS]), driven_m=round(driven_m, 1), walks=walks)


def _from(event: MotionEvent) -> float:
    return event.from_s


def _accelerations(track: Track, step_s: float) -> Values:
    """Return accelerations along the track in m/s², (n,), from smoothed speeds."""
    if len(track.speeds_mps) < 2:
        return np.zeros(len(track.speeds_mps))
    smoothed = gaussian(track.speeds_mps.reshape(-1, 1), SMOOTHED_S / step_s)[:, 0]
    return np.asarray(np.gradient(smoothed, step_s))


def _moment(scene: Scene, track: Track, index: int, begin: int, acceleration: Values) -> MotionMoment:
    leader = leader_of(scene, track, index)
    return MotionMoment(
        time_s=_time_s(scene, track, index, begin),
        speed_mps=round(float(track.speeds_mps[index]), 2),
        acceleration_mps2=round(float(acceleration[index]), 2) + 0.0,
        lanelet=lanelet_of(scene, track, index),
        leader=leader[0] if leader else None,
        gap_m=round(leader[1], 1) if leader else None,
    )


def lanelet_of(scene: Scene, track: Track, index: int) -> int | None:
    """Return the lanelet that a road user is on at an index of its track, or None if it is off the lanelets.

    A pedestrian who crosses the lanes is on the lanelet with the nearest centre line.
    """
    match, point = scene.matches.get(track.obstacle_id), track.positions[index]
    if match is not None or track.kind not in NOT_DRIVEN:
        return None if match is None else match.at(index)
    under = [
        (abs(project(center_line(scene.network, key), point)[1]), key) for key in lanelets_at(scene.network, point)
    ]
    return min(under)[1] if under else None


def _time_s(scene: Scene, track: Track, index: int, begin: int) -> float:
    return round((track.first_step + index - begin) * scene.step_s, 2)


def leader_of(scene: Scene, track: Track, index: int) -> tuple[int, float] | None:
    """Return the nearest vehicle ahead in a vehicle's lane at an index of its track, and the gap between them in m.

    It is None for pedestrians, who follow no vehicle.
    """
    match = scene.matches.get(track.obstacle_id)
    if match is None or track.kind in NOT_DRIVEN:
        return None
    line, _ = path_ahead(scene.network, scene.lanelet_graph, match.at(index), match.sequence, LOOK_M)
    if len(line) < 2:
        return None
    here, step = project(line, track.positions[index])[0], track.first_step + index
    found: list[tuple[float, int]] = []
    for key, other in (scene.tracks | scene.standing).items():
        at = other.index_at(step)
        if key == track.obstacle_id or at is None or other.kind in NOT_DRIVEN:
            continue
        if not is_near_line(line, other.positions[at : at + 1], HALF_LANE_M)[0]:
            continue
        stations, offsets, turned = along_line(line, other.positions[at : at + 1], other.headings_rad[at : at + 1])
        ahead_m = float(stations[0]) - here
        if ahead_m > 0 and abs(float(offsets[0])) <= HALF_LANE_M and abs(wrap_angle(float(turned[0]))) < SAME_RAD:
            found.append((ahead_m - (track.length_m + other.length_m) / 2, key))
    if not found:
        return None
    gap_m, key = min(found)
    return (key, gap_m) if gap_m <= LOOK_M else None


def _braking(scene: Scene, track: Track, begin: int, acceleration: Values, *, edited: bool) -> Iterator[MotionEvent]:
    """Yield each braking phase with what was ahead when it started, else the edit that sets the motion.

    Smoothing spreads braking over time, so a phase begins only when the file's speed falls.
    """
    braking = np.concatenate([[False], acceleration < -BRAKES_MPS2, [False]])
    edges = np.flatnonzero(braking[1:] != braking[:-1])
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        last = min(end, len(track.speeds_mps) - 1)
        before, after = float(track.speeds_mps[first]), float(track.speeds_mps[last])
        if before - after < LOST_MPS:
            continue
        hardest = -float(acceleration[first:end].min())
        code, cause = _cause(scene, track, first, last)
        if code == "unknown" and edited:
            code, cause = "edit", "an edit sets this motion"
        begins = first + int(np.flatnonzero(track.speeds_mps[first:last] > before - ROUNDED_MPS)[-1])
        yield MotionEvent(
            code="brakes",
            cause=code,
            from_s=_time_s(scene, track, begins, begin),
            until_s=_time_s(scene, track, last, begin),
            words=f"brakes from {before:.1f} to {after:.1f} m/s, by up to {hardest:.1f} m/s²: {cause}",
        )


def _cause(scene: Scene, track: Track, first: int, last: int) -> tuple[str, str]:
    """Return what was ahead when a vehicle started to brake: a code, and the evidence as text."""
    speed = float(track.speeds_mps[first])
    reach_m = max(HEADWAY_S * speed, STANDING_GAP_M)
    leader = leader_of(scene, track, first)
    if leader is not None and leader[1] <= reach_m:
        other = (scene.tracks | scene.standing)[leader[0]]
        at, then = other.index_at(track.first_step + first), other.index_at(track.first_step + last)
        slowest = min(float(other.speeds_mps[one]) for one in (at, then) if one is not None)
        if slowest < speed:
            now = f"{leader[1]:.1f} m ahead at {float(other.speeds_mps[at or 0]):.1f} m/s"
            return "leader", f"vehicle {leader[0]} is {now} in its lane"
    crossing = _crosses(scene, track, first, last)
    if crossing is not None:
        return "crossing", f"{other_kind(scene, crossing)} {crossing} crosses its path"
    match = scene.matches.get(track.obstacle_id)
    if match is not None and has_light(scene.network, [match.at(last)]) and track.speeds_mps[last] < speed / 2:
        return "light", f"a traffic light is at the end of lanelet {match.at(last)}"
    behind = _index_after(track, last, 2 * STANDING_GAP_M)
    turned = wrap_angle(float(track.headings_rad[behind] - track.headings_rad[first]))
    if abs(turned) > TURN_RAD:
        return "turn", f"it then turns {'left' if turned > 0 else 'right'}"
    if match is not None:
        before, after = (limits_kmh(signs_of(scene.network, [match.at(index)])) for index in (first, last))
        if before and after and after[0] < before[0]:
            return "limit", f"the limit falls from {before[0]:g} to {after[0]:g} km/h"
    return "unknown", "the recording shows no cause within 3 s ahead"


def other_kind(scene: Scene, key: int) -> str:
    """Return the obstacle type of a road user."""
    return (scene.tracks | scene.standing)[key].kind


def _index_after(track: Track, index: int, further_m: float) -> int:
    """Return the index at which a vehicle has driven a given distance farther, or its last index."""
    driven = arc_length(track.positions)
    return min(int(np.searchsorted(driven, driven[index] + further_m)), len(driven) - 1)


def _crosses(scene: Scene, track: Track, first: int, last: int) -> int | None:
    """Return a road user that crosses a vehicle's path before one headway after the braking has passed, or None."""
    end = min(last + round(AHEAD_S / scene.step_s), len(track.positions) - 1)
    match = scene.matches.get(track.obstacle_id)
    if match is None:
        return None
    line, _ = path_ahead(scene.network, scene.lanelet_graph, match.at(first), match.sequence, LOOK_M)
    if len(line) < 2:
        return None
    here = project(line, track.positions[first])[0]
    reach_m = max(HEADWAY_S * float(track.speeds_mps[first]), STANDING_GAP_M)
    for key, other in scene.tracks.items():
        begin, stop = (track.first_step + index - other.first_step for index in (first, end))
        positions = other.positions[max(begin, 0) : max(stop + 1, 0)]
        facing = other.headings_rad[max(begin, 0) : max(stop + 1, 0)]
        if key == track.obstacle_id or not len(positions) or not is_near_line(line, positions, HALF_LANE_M).any():
            continue
        stations, offsets, turned = along_line(line, positions, facing)
        across = np.abs(np.cos(turned)) < math.cos(SAME_RAD)
        ahead = (stations > here) & (stations <= here + reach_m) & (np.abs(offsets) <= HALF_LANE_M)
        if np.any(across & ahead):
            return key
    return None


def _lane_changes(scene: Scene, track: Track, begin: int) -> Iterator[MotionEvent]:
    """Yield each change to an adjacent lane."""
    match = scene.matches.get(track.obstacle_id)
    if match is None:
        return
    for place in range(1, len(match.lanelets)):
        one, other = match.lanelets[place - 1], match.lanelets[place]
        if other in scene.lanelet_graph.neighbours.get(one, ()):
            lane = scene.network.find_lanelet_by_id(one)
            side = "left" if lane.adj_left == other else "right"
            time_s = _time_s(scene, track, match.indices[place], begin)
            yield MotionEvent(
                code="changes_lane",
                cause="",
                from_s=time_s,
                until_s=time_s,
                words=f"changes to the lane on its {side}, lanelet {other}",
            )
