"""Recorded SUMO tracks as drivable motions from step 0 on."""

from dataclasses import dataclass

import numpy as np

from plannerforge.engine.geometry.polyline import oriented_rectangle, rectangles_overlap
from plannerforge.engine.traffic.feasibility import check_kinematics
from plannerforge.engine.traffic.simulation import RawTrack, RecordedTraffic
from plannerforge.engine.traffic.smoothing import Motion, drivable_motion
from plannerforge.engine.traffic.vehicle_classes import VehicleClass

SMOOTHINGS = ((3.0, 2.0), (5.0, 3.0), (8.0, 4.0))
"""(steps, metres) tried in this order until a motion is drivable; stronger smoothing moves the vehicle more."""

DECIMALS = 4


@dataclass(frozen=True)
class Participant:
    """A vehicle from step 0 on: its class, its motion of the centre, and whether that can be driven."""

    vehicle_id: str
    vehicle_class: VehicleClass
    motion: Motion
    feasible: bool

    @property
    def size_m(self) -> tuple[float, float]:
        """Length and width."""
        return self.vehicle_class.length_m, self.vehicle_class.width_m

    @property
    def steps(self) -> int:
        """How many steps it is there, step 0 included."""
        return len(self.motion.positions)

    def overlaps(self, other: "Participant", step: int) -> bool:
        """Whether the rectangles of the two overlap at a step at which both are there."""
        one = oriented_rectangle(self.motion.positions[step], float(self.motion.headings_rad[step]), self.size_m)
        two = oriented_rectangle(other.motion.positions[step], float(other.motion.headings_rad[step]), other.size_m)
        return rectangles_overlap(one, two)


def participants(traffic: RecordedTraffic) -> tuple[tuple[Participant, ...], int]:
    """Smoothed participants without overlaps at step 0, and how many were left out for overlapping there."""
    kept: list[Participant] = []
    dropped = 0
    for track in traffic.tracks:
        new = _participant(track, traffic.step_s)
        if any(_near(new, other) and new.overlaps(other, 0) for other in kept):
            dropped += 1
        else:
            kept.append(new)
    return tuple(kept), dropped


def first_collision(one: Participant, others: tuple[Participant, ...]) -> tuple[int, str] | None:
    """The first step at which a participant overlaps another, and that one's id."""
    for step in range(one.steps):
        for other in others:
            if other is not one and step < other.steps:
                distance = np.abs(other.motion.positions[step] - one.motion.positions[step]).max()
                if distance < 20.0 and one.overlaps(other, step):
                    return step, other.vehicle_id
    return None


def _near(one: Participant, other: Participant) -> bool:
    return bool(np.abs(one.motion.positions[0] - other.motion.positions[0]).max() < 20.0)


def _participant(track: RawTrack, step_s: float) -> Participant:
    tried: list[Participant] = []
    for sigma_steps, sigma_m in SMOOTHINGS:
        whole = drivable_motion(
            track.front,
            track.first_heading_rad,
            track.vehicle_class.length_m,
            step_s,
            sigma_steps=sigma_steps,
            sigma_m=sigma_m,
        )
        motion = _rounded(_from(whole, track.lead_in))
        feasible = check_kinematics(motion, step_s).feasible
        tried.append(Participant(track.vehicle_id, track.vehicle_class, motion, feasible))
        if feasible:
            return tried[-1]
    return tried[0]


def _from(motion: Motion, first: int) -> Motion:
    return Motion(
        motion.positions[first:],
        motion.headings_rad[first:],
        motion.speeds_mps[first:],
        motion.accelerations_mps2[first:],
    )


def _rounded(motion: Motion) -> Motion:
    """The motion as it will stand in the file, headings in (−π, π], so that all checks see the same."""
    turn = np.arctan2(np.sin(motion.headings_rad), np.cos(motion.headings_rad))
    return Motion(
        motion.positions.round(DECIMALS),
        turn.round(DECIMALS),
        motion.speeds_mps.round(DECIMALS),
        motion.accelerations_mps2.round(DECIMALS),
    )
