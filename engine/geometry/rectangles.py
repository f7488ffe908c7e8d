"""Which vehicles overlap, at all steps and for all pairs at once (separating axes on oriented rectangles)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .polyline import Points, Values

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Body:
    """A vehicle from step 0 on: centres (n, 2) in m, headings (n,) in rad, length and width in m."""

    positions: Points
    headings_rad: Values
    size_m: tuple[float, float]


@dataclass(frozen=True)
class Overlap:
    """Two bodies by their places in the sequence (``one`` < ``other``), and the first step at which they overlap."""

    one: int
    other: int
    step: int


def overlaps(bodies: Sequence[Body]) -> list[Overlap]:
    """All overlapping pairs, each once, in order; two bodies are compared at the steps at which both are there."""
    found: list[Overlap] = []
    for one, body in enumerate(bodies):
        others, steps = _near(body, bodies, one + 1)
        if not len(others):
            continue
        hit = _separating_axes(body, bodies, others, steps)
        found += [
            Overlap(one, int(other), int(steps[hit & (others == other)].min())) for other in np.unique(others[hit])
        ]
    return found


def _near(body: Body, bodies: Sequence[Body], first: int) -> tuple[Indices, Indices]:
    """(body, step) of all later bodies whose circle around meets that of this one."""
    others: list[Indices] = []
    steps: list[Indices] = []
    for index in range(first, len(bodies)):
        count = min(len(body.positions), len(bodies[index].positions))
        reach = (np.hypot(*body.size_m) + np.hypot(*bodies[index].size_m)) / 2
        apart = np.abs(body.positions[:count] - bodies[index].positions[:count])
        near = np.flatnonzero((apart[:, 0] < reach) & (apart[:, 1] < reach))
        others.append(np.full(len(near), index))
        steps.append(near)
    if not others:
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    return np.concatenate(others), np.concatenate(steps)


def _separating_axes(body: Body, bodies: Sequence[Body], others: Indices, steps: Indices) -> NDArray[np.bool_]:
    """Whether the rectangles overlap, shape (k,): no axis of either one keeps them apart."""
    apart = np.array([bodies[i].positions[s] for i, s in zip(others, steps, strict=True)]) - body.positions[steps]
    theta = np.array([bodies[i].headings_rad[s] for i, s in zip(others, steps, strict=True)])
    sizes = np.array([bodies[i].size_m for i in others]) / 2
    half = np.broadcast_to(np.array(body.size_m) / 2, sizes.shape)
    hit = np.ones(len(others), dtype=bool)
    turn = theta - body.headings_rad[steps]
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    for mine, theirs, angle in ((half, sizes, body.headings_rad[steps]), (sizes, half, theta)):
        along = np.abs(apart[:, 0] * np.cos(angle) + apart[:, 1] * np.sin(angle))
        across = np.abs(apart[:, 1] * np.cos(angle) - apart[:, 0] * np.sin(angle))
        hit &= along < mine[:, 0] + theirs[:, 0] * cos + theirs[:, 1] * sin
        hit &= across < mine[:, 1] + theirs[:, 0] * sin + theirs[:, 1] * cos
    return hit
