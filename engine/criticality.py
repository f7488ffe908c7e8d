"""How critical a drive was: gaps, times to collision, time headways and a risk score.

These figures are computed only here, for both runs and edits. Lengths in m, times in s, headings in rad. The time to
collision is that of two road users that keep their present courses and speeds in the plane (Hayward, "Near-miss
determination through use of a scale of danger", 1972). The catalogue's time to conflict is a different quantity: there
the ego follows its lanes and other road users their recording (``scenarios/facts.py``).
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .commonroad import Track
from .geometry import Points, Values, arc_length, wrap_angles
from .vehicles import STANDING_MPS

_COUNTED_WITHIN_M = 60.0
"""Others with a centre farther from the ego's than this do not count (chosen)."""
SAME_DIRECTION_RAD = np.pi / 4
"""Headings that differ by less have the same direction (chosen)."""
_RISK_STEPS_S = (0.0, 0.5, 1.0, 3.0, 5.0)
_RISK_STEPS_M = (0.0, 0.5, 1.0, 3.0, 5.0)
"""Steps of the risk score; their source is that of :func:`risk_scores`."""
_LONGEST_S = 100.0
"""Longer times do not count (chosen): two vehicles of nearly equal speed would otherwise collide in a day."""
_LEVEL_M = 1e-6
"""If two centres are level up to rounding, neither is ahead."""
_PAIRS_AT_ONCE = 2000
"""Number of pairs per array in the search for nearest points on a path (chosen for memory)."""


@dataclass(frozen=True)
class _Criticality:
    """The most critical figures of a drive; None if no road user (for times: no closing one) came within 60 m."""

    minimum_distance_m: float | None = None
    minimum_time_to_collision_s: float | None = None
    minimum_time_headway_s: float | None = None
    minimum_time_gap_s: float | None = None
    risk_score: int | None = None


@dataclass(frozen=True)
class MovingRectangles:
    """Rectangles that move along their headings: centres (n, 2), headings (n,), sizes (n, 2), speeds (n,)."""

    centers: Points
    headings_rad: Values
    sizes_m: Points
    speeds_mps: Values

    @property
    def velocities(self) -> Points:
        """The velocities in m/s, shape (n, 2)."""
        return self.speeds_mps[:, None] * _directions(self.headings_rad)


@dataclass(frozen=True)
class Encounters:
    """All pairs of a driven state (``state``, an index) and a nearby road user; ``ego`` and ``other`` have shape (n,).

    ``track``: an index into the moving road users, followed by the standing road users.
    """

    state: NDArray[np.intp]
    track: NDArray[np.intp]
    ego: MovingRectangles
    other: MovingRectangles


def drive_criticality(ego: Track, moving: Iterable[Track], standing: Iterable[Track] = ()) -> _Criticality:
    """Return the most critical figures over the driven states of the ego, including the initial one.

    Args:
        ego: the drive, with the ego's size.
        moving: the other road users while they are present, from their first to their last step.
        standing: road users that are present at every step, as tracks of a single state.
    """
    met = encounters(ego, moving, standing)
    if not len(met.state):
        return _Criticality()
    gaps = gaps_m(met)
    times = times_to_collision_s(met.ego, met.other)
    ahead = ahead_of(ego, met).gaps_m
    return _Criticality(
        minimum_distance_m=float(gaps.min()),
        minimum_time_to_collision_s=_least(times),
        minimum_time_headway_s=_least(driving_times_s(ahead + met.other.sizes_m[:, 0], met)),
        minimum_time_gap_s=_least(driving_times_s(ahead, met)),
        risk_score=int(risk_scores(gaps, times).min()),
    )


def encounters(ego: Track, moving: Iterable[Track], standing: Iterable[Track] = ()) -> Encounters:
    """Return all pairs of a state of the ego and a road user within 60 m of it, centre to centre."""
    steps = np.arange(ego.first_step, ego.last_step + 1)
    centers = ego.positions
    chosen, states, sizes = [], [], []
    for track, stands in [*((track, False) for track in moving), *((track, True) for track in standing)]:
        index = np.zeros(len(steps), dtype=int) if stands else steps - track.first_step
        there = np.flatnonzero((index >= 0) & (index < len(track.positions)))
        away = np.linalg.norm(track.positions[index[there]] - centers[there], axis=1)
        near = there[away < _COUNTED_WITHIN_M]
        at = index[near]
        chosen.append(near)
        states.append(np.column_stack([track.positions[at], track.headings_rad[at], track.speeds_mps[at]]))
        sizes.append(np.tile([track.length_m, track.width_m], (len(near), 1)))
    state = np.concatenate(chosen) if chosen else np.zeros(0, dtype=np.intp)
    track_of = np.repeat(np.arange(len(chosen)), [len(near) for near in chosen])
    other = np.concatenate(states) if states else np.zeros((0, 4))
    size = np.concatenate(sizes) if sizes else np.zeros((0, 2))
    own_size = np.tile([ego.length_m, ego.width_m], (len(state), 1))
    return Encounters(
        state,
        track_of,
        MovingRectangles(centers[state], ego.headings_rad[state], own_size, ego.speeds_mps[state]),
        MovingRectangles(other[:, :2], other[:, 2], size, other[:, 3]),
    )


def corners_of(bodies: MovingRectangles) -> NDArray[np.float64]:
    """Return the corners of shape (n, 4, 2), counter-clockwise from the front left."""
    along = _directions(bodies.headings_rad)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    long, wide = along * bodies.sizes_m[:, :1] / 2, across * bodies.sizes_m[:, 1:] / 2
    center = bodies.centers
    return np.stack([center + long + wide, center - long + wide, center - long - wide, center + long - wide], axis=1)


def times_to_collision_s(ones: MovingRectangles, others: MovingRectangles) -> Values:
    """Return the times (n,) in s until paired rectangles first touch; 0 while they overlap, infinite if they never do.

    The rectangles move without turning (Hayward 1972). On every axis that is normal to a side, their projections
    overlap during a time interval; the rectangles overlap while all four projections do (separating axes).
    """
    first, second = corners_of(ones), corners_of(others)
    closing = ones.velocities - others.velocities
    begin, end = np.zeros(len(closing)), np.full(len(closing), np.inf)
    quarter = np.pi / 2
    for headings in (
        ones.headings_rad,
        ones.headings_rad + quarter,
        others.headings_rad,
        others.headings_rad + quarter,
    ):
        axis = _directions(headings)
        near, far = (np.einsum("nki,ni->nk", corners, axis) for corners in (first, second))
        speed = np.einsum("ni,ni->n", closing, axis)
        before, behind = far.min(axis=1) - near.max(axis=1), far.max(axis=1) - near.min(axis=1)
        moves = np.abs(speed) >= 1e-9
        divisor = np.where(moves, speed, 1.0)
        enters, leaves = np.sort([before / divisor, behind / divisor], axis=0)
        apart = ~moves & ((before > 0) | (behind < 0))
        begin = np.where(moves, np.maximum(begin, enters), np.where(apart, np.inf, begin))
        end = np.where(moves, np.minimum(end, leaves), end)
    return np.where(begin <= end, begin, np.inf)


def _directions(headings_rad: Values) -> Points:
    return np.stack([np.cos(headings_rad), np.sin(headings_rad)], axis=1)


def gaps_m(met: Encounters) -> Values:
    """Return the distances between the rectangles of all pairs, 0 if they overlap, shape (n,)."""
    import shapely

    # A state of the ego makes a pair with each of many others; its polygon is built once.
    _, first, state = np.unique(met.state, return_index=True, return_inverse=True)
    ego = shapely.polygons(corners_of(met.ego)[first])[state]
    gaps: Values = shapely.distance(ego, shapely.polygons(corners_of(met.other)))
    return gaps


def driving_times_s(ahead_m: Values, met: Encounters) -> Values:
    """Return the time in s in which the ego covers a distance at its speed; infinite while it stands.

    Time headway as in Vogel 2003 (a comparison of headway and time to collision) is from front to front, the time gap
    (ISO 15622) from the ego's front to the rear of the vehicle ahead.
    """
    moving = met.ego.speeds_mps > STANDING_MPS
    times = np.maximum(ahead_m, 0.0) / np.maximum(met.ego.speeds_mps, STANDING_MPS)
    return np.where(moving & np.isfinite(ahead_m), times, np.inf)


@dataclass(frozen=True)
class _Ahead:
    """Road users along the ego's path: ``gaps_m`` from the ego's front to their rear, infinite if not ahead.

    ``speeds_mps``: their speeds along the path; ``aside_m``: how far their centres are from it.
    """

    gaps_m: Values
    speeds_mps: Values
    aside_m: Values


def ahead_of(ego: Track, met: Encounters) -> _Ahead:
    """Return the gaps to other road users along the ego's path, their speeds along it, and their distance from it.

    The path is what the ego drove afterwards, extended straight ahead; a vehicle is ahead if it is on that path
    (lateral overlap of the bodies) and heads within 45° of it.
    """
    last = np.array([np.cos(ego.headings_rad[-1]), np.sin(ego.headings_rad[-1])])
    path = np.concatenate([ego.positions, ego.positions[-1:] + _COUNTED_WITHIN_M * last])
    stations = arc_length(path)
    station, distance, heading = _on_path(path, stations, met)
    on_it = distance < (met.ego.sizes_m[:, 1] + met.other.sizes_m[:, 1]) / 2
    turned = wrap_angles(met.other.headings_rad - heading)
    in_front = (station - stations[met.state] > _LEVEL_M) & on_it & (np.abs(turned) < SAME_DIRECTION_RAD)
    gap = station - stations[met.state] - (met.other.sizes_m[:, 0] + met.ego.sizes_m[:, 0]) / 2
    return _Ahead(np.where(in_front, gap, np.inf), met.other.speeds_mps * np.cos(turned), distance)


def risk_scores(gaps_m: Values, times_to_collision: Values) -> NDArray[np.intp]:
    """Return risk scores (n,): 0 collision, 1 extreme, 2 high, 3 medium, 4 low, 5 negligible; gaps in m, times in s.

    The scale comes from "From Words to Collisions" (TUM-AVS, ITSC 2025). Distance and time to collision each get a
    score, 0 at zero and 1 to 4 up to 0.5, 1, 3 and 5 (m or s), and the mean is rounded down. The most dangerous road
    user at the most dangerous step counts. We use the gap between the rectangles and the time to collision in the
    plane; the source weights longitudinal and lateral parts by the other road user's direction.
    """
    distance = np.searchsorted(_RISK_STEPS_M, gaps_m, side="left")
    time = np.searchsorted(_RISK_STEPS_S, times_to_collision, side="left")
    scores: NDArray[np.intp] = (distance + time) // 2
    return scores


def _on_path(path: Points, stations: Values, met: Encounters) -> tuple[Values, Values, Values]:
    """Return the path's arc length, distance and heading at the point nearest to each road user, shapes (n,).

    Only the path after the ego's state counts: on a route that crosses itself, road users behind the ego must not be
    found.
    """
    blocks = range(0, len(met.state), _PAIRS_AT_ONCE)
    parts = [
        _nearest(path, stations, met.other.centers[i : i + _PAIRS_AT_ONCE], met.state[i : i + _PAIRS_AT_ONCE])
        for i in blocks
    ]
    station, distance, heading = (np.concatenate(values) for values in zip(*parts, strict=True))
    return station, distance, heading


def _nearest(path: Points, stations: Values, points: Points, begin: NDArray[np.intp]) -> tuple[Values, Values, Values]:
    start, step = path[:-1], np.diff(path, axis=0)
    squared = np.maximum((step**2).sum(axis=1), 1e-12)
    away = points[:, None, :] - start[None, :, :]
    share = np.clip((away * step).sum(axis=2) / squared, 0.0, 1.0)
    gap = np.linalg.norm(away - share[:, :, None] * step, axis=2)
    gap[np.arange(len(start))[None, :] < begin[:, None]] = np.inf
    gap[:, np.diff(stations) < 1e-6] = np.inf
    nearest, rows = gap.argmin(axis=1), np.arange(len(points))
    station = stations[nearest] + share[rows, nearest] * np.sqrt(squared[nearest])
    return station, gap[rows, nearest], np.arctan2(step[nearest, 1], step[nearest, 0])


def _least(values: Values) -> float | None:
    """Return the shortest time in s, or None if no time is within 100 s."""
    least = float(values.min())
    return least if least <= _LONGEST_S else None
