"""Scripted motion: a road user moves as prescribed, regardless of other road users.

A script changes an existing track: its speed, with a prescribed acceleration from a given step, and its lateral
position, in a prescribed time. Acts apply in sequence: each act changes the result of the previous ones. To be
drivable, the result is smoothed and joined to the earlier track, as motions that SUMO drove are.

The lateral speed is constant for most of the prescribed time, as in the cut-ins of UN Regulation 157, with a sixth of
the time each to reach it and to return to zero.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..commonroad import Track
from ..geometry import Points, Values, arc_length, interpolate, length_m, point_at, project
from ..scene import Scene
from .handover import led_track
from .triggers import Act, LateralAct, SpeedAct

_TANGENT_M = 1.5
"""The direction of a path is that between two points this far before and after a place (chosen)."""
_REPEATED_M = 0.02
"""Points of a path nearer to each other are merged: a standing vehicle is recorded many times at one place."""

_LOOK_M = 250.0
"""A path extends at least this far beyond a motion (chosen)."""
_JOIN_M = 30.0
"""Beyond its recording a vehicle returns to the centre of its lane within this distance (chosen)."""

_CERTAINLY_APART = 1.0 + 1e-9
"""Squared distances above the limit by this factor are above it whatever the rounding."""
RAMP_SHARE = 1.0 / 6.0
"""The share of a lateral motion in which it reaches its speed, and in which it comes to rest again (chosen)."""


def scripted_track(base: Track, acts: Sequence[Act], beyond: Points, last_step: int, step_s: float) -> Track | None:
    """Return the track as changed by the acts; it is unchanged up to the step of the first act.

    Args:
        base: the track that the acts change.
        acts: the prescribed acts.
        beyond: where the centre continues after the end of the track, (n, 2) in m.
        last_step: the last step of the scenario.
        step_s: duration of a time step in s.

    Returns:
        The track, or None if it would have fewer than two new states.
    """
    if not acts:
        return base
    first = min(act.from_step for act in acts)
    index = first - base.first_step
    recorded = base.positions
    line, at_each = _path(np.concatenate([recorded, beyond]), base)
    along = arc_length(line)
    stations = along[at_each[: len(recorded)]]
    wanted, speed = [float(stations[index])], float(max(base.speeds_mps[index], 0.0))
    speed_acts = sorted((act for act in acts if isinstance(act, SpeedAct)), key=lambda act: act.from_step)
    for step in range(first + 1, last_step + 1):
        holding = [act for act in speed_acts if act.from_step < step]
        at = step - base.first_step
        if not holding:
            if at >= len(stations):
                break
            wanted.append(float(stations[at]))
            speed = float(max(base.speeds_mps[at], 0.0))
            continue
        change = np.clip(holding[-1].speed_mps - speed, -holding[-1].rate_mps2 * step_s, holding[-1].rate_mps2 * step_s)
        wanted.append(wanted[-1] + max(speed + float(change) / 2, 0.0) * step_s)
        speed = max(speed + float(change), 0.0)
    reached = np.array([station for station in wanted if station <= along[-1]])
    times: Values = np.arange(len(reached), dtype=np.float64) * step_s + first * step_s
    aside = sum(
        (
            act.aside_m * smooth_step(np.asarray((times - act.from_step * step_s) / act.duration_s, dtype=np.float64))
            for act in acts
            if isinstance(act, LateralAct)
        ),
        np.zeros(len(reached)),
    )
    centers = interpolate(line, along, reached) + aside[:, None] * _left_of(line, along, reached)
    return joined_track(base, first, centers, last_step, step_s)


def joined_track(base: Track, from_step: int, centers: Points, last_step: int, step_s: float) -> Track | None:
    """Return a track up to a step, continued by a smoothed, drivable motion along positions (n, 2) of the centre.

    ``centers``: one position per step; the first is the track's at the step. The result is None if there are fewer than
    two new states.
    """
    taken = led_track(base, from_step, centers, step_s, last_step)
    if taken is None:
        return None
    return taken.whole(base)


def smooth_step(share: Values) -> Values:
    """Return the lateral progress, from 0 to 1, after given shares (n,) of the manoeuvre's time."""
    p = np.clip(share, 0.0, 1.0)
    ramp, speed = RAMP_SHARE, 1.0 / (1.0 - RAMP_SHARE)
    ends = speed / (2.0 * ramp) * np.minimum(p, 1.0 - p) ** 2
    steady = speed * (p - ramp / 2.0)
    smooth: Values = np.where(p < ramp, ends, np.where(p > 1.0 - ramp, 1.0 - ends, steady))
    return smooth


def _path(points: Points, base: Track) -> tuple[Points, NDArray[np.intp]]:
    """Return the points without repeats, and each point's new index; a single point gets a second one straight
    ahead.
    """
    steps = np.diff(points, axis=0)
    if len(steps) and float((steps * steps).sum(axis=1).min()) > _CERTAINLY_APART * _REPEATED_M**2:
        return points, np.arange(len(points))
    kept, places = [points[0]], [0]
    for point in points[1:]:
        if float(np.linalg.norm(point - kept[-1])) > _REPEATED_M:
            kept.append(point)
        places.append(len(kept) - 1)
    if len(kept) < 2:
        heading = float(base.headings_rad[-1])
        kept.append(kept[0] + np.array([np.cos(heading), np.sin(heading)]))
    return np.array(kept), np.array(places)


def _left_of(line: Points, along: Values, stations: Values) -> Points:
    """Return unit vectors (n, 2) to the left of a line at stations."""
    low, high = np.clip(stations - _TANGENT_M, 0.0, along[-1]), np.clip(stations + _TANGENT_M, 0.0, along[-1])
    ahead = interpolate(line, along, high) - interpolate(line, along, low)
    ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=1), 1e-9)[:, None]
    return np.column_stack([-ahead[:, 1], ahead[:, 0]])


def resized(track: Track, kind: str, length_m: float, width_m: float) -> Track:
    """Return the same motion of the centre with a body of a different size."""
    return replace(track, kind=kind, length_m=length_m, width_m=width_m)


def beyond(scene: Scene, track: Track) -> Points:
    """Return the path (n, 2) of a road user's centre beyond its track: along its lane, then straight ahead.

    An offset from the centre of the lane fades out.
    """
    match, last = scene.matcher.match(track), len(track.positions) - 1
    if match is None:
        return np.zeros((0, 2))
    return line_from(scene, track.positions[last], (match.at(last),))[1:]


def line_from(scene: Scene, place: Points, lanelets: tuple[int, ...]) -> Points:
    """Return the path (n, 2) that starts at a position, follows lanelets and then continues straight ahead."""
    lanes = scene.layout.table.lanes
    chain = list(lanelets)
    while sum(lanes[key].length_m for key in chain) < _LOOK_M + lanes[chain[0]].length_m:
        following = scene.edge_graph.straight_on(chain[-1])
        if not following or not set(chain).isdisjoint(following):
            break
        chain += following
    middle = _joined_centers(scene, chain)
    station, aside = project(middle, place)
    along = arc_length(middle)
    ahead = np.arange(1.0, max(float(along[-1]) - station, 1.0), 1.0)
    points = interpolate(middle, along, station + ahead)
    if not len(points):
        return np.asarray(place)[None]
    direction = np.gradient(np.vstack([place, points]), axis=0)[1:]
    direction /= np.maximum(np.linalg.norm(direction, axis=1), 1e-9)[:, None]
    left = np.column_stack([-direction[:, 1], direction[:, 0]])
    fade = 1.0 - smooth_step(ahead / _JOIN_M)
    return np.vstack([place, points + left * (aside * fade)[:, None]])


def _joined_centers(scene: Scene, chain: Sequence[int]) -> Points:
    """Join the centre lines of consecutive lanelets; after a lane change, only the part ahead is used."""
    lanes, successors = scene.layout.table.lanes, scene.layout.table.successors
    parts = [lanes[chain[0]].center]
    for before, key in pairwise(chain):
        center = lanes[key].center
        if key not in successors[before] and before in lanes:
            begin = length_m(center) / 2
            center = np.vstack([point_at(center, begin)[0], center[arc_length(center) > begin]])
            kept = parts[-1][arc_length(parts[-1]) < length_m(parts[-1]) / 4]
            parts[-1] = kept if len(kept) else parts[-1][:1]
        parts.append(center)
    return np.concatenate(parts)
