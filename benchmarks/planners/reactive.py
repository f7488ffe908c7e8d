"""``make bench-reactive``: rear hits of an ego that brakes to a standstill.

Scenarios with a follower in the ego's lane are driven with recorded and with reactive traffic. The planners are one
that brakes at once with 6 m/s², and each built-in planner, which drives for a second before the ego brakes in the same
way. A rear hit is one by a vehicle that followed the ego in its lane when it began to brake. A vehicle that the ego
cuts in on while it brakes, because its reference path changes lanes, does not count.

Keys: ``scenarios`` (with a follower), ``runs`` (with one traffic), ``recorded_rear_hits``, ``reactive_rear_hits``,
``reactive_step_ms`` (median duration of a step of the reactive traffic).

``--fresh SEED`` measures newly drawn approaches, ``--count`` for each seed: any recorded car with a follower becomes
the ego at any step of its recording. Keys: ``seeds``, ``fresh_approaches``, ``fresh_recorded_rear_hits``,
``fresh_rear_hits`` (reactive), and ``fresh_avoidable_rear_hits``, those by followers that could have stopped behind the
ego with 8 m/s² after one step.
"""

import random
import statistics
import time
from argparse import ArgumentParser
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plannerforge.engine.commonroad import LoadedScenario, Track, read_scenario, recorded_tracks
from plannerforge.engine.execution import silent
from plannerforge.engine.geometry import arc_length, interpolate, point_at, project, wrap_angle
from plannerforge.engine.planners import (
    PLANNERS,
    EgoState,
    Observation,
    Plan,
    PlannedTrajectory,
    Planner,
    PlanningTask,
    make_planner,
    simulate,
)
from plannerforge.engine.planners.registry import open_traffic
from plannerforge.engine.planners.simulation import DrivenRun
from plannerforge.engine.vehicles import BMW_320I
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.runs import Traffic

from ..harness import print_figures, process_pool, scenario_files, shared_scenarios
from ..tracks import ahead_and_left_m
from .fresh import drawn_problem

_PROCESSES = 2
_BRAKING_MPS2 = 6.0
"""Hard braking (chosen)."""
_HARDEST_MPS2 = 8.0
"""Highest deceleration of a follower (dry road)."""
_HORIZON_S = 3.0
"""Length of the braking plan (chosen)."""
_TRIES = 8
"""Draws for each requested approach (chosen)."""
_MODES: tuple[Traffic, ...] = ("recorded", "reactive")
_BRAKES_AFTER_S = {"at once": 0.0} | dict.fromkeys(PLANNERS, 1.0)
"""The planner that drives before the ego brakes, and its duration."""
_BEHIND_M, _LATERAL_M, _ALIKE_RAD, _SLOWEST_MPS = 60.0, 1.75, 0.5, 1.0
"""Largest longitudinal and lateral distance from the ego (half a lane), largest difference of headings, and lowest
speed of a follower (chosen).
"""


@dataclass(frozen=True)
class _BrakedRun:
    """A run of an ego that braked; ``hit`` names the vehicle that hit it from behind, or is None."""

    scenario_id: str
    planner: str
    traffic: Traffic
    outcome: str
    hit: str | None
    step_ms: float
    avoidable: bool = True


def braked_runs(files: Sequence[Path], processes: int) -> list[_BrakedRun]:
    """Return the runs of all planners in all traffic modes on the scenarios that have a follower."""
    with process_pool(processes) as pool:
        return [run for runs in pool.map(_braked_runs_of, files) for run in runs]


def fresh_runs(files: Sequence[Path], seed: int, count: int, processes: int) -> list[_BrakedRun]:
    """Run the braking planner on ``count`` approaches drawn from these files, in both traffic modes.

    It tries several times as many, because a draw may have no follower.
    """
    draws = random.Random(seed)  # noqa: S311 - a sample, no secret
    tries = [(draws.choice(files), draws.randrange(2**32)) for _ in range(_TRIES * count)]
    runs: list[_BrakedRun] = []
    with process_pool(processes) as pool:
        for begin in range(0, len(tries), count):
            runs += [run for found in pool.map(_fresh_runs_of, tries[begin : begin + count]) for run in found]
            if len(runs) >= len(_MODES) * count:
                break
    return runs[: len(_MODES) * count]


def rear_hits(runs: Sequence[_BrakedRun], traffic: str, planner: str | None = None) -> int:
    """Return runs in which the ego was hit from behind."""
    return sum(run.hit is not None for run in runs if run.traffic == traffic and planner in (None, run.planner))


def rows(runs: Sequence[_BrakedRun]) -> list[tuple[str, str]]:
    """Return hits by planner, then every hit of reactive traffic."""
    lines = []
    for planner in _BRAKES_AFTER_S:
        recorded, reactive = (rear_hits(runs, traffic, planner) for traffic in _MODES)
        count = sum(run.planner == planner and run.traffic == "recorded" for run in runs)
        lines.append((f"rear hits, driven by {planner}", f"recorded {recorded}, reactive {reactive} of {count}"))
    hit = [run for run in runs if run.traffic == "reactive" and run.hit is not None]
    return lines + [(f"{run.scenario_id}, {run.planner}", str(run.hit)) for run in hit]


def _braked_runs_of(file: Path) -> list[_BrakedRun]:
    """Return the runs on one scenario, empty if no vehicle follows the ego."""
    loaded = read_scenario(file)
    others = recorded_tracks(loaded.scenario).values()
    if not _has_follower(others, EgoState.of(loaded.problem().initial_state)):
        return []
    return [_braked(loaded, planner, traffic) for planner in _BRAKES_AFTER_S for traffic in _MODES]


def _fresh_runs_of(draw: tuple[Path, int]) -> list[_BrakedRun]:
    file, seed = draw
    loaded = drawn_approach(read_scenario(file), random.Random(seed))  # noqa: S311 - a sample, no secret
    return [] if loaded is None else [_braked(loaded, "at once", traffic) for traffic in _MODES]


def drawn_approach(loaded: LoadedScenario, draws: random.Random) -> LoadedScenario | None:
    """Return the scenario with one of its cars as the ego, from a step with a follower; None without one."""
    return drawn_problem(
        loaded, draws, lambda problem, others: _has_follower(others, EgoState.of(problem.initial_state))
    )


def _has_follower(others: Iterable[Track], ego: EgoState) -> bool:
    """Return True if a vehicle drives behind a moving ego in its lane at its first step."""
    return ego.speed_mps >= _SLOWEST_MPS and any(_follows(other, ego) for other in others)


def _follows(other: Track, ego: EgoState) -> bool:
    """Return True if another vehicle drives behind the ego in its lane."""
    index = other.index_at(ego.step)
    if index is None or other.speeds_mps[index] < _SLOWEST_MPS:
        return False
    ahead_m, left_m = ahead_and_left_m(other.positions[index], ego.position, ego.heading_rad)
    alike = abs(wrap_angle(float(other.headings_rad[index]) - ego.heading_rad)) < _ALIKE_RAD
    return 0.0 < -ahead_m < _BEHIND_M and abs(left_m) < _LATERAL_M and alike


def _braked(loaded: LoadedScenario, name: str, traffic: Traffic) -> _BrakedRun:
    configuration = built_in(name if name in PLANNERS else "frenetix")
    planner = _BrakingFrom(make_planner(configuration.planner), _BRAKES_AFTER_S[name])
    began, problem = time.perf_counter(), loaded.problem()
    with open_traffic(traffic, loaded, problem, BMW_320I, seed=0) as others:
        run = simulate(loaded.scenario, problem, configuration, planner, "constant_velocity", silent, others)
    step_ms = 1000 * (time.perf_counter() - began - sum(run.plan_s)) / len(run.states)
    hit, avoidable = _rear_hit(run, planner.brake_step)
    return _BrakedRun(str(loaded.scenario.scenario_id), name, traffic, run.final.outcome, hit, step_ms, avoidable)


def _rear_hit(run: DrivenRun, brake_step: int) -> tuple[str | None, bool]:
    """Return the vehicle that hit the ego from behind, if it followed when the ego began to brake, and if it was
    avoidable.
    """
    hit = run.final.collision
    begin = next((state for state in run.states if state.step in run.plan_steps and state.step >= brake_step), None)
    if hit is None or hit.obstacle_id is None or begin is None:
        return None, False
    ego = run.states[-1]
    tracks = (*run.traffic.moving, *run.traffic.standing)
    other = next(track for track in tracks if track.obstacle_id == hit.obstacle_id)
    there = other.positions[other.index_at(ego.step) or 0]
    if not _follows(other, begin) or ahead_and_left_m(there, ego.position, ego.heading_rad)[0] >= 0.0:
        return None, False
    driven = (
        "driven" if any(track.obstacle_id == hit.obstacle_id for track in run.traffic.driven) else "on its recording"
    )
    what = f"{hit.kind} {hit.obstacle_id} ({driven}) at {hit.time_s:.1f} s, ego {ego.speed_mps:.1f} m/s"
    return what, _can_stop_behind(other, begin, float(hit.time_s) / max(ego.step - run.states[0].step, 1))


def _can_stop_behind(follower: Track, ego: EgoState, step_s: float) -> bool:
    """Return True if a vehicle that brakes as hard as it can one step after the ego stops before it touches the ego."""
    index = follower.index_at(ego.step)
    if index is None:
        return False
    speed_mps = float(follower.speeds_mps[index])
    apart_m = float(np.linalg.norm(follower.positions[index] - ego.position))
    gap_m = apart_m - (follower.length_m + BMW_320I.length_m) / 2
    own_m = speed_mps * step_s + speed_mps**2 / (2 * _HARDEST_MPS2)
    return own_m < gap_m + ego.speed_mps**2 / (2 * _BRAKING_MPS2)


class BrakingPlanner:
    """A planner that brakes at once with 6 m/s² and remains at a standstill."""

    def __init__(self, braking_mps2: float = _BRAKING_MPS2) -> None:
        self._braking_mps2 = braking_mps2
        self._task: PlanningTask | None = None

    def reset(self, task: PlanningTask) -> None:
        """Keep the task of the run."""
        self._task = task

    def plan(self, observation: Observation) -> Plan:
        """Return the path to the standstill along the reference path, at the present lateral offset."""
        if self._task is None:
            raise RuntimeError("reset the planner before it plans")
        ego, step_s = observation.ego, self._task.step_s
        times = np.arange(round(_HORIZON_S / step_s) + 1) * step_s
        until_stand_s = ego.speed_mps / self._braking_mps2
        braked = np.minimum(times, until_stand_s)
        moved = ego.speed_mps * braked - self._braking_mps2 * braked**2 / 2
        points = self._task.reference.points
        stations = project(points, ego.position)[0] + moved
        path = interpolate(points, arc_length(points), stations)
        directions = np.unwrap([point_at(points, station)[1] for station in stations])
        return Plan(
            PlannedTrajectory(
                positions=path - path[0] + ego.position,
                headings_rad=ego.heading_rad + directions - directions[0],
                speeds_mps=np.maximum(ego.speed_mps - self._braking_mps2 * times, 0.0),
                accelerations_mps2=np.where(times < until_stand_s, -self._braking_mps2, 0.0),
            ),
            candidates=1,
        )


class _BrakingFrom:
    """A planner that drives as another one and brakes to a standstill from a time on; ``brake_step`` is its time step.

    Args:
        planner: drives first.
        after_s: time from the start of the run at which the ego begins to brake.
    """

    def __init__(self, planner: Planner, after_s: float) -> None:
        self.brake_step = 0
        self._planner, self._after_s, self._braking = planner, after_s, BrakingPlanner()

    def reset(self, task: PlanningTask) -> None:
        """Prepare both planners."""
        self.brake_step = int(task.problem.initial_state.time_step) + round(self._after_s / task.step_s)
        self._planner.reset(task)
        self._braking.reset(task)

    def plan(self, observation: Observation) -> Plan:
        """Return the other planner's plan before the brake step, and the braking one's from then on."""
        planner = self._planner if observation.ego.step < self.brake_step else self._braking
        return planner.plan(observation)


def _measure(files: Sequence[Path]) -> None:
    runs = braked_runs(files, _PROCESSES)
    steps_ms = [run.step_ms for run in runs if run.traffic == "reactive"]
    figures = {
        "scenarios": len({run.scenario_id for run in runs}),
        "runs": sum(run.traffic == "recorded" for run in runs),
        "recorded_rear_hits": rear_hits(runs, "recorded"),
        "reactive_rear_hits": rear_hits(runs, "reactive"),
        "reactive_step_ms": round(statistics.median(steps_ms), 2) if steps_ms else 0.0,
    }
    print_figures("The ego brakes to a stand", figures, rows(runs))


def _measure_fresh(files: Sequence[Path], seeds: Sequence[int], count: int) -> None:
    runs = [run for seed in seeds for run in fresh_runs(files, seed, count, _PROCESSES)]
    figures: dict[str, float | int | str] = {
        "seeds": " ".join(map(str, seeds)),
        "fresh_approaches": sum(run.traffic == "reactive" for run in runs),
        "fresh_recorded_rear_hits": rear_hits(runs, "recorded"),
        "fresh_rear_hits": rear_hits(runs, "reactive"),
        "fresh_avoidable_rear_hits": sum(
            run.hit is not None and run.avoidable for run in runs if run.traffic == "reactive"
        ),
    }
    print_figures("The ego, one of the recorded cars, brakes to a stand", figures, rows(runs))


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="default: all of the shared folder")
    parser.add_argument("--fresh", type=int, nargs="+", metavar="SEED", help="draw approaches from these files")
    parser.add_argument("--count", type=int, default=100, help="approaches to draw for each seed")
    arguments = parser.parse_args()
    chosen = arguments.files or scenario_files(shared_scenarios(), None)
    if arguments.fresh is None:
        _measure(chosen)
    else:
        _measure_fresh(chosen, arguments.fresh, arguments.count)
