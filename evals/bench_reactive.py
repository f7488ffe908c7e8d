"""``python -m plannerforge.evals.bench_reactive [FILES]``: the ego brakes to a stand; who hits it from behind?

Scenarios with a follower in the ego's lane are driven twice by a planner that brakes with 6 m/s², once with recorded
and once with reactive traffic. Keys: ``scenarios`` (with a follower), ``recorded_rear_hits``, ``reactive_rear_hits``,
``reactive_step_ms`` (median duration of a step of the reactive traffic).
"""

import math
import os
import statistics
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from rich.progress import track

from plannerforge.engine.execution.progress import silent
from plannerforge.engine.geometry.polyline import wrap_angle
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.simulation import DrivenRun, initial_ego, simulate
from plannerforge.engine.planners.traffic_modes import open_traffic
from plannerforge.engine.planners.vehicle import BMW_320I
from plannerforge.engine.scenarios.reader import LoadedScenario, read_scenario
from plannerforge.engine.scenarios.tracks import recorded_tracks
from plannerforge.engine.tuning.configurations import named_configuration
from plannerforge.evals.bench_output import print_figures
from plannerforge.evals.braking_planner import BrakingPlanner
from plannerforge.schemas.runs import Traffic

MOST_SCENARIOS = 25
BEHIND_M, BESIDE_M, ALIKE_RAD = 60.0, 1.75, 0.5


def place_behind(ego: EgoState, x_m: float, y_m: float) -> tuple[float, float]:
    """How far a point lies behind the ego, and to its left, in m."""
    cos, sin = math.cos(ego.heading_rad), math.sin(ego.heading_rad)
    dx, dy = x_m - float(ego.position[0]), y_m - float(ego.position[1])
    return -(dx * cos + dy * sin), dy * cos - dx * sin


def has_follower(loaded: LoadedScenario, ego: EgoState) -> bool:
    """Whether somebody drives behind a moving ego in its lane at its first step."""
    for other in recorded_tracks(loaded.scenario).values():
        index = other.index_at(ego.step)
        if index is None or other.speeds_mps[index] < 1.0 or ego.speed_mps < 1.0:
            continue
        behind, left = place_behind(ego, *other.positions[index])
        alike = abs(wrap_angle(float(other.headings_rad[index]) - ego.heading_rad)) < ALIKE_RAD
        if 0.0 < behind < BEHIND_M and abs(left) < BESIDE_M and alike:
            return True
    return False


def braked(loaded: LoadedScenario, traffic: Traffic) -> DrivenRun:
    """The run of an ego that brakes to a stand."""
    configuration, problem = named_configuration("frenetix:Default"), loaded.problem()
    if configuration is None:
        raise RuntimeError("the built-in configuration is gone")
    with open_traffic(traffic, loaded, problem, BMW_320I, seed=0) as others:
        return simulate(loaded.scenario, problem, configuration, BrakingPlanner(), "constant_velocity", silent, others)


def is_rear_hit(run: DrivenRun) -> bool:
    """Whether somebody ran into the ego from behind."""
    hit = run.final.collision
    if hit is None or hit.obstacle_id is None:
        return False
    ego = run.states[-1]
    other = next(one for one in (*run.traffic.moving, *run.traffic.standing) if one.obstacle_id == hit.obstacle_id)
    index = other.index_at(ego.step) or 0
    behind, _ = place_behind(ego, *other.positions[index])
    alike = abs(wrap_angle(float(other.headings_rad[index]) - ego.heading_rad)) < ALIKE_RAD
    return behind > 0.0 and alike


def main(arguments: Sequence[str]) -> None:
    """Measure on the named files, or on evenly chosen ones of the shared scenarios."""
    folder = Path(os.environ.get("PLANNERFORGE_SHARED", "../shared")) / "data" / "commonroad"
    files = [Path(text) for text in arguments] or sorted(folder.glob("*.xml"))
    chosen: list[LoadedScenario] = []
    for path in files[:: max(1, len(files) // (2 * MOST_SCENARIOS))] if not arguments else files:
        loaded = read_scenario(path)
        if len(chosen) < MOST_SCENARIOS and has_follower(loaded, initial_ego(loaded.problem().initial_state)):
            chosen.append(loaded)
    hits: dict[Traffic, int] = {"recorded": 0, "reactive": 0}
    step_ms: list[float] = []
    for loaded in track(chosen, description="braking"):
        for traffic in hits:
            began = time.perf_counter()
            run = braked(loaded, traffic)
            if traffic == "reactive":
                step_ms.append(1000 * (time.perf_counter() - began - sum(run.plan_s)) / len(run.states))
            hits[traffic] += is_rear_hit(run)
    figures = {
        "scenarios": len(chosen),
        "recorded_rear_hits": hits["recorded"],
        "reactive_rear_hits": hits["reactive"],
        "reactive_step_ms": round(statistics.median(step_ms), 2) if step_ms else 0.0,
    }
    print_figures("The ego brakes to a stand", [(key, str(value)) for key, value in figures.items()], figures)


if __name__ == "__main__":
    main(sys.argv[1:])
