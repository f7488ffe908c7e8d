"""Who gives way where SUMO lets two driven vehicles collide, and where it waits.

SUMO knows lanes, not bodies: it does not see who stands askew between two lanes, a rear that cuts a corner, or two
lanelets that overlap before they meet, and takes nobody to be in the way who has passed its stop line already.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from plannerforge.engine.edits.changes import DrivePlan
from plannerforge.engine.edits.collisions import Body, Overlap, body_of_touched
from plannerforge.engine.edits.handover import TouchedTrack
from plannerforge.engine.edits.manoeuvring import Halt
from plannerforge.engine.edits.turn_speed import HARDEST_BRAKING_MPS2
from plannerforge.engine.geometry.polyline import Points, arc_length, oriented_rectangle, rectangles_overlap

CLEAR_LENGTH_M, CLEAR_WIDTH_M = 0.5, 0.3
"""So much longer and wider is the body that has to find room where it waits."""

STOP_BEFORE_M = 0.5
"""Smoothing moves a vehicle along its way by so much at most."""

SAME_PLACE_M = 0.1
"""Poses nearer to each other than this are looked at once."""

AFTER_STEPS = 2


@dataclass(frozen=True)
class _Wait:
    """A vehicle that can give way: where, and at which step it comes to what it waits for."""

    plan: DrivePlan
    halt: Halt
    step: int


def plans_giving_way(
    plans: Mapping[int, DrivePlan],
    tracks: Mapping[int, TouchedTrack],
    bodies: Mapping[int, Body],
    overlaps: Iterable[Overlap],
) -> dict[int, DrivePlan]:
    """Plans with one halt more for one vehicle of every pair that overlaps and in which one can still stop before.

    That is one that was handed over rather than one that an edit is about, and of two such the later one.

    Args:
        plans: of the driven vehicles, whose new motions are in ``tracks``.
        bodies: everybody as the edits leave them.
    """
    found: dict[int, DrivePlan] = {}
    for hit in overlaps:
        if hit.first in found or hit.second in found:
            continue
        pairs = ((hit.first, hit.second), (hit.second, hit.first))
        waits = [
            _wait(plans[key], tracks[key], bodies[other], hit.step)
            for key, other in pairs
            if key in tracks and other in bodies
        ]
        possible = [wait for wait in waits if wait is not None]
        if possible:
            best = min(possible, key=lambda wait: (wait.plan.cause != "handed_over", -wait.step))
            found[best.plan.start.obstacle_id] = replace(best.plan, halts=(*best.plan.halts, best.halt))
    return found


def _wait(plan: DrivePlan, track: TouchedTrack, other: Body, hit_step: int) -> _Wait | None:
    """How a vehicle waits until another one is gone from where they meet; None if it cannot stop before.

    It reacts to nobody who has not entered yet.
    """
    body, in_the_way = body_of_touched(track), _in_the_way(other, hit_step)
    roomy = (body.size_m[0] + CLEAR_LENGTH_M, body.size_m[1] + CLEAR_WIDTH_M)
    index, gone = hit_step - body.first_step, hit_step
    while index >= 0:
        mine = oriented_rectangle(body.positions[index], float(body.headings_rad[index]), roomy)
        met = [step for step, corners in in_the_way if rectangles_overlap(mine, corners)]
        if not met:
            break
        gone, index = max(gone, met[-1]), index - 1
    if index < 0:
        return None
    from_step = max(body.first_step, other.first_step)
    stations = arc_length(track.motion.positions)
    rolled_m = max(float(stations[index]) - STOP_BEFORE_M, 0.0)
    now = from_step - body.first_step
    if float(track.motion.speeds_mps[now]) ** 2 > 2 * HARDEST_BRAKING_MPS2 * (rolled_m - float(stations[now])):
        return None
    return _Wait(plan, Halt(from_step, gone + AFTER_STEPS, rolled_m), body.first_step + index)


def _in_the_way(body: Body, from_step: int) -> list[tuple[int, Points]]:
    """The corners (4, 2) of a body from a step on, each place once: with the last step at which it is there."""
    places: list[tuple[int, int]] = []
    for index in range(max(from_step - body.first_step, 0), len(body.positions)):
        stays = bool(places) and math.dist(body.positions[places[-1][0]], body.positions[index]) < SAME_PLACE_M
        first = places.pop()[0] if stays else index
        places.append((first, index))
    return [
        (
            body.first_step + last,
            oriented_rectangle(body.positions[first], float(body.headings_rad[first]), body.size_m),
        )
        for first, last in places
    ]
