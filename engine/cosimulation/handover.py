"""Convert SUMO's track of a driven vehicle into a motion that starts exactly at its recorded state.

SUMO moves the front bumper, on the centre of a lane and with stepwise speeds. The written motion is that of the centre:
the recorded states before the hand-over are prepended to SUMO's track, the result is smoothed, and the remaining
difference from the recorded state fades out (:func:`handover_track`).

The bumper follows the lane. A long vehicle cannot be driven in this way through turns with a radius of a few metres: a
bumper 12 m ahead of the rear axle needs at least 13 m. In that case, the centre follows the lane, as in generated
traffic, and the front swings out.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..commonroad import Track
from ..geometry import Points, Values
from ..vehicles import (
    REST_OF_SMOOTHING_MPS,
    SMOOTHINGS,
    Motion,
    VehicleClass,
    center_track,
    check_kinematics,
    drivable_motion,
    nearest_class,
    tractrix,
)
from .plans import lane_change_track
from .replay import DrivenTrack

HISTORY_STEPS = 15
"""Recorded states before the hand-over that smoothing uses (chosen: five standard deviations of 3 steps)."""
FEWEST_STATES = 5
"""Least number of states of a motion if the scenario lasts long enough (chosen): speeds need some steps."""
POSE_DECAY_S = 1.5
"""Time in which a difference in position falls to 37% (chosen)."""
SPEED_DECAYS_S = (0.8, 1.6, 3.2)
"""Times in which a difference in speed falls to 37% (chosen).

Tried in this order, each time compensated for the excess, until the first step changes the speed by no more than
``LARGEST_SPEED_STEP_MPS``; a slower one moves the vehicle more.
"""
LARGEST_SPEED_STEP_MPS = 0.95
"""Largest change of speed in a step of 0.1 s: 9.5 m/s², within the 11.5 m/s² of CommonRoad's vehicles."""
LANE_S = 3.0
"""A vehicle recorded next to its lane is led into it in this time, as in a lane change; SUMO puts it there at once."""
LONG_M = 6.0
"""A longer vehicle may swing its front out in curves (chosen): all classes except cars, taxis and two-wheelers."""
LEAST_SMOOTHING = (1.5, 0.8)
"""Smoothing in steps and in m of a prescribed motion (chosen): it has few kinks, and its values must be kept."""


@dataclass(frozen=True)
class HandoverTrack(Track):
    """A vehicle's new track with accelerations, starting from the recorded state at the hand-over.

    ``leaves``, ``lanes``, ``blocked_by``: as in ``DrivenTrack``.
    """

    accelerations_mps2: Values
    leaves: bool
    lanes: tuple[str, ...]
    blocked_by: tuple[int, ...] = ()

    @property
    def motion(self) -> Motion:
        """The motion of the centre."""
        return Motion(self.positions, self.headings_rad, self.speeds_mps, self.accelerations_mps2)

    @property
    def fronts(self) -> Points:
        """The front bumper (n, 2) in m at every step."""
        return self.positions + self.length_m / 2 * _directions(self.headings_rad)

    def whole(self, start: Track) -> Track:
        """Return the recorded track up to the hand-over, followed by the new track."""
        index = self.first_step - start.first_step
        return replace(
            start,
            positions=np.concatenate([start.positions[:index], self.positions]),
            headings_rad=np.concatenate([start.headings_rad[:index], self.headings_rad]),
            speeds_mps=np.concatenate([start.speeds_mps[:index], self.speeds_mps]),
        )


def handover_track(
    start: Track, driven: DrivenTrack, step_s: float, last_step: int, over_m: float | None = None
) -> HandoverTrack | None:
    """Smooth a driven track and join it to its recorded start without a jump.

    A vehicle that leaves the network at once rolls straight ahead for a few steps, because the road continues beyond
    the map. The result is None if the scenario ends within two steps of the hand-over.

    ``over_m``: the distance along its lane in which the vehicle changes to the adjacent lane, on which SUMO drives it;
    until the change is complete, it is on no lane. None means that it is already on the lane on which SUMO drives it.
    """
    index = driven.first_step - start.first_step
    wanted = min(FEWEST_STATES, last_step - driven.first_step + 1)
    onward = _rolled_on(start, index, driven.front[1:], wanted - 1, step_s)
    if len(onward) < 2:
        return None
    lanes, begin, expected = driven.lanes, start.front_at(index), _rolled_on(start, index, onward[:0], 1, step_s)[0]
    if over_m is None:
        onward = _led_into_lane(expected, onward, step_s)
    else:
        onward, across = lane_change_track(begin, expected, onward, over_m)
        lanes = ("", *(lane if is_across else "" for lane, is_across in zip(lanes[1:], across, strict=False)))
    motion = _driven_motion(start, index, onward, step_s)
    return HandoverTrack(
        obstacle_id=start.obstacle_id,
        kind=start.kind,
        length_m=start.length_m,
        width_m=start.width_m,
        first_step=driven.first_step,
        positions=motion.positions,
        headings_rad=motion.headings_rad,
        speeds_mps=motion.speeds_mps,
        accelerations_mps2=motion.accelerations_mps2,
        leaves=driven.leaves,
        lanes=lanes,
        blocked_by=driven.blocked_by,
    )


def led_track(
    start: Track, first_step: int, centers: Points, step_s: float, last_step: int, *, leaves: bool = False
) -> HandoverTrack | None:
    """Return given positions (n, 2) of the centre as a drivable motion, joined to a recorded start without a jump.

    The first point is the position at ``first_step``. The result has the weakest smoothing with which every step can be
    driven, else the smoothing with which most steps can. The result is None if the scenario ends within two steps.
    """
    index, chassis = first_step - start.first_step, nearest_class(start.kind, start.length_m)
    centers = centers[: last_step - first_step + 1]
    if len(centers) < 3:
        return None
    best = _most_drivable(
        (_led_motion(start, index, centers, 0.0, one, step_s, chassis) for one in (LEAST_SMOOTHING, *SMOOTHINGS)),
        step_s,
        chassis,
    )
    return HandoverTrack(
        obstacle_id=start.obstacle_id,
        kind=start.kind,
        length_m=start.length_m,
        width_m=start.width_m,
        first_step=first_step,
        positions=best.positions,
        headings_rad=best.headings_rad,
        speeds_mps=best.speeds_mps,
        accelerations_mps2=best.accelerations_mps2,
        leaves=leaves,
        lanes=("",) * len(best.speeds_mps),
    )


def _driven_motion(start: Track, index: int, onward: Points, step_s: float) -> Motion:
    """Return the motion after the hand-over for a track of the front, with the bumper on that track if possible.

    Of the motions that are tried, the first drivable one is chosen, else the most drivable one.
    """
    chassis, front = nearest_class(start.kind, start.length_m), np.vstack([start.front_at(index), onward])
    led = _led_motion(start, index, front, start.length_m / 2, SMOOTHINGS[0], step_s, chassis)
    if start.length_m <= LONG_M:
        return led

    def tried() -> Iterator[Motion]:
        yield led
        centers = center_track(front, float(start.headings_rad[index]), start.length_m)
        yield from (_led_motion(start, index, centers, 0.0, one, step_s, chassis) for one in SMOOTHINGS)

    return _most_drivable(tried(), step_s, chassis)


def _most_drivable(motions: Iterable[Motion], step_s: float, chassis: VehicleClass) -> Motion:
    """Return the first drivable motion, or the most drivable one; motions after the first are not computed."""
    best: Motion | None = None
    most = -1.0
    for motion in motions:
        share = _drivable_share(motion, step_s, chassis)
        if share > most:
            best, most = motion, share
        if most == 1.0:
            break
    if best is None:
        raise ValueError("there is no motion to choose from")
    return best


def _drivable_share(motion: Motion, step_s: float, chassis: VehicleClass) -> float:
    """Return the share of a motion's steps that a chassis can drive."""
    return check_kinematics(
        motion, step_s, wheelbase_m=chassis.wheelbase_m, rear_axle_m=chassis.rear_axle_m
    ).share_of_steps


def _led_motion(
    start: Track,
    index: int,
    led: Points,
    ahead_m: float,
    smoothing: tuple[float, float],
    step_s: float,
    chassis: VehicleClass,
) -> Motion:
    """Return the motion after the hand-over of a vehicle led by a point ``ahead_m`` ahead of its centre.

    ``led``: that point's track, starting at the hand-over; ``smoothing``: in steps and in m.
    """
    history = _history(start, index, ahead_m, step_s)
    first_heading = float(start.headings_rad[max(0, index - HISTORY_STEPS)])
    smooth = drivable_motion(
        np.concatenate([history, led]),
        first_heading,
        2 * ahead_m,
        step_s,
        sigma_steps=smoothing[0],
        sigma_m=smoothing[1],
        rear_axle_m=chassis.rear_axle_m,
    )
    return _joined(smooth, len(history), start, index, ahead_m, step_s, chassis.rear_axle_m)


def _rolled_on(start: Track, index: int, onward: Points, count: int, step_s: float) -> Points:
    """Return the front track after the hand-over with at least ``count`` points, continued at the recorded speed."""
    forward = _step_ahead(start, index, step_s)
    last = onward[-1] if len(onward) else start.front_at(index)
    more = [last + forward * step for step in range(1, count - len(onward) + 1)]
    return np.array([*onward, *more]).reshape(-1, 2)


def _led_into_lane(expected: Points, onward: Points, step_s: float) -> Points:
    """Return the front track after the hand-over with SUMO's jump to the centre of the lane faded in.

    ``expected``: where the front is after the first step if it rolls straight ahead, shape (2,).
    """
    share = np.clip(np.arange(1, len(onward) + 1) * step_s / LANE_S, 0.0, 1.0)
    led: Points = onward + (expected - onward[0]) * (1.0 - share**2 * (3.0 - 2.0 * share))[:, None]
    return led


def _led_at(start: Track, index: int, ahead_m: float) -> Points:
    """Return the recorded position (2,) of the point ``ahead_m`` ahead of the centre."""
    angle = float(start.headings_rad[index])
    return np.asarray(start.positions[index] + ahead_m * np.array([math.cos(angle), math.sin(angle)]))


def _history(start: Track, index: int, ahead_m: float, step_s: float) -> Points:
    """Return the recorded track of the point ``ahead_m`` ahead of the centre, up to the hand-over: (15, 2).

    The track is extended straight backwards if the recording is too short.
    """
    first = max(0, index - HISTORY_STEPS)
    recorded = [_led_at(start, past, ahead_m) for past in range(first, index)]
    ahead, missing = _step_ahead(start, first, step_s), HISTORY_STEPS - len(recorded)
    begin = _led_at(start, first, ahead_m)
    return np.array([begin - ahead * steps for steps in range(missing, 0, -1)] + recorded)


def _step_ahead(start: Track, index: int, step_s: float) -> Points:
    """Return the displacement (2,) in m of a vehicle that rolls straight ahead for one step from a recorded state."""
    angle, speed = float(start.headings_rad[index]), max(float(start.speeds_mps[index]), 0.0)
    return np.array([math.cos(angle), math.sin(angle)]) * speed * step_s


def _joined(
    smooth: Motion, skip: int, start: Track, index: int, ahead_m: float, step_s: float, rear_axle_m: float
) -> Motion:
    """Return the smoothed motion after the hand-over; differences from the recorded state fade out.

    Only the track of the leading point, ``ahead_m`` ahead of the centre, is corrected; the heading follows it as a
    tractrix that starts at the recorded heading, so the rear axle never slips sideways.
    """
    headings = smooth.headings_rad[skip:]
    forward = _directions(headings)
    led = smooth.positions[skip:] + ahead_m * forward
    times = np.arange(len(led)) * step_s
    led = led + (_led_at(start, index, ahead_m) - led[0]) * np.exp(-times / POSE_DECAY_S)[:, None]
    speed, drag = max(float(start.speeds_mps[index]), 0.0), ahead_m + rear_axle_m
    headings = tractrix(led, float(start.headings_rad[index]), drag)
    rear = led[:3] - drag * _directions(headings[:3])
    first_speeds = np.linalg.norm(np.diff(rear, axis=0), axis=1) / step_s
    missing = speed - (1.5 * first_speeds[0] - 0.5 * first_speeds[-1])
    for decay_s in SPEED_DECAYS_S:
        sped = _never_back(led + forward * (missing * times * np.exp(-times / decay_s))[:, None], forward)
        headings = tractrix(sped, float(start.headings_rad[index]), drag)
        centers = sped - ahead_m * _directions(headings)
        speeds = _rear_axle_speeds(centers - rear_axle_m * _directions(headings), headings, speed, step_s)
        step_mps = speeds[1] - speeds[0]
        if abs(step_mps) <= LARGEST_SPEED_STEP_MPS:
            break
        missing -= step_mps - math.copysign(LARGEST_SPEED_STEP_MPS, step_mps)
    return Motion(centers, headings, speeds, np.gradient(speeds, step_s))


def _never_back(led: Points, forward: Points) -> Points:
    """Return a track (n, 2) that stands where it would move backwards, as fading differences may cause at a stop.

    ``forward``: the unit vectors (n, 2) along which the vehicle drives.
    """
    ahead_m = np.concatenate([[0.0], np.cumsum((np.diff(led, axis=0) * forward[1:]).sum(axis=1))])
    monotone_m = np.maximum.accumulate(ahead_m)
    monotone: Points = led + forward * (monotone_m - ahead_m)[:, None]
    return monotone


def _directions(headings_rad: Values) -> Points:
    return np.stack([np.cos(headings_rad), np.sin(headings_rad)], axis=1)


def _rear_axle_speeds(rear: Points, headings: Values, first_mps: float, step_s: float) -> Values:
    """Return speeds along the heading of the rear axle, which a kinematic single-track model steers, shape (n,)."""
    forward = _directions(headings)
    moved = np.diff(rear, axis=0)
    along = np.maximum((moved * forward[:-1]).sum(axis=1) / step_s, 0.0)
    speeds = np.concatenate([[first_mps], (along[:-1] + along[1:]) / 2, along[-1:]])
    speeds[speeds < REST_OF_SMOOTHING_MPS] = 0.0
    return speeds
