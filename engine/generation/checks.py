"""Checks a scenario file as other tools will read it, and decides which faults make it unusable."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from ...schemas.generation import Checks
from ...schemas.scenarios import RuleFinding
from ..commonroad import LoadedScenario, Track, kept_recording, schema_errors
from ..geometry import BoxTrack, first_overlaps
from ..network import LaneletGraph, summarise_findings
from ..scene import lanelets_of_pose
from ..vehicles import Motion, check_kinematics, class_by_size, ego_class

LEAST_FEASIBLE = 0.97
"""Minimum share of tracks that a vehicle must be able to drive (chosen; docs/generation.md states it)."""
LEAST_ON_LANELETS = 0.985
"""Minimum share of recorded centres that must be on lanelets (chosen; docs/generation.md states it)."""
EDGE_M = 0.02
"""Widening of lanelets for this check in m: neighbours share their bound only up to rounding."""


def check_scenario(path: Path, ego: BoxTrack | None, findings: Sequence[RuleFinding]) -> Checks:
    """Read a written scenario back and check it.

    Args:
        path: the CommonRoad file.
        ego: the ego's recorded motion, which the file does not contain. None if an edit scripted other road users after
            the recording; the ego is then not checked here, and the caller checks an ordinary driver instead.
        findings: the rules' findings on its road network.
    """
    with ThreadPoolExecutor(1) as pool:  # libxml2 works without Python's lock
        schema_faults = pool.submit(schema_errors, path)
        recorded = kept_recording(path)
        loaded, tracks = recorded.loaded, recorded.tracks
        bodies = [BoxTrack(track.positions, track.headings_rad, track.size_m) for track in tracks.values()]
        first = 0 if ego is None else 1
        overlaps = first_overlaps(bodies if ego is None else [ego, *bodies])
        driven = {key: track for key, track in tracks.items() if track.kind != "pedestrian"}
        infeasible = tuple(key for key, track in driven.items() if not _feasible(track, loaded.step_s))
        return Checks(
            goal_reachable=_goal_reachable(loaded),
            collisions_at_start=_collisions_at_start(loaded, tracks),
            overlapping_pairs=sum(pair.first >= first for pair in overlaps),
            recorded_ego_collision_free=None if ego is None else all(pair.first >= first for pair in overlaps),
            centers_on_lanelets=_share_on_lanelets(loaded, tracks),
            feasible_share=1.0 - len(infeasible) / max(len(driven), 1),
            infeasible_vehicles=infeasible,
            network_errors=summarise_findings(findings, "error"),
            network_warnings=summarise_findings(findings, "warning"),
            schema_valid=not schema_faults.result(),
        )


def faults_of(checks: Checks) -> tuple[list[str], list[str]]:
    """Return the faults that make a scenario unusable, and those that only lower its quality, as text."""
    broken = {
        "the file breaks CommonRoad's schema": not checks.schema_valid,
        "the goal cannot be reached": not checks.goal_reachable,
        "vehicles overlap": checks.overlapping_pairs > 0 or checks.collisions_at_start > 0,
        "the ego's recorded path collides with another vehicle": checks.recorded_ego_collision_free is False,
        f"the road network is wrong: {'; '.join(checks.network_errors)}": bool(checks.network_errors),
    }
    weak = {
        f"{checks.feasible_share:.1%} of the tracks are drivable": checks.feasible_share < LEAST_FEASIBLE,
        f"{checks.centers_on_lanelets:.1%} of the centres are on lanelets": (
            checks.centers_on_lanelets < LEAST_ON_LANELETS
        ),
    }
    return [text for text, wrong in broken.items() if wrong], [text for text, wrong in weak.items() if wrong]


def _feasible(track: Track, step_s: float) -> bool:
    """Return whether a vehicle can drive a track, with the dimensions of its class if its size identifies the class."""
    motion = Motion(track.positions, track.headings_rad, track.speeds_mps, np.gradient(track.speeds_mps, step_s))
    known = class_by_size(track.kind, track.length_m)
    size = {} if known is None else {"wheelbase_m": known.wheelbase_m, "rear_axle_m": known.rear_axle_m}
    return check_kinematics(motion, step_s, **size).feasible


def _goal_reachable(loaded: LoadedScenario) -> bool:
    network = loaded.scenario.lanelet_network
    problem = loaded.problem()
    start = problem.initial_state
    starts = lanelets_of_pose(network, np.asarray(start.position), float(start.orientation))
    goals = [
        key
        for state in problem.goal.state_list
        for key in network.find_lanelet_by_position([np.asarray(state.position.center)])[0]
    ]
    return bool(starts and goals) and LaneletGraph.of(network).shortest_route(starts, goals) is not None


def _collisions_at_start(loaded: LoadedScenario, tracks: dict[int, Track]) -> int:
    """Count the pairs of road users that overlap at the ego's first step."""
    problem = loaded.problem()
    state = problem.initial_state
    size_m = ego_class(loaded.ego_class(int(problem.planning_problem_id))).vehicle.size_m
    ego = BoxTrack(np.array([state.position]), np.array([float(state.orientation)]), size_m)
    places = [(track, track.index_at(int(state.time_step))) for track in tracks.values()]
    others = [
        BoxTrack(track.positions[index : index + 1], track.headings_rad[index : index + 1], track.size_m)
        for track, index in places
        if index is not None
    ]
    return len(first_overlaps([ego, *others]))


def _share_on_lanelets(loaded: LoadedScenario, tracks: dict[int, Track]) -> float:
    """Return the share of all recorded centres that are on a lanelet."""
    from shapely import contains_xy, prepare, union_all

    if not tracks:
        return 1.0
    lanelets = [*loaded.scenario.lanelet_network.lanelets, *loaded.footways]
    union = union_all([lanelet.polygon.shapely_object.buffer(EDGE_M) for lanelet in lanelets])
    prepare(union)
    points = np.concatenate([track.positions for track in tracks.values()])
    return float(np.mean(contains_xy(union, points[:, 0], points[:, 1])))
