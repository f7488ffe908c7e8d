"""Recorded SUMO tracks as drivable motions from step 0 on.

SUMO spreads a lane change over time: a vehicle that must stop during the change keeps sliding sideways, or is set back
if the next lane is curved differently, and the heading derived from its track turns across the lane. Therefore each
track is first corrected (:func:`on_wheels`): the vehicle moves sideways only while it rolls. Then the track is
smoothed, more strongly if it is less drivable (:func:`generated_vehicles`). Motions that still cannot be driven, or
overlap, are left out (:func:`drop_infeasible`).
"""

import logging
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..geometry import BoxTrack, Points, Values, first_overlaps
from ..vehicles import SMOOTHINGS, Motion, VehicleClass, center_track, check_kinematics, drivable_motion
from .simulation import RawTrack

logger = logging.getLogger(__name__)
DECIMALS = 4
"""Decimal places in scenario files: 0.1 mm, and 20 seconds of arc."""
FARTHEST_ASTRAY_M = 4.0
"""A vehicle farther from SUMO's position missed more than one lane change (a lane's width is 3 to 3.75 m)."""


@dataclass(frozen=True)
class GeneratedVehicle:
    """A generated vehicle from step 0 on: its class, the motion of its centre, and whether the motion can be driven."""

    vehicle_id: str
    vehicle_class: VehicleClass
    motion: Motion
    feasible: bool

    @property
    def size_m(self) -> tuple[float, float]:
        """The length and width in m."""
        return self.vehicle_class.length_m, self.vehicle_class.width_m

    @property
    def steps(self) -> int:
        """The number of steps at which the vehicle is present, including step 0."""
        return len(self.motion.positions)

    @property
    def body(self) -> BoxTrack:
        """The moving body of the vehicle."""
        return BoxTrack(self.motion.positions, self.motion.headings_rad, self.size_m)


def generated_vehicles(tracks: Iterable[RawTrack], step_s: float) -> tuple[GeneratedVehicle, ...]:
    """Return the recorded vehicles with smoothed, drivable motions."""
    return tuple(_generated_vehicle(track, step_s) for track in tracks)


@dataclass(frozen=True)
class DroppedVehicle:
    """A recorded vehicle that is left out, and the reason."""

    vehicle: GeneratedVehicle
    code: Literal["not_drivable", "overlap"]


def drop_infeasible(
    everyone: Sequence[GeneratedVehicle], needed: Mapping[str, int]
) -> tuple[tuple[GeneratedVehicle, ...], tuple[DroppedVehicle, ...]]:
    """Return the vehicles that stay, and as few as possible that cannot be driven or overlap other vehicles.

    ``needed``: how many of a class must stay, even if their motion cannot be driven.
    """
    counts = Counter(vehicle.vehicle_class.name for vehicle in everyone)
    kept: list[GeneratedVehicle] = []
    dropped: list[DroppedVehicle] = []
    for vehicle in everyone:
        name = vehicle.vehicle_class.name
        if vehicle.feasible or counts[name] <= needed.get(name, 0):
            kept.append(vehicle)
        else:
            counts[name] -= 1
            dropped.append(DroppedVehicle(vehicle, "not_drivable"))
    apart = _apart(kept, counts, needed)
    stay = {vehicle.vehicle_id for vehicle in apart}
    dropped += [DroppedVehicle(vehicle, "overlap") for vehicle in kept if vehicle.vehicle_id not in stay]
    for one in dropped:
        name = one.vehicle.vehicle_class.name
        logger.debug("vehicle_left_out vehicle=%s class=%s code=%s", one.vehicle.vehicle_id, name, one.code)
    return apart, tuple(dropped)


def _apart(
    kept: list[GeneratedVehicle], counts: Counter[str], needed: Mapping[str, int]
) -> tuple[GeneratedVehicle, ...]:
    """Return vehicles without overlaps; those that overlap most and that their class can spare are removed first."""
    pairs = [(kept[pair.first], kept[pair.second]) for pair in first_overlaps([vehicle.body for vehicle in kept])]
    gone: set[str] = set()
    while pairs:
        involved = Counter(vehicle.vehicle_id for pair in pairs for vehicle in pair)
        *_, worst, name = max(
            (counts[name] > needed.get(name, 0), involved[vehicle.vehicle_id], vehicle.vehicle_id, name)
            for pair in pairs
            for vehicle in pair
            for name in [vehicle.vehicle_class.name]
        )
        gone.add(worst)
        counts[name] -= 1
        pairs = [pair for pair in pairs if worst not in (pair[0].vehicle_id, pair[1].vehicle_id)]
    return tuple(vehicle for vehicle in kept if vehicle.vehicle_id not in gone)


def _generated_vehicle(track: RawTrack, step_s: float) -> GeneratedVehicle:
    chassis = track.vehicle_class
    front = on_wheels(track.front, track.along_m, track.aside_m)
    center = center_track(front, track.first_heading_rad, chassis.length_m)
    astray = bool(np.any(np.linalg.norm((front - track.front)[track.lead_in :], axis=1) > FARTHEST_ASTRAY_M))
    tried: list[GeneratedVehicle] = []
    for sigma_steps, sigma_m in SMOOTHINGS:
        whole = drivable_motion(
            center,
            track.first_heading_rad,
            0.0,  # the track is the centre's already
            step_s,
            sigma_steps=sigma_steps,
            sigma_m=sigma_m,
            rear_axle_m=chassis.rear_axle_m,
        )
        motion = _rounded(whole, track.lead_in)
        verdict = check_kinematics(motion, step_s, wheelbase_m=chassis.wheelbase_m, rear_axle_m=chassis.rear_axle_m)
        tried.append(GeneratedVehicle(track.vehicle_id, chassis, motion, verdict.feasible and not astray))
        if verdict.feasible:
            return tried[-1]
    return tried[0]


def _rounded(motion: Motion, first: int) -> Motion:
    """Return the motion after a step as written to the file, with headings in (−π, π], for use in all checks."""
    turn = np.arctan2(np.sin(motion.headings_rad), np.cos(motion.headings_rad))
    values = motion.positions, turn, motion.speeds_mps, motion.accelerations_mps2
    return Motion(*(value[first:].round(DECIMALS) for value in values))


STEEPEST = 0.3
"""Largest lateral metres per metre along the lane (chosen): 17°, a lane's width in 11 m."""
LARGEST_EXCESS, LARGEST_EXCESS_M = 1.05, 0.01
"""A step longer than the vehicle's motion, by more than this factor and length, is a jump (chosen)."""
MOVED_M = 1e-3
"""A shorter step has no direction (chosen)."""


def on_wheels(track: Points, along_m: Values, aside_m: Values) -> Points:
    """Return a vehicle's track without jumps, sliding and driving backwards, shape (n, 2).

    Args:
        track: where the vehicle is at each step, shape (n, 2), in metres.
        along_m: how far it has rolled along its lane since the step before, shape (n,).
        aside_m: how far it was moved sideways since the step before, shape (n,), left positive.
    """
    made = [(float(track[0, 0]), float(track[0, 1]))]
    for (goal_x, goal_y), course in zip(track[1:].tolist(), _lane_headings(track, along_m, aside_m), strict=True):
        x, y = made[-1]
        cos, sin = math.cos(course), math.sin(course)
        ahead = max((goal_x - x) * cos + (goal_y - y) * sin, 0.0)
        aside = (goal_y - y) * cos - (goal_x - x) * sin
        aside = min(max(aside, -STEEPEST * ahead), STEEPEST * ahead)
        made.append((x + ahead * cos - aside * sin, y + ahead * sin + aside * cos))
    return np.array(made)


def _lane_headings(track: Points, along_m: Values, aside_m: Values) -> list[float]:
    """Return the heading of the lane at each step but the first; if unknown, repeat the heading of the previous
    step.
    """
    moved = np.diff(track, axis=0)
    length, wanted = np.hypot(moved[:, 0], moved[:, 1]), np.hypot(along_m[1:], aside_m[1:])
    shows = (length > MOVED_M) & (length < LARGEST_EXCESS * wanted + LARGEST_EXCESS_M)
    course = np.arctan2(moved[:, 1], moved[:, 0]) - np.arctan2(aside_m[1:], along_m[1:])
    last = np.maximum.accumulate(np.where(shows, np.arange(len(moved)), int(np.argmax(shows))))
    return list(course[last])
