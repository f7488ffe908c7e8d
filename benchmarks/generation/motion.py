"""Checks the traffic of a generated scenario: on the lanelets, without overlaps, feasible for the checker."""

import itertools
import random
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.commonroad import LoadedScenario, recorded_tracks

from ..tracks import is_drivable, overlap_steps

TOUCHING_M = 1e-6
"""Depth of overlap that rounding can cause for touching rectangles."""


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
