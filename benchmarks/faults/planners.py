"""``make bench-faults``: planner batches while servers die, runs hang or crash, and the disk is full.

The grids use small starter scenarios and fast configurations of both planners with random weights. In each grid the
runs of one scenario hang at first, and those of another crash the native core. Servers then receive the whole grid
until it is complete, while faults strike at random times. One seed determines all times and weights.

Keys:

- ``runs`` (requested), ``results`` (stored), ``named_errors`` (runs and calls that ended in an error with a code).
- ``lost``: runs that ended in neither; ``double``: runs created or listed more than once.
- ``resumed``: servers that resumed the grid of a killed one.
- ``worker_killed``, ``server_killed``, ``disk_full``, ``hung``, ``crashed``: numbers of faults.
- ``minutes``.
"""

import argparse
import json
import math
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

import anyio

from plannerforge.engine.catalog import open_catalogue
from plannerforge.engine.execution import Claims, JobRunner, JobStore, Limits, WorkerPool
from plannerforge.engine.tuning import changed_configuration
from plannerforge.engine.workspace import Workspace
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.errors import UnexpectedFailure, error_classes
from plannerforge.schemas.planning import RunPlannerArguments, RunPlannerResult
from plannerforge.schemas.runs import BatchRecord
from plannerforge.workflows.configurations import store_configuration
from plannerforge.workflows.context import Services, WorkflowContext
from plannerforge.workflows.planners import run_planner

from ..harness import print_figures
from .fault_injection import CRASH, HANG, FaultInjector, RunOperation
from .processes import workers_of_this_process

_SCENARIOS, _CONFIGS, _FAULTY_CONFIGS = 10, 20, 4
"""Size of a grid, and the number of configurations for the runs that hang or crash (chosen)."""
_FAULTS_A_GRID = 15
"""Number of faults during a grid (chosen)."""
_PLANNERS = {
    "frenetix:Default": (["prediction", "velocity_offset", "lateral_jerk"], ["sampling_level=1", "replan_steps=5"]),
    "idm": (["time_headway_s", "minimum_gap_m"], ["horizon_s=2"]),
}
"""Base configurations with the drawn weights and the settings for short runs."""
_FAULTS = {"worker_killed": 12, "server_killed": 3, "disk_full": 4}
"""Every kind of fault with its share among all."""
_FULL_AT_BYTES = 1024
"""With this limit on file sizes a server cannot write its database or a run, as on a full disk."""
_FULL_FOR_S, _BETWEEN_FAULTS_S = (0.3, 1.5), (1.0, 5.0)
"""Ranges of the drawn times of a full disk and between two faults (chosen)."""
_MOST_CALLS = 40
"""Number of calls after which a grid counts as incomplete (chosen)."""


@dataclass
class _Grid:
    """Scenarios × configurations."""

    scenarios: tuple[str, ...]
    configs: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of runs."""
        return len(self.scenarios) * len(self.configs)


@dataclass
class _Tally:
    """The work and its observations: faults by kind, codes of errors, and errors without a code."""

    faults: Counter[str] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    unnamed: list[str] = field(default_factory=list)
    calls: int = 0

    def see(self, text: str) -> None:
        """Count an error by the code it names; a defect of ours has no code."""
        code = next((word for word in re.findall(r"\[(\w+)\]", text) if word in error_classes()), "")
        if code and code != UnexpectedFailure.code:
            self.errors[code] += 1
        else:
            self.unnamed.append(text.strip()[-500:])


def _drive(workspace: Path, grid: _Grid, chance: random.Random, tally: _Tally, faults: int) -> None:
    """Ask until the grid is whole; at most ``faults`` faults strike meanwhile, at random moments.

    Raises:
        RuntimeError: it never was.
    """
    for _ in range(_MOST_CALLS):
        process = _server(workspace, grid)
        tally.calls += 1
        faults -= _strike(process, chance, tally, faults)
        output, errors = process.communicate()
        if process.returncode == -signal.SIGKILL:
            continue
        if process.returncode != 0:
            tally.see(errors)
            continue
        result = RunPlannerResult.model_validate_json(output)
        if result.state == "failed":
            tally.see(result.notes[-1])
        elif result.batch_id and not result.lost:
            return
    raise RuntimeError(f"a grid is still incomplete after {_MOST_CALLS} calls")


def _server(workspace: Path, grid: _Grid) -> subprocess.Popen[str]:
    arguments: dict[str, Sequence[str] | int] = {"scenarios": grid.scenarios, "configs": grid.configs, "wait_s": 50}
    return subprocess.Popen(
        [sys.executable, "-m", "plannerforge", "call", "run_planner", json.dumps(arguments), "--json"],
        env={
            **os.environ,
            "PLANNERFORGE_WORKSPACE": str(workspace),
            "PLANNERFORGE_WARM_UP": "false",
            "PLANNERFORGE_MAPS_ONLINE": "offline",
        },
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _strike(process: subprocess.Popen[str], chance: random.Random, tally: _Tally, most: int) -> int:
    """Strike a server repeatedly until it has ended or enough is done; return the number of faults."""
    struck = 0
    while struck < most and _still_runs(process, chance.uniform(*_BETWEEN_FAULTS_S)):
        fault = chance.choices(list(_FAULTS), weights=list(_FAULTS.values()))[0]
        workers = workers_of_this_process()
        if fault == "server_killed":
            process.kill()
        elif fault == "disk_full":
            _fill_the_disk(process, chance)
        elif workers:
            os.kill(chance.choice(workers).pid, signal.SIGKILL)
        else:
            continue
        tally.faults[fault] += 1
        struck += 1
    return struck


def _fill_the_disk(process: subprocess.Popen[str], chance: random.Random) -> None:
    """Let the server's writes fail for a while."""
    _, most = resource.prlimit(process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (_FULL_AT_BYTES, most))
    if _still_runs(process, chance.uniform(*_FULL_FOR_S)):
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (most, most))


def _still_runs(process: subprocess.Popen[str], after_s: float) -> bool:
    until = time.monotonic() + after_s
    while time.monotonic() < until and process.poll() is None:
        time.sleep(0.05)
    return process.poll() is None


@asynccontextmanager
async def _faulty_call(workspace: Workspace, instead: Mapping[str, RunOperation]) -> AsyncIterator[WorkflowContext]:
    """Return a tool call in this process, in which the runs of some scenarios hang or crash."""

    async def ignore(share: float, message: str) -> None:
        del share, message

    limits = Limits(roots=(workspace.root,))
    async with (
        WorkerPool.open(limits, workspace.root / "logs" / "faults.log") as pool,
        anyio.create_task_group() as tasks,
    ):
        jobs = JobRunner(JobStore(workspace.database), tasks)
        executor = FaultInjector(pool, instead)
        yield WorkflowContext(Services(workspace, executor, jobs, Claims(workspace.database), limits), ignore)


def _small_scenarios(workspace: Workspace) -> list[str]:
    """Return ids of the scenarios with the smallest files: reading is most of the time of a run."""
    known = sorted(artifact.artifact_id for artifact in workspace.newest(kind="scenario", limit=1000))
    return sorted(known, key=lambda key: workspace.file("scenario", key, "scenario.xml").stat().st_size)[:_SCENARIOS]


def _drawn_configs(call: WorkflowContext, chance: random.Random) -> tuple[str, ...]:
    """Return ids of new configurations, the planners in turn."""
    made = []
    for number in range(_CONFIGS):
        name = list(_PLANNERS)[number % len(_PLANNERS)]
        weights, settings = _PLANNERS[name]
        factors = [f"{weight}*{chance.uniform(0.5, 2.0):.4f}" for weight in weights]
        made.append(changed_configuration(built_in(name), None, factors, settings)[0])
        store_configuration(call, made[-1])
    return tuple(configuration.config_id for configuration in made)


async def _faulty_grid(workspace: Workspace, scenarios: list[str], chance: random.Random, tally: _Tally) -> _Grid:
    """Run a new grid, after the runs of a scenario that hangs and of one that crashes were tried."""
    hanging, crashing = chance.sample(scenarios, 2)
    async with _faulty_call(workspace, {hanging: HANG, crashing: CRASH}) as call:
        grid = _Grid(tuple(scenarios), _drawn_configs(call, chance))
        faulty = grid.configs[:_FAULTY_CONFIGS]
        arguments = RunPlannerArguments(scenarios=[hanging, crashing], configs=list(faulty), wait_s=50)
        result = await run_planner(arguments, call)
        while result.state == "running":
            result = await run_planner(arguments, call)
    tally.faults["hung"] += len(faulty)
    tally.faults["crashed"] += len(faulty)
    return grid


def _count_lost_cells(workspace: Workspace, tally: _Tally) -> None:
    """Count the errors of the cells that some batch lost."""
    for artifact in workspace.newest(kind="batch", limit=10_000):
        for cell in artifact.read(BatchRecord).lost:
            tally.see(cell.error)


def _whole_batches(workspace: Workspace, grids: list[_Grid]) -> list[BatchRecord]:
    """Return the batch of each grid that lost no run, if there is one."""
    batches = [artifact.read(BatchRecord) for artifact in workspace.newest(kind="batch", limit=10_000)]
    whole = {(batch.scenarios, batch.configs): batch for batch in batches if not batch.lost}
    return [whole[key] for grid in grids if (key := (grid.scenarios, grid.configs)) in whole]


def _measure(folder: Path, runs: int, seed: int) -> None:
    """Run grids one after the other until at least ``runs`` runs were requested."""
    began, chance, tally = time.monotonic(), random.Random(seed), _Tally()  # noqa: S311 - moments of faults, no secret
    workspace, grids = Workspace(folder), list[_Grid]()
    open_catalogue(workspace)
    scenarios = _small_scenarios(workspace)
    for number in range(math.ceil(runs / (len(scenarios) * _CONFIGS))):
        grids.append(anyio.run(_faulty_grid, workspace, scenarios, chance, tally))
        _drive(folder, grids[-1], chance, tally, _FAULTS_A_GRID)
        minutes = (time.monotonic() - began) / 60
        sys.stderr.write(f"grid {number + 1} is whole after {minutes:.1f} minutes: {dict(tally.faults)}\n")
    _count_lost_cells(workspace, tally)
    stored = [artifact.artifact_id for artifact in workspace.newest(kind="run", limit=1_000_000)]
    listed = [run_id for batch in _whole_batches(workspace, grids) for run_id in batch.runs]
    workspace.close()
    asked = sum(grid.size for grid in grids)
    figures = {
        "runs": asked,
        "results": len(stored),
        "named_errors": tally.errors.total(),
        "lost": asked - len(set(listed) & set(stored)) + len(tally.unnamed),
        "double": len(listed) - len(set(listed)) + len(set(stored) - set(listed)),
        "resumed": tally.faults["server_killed"],
        **{name: tally.faults[name] for name in ("worker_killed", "server_killed", "disk_full", "hung", "crashed")},
        "minutes": round((time.monotonic() - began) / 60, 1),
    }
    codes = ", ".join(f"{code} {count}" for code, count in sorted(tally.errors.items()))
    print_figures("Planner runs under faults", figures, more_rows=[("errors by code", codes)])
    for text in tally.unnamed:
        sys.stderr.write(f"without a code: {text}\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        _measure(Path(name), given.runs, given.seed)
