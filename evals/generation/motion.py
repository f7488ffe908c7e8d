"""How the traffic of a made scenario moves: on the lanelets, without overlaps, drivable for the drivability checker."""

import itertools
import random
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...engine.commonroad import LoadedScenario, Track, recorded_tracks
from ...engine.geometry import wrap_angle
from ...engine.vehicles import Motion, VehicleClass, class_by_size, steering_angles
from ..geometry import overlap_steps

TOUCHING_M = 1e-6
"""Rounding makes rectangles that only touch overlap less deep."""


@dataclass(frozen=True)
class MotionFigures:
    """Positions and how many of them lie on lanelets, overlapping pairs, tracks checked and feasible ones."""

    positions: int
    inside: int
    overlapping_pairs: int
    checked: int
    feasible: int
    infeasible_names: tuple[str, ...]


def measure_motion(loaded: LoadedScenario, sample: int, seed: int) -> MotionFigures:
    """Judge all positions and pairs, and the drivability of a sample of tracks (0.5 s each)."""
    from shapely import contains_xy, prepare, union_all

    tracks = list(recorded_tracks(loaded.scenario).values())
    lanes = union_all([lane.polygon.shapely_object.buffer(0.01) for lane in loaded.scenario.lanelet_network.lanelets])
    prepare(lanes)
    points = np.concatenate([track.positions for track in tracks]) if tracks else np.empty((0, 2))
    chosen = random.Random(seed).sample(tracks, min(sample, len(tracks)))  # noqa: S311 - reproducible, not secret
    verdicts = {f"{track.kind} {track.obstacle_id}": is_drivable(track, loaded.step_s) for track in chosen}
    return MotionFigures(
        positions=len(points),
        inside=int(contains_xy(lanes, points[:, 0], points[:, 1]).sum()),
        overlapping_pairs=sum(bool(overlap_steps(*pair, TOUCHING_M)) for pair in itertools.combinations(tracks, 2)),
        checked=len(verdicts),
        feasible=sum(verdicts.values()),
        infeasible_names=tuple(f"{loaded.benchmark_id}: {name}" for name, good in verdicts.items() if not good),
    )


def is_drivable(track: Track, step_s: float) -> bool:
    """The checker's verdict on a whole track: kinematic single track, with the dimensions of its own class."""
    from commonroad.common.solution import VehicleType
    from commonroad.scenario.state import KSState
    from commonroad.scenario.trajectory import Trajectory
    from commonroad_dc.feasibility.feasibility_checker import trajectory_feasibility
    from commonroad_dc.feasibility.vehicle_dynamics import VehicleDynamics

    model = VehicleDynamics.KS(VehicleType.BMW_320i)
    known = class_by_size(track.kind, track.length_m)
    if known is not None:
        model.parameters = _with_dimensions(model.parameters, known)
    motion = Motion(track.positions, track.headings_rad, track.speeds_mps, np.zeros(len(track.positions)))
    steering = steering_angles(motion, step_s) if known is None else steering_angles(motion, step_s, known.wheelbase_m)
    states = [
        KSState(
            time_step=index,
            position=position,
            steering_angle=float(steering[index]),
            velocity=max(float(track.speeds_mps[index]), 0.0),
            orientation=wrap_angle(float(track.headings_rad[index])),
        )
        for index, position in enumerate(track.positions)
    ]
    return bool(trajectory_feasibility(Trajectory(0, states), model, step_s)[0])


def _with_dimensions(parameters: Any, known: VehicleClass) -> Any:
    """The parameters with axles and size of a class; a copy, because the checker's are shared."""
    own = copy(parameters)
    own.b, own.a = known.rear_axle_m, known.wheelbase_m - known.rear_axle_m
    own.l, own.w = known.length_m, known.width_m
    return own
