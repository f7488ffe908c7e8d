"""The network of radial basis functions that generates motion primitives, implemented in numpy.

A primitive is a rear-axle motion by the kinematic single-track model between two states in a given time, with as little
change of speed and curvature as possible. The idea is that of Kaufeld, Piccinini and Betz, "MP-RBFN: Learning-based
vehicle motion primitives using radial basis function networks" (2025): a network learns the solutions of an optimal
control problem. Scaling, network and training are ours.

**Scaling.** Measured in its own duration and in the length of its chord, every primitive belongs to a family with six
boundary values, regardless of speed, duration and wheelbase. With ``T`` the duration, ``l`` the chord, ``v`` the speed
and ``k`` the curvature (tangent of the steering angle ÷ wheelbase), ``V = v·T/l`` and ``K = k·l``:

- ``dx/dτ = V cos ψ``, ``dy/dτ = V sin ψ``, ``dψ/dτ = V·K``, for τ from 0 to 1;
- the inputs are V and K at the start, the bearing of the chord, the turn ψ(1), and K and V at the end;
- mirrored inputs give the mirrored primitive, so the network knows only bearings to the left.

**Network.** One linear layer (the standardised inputs), Gaussian radial units, one linear layer. Its outputs are the
differences of V and K from the straight line between their ends, at 29 inner nodes; between nodes both are linear, as
in the samples. Integrating them gives the pose, so every primitive satisfies the model, however well the network is
trained; a training error only makes it miss the end, and a smooth shift along the primitive corrects that.
"""

from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from ...geometry import Points, Values

PRIMITIVE_NODES = 31
"""States of a primitive, including both ends."""
PRIMITIVE_INPUTS = ("speed_start", "curvature_start", "bearing", "turn", "curvature_end", "speed_end")
"""The boundary values in order, scaled as the module describes."""
_FILE = "network.npz"
_SHORTEST_CHORD_M = 1e-3
"""Shorter distances count as 0, so that nothing is divided by them (chosen)."""
_LARGEST_MISS, _LARGEST_MISS_RAD = 0.02, 0.03
"""Largest miss of an end, as a share of the chord and in heading, of a primitive that the network knows (chosen)."""
_STEP = 1.0 / (PRIMITIVE_NODES - 1)
_TAU: Values = np.linspace(0.0, 1.0, PRIMITIVE_NODES)
_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float32]


@dataclass(frozen=True)
class PrimitiveEnds:
    """The ends of n primitives relative to the rear axle at their start; each array has shape (n,)."""

    duration_s: Values
    x_m: Values
    y_m: Values
    turn_rad: Values
    curvature_per_m: Values
    speed_mps: Values


@dataclass(frozen=True)
class Motions:
    """States of n rear axles at m times, each of shape (n, m): positions, headings, speeds, curvatures."""

    x_m: Points
    y_m: Points
    heading_rad: Points
    speed_mps: Points
    curvature_per_m: Points


@dataclass(frozen=True)
class PrimitiveNetwork:
    """Weights of a network; ``lowest`` and ``highest`` (6,) bound its training inputs.

    ``mean`` and ``spread`` (6,) standardise inputs. The units have ``centres`` (h, 6) and one ``width`` for all.
    ``outputs`` (h + 7, 58): weights of the units, of the six inputs and of a constant, for K at the inner nodes, then
    for V.
    """

    mean: _Floats
    spread: _Floats
    lowest: _Floats
    highest: _Floats
    centres: _Floats
    width: _Floats
    outputs: _Floats

    @classmethod
    def shipped(cls) -> "PrimitiveNetwork":
        """Return the network in the package."""
        with files(__package__ or "").joinpath(_FILE).open("rb") as stream, np.load(stream) as arrays:
            return cls(**{name: arrays[name] for name in cls.__dataclass_fields__})

    def knows(self, inputs: Points) -> _Flags:
        """Return whether the training covered the inputs (n, 6), mirrored if the bearing is to the right;
        shape (n,).
        """
        canonical = _to_the_left(inputs)[0]
        return np.asarray(((canonical >= self.lowest) & (canonical <= self.highest)).all(axis=1))

    def profiles(self, inputs: Points) -> tuple[Points, Points]:
        """Return curvature K and speed V at the nodes, each of shape (n, 31), for inputs (n, 6); their ends
        are exact.
        """
        canonical, side = _to_the_left(inputs)
        above = self.features(canonical) @ self.outputs
        inner = (PRIMITIVE_NODES - 2,)
        curvature = straight_lines(canonical[:, 1], canonical[:, 4])
        speed = straight_lines(canonical[:, 0], canonical[:, 5])
        curvature[:, 1:-1] += above[:, : inner[0]]
        speed[:, 1:-1] += above[:, inner[0] :]
        return curvature * side[:, None], np.maximum(speed, 0.0)

    def features(self, canonical: Points) -> _Floats:
        """Return the inputs of the last layer, shape (n, h + 7), for inputs with bearings to the left."""
        scaled = ((canonical - self.mean) / self.spread).astype(np.float32)
        squared = (scaled**2).sum(axis=1)[:, None] - 2.0 * scaled @ self.centres.T + self._squared
        units = np.exp(squared * np.float32(-0.5 / float(self.width) ** 2))
        return np.concatenate([units, scaled, np.ones((len(scaled), 1), dtype=np.float32)], axis=1)

    @cached_property
    def _squared(self) -> _Floats:
        return np.asarray((self.centres**2).sum(axis=1))


def scaled_inputs(speed_mps: float, curvature_per_m: float, ends: PrimitiveEnds) -> tuple[Points, Values]:
    """Return the network's inputs (n, 6) for a start and n ends, and the chords (n,) in m."""
    chord = np.maximum(np.hypot(ends.x_m, ends.y_m), _SHORTEST_CHORD_M)
    pace = ends.duration_s / chord
    bearing = np.arctan2(ends.y_m, ends.x_m)
    columns = (speed_mps * pace, curvature_per_m * chord, bearing, ends.turn_rad)
    return np.stack([*columns, ends.curvature_per_m * chord, ends.speed_mps * pace], axis=1), chord


def _to_the_left(inputs: Points) -> tuple[Points, Values]:
    """Return the inputs, mirrored if the bearing is to the right, and the sides: −1 for mirrored inputs."""
    side = np.where(inputs[:, 2] < 0.0, -1.0, 1.0)
    mirrored = inputs.copy()
    mirrored[:, 1:5] *= side[:, None]
    return mirrored, side


def straight_lines(first: Values, last: Values) -> Points:
    """Return straight lines over the nodes from first to last values (n,), shape (n, 31)."""
    return np.asarray(first[:, None] + (last - first)[:, None] * _TAU)


def driven_poses(curvature: Points, speed: Points) -> tuple[Points, Points, Points]:
    """Return x, y and heading (n, 31) of a rear axle with scaled curvatures and speeds (n, 31), linear between nodes.

    The headings are exact; the positions use Simpson's rule on every interval.
    """
    k0, k1, v0, v1 = curvature[:, :-1], curvature[:, 1:], speed[:, :-1], speed[:, 1:]
    middle_k, middle_v = (k0 + k1) / 2, (v0 + v1) / 2
    begins, both, ends = k0 * v0, middle_k * middle_v, k1 * v1
    heading = _summed(_STEP / 6 * (begins + 4 * both + ends))
    middle = heading[:, :-1] + _STEP / 24 * (5 * begins + 8 * both - ends)
    x, y = (
        _summed(_STEP / 6 * (v0 * part(heading[:, :-1]) + 4 * middle_v * part(middle) + v1 * part(heading[:, 1:])))
        for part in (np.cos, np.sin)
    )
    return x, y, heading


def _summed(gains: Points) -> Points:
    return np.concatenate([np.zeros((len(gains), 1)), np.cumsum(gains, axis=1)], axis=1)


def motion_primitives(
    network: PrimitiveNetwork, speed_mps: float, curvature_per_m: float, ends: PrimitiveEnds, times_s: Values
) -> tuple[Motions, _Flags]:
    """Return the primitives to n ends at m times, and whether the network knows each of them.

    The network knows a primitive if the training covered the inputs and the primitive misses its end only slightly.
    Primitives start at the origin with the heading along x. After its duration a primitive stays at its end.
    """
    inputs, chord = scaled_inputs(speed_mps, curvature_per_m, ends)
    curvature, speed = network.profiles(inputs)
    x, y, heading = driven_poses(curvature, speed)
    shift = _TAU**2 * (3 - 2 * _TAU)
    slope = 6 * _TAU * (1 - _TAU)
    miss_x, miss_y = np.cos(inputs[:, 2]) - x[:, -1], np.sin(inputs[:, 2]) - y[:, -1]
    missed_rad = inputs[:, 3] - heading[:, -1]
    known = network.knows(inputs) & (np.hypot(miss_x, miss_y) <= _LARGEST_MISS) & (abs(missed_rad) <= _LARGEST_MISS_RAD)
    heading = heading + missed_rad[:, None] * shift
    slope_x = speed * np.cos(heading) + miss_x[:, None] * slope
    slope_y = speed * np.sin(heading) + miss_y[:, None] * slope
    x, y = x + miss_x[:, None] * shift, y + miss_y[:, None] * shift
    made = [np.empty((len(x), len(times_s))) for _ in range(5)]
    for duration in np.unique(ends.duration_s):
        rows = np.flatnonzero(ends.duration_s == duration)
        at = np.minimum(times_s / duration, 1.0) * (PRIMITIVE_NODES - 1)
        left = np.minimum(at.astype(np.intp), PRIMITIVE_NODES - 2)
        share = at - left
        for into, values, slopes in (
            (made[0], x, slope_x),
            (made[1], y, slope_y),
            (made[2], heading, speed * curvature),
        ):
            into[rows] = _cubic(values[rows], slopes[rows], left, share)
        for into, values in ((made[3], speed), (made[4], curvature)):
            into[rows] = values[rows][:, left] * (1 - share) + values[rows][:, left + 1] * share
    back = chord[:, None]
    motions = Motions(
        made[0] * back, made[1] * back, made[2], made[3] * back / ends.duration_s[:, None], made[4] / back
    )
    return motions, known


def _cubic(values: Points, slopes: Points, left: NDArray[np.intp], share: Values) -> Points:
    """Return cubic Hermite curves from values and slopes at the nodes (n, 31), at m positions: shape (n, m)."""
    rest = 1.0 - share
    ends = values[:, left] * (1 + 2 * share) * rest**2 + values[:, left + 1] * share**2 * (3 - 2 * share)
    bent = slopes[:, left] * share * rest**2 - slopes[:, left + 1] * share**2 * rest
    return np.asarray(ends + _STEP * bent)
