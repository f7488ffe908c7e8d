"""Conflicts of the ego with other road users: time left to act, the worst possible case, and crossing paths.

Unless stated otherwise, arrays have one entry per pair of a driven state of the ego and another road user
(``criticality.encounters``). Formulas and parameters are those of ``schemas/measures.py``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..commonroad import Track
from ..criticality import MovingRectangles, corners_of
from ..geometry import Points, Values, wrap_angle, wrap_angles
from ..vehicles import HARDEST_BRAKING_MPS2, VehicleParameters

CONFLICT_S = 10.0
"""Later collisions do not limit the time to act (chosen): road users do not keep course and speed for longer."""
_AFTER_S = 3.0
"""How long an ego must stay clear after the collision that it evades (chosen), as for reference drivers."""
_SAMPLES = 651
"""Number of times at which bodies are checked between now and then: 0.02 s apart at most (chosen)."""
_BEGINS, _HALVINGS = 60, 5
"""Start times tried before a collision, and bisections between two of them (chosen): 5 ms resolution."""
_ASIDE_M = 3.5
"""How far an ego swerves for a crossing road user: about one lane width (chosen)."""
_PAIRS_AT_ONCE = 100
"""Number of pairs processed in one array (chosen for memory)."""
_FINE_S = 0.005
"""Time resolution between steps for crossing paths (chosen)."""
_CROSSING_RAD = np.pi / 4
"""Headings that differ by less count as the same direction, in which bodies follow each other."""


def times_left_to_crossing(
    ego: MovingRectangles, other: MovingRectangles, collision_s: Values, vehicle: VehicleParameters
) -> tuple[Values, Values]:
    """Return the times in s until full braking, or the best manoeuvre, cannot prevent a collision; two arrays (n,).

    The other road user keeps its course and speed. The ego does so until it brakes, swerves to either side or
    accelerates. 0 means too late.

    Args:
        ego, other: the bodies, on a collision course.
        collision_s: time until they touch.
        vehicle: limits of the ego.
    """
    brake, react, hardest = [np.zeros(0)], [np.zeros(0)], vehicle.hardest_braking_mps2
    for begin in range(0, len(collision_s), _PAIRS_AT_ONCE):
        part = slice(begin, begin + _PAIRS_AT_ONCE)
        conflict = _Conflict.of(_part(ego, part), _part(other, part), collision_s[part])
        braking = conflict.latest(_braked(hardest))
        others = [
            conflict.latest(_accelerated(vehicle)),
            *(conflict.latest(_swerved(side, hardest)) for side in (1.0, -1.0)),
        ]
        brake.append(braking)
        react.append(np.maximum.reduce([braking, *others]))
    return np.concatenate(brake), np.concatenate(react)


def _part(bodies: MovingRectangles, part: slice) -> MovingRectangles:
    return MovingRectangles(
        bodies.centers[part], bodies.headings_rad[part], bodies.sizes_m[part], bodies.speeds_mps[part]
    )


_Manoeuvre = Callable[[Values, Values], tuple[Values, Values]]
"""From times since its start and speeds, (n, times) and (n, 1), to the ego's displacement forward and to the left."""


def _braked(hardest_mps2: float) -> _Manoeuvre:
    def manoeuvre(since_s: Values, speed: Values) -> tuple[Values, Values]:
        braking = np.minimum(since_s, speed / hardest_mps2)
        return -hardest_mps2 / 2 * braking**2 - speed * (since_s - braking), np.zeros_like(since_s)

    return manoeuvre


def _accelerated(vehicle: VehicleParameters) -> _Manoeuvre:
    def manoeuvre(since_s: Values, speed: Values) -> tuple[Values, Values]:
        power = np.minimum(vehicle.switching_speed_mps / np.maximum(speed, 0.1), 1.0)
        return vehicle.maximum_acceleration_mps2 * power / 2 * since_s**2, np.zeros_like(since_s)

    return manoeuvre


def _swerved(side: float, hardest_mps2: float) -> _Manoeuvre:
    """Return a swerve: the largest lateral acceleration over half of the offset, then the opposite over the rest."""
    half_s = np.sqrt(_ASIDE_M / hardest_mps2)

    def manoeuvre(since_s: Values, _: Values) -> tuple[Values, Values]:
        first, rest = np.minimum(since_s, half_s), np.clip(2 * half_s - since_s, 0.0, half_s)
        aside = np.where(since_s < half_s, hardest_mps2 / 2 * first**2, _ASIDE_M - hardest_mps2 / 2 * rest**2)
        return np.zeros_like(since_s), side * aside

    return manoeuvre


@dataclass(frozen=True)
class _Conflict:
    """Bodies that will touch: their separation along their four axes, and how manoeuvres change it.

    ``apart`` (n, times, 4) is the difference between the centres on each axis while the two bodies keep their motion.
    ``along`` and ``aside`` (n, 1, 4) are its change per metre that the ego moves forward or to its left. The bodies are
    clear of each other at the difference ``needed_m`` (n, 1, 4). ``times_s`` has the shape (n, times).
    """

    times_s: Values
    speeds: Values
    apart: Values
    along: Values
    aside: Values
    needed_m: Values
    collision_s: Values

    @classmethod
    def of(cls, ego: MovingRectangles, other: MovingRectangles, collision_s: Values) -> "_Conflict":
        """Return the conflicts of all pairs, from the present state until some time after the collision."""
        axes = np.stack([*_axes(ego.headings_rad), *_axes(other.headings_rad)], axis=1)
        halves = sum(
            np.abs(np.einsum("nkd,nd->nk", axes, side)) * bodies.sizes_m[:, number, None] / 2
            for bodies in (ego, other)
            for number, side in enumerate(_axes(bodies.headings_rad))
        )
        times = np.linspace(0.0, 1.0, _SAMPLES)[None, :] * (collision_s + _AFTER_S)[:, None]
        now = np.einsum("nkd,nd->nk", axes, ego.centers - other.centers)
        change = np.einsum("nkd,nd->nk", axes, ego.velocities - other.velocities)
        ahead, left = _axes(ego.headings_rad)
        return cls(
            times_s=times,
            speeds=ego.speeds_mps[:, None],
            apart=now[:, None, :] + times[:, :, None] * change[:, None, :],
            along=np.einsum("nkd,nd->nk", axes, ahead)[:, None, :],
            aside=np.einsum("nkd,nd->nk", axes, left)[:, None, :],
            needed_m=np.asarray(halves)[:, None, :],
            collision_s=collision_s,
        )

    def latest(self, manoeuvre: _Manoeuvre) -> Values:
        """Return the latest start in s of a manoeuvre that stays clear; 0 if there is none.

        Evenly spaced start times are tried first, because a later one may be clear when an earlier one is not. The
        result is then refined by bisection.
        """
        low, span_s = np.full(len(self.collision_s), -1.0), self.collision_s / _BEGINS
        for number in range(_BEGINS):
            low = np.where(self._clear(manoeuvre, number * span_s), number * span_s, low)
        known, high = low >= 0, low + span_s
        low = np.maximum(low, 0.0)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            clear = known & self._clear(manoeuvre, middle)
            low, high = np.where(clear, middle, low), np.where(clear, high, middle)
        return np.where(known, low, 0.0)

    def _clear(self, manoeuvre: _Manoeuvre, begin_s: Values) -> NDArray[np.bool_]:
        farther, aside = manoeuvre(np.maximum(self.times_s - begin_s[:, None], 0.0), self.speeds)
        apart = self.apart + farther[:, :, None] * self.along + aside[:, :, None] * self.aside
        separated: NDArray[np.bool_] = np.any(np.abs(apart) >= self.needed_m, axis=2)
        clear: NDArray[np.bool_] = np.all(separated, axis=1)
        return clear


def _axes(headings_rad: Values) -> tuple[Points, Points]:
    """Return the directions forward and to the left, each (n, 2)."""
    cosine, sine = np.cos(headings_rad), np.sin(headings_rad)
    return np.stack([cosine, sine], axis=1), np.stack([-sine, cosine], axis=1)


def worst_times_s(ego: MovingRectangles, other: MovingRectangles, stands: NDArray[np.bool_]) -> Values:
    """Return worst times to collision (Wachenfeld et al. 2016), shape (n,); 0 if the bodies' discs overlap now.

    Each body is covered by three discs, a third of its length apart, that keep its velocity and grow with a t² ÷ 2. The
    first solution of |Δp + Δv t| = R + A t² ÷ 2 is a root of a polynomial of degree four.

    Args:
        ego, other: the bodies.
        stands: whether the other road user never moves.
    """
    if not len(stands):
        return np.zeros(0)
    grows = np.where(stands, HARDEST_BRAKING_MPS2, 2 * HARDEST_BRAKING_MPS2)
    change = other.velocities - ego.velocities
    radius = sum(np.hypot(bodies.sizes_m[:, 0] / 6, bodies.sizes_m[:, 1] / 2) for bodies in (ego, other))
    worst = np.full(len(stands), np.inf)
    for own in _thirds(ego):
        for theirs in _thirds(other):
            worst = np.minimum(worst, _first_meeting_s(theirs - own, change, np.asarray(radius), grows))
    return worst


def _thirds(bodies: MovingRectangles) -> list[Points]:
    ahead, _ = _axes(bodies.headings_rad)
    return [bodies.centers + share * bodies.sizes_m[:, :1] * ahead for share in (-1 / 3, 0.0, 1 / 3)]


def _first_meeting_s(away: Points, change: Points, radius_m: Values, grows_mps2: Values) -> Values:
    """Return the times in s at which discs that move by ``change`` and grow by ``grows_mps2`` · t² ÷ 2 touch.

    The time is 0 for discs that touch already.
    """
    fourth = -(grows_mps2**2) / 4
    square = (change**2).sum(axis=1) - grows_mps2 * radius_m
    linear = 2 * (away * change).sum(axis=1)
    constant = (away**2).sum(axis=1) - radius_m**2
    companion = np.zeros((len(fourth), 4, 4))
    companion[:, 1, 0] = companion[:, 2, 1] = companion[:, 3, 2] = 1.0
    companion[:, 0, 3], companion[:, 1, 3], companion[:, 2, 3] = (
        -constant / fourth,
        -linear / fourth,
        -square / fourth,
    )
    roots = np.linalg.eigvals(companion)
    real = (np.abs(roots.imag) < _ROUNDING * (1 + np.abs(roots.real))) & (roots.real > 0)
    first = np.where(real, roots.real, np.inf).min(axis=1)
    return np.where(constant <= 0, 0.0, first)


_ROUNDING = 1e-6
"""Tolerance for a root's imaginary part: if discs just touch, two real roots coincide up to rounding."""


@dataclass(frozen=True)
class Crossing:
    """A crossing of the ego's path with another road user's, and the times at which each is in the common area.

    Times in s since the ego's first state. ``ego_whole``: whether the ego both entered and left the area;
    ``turned_rad``: the difference of their headings there, 0 to π.
    """

    track: int
    ego_s: tuple[float, float]
    other_s: tuple[float, float]
    ego_whole: bool
    turned_rad: float

    @property
    def post_encroachment_s(self) -> float:
        """The time from the first road user's exit to the other's entry; 0 if they were in the area together."""
        return max(self.other_s[0] - self.ego_s[1], self.ego_s[0] - self.other_s[1], 0.0)

    @property
    def second_arrival_s(self) -> float:
        """The time at which the second road user enters the area."""
        return max(self.ego_s[0], self.other_s[0])


def nearest_crossing(ego: Track, others: Sequence[Track], step_s: float, within_s: float) -> Crossing | None:
    """Return the crossing with the shortest post-encroachment time, up to ``within_s``, or None if there is none."""
    import shapely

    swept = [_bodies(track, step_s) for track in (ego, *others)]
    tree = shapely.STRtree(swept[0].polygons)
    found: list[Crossing] = []
    for number, (track, theirs) in enumerate(zip(others, swept[1:], strict=True)):
        if np.ptp(track.positions, axis=0).max() < _MOVED_M:
            continue
        at, own = tree.query(theirs.polygons, predicate="intersects")
        turned = np.abs(wrap_angles(track.headings_rad[at] - ego.headings_rad[own]))
        apart_s = np.abs((track.first_step + at - ego.first_step - own) * step_s)
        crosses = (turned > _CROSSING_RAD) & (apart_s <= within_s)
        if crosses.any():
            crossing = _crossing(number, swept[0], theirs, own[crosses], at[crosses], ego.first_step - track.first_step)
            found += [crossing] if crossing.post_encroachment_s <= within_s else []
    return min(found, key=lambda one: (one.post_encroachment_s, one.track), default=None)


_MOVED_M = 0.5
"""A road user that moved less counts as standing, and has no path that could cross (chosen)."""


@dataclass(frozen=True)
class _Bodies:
    """A road user's body at each of its steps, as polygons, with its track and time step."""

    track: Track
    step_s: float
    polygons: NDArray[np.object_]

    def band(self, begin: int, end: int) -> object:
        """Return the area that the body sweeps from one index to another."""
        import shapely

        pieces = self.polygons[begin : end + 1]
        swept = shapely.convex_hull(shapely.union(pieces[:-1], pieces[1:])) if len(pieces) > 1 else pieces
        return shapely.union_all(swept)

    def inside(self, band: object, begin: int, end: int) -> tuple[float, float, bool]:
        """Return the first and last times in a band, and whether the body is outside before and after.

        Times are in s since the track's first state. The search covers one step before the first index to one step
        after the last, linear between the steps.
        """
        import shapely

        last = len(self.polygons) - 1
        first_s, last_s = max(begin - 1, 0) * self.step_s, min(end + 1, last) * self.step_s
        between = np.linspace(first_s, last_s, max(round((last_s - first_s) / _FINE_S), 1) + 1)
        index = np.arange(last + 1)
        times = np.union1d(between, index[max(begin - 1, 0) : end + 2] * self.step_s)
        share = times / self.step_s
        centers = np.column_stack([np.interp(share, index, self.track.positions[:, axis]) for axis in (0, 1)])
        headings = np.interp(share, index, np.unwrap(self.track.headings_rad))
        touching = np.flatnonzero(shapely.intersects(_polygons(self.track, centers, headings), band))
        first, end = int(touching[0]), int(touching[-1])
        came, left = (
            (times[max(first - 1, 0)] + times[first]) / 2,
            (times[end] + times[min(end + 1, len(times) - 1)]) / 2,
        )
        return float(came), float(left), bool(first > 0 and end < len(times) - 1)


def _bodies(track: Track, step_s: float) -> _Bodies:
    return _Bodies(track, step_s, _polygons(track, track.positions, track.headings_rad))


def _polygons(track: Track, centers: Points, headings_rad: Values) -> NDArray[np.object_]:
    import shapely

    sizes = np.tile(track.size_m, (len(centers), 1))
    bodies = MovingRectangles(centers, headings_rad, sizes, np.zeros(len(centers)))
    polygons: NDArray[np.object_] = shapely.polygons(corners_of(bodies))
    return polygons


def _crossing(
    number: int, ego: _Bodies, other: _Bodies, own: NDArray[np.intp], at: NDArray[np.intp], ego_later_steps: int
) -> Crossing:
    """Return the crossing around the pair of overlapping states that are nearest in time.

    Each body is in the area while it is in the band that the other body sweeps.

    Args:
        number: index of the other road user.
        ego, other: the bodies.
        own, at: states in which the bodies overlap.
        ego_later_steps: steps from the other road user's first state to the ego's.
    """
    nearest = int(np.argmin(np.abs(at - own - ego_later_steps)))
    own_span, other_span = _run_around(own, own[nearest]), _run_around(at, at[nearest])
    ego_first, ego_last, whole = ego.inside(other.band(*other_span), *own_span)
    other_first, other_last, _ = other.inside(ego.band(*own_span), *other_span)
    later_s = ego_later_steps * ego.step_s
    turned = wrap_angle(float(other.track.headings_rad[at[nearest]] - ego.track.headings_rad[own[nearest]]))
    return Crossing(number, (ego_first, ego_last), (other_first - later_s, other_last - later_s), whole, abs(turned))


def _run_around(indices: NDArray[np.intp], middle: int) -> tuple[int, int]:
    """Return the first and last indices of the consecutive run that contains an index."""
    known = np.unique(indices)
    place = int(np.searchsorted(known, middle))
    breaks = np.flatnonzero(np.diff(known) > 1)
    begin = int(breaks[breaks < place].max(initial=-1)) + 1
    end = int(breaks[breaks >= place].min(initial=len(known) - 1))
    return int(known[begin]), int(known[end])
