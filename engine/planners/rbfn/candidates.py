"""Candidates of MP-RBFN: sampled end states next to the reference path, and the rear-axle motions that lead to them.

A candidate is a primitive of the network onto an offset from the path, followed by a motion along the path at that
offset until the horizon. Its speed changes evenly to a target within a ramp, which may extend beyond the primitive, and
then stays constant. Stations are arc lengths along the path in m, offsets in m with left positive.
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...geometry import PathFollower, Points, Values, arc_length, gaussian, wrap_angle
from ...vehicles import VehicleParameters
from ..driving.following import is_on_plan
from ..interface import EgoState, PlannedTrajectory
from ..reference_path import FASTEST_MPS
from .network import Motions, PrimitiveEnds, PrimitiveNetwork, motion_primitives

_SPACING_M = 0.2
"""Distance between the entries of a path's table, which is linear between them (chosen)."""
_SMOOTHING_M = 1.5
"""Length over which the curvature of the path is smoothed for the primitives' end states (chosen)."""
_LATERAL_M = 3.0
"""Largest sampled offset, as in Frenetix."""
_SHARES = (1 / 3, 2 / 3, 1.0)
"""Shares of the horizon that primitives and ramps take (chosen)."""
_ASKEW_RAD = (-0.15, 0.15)
"""Angles to the path at which some full-horizon primitives end, in addition to those that end along it (chosen)."""
_HARDEST = 0.9
"""Share of the vehicle's largest acceleration that the hardest stop uses (chosen)."""
_STANDING_M = 0.01
"""A stop on a shorter distance counts as one on the spot (chosen)."""
_LEAST_PACE = 0.2
"""Inside a turn, the distance at an offset is shorter than the path's, at most by this factor."""


class PathTable:
    """A reference path by its arc length: points, headings and curvatures, for many stations at once.

    It follows the rear axle of one run, which starts near the station ``begin_m`` if that is known. Requests for its
    feet must come in driving order.
    """

    def __init__(self, path: Points, begin_m: float | None = None) -> None:
        from scipy.interpolate import CubicSpline

        self._follower, stations = PathFollower(path, begin_m), arc_length(path)
        spline = CubicSpline(stations, path)
        at = np.arange(0.0, float(stations[-1]), _SPACING_M)
        points, along, bending = spline(at), spline(at, 1), spline(at, 2)
        heading = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
        turn = (along[:, 0] * bending[:, 1] - along[:, 1] * bending[:, 0]) / np.linalg.norm(along, axis=1) ** 3
        self._table = np.column_stack([points, heading, gaussian(turn, _SMOOTHING_M / _SPACING_M)])

    def at(self, stations_m: Points) -> Points:
        """Return x, y, heading and curvature at stations of any shape, along a new last axis.

        Beyond either end, the values are those at the end.
        """
        place = np.clip(stations_m / _SPACING_M, 0.0, len(self._table) - 1.000001)
        left = place.astype(np.intp)
        share = (place - left)[..., None]
        return np.asarray(self._table[left] * (1 - share) + self._table[left + 1] * share)

    def foot(self, point: Points) -> float:
        """Return the station nearest to a point (2,)."""
        nearest = np.array([self._follower.place(point)[0]])
        return float(self.coordinates(point[:1], point[1:], nearest)[0][0])

    def coordinates(self, x_m: Points, y_m: Points, near_m: Points, rounds: int = 4) -> tuple[Points, Points, Points]:
        """Return stations, offsets and the path's headings for points near stations, all of the same shape."""
        stations = near_m
        for _ in range(rounds):
            here = self.at(stations)
            cos, sin = np.cos(here[..., 2]), np.sin(here[..., 2])
            away_x, away_y = x_m - here[..., 0], y_m - here[..., 1]
            stations = stations + away_x * cos + away_y * sin
        here = self.at(stations)
        cos, sin = np.cos(here[..., 2]), np.sin(here[..., 2])
        return stations, (y_m - here[..., 1]) * cos - (x_m - here[..., 0]) * sin, here[..., 2]


@dataclass(frozen=True)
class Start:
    """The rear axle at the start: position (2,), heading, speed, curvature, and its position relative to the path."""

    position: Points
    heading_rad: float
    speed_mps: float
    curvature_per_m: float
    station_m: float
    offset_m: float
    turned_rad: float

    @classmethod
    def of(cls, path: PathTable, rear: Points, heading_rad: float, speed_mps: float, curvature_per_m: float) -> "Start":
        """Return the start for a rear axle at a point (2,); ``turned_rad`` is its heading relative to the path."""
        near = np.array([path.foot(rear)])
        (station,), (offset,), (along,) = path.coordinates(rear[:1], rear[1:], near)
        turned = wrap_angle(heading_rad - float(along))
        return cls(rear, heading_rad, speed_mps, curvature_per_m, float(station), float(offset), turned)


def _sampled_values(level: int) -> int:
    """Return the number of sampled speeds and offsets."""
    return int(2 ** (level + 1)) + 1


def followed_within_m(level: int) -> float:
    """Return the largest distance from a candidate at which the vehicle still follows it: half the offset spacing."""
    return _LATERAL_M / (_sampled_values(level) - 1)


@dataclass(frozen=True)
class Samples:
    """The targets of n candidates, each of shape (n,): a speed within a ramp, and an offset at a primitive's end.

    ``askew_rad``: the angle to the path at its end; ``as_steered``: the candidate keeps the present steering angle
    instead, and ends at a standstill.
    """

    duration_s: Values
    ramp_s: Values
    target_mps: Values
    offset_m: Values
    askew_rad: Values
    as_steered: NDArray[np.bool_]

    @classmethod
    def of(
        cls, start: Start, desired_mps: float, horizon_s: float, step_s: float, level: int, vehicle: VehicleParameters
    ) -> "Samples":
        """Return all combinations, including the present speed and offset, the desired speed, and the hardest stop."""
        values = _sampled_values(level)
        spans = [max(round(share * horizon_s / step_s), 1) * step_s for share in _SHARES]
        low = max(0.0, start.speed_mps - vehicle.maximum_acceleration_mps2 * horizon_s)
        reach = start.speed_mps + vehicle.maximum_acceleration_mps2 / 6.0 * horizon_s
        high = max(min(reach, FASTEST_MPS, vehicle.maximum_speed_mps), low)
        speeds = np.unique([*np.linspace(low, high, values), start.speed_mps, desired_mps])
        offsets = np.unique([*np.linspace(-_LATERAL_M, _LATERAL_M, values), start.offset_m])
        pairs = [(span, ramp) for ramp in reversed(spans) for span in spans if span <= ramp]
        aims = [(span, ramp, 0.0) for span, ramp in pairs] + [(spans[-1], spans[-1], askew) for askew in _ASKEW_RAD]
        rows = [
            (span, ramp, speed, offset, askew, 0.0)
            for span, ramp, askew in aims
            for speed in speeds
            for offset in offsets
        ]
        hardest = np.ceil(start.speed_mps / (_HARDEST * vehicle.maximum_acceleration_mps2) / step_s) * step_s
        stops = [*spans, hardest] if 0.0 < hardest < spans[0] else spans
        rows += [(stop, stop, 0.0, start.offset_m, 0.0, 1.0) for stop in stops]
        span, ramp, target, offset, askew, steered = np.array(rows).T
        return cls(span, ramp, target, offset, askew, steered > 0.0)

    def speeds_at(self, start: Start, times_s: Values) -> Points:
        """Return the speed after each time, shape (n, m)."""
        gained = np.minimum(times_s / self.ramp_s[:, None], 1.0)
        return np.asarray(start.speed_mps + (self.target_mps - start.speed_mps)[:, None] * gained)

    def travelled_m(self, start: Start, times_s: Points) -> Points:
        """Return the distances covered after times of shape (m,) or (n, m), as (n, m)."""
        ramp = self.ramp_s[:, None]
        within, after = np.minimum(times_s, ramp), np.maximum(times_s - ramp, 0.0)
        change = (self.target_mps - start.speed_mps)[:, None]
        return np.asarray(start.speed_mps * within + change * within**2 / (2 * ramp) + self.target_mps[:, None] * after)


@dataclass(frozen=True)
class Candidates:
    """Motions of n candidates over m steps in world coordinates, and their last positions relative to the path.

    ``known``: whether the network knows the primitive. ``primitive_steps`` (n,): its number of steps. ``can_continue``:
    whether it ends along the path or standing. ``gentleness`` (n,): mean change of speed in m/s² over the ramp.
    ``stops_s`` (n,): the time of its standstill, otherwise infinite.
    """

    motions: Motions
    known: NDArray[np.bool_]
    can_continue: NDArray[np.bool_]
    primitive_steps: NDArray[np.intp]
    gentleness: Values
    stops_s: Values
    last_station_m: Values
    last_offset_m: Values

    @property
    def count(self) -> int:
        """The number of candidates."""
        return len(self.known)

    def part(self, rows: slice) -> "Candidates":
        """Return the candidates in the given rows."""
        motions = Motions(*(values[rows] for values in _arrays(self.motions)))
        return Candidates(motions, *(values[rows] for values in _arrays(self)[1:]))

    def with_rest(self, rest: "Candidates | None") -> "Candidates":
        """Return these candidates together with the rest of the current plan."""
        if rest is None:
            return self
        both = (np.concatenate(pair) for pair in zip(_arrays(self.motions), _arrays(rest.motions), strict=True))
        others = (np.concatenate(pair) for pair in zip(_arrays(self)[1:], _arrays(rest)[1:], strict=True))
        return Candidates(Motions(*both), *others)


def _arrays(record: Motions | Candidates) -> list[Any]:
    return [getattr(record, item.name) for item in fields(record)]


def candidates(
    network: PrimitiveNetwork, path: PathTable, start: Start, samples: Samples, times_s: Values
) -> Candidates:
    """Return the motions to sampled ends at m times; the first is 0."""
    span = samples.duration_s
    distances_m = samples.travelled_m(start, span[:, None])[:, 0]
    station = _stations_after(path, start, samples.offset_m, distances_m)
    motions, known = motion_primitives(
        network, start.speed_mps, start.curvature_per_m, _ends(path, start, samples, distances_m, station), times_s
    )
    on_path, last_m = _along(path, start, samples, station, times_s)
    cos, sin = np.cos(start.heading_rad), np.sin(start.heading_rad)
    x = start.position[0] + motions.x_m * cos - motions.y_m * sin
    y = start.position[1] + motions.x_m * sin + motions.y_m * cos
    is_over = (times_s > span[:, None] + 1e-9) & ~samples.as_steered[:, None]
    merged = (
        np.where(is_over, after, before)
        for after, before in zip(
            _arrays(on_path),
            (x, y, motions.heading_rad + start.heading_rad, motions.speed_mps, motions.curvature_per_m),
            strict=True,
        )
    )
    still = samples.as_steered & (distances_m < _STANDING_M)
    as_now = (*start.position, start.heading_rad, 0.0, start.curvature_per_m)
    standing = (np.where(still[:, None], now, values) for now, values in zip(as_now, merged, strict=True))
    stands = np.where(samples.target_mps > 0.0, np.inf, samples.ramp_s)
    return Candidates(
        Motions(*standing),
        known | still,
        samples.askew_rad == 0.0,
        np.rint(span / (times_s[1] - times_s[0])).astype(np.intp),
        np.abs(samples.target_mps - start.speed_mps) / samples.ramp_s,
        stands,
        last_m,
        samples.offset_m,
    )


def _stations_after(path: PathTable, start: Start, offsets_m: Values, distances_m: Values) -> Values:
    """Return the stations at which primitives of a length and end offset end, shape (n,).

    Lateral motion uses up distance. At an offset, the distance is longer or shorter than along the path, depending on
    the curvature.
    """
    aside = offsets_m - start.offset_m
    ahead = np.sqrt(np.maximum(distances_m**2 - 1.2 * aside**2, (0.3 * distances_m) ** 2))
    turn = path.at(start.station_m + ahead)[:, 2] - path.at(np.array([start.station_m]))[:, 2]
    curvature = turn / np.maximum(ahead, _SPACING_M)
    pace = np.maximum(1.0 - curvature * (offsets_m + start.offset_m) / 2, _LEAST_PACE)
    return np.asarray(start.station_m + ahead / pace)


def _ends(path: PathTable, start: Start, samples: Samples, distances_m: Values, station_m: Values) -> PrimitiveEnds:
    """Return the primitives' ends relative to the rear axle."""
    here = path.at(station_m)
    heading, end_curvature = here[:, 2], here[:, 3]
    x = here[:, 0] - samples.offset_m * np.sin(heading) - start.position[0]
    y = here[:, 1] + samples.offset_m * np.cos(heading) - start.position[1]
    cos, sin = np.cos(start.heading_rad), np.sin(start.heading_rad)
    begin_rad = float(path.at(np.array([start.station_m]))[0, 2]) + start.turned_rad
    curvature = end_curvature / np.maximum(1.0 - end_curvature * samples.offset_m, _LEAST_PACE)
    steered = samples.as_steered
    turn = start.curvature_per_m * distances_m
    chord = distances_m * np.sinc(turn / (2 * np.pi))
    gained = np.minimum(samples.duration_s / samples.ramp_s, 1.0)
    return PrimitiveEnds(
        samples.duration_s,
        np.where(steered, chord * np.cos(turn / 2), x * cos + y * sin),
        np.where(steered, chord * np.sin(turn / 2), y * cos - x * sin),
        np.where(steered, turn, heading + samples.askew_rad - begin_rad),
        np.where(steered, start.curvature_per_m, curvature),
        start.speed_mps + (samples.target_mps - start.speed_mps) * gained,
    )


def _along(
    path: PathTable, start: Start, samples: Samples, station_m: Values, times_s: Values
) -> tuple[Motions, Values]:
    """Return the motions along the path after the primitives' ends, and the stations at their last step.

    The headings continue those of the start, whatever multiple of 2π the path's headings have.
    """
    offset = samples.offset_m
    distances_m = samples.travelled_m(start, np.maximum(times_s, samples.duration_s[:, None]))
    stations = np.empty_like(distances_m)
    stations[:, 0] = now = station_m
    for step, gained in enumerate(np.diff(distances_m, axis=1).T, start=1):
        pace = np.maximum(1.0 - path.at(now)[:, 3] * offset, _LEAST_PACE)
        stations[:, step] = now = now + gained / pace
    here = path.at(stations)
    x, y, heading, curvature = (here[..., column] for column in range(4))
    behind = start.heading_rad - start.turned_rad - float(path.at(np.array([start.station_m]))[0, 2])
    motions = Motions(
        x - offset[:, None] * np.sin(heading),
        y + offset[:, None] * np.cos(heading),
        heading + behind,
        samples.speeds_at(start, times_s),
        curvature / np.maximum(1.0 - curvature * offset[:, None], _LEAST_PACE),
    )
    return motions, np.asarray(stations[:, -1])


@dataclass(frozen=True)
class Driven:
    """The candidate chosen at ``first_step``, as a candidate and as a trajectory of the centre."""

    first_step: int
    chosen: Candidates
    trajectory: PlannedTrajectory

    def holds(self, ego: EgoState, within_m: float) -> bool:
        """Return True if the ego is within ``within_m`` of this plan."""
        return is_on_plan(self.trajectory, ego.step - self.first_step, ego, within_m)

    def rest(self, path: PathTable, step: int, step_s: float) -> Candidates | None:
        """Return the rest at a later step, continued along the path at its last speed; None if it ends at an angle."""
        gone, before = step - self.first_step, self.chosen
        if not before.can_continue[0]:
            return None
        last = [values[:, -1] for values in _arrays(before.motions)]
        x, y, heading, speed, _ = last
        times: Values = np.arange(gone + 1, dtype=np.float64) * step_s
        beyond = Samples(
            np.zeros(1), np.full(1, step_s), speed, before.last_offset_m, np.zeros(1), np.zeros(1, np.bool_)
        )
        start = Start(
            np.array([x[0], y[0]]),
            float(heading[0]),
            float(speed[0]),
            0.0,
            float(before.last_station_m[0]),
            float(before.last_offset_m[0]),
            0.0,
        )
        on_path, last_m = _along(path, start, beyond, before.last_station_m, times)
        if not speed[0]:  # a candidate as steered may stand askew
            on_path = Motions(*(np.repeat(values[:, None], gone + 1, axis=1) for values in last))
        joined = (
            np.concatenate([first[:, gone:], after[:, 1:]], axis=1)
            for first, after in zip(_arrays(before.motions), _arrays(on_path), strict=True)
        )
        return Candidates(
            Motions(*joined),
            before.known,
            before.can_continue,
            np.maximum(before.primitive_steps - gone, 0),
            before.gentleness,
            np.maximum(before.stops_s - gone * step_s, 0.0),
            last_m,
            before.last_offset_m,
        )
