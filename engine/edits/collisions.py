"""Collisions that edits bring about: overlaps of touched vehicles that are not in the recording."""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.edits.handover import TouchedTrack
from plannerforge.engine.geometry.polyline import Points, Values, oriented_rectangle, rectangles_overlap
from plannerforge.engine.scenarios.tracks import Track

TOUCH_M = 0.05
"""Bodies that overlap by less are not colliding: recorded positions are not better than that."""

NEAR_STEPS = 10
"""An overlap that begins so soon before or after a recorded one of the same two is the recorded one."""


@dataclass(frozen=True)
class Body:
    """A moving rectangle: centres (n, 2) and headings (n,) from ``first_step`` on, length and width in m.

    ``shifted_steps``: how much later than recorded it moves, of a recording moved in time.
    """

    key: int
    first_step: int
    positions: Points
    headings_rad: Values
    size_m: tuple[float, float]
    shifted_steps: int = 0


@dataclass(frozen=True)
class Overlap:
    """The step from which on two bodies overlap; ``first`` is a touched one."""

    first: int
    second: int
    step: int


def body_of_track(track: Track) -> Body:
    """A recorded road user."""
    return Body(
        track.obstacle_id, track.first_step, track.positions, track.headings_rad, (track.length_m, track.width_m)
    )


def body_of_touched(track: TouchedTrack) -> Body:
    """A touched vehicle."""
    size = (track.length_m, track.width_m)
    return Body(track.vehicle_id, track.first_step, track.motion.positions, track.motion.headings_rad, size)


def new_overlaps(touched: Iterable[Body], others: Iterable[Body], recorded: Mapping[int, Body]) -> tuple[Overlap, ...]:
    """First overlaps of touched bodies with all others and with one another, ordered by step.

    An overlap that begins where the same two overlap in the recording is left out: no edit caused it. The recordings
    of two that are moved in time alike count as recorded, those of two that are moved otherwise do not. Several of the
    others may have one key: they stand for one obstacle.
    """
    moved, rest = list(touched), list(others)
    found: dict[tuple[int, int], Overlap] = {}
    for number, body in enumerate(moved):
        among_moved = [(other, recorded.get(other.key)) for other in moved[number + 1 :]]
        for other, before in among_moved + [(other, recorded.get(other.key, other)) for other in rest]:
            step, pair = _first_new(body, other, recorded.get(body.key), before), (body.key, other.key)
            if step is not None and (pair not in found or step < found[pair].step):
                found[pair] = Overlap(*pair, step)
    return tuple(sorted(found.values(), key=lambda hit: (hit.step, hit.first, hit.second)))


def overlap_steps(first: Body, second: Body) -> Iterator[int]:
    """The steps at which two bodies overlap, ascending."""
    begin = max(first.first_step, second.first_step)
    end = min(first.first_step + len(first.positions), second.first_step + len(second.positions))
    if begin >= end:
        return
    one, two = (
        slice(begin - first.first_step, end - first.first_step),
        slice(begin - second.first_step, end - second.first_step),
    )
    apart = np.linalg.norm(first.positions[one] - second.positions[two], axis=1)
    reach = (math.hypot(*first.size_m) + math.hypot(*second.size_m)) / 2
    for offset in np.flatnonzero(apart < reach).tolist():
        corners = [
            oriented_rectangle(body.positions[index], float(body.headings_rad[index]), body.size_m)
            for body, index in ((first, one.start + offset), (second, two.start + offset))
        ]
        if rectangles_overlap(corners[0], corners[1], TOUCH_M):
            yield int(begin + offset)


def _first_new(first: Body, second: Body, first_before: Body | None, second_before: Body | None) -> int | None:
    """The first step at which two bodies begin to overlap and did not about then as they were before; or None."""
    steps = overlap_steps(first, second)
    step = next(steps, None)
    if step is None or first_before is None or second_before is None:
        return step
    if first_before.shifted_steps != second_before.shifted_steps:
        return step
    known = tuple(overlap_steps(first_before, second_before))
    before = -2
    for now in itertools.chain([step], steps):
        if now > before + 1 and not any(abs(now - one) <= NEAR_STEPS for one in known):
            return now
        before = now
    return None
