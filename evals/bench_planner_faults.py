"""``make bench-faults``: planner batches while servers and workers are killed, runs hang or crash, the disk is full.

Grids of small starter scenarios under fast configurations of both planners, their weights drawn at random. Of each grid
the runs of one scenario hang and those of another crash the native core, at first; then servers are asked for the whole
grid until it is whole, while faults strike at random moments. All moments and weights come from one seed.

Keys: ``runs`` (asked for), ``results`` (runs stored), ``named_errors`` (runs and calls that ended in an error with a
code), ``lost`` (runs that ended in neither), ``double`` (runs made or listed more than once), ``resumed`` (servers that
took up a grid of one that was killed), ``worker_killed``, ``server_killed``, ``disk_full``, ``hung``, ``crashed``
(faults that struck), ``minutes``.
"""

import argparse
import math
import random
import sys
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import anyio

from plannerforge.engine.catalog.starter import open_catalogue
from plannerforge.engine.execution.claims import Claims
from plannerforge.engine.execution.job_runner import JobRunner
from plannerforge.engine.execution.jobs import JobStore
from plannerforge.engine.execution.limits import Limits
from plannerforge.engine.execution.pool import WorkerPool
from plannerforge.engine.tuning.configurations import changed_configuration, named_configuration
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.evals.bench_output import print_figures
from plannerforge.evals.misdirecting import Misdirecting
from plannerforge.evals.struck_server import Grid, Tally, drive
from plannerforge.schemas.planning import RunPlannerArguments
from plannerforge.schemas.runs import BatchRecord
from plannerforge.tools.call import Services, ToolCall
from plannerforge.tools.configurations import store_configuration
from plannerforge.tools.planning import run_planner

HANG, CRASH = "plannerforge.evals.misbehaving:hang", "plannerforge.evals.misbehaving:crash"
HANG_LIMIT_S = 4.0
SCENARIOS, CONFIGS, MISBEHAVING_CONFIGS = 10, 20, 4
FAULTS_A_GRID = 15
PLANNERS = {
    "frenetix:Default": (["prediction", "velocity_offset", "lateral_jerk"], ["sampling_level=1", "replan_steps=5"]),
    "idm": (["time_headway_s", "minimum_gap_m"], ["horizon_s=2"]),
}
"""Base configurations with the weights that are drawn and the settings that make their runs short."""


@asynccontextmanager
async def misdirected_call(workspace: Workspace, instead: dict[str, str]) -> AsyncIterator[ToolCall]:
    """A tool call in this process, in which the runs of some scenarios misbehave."""

    async def ignore(share: float, message: str) -> None:
        del share, message

    limits = Limits(roots=(workspace.root,))
    async with (
        WorkerPool.open(limits, workspace.root / "logs" / "faults.log") as pool,
        anyio.create_task_group() as tasks,
    ):
        jobs = JobRunner(JobStore(workspace.database), tasks)
        executor = Misdirecting(pool, instead, HANG_LIMIT_S)
        yield ToolCall(Services(workspace, executor, jobs, Claims(workspace.database), limits), ignore)


def small_scenarios(workspace: Workspace) -> list[str]:
    """Ids of the scenarios with the smallest files: reading is most of the time of a run."""
    known = sorted(artifact.artifact_id for artifact in workspace.newest(kind="scenario", limit=1000))
    return sorted(known, key=lambda key: workspace.file("scenario", key, "scenario.xml").stat().st_size)[:SCENARIOS]


def drawn_configs(call: ToolCall, chance: random.Random) -> tuple[str, ...]:
    """Ids of new configurations, the planners in turn."""
    made = []
    for number in range(CONFIGS):
        name = list(PLANNERS)[number % len(PLANNERS)]
        weights, settings = PLANNERS[name]
        base = named_configuration(name)
        if base is None:
            raise RuntimeError(f"the built-in configuration {name} is gone")
        factors = [f"{weight}*{chance.uniform(0.5, 2.0):.4f}" for weight in weights]
        made.append(changed_configuration(base, None, factors, settings)[0])
        store_configuration(call, made[-1])
    return tuple(configuration.config_id for configuration in made)


async def misbehaved_grid(workspace: Workspace, scenarios: list[str], chance: random.Random, tally: Tally) -> Grid:
    """A new grid, of which the runs of a scenario that hangs and of one that crashes were tried."""
    hanging, crashing = chance.sample(scenarios, 2)
    async with misdirected_call(workspace, {hanging: HANG, crashing: CRASH}) as call:
        grid = Grid(tuple(scenarios), drawn_configs(call, chance))
        misbehaving = grid.configs[:MISBEHAVING_CONFIGS]
        arguments = RunPlannerArguments(scenarios=[hanging, crashing], configs=list(misbehaving), wait_s=50)
        result = await run_planner(arguments, call)
        while result.state == "running":
            result = await run_planner(arguments, call)
    tally.faults["hung"] += len(misbehaving)
    tally.faults["crashed"] += len(misbehaving)
    return grid


def count_lost_cells(workspace: Workspace, tally: Tally) -> None:
    """Count the errors of the cells that some batch lost."""
    for artifact in workspace.newest(kind="batch", limit=10_000):
        for cell in artifact.read(BatchRecord).lost:
            tally.see(cell.error)


def whole_batches(workspace: Workspace, grids: list[Grid]) -> list[BatchRecord]:
    """The batch of each grid that lost nothing, where there is one."""
    batches = [artifact.read(BatchRecord) for artifact in workspace.newest(kind="batch", limit=10_000)]
    whole = {(batch.scenarios, batch.configs): batch for batch in batches if not batch.lost}
    return [whole[key] for grid in grids if (key := (grid.scenarios, grid.configs)) in whole]


def measure(folder: Path, runs: int, seed: int) -> None:
    """Grids until so many runs were asked for, one after the other."""
    began, chance, tally = time.monotonic(), random.Random(seed), Tally()  # noqa: S311 - moments of faults, no secret
    workspace, grids = Workspace(folder), list[Grid]()
    open_catalogue(workspace)
    scenarios = small_scenarios(workspace)
    for number in range(math.ceil(runs / (len(scenarios) * CONFIGS))):
        grids.append(anyio.run(misbehaved_grid, workspace, scenarios, chance, tally))
        drive(folder, grids[-1], chance, tally, FAULTS_A_GRID)
        minutes = (time.monotonic() - began) / 60
        sys.stderr.write(f"grid {number + 1} is whole after {minutes:.1f} minutes: {dict(tally.faults)}\n")
    count_lost_cells(workspace, tally)
    stored = [artifact.artifact_id for artifact in workspace.newest(kind="run", limit=1_000_000)]
    listed = [run_id for batch in whole_batches(workspace, grids) for run_id in batch.runs]
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
    rows = [(name, str(value)) for name, value in figures.items()]
    print_figures("Planner runs under faults", [*rows, ("errors by code", codes)], figures)
    for text in tally.unnamed:
        sys.stderr.write(f"without a code: {text}\n")


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description="Planner batches under faults.")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        measure(Path(folder), arguments.runs, arguments.seed)


if __name__ == "__main__":
    main()
