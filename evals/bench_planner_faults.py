"""``make bench-faults``: planner batches while servers and workers are killed, runs hang or crash, the disk is full.

Keys: ``runs`` (asked for), ``results`` (runs stored), ``named_errors`` (runs and calls that ended in an error with a
code), ``lost`` (runs that ended in neither), ``double`` (runs stored more than once), ``resumed`` (servers that took up
a batch of one that was killed).
"""

import argparse
import json
import math
import os
import random
import resource
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio

from plannerforge.engine.execution.claims import Claims
from plannerforge.engine.execution.executor import Executor, Lane, OnProgress, Response, no_progress
from plannerforge.engine.execution.job_runner import JobRunner
from plannerforge.engine.execution.jobs import JobStore
from plannerforge.engine.execution.limits import Limits
from plannerforge.engine.execution.pool import WorkerPool
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.evals.bench_faults import workers_of_this_process
from plannerforge.evals.bench_output import print_figures
from plannerforge.schemas.base import Model
from plannerforge.schemas.planning import RunPlannerArguments, RunPlannerResult, RunRequest
from plannerforge.tools.call import Services, ToolCall
from plannerforge.tools.planning import run_planner

OPERATIONS = ("plannerforge.evals.misbehaving:hang", "plannerforge.evals.misbehaving:crash")
CONFIGS = ("frenetix:Default", "frenetix:Safety-Conservative", "frenetix:Comfort")
HANG_LIMIT_S = 4.0
FULL_AT_BYTES = 1024
MOST_CALLS = 60


@dataclass
class Tally:
    """What was seen so far."""

    named_errors: int = 0
    unnamed: int = 0
    resumed: int = 0
    notes: list[str] = field(default_factory=list)


class Misdirecting:
    """An executor that has every seventh run carried out by an operation that misbehaves."""

    def __init__(self, inner: Executor) -> None:
        self._inner, self._seen = inner, 0

    @property
    def capacity(self) -> int:
        """That of the executor behind it."""
        return self._inner.capacity

    async def run(
        self,
        entry_point: str,
        request: Model,
        response_type: type[Response],
        *,
        timeout_s: float | None = None,
        on_progress: OnProgress = no_progress,
        lane: Lane = "compute",
    ) -> Response:
        """Run the operation, or one that misbehaves."""
        if isinstance(request, RunRequest):
            self._seen += 1
            if self._seen % 7 == 0:
                entry_point, timeout_s = OPERATIONS[self._seen // 7 % 2], HANG_LIMIT_S
        return await self._inner.run(
            entry_point, request, response_type, timeout_s=timeout_s, on_progress=on_progress, lane=lane
        )


async def misdirected_batch(workspace: Path, seed: int, tally: Tally) -> None:
    """A batch of which some runs hang or crash."""
    limits = Limits(roots=(workspace,))
    opened = Workspace(workspace)

    async def ignore(share: float, message: str) -> None:
        del share, message

    async with WorkerPool.open(limits, workspace / "logs" / "faults.log") as pool, anyio.create_task_group() as tasks:
        jobs = JobRunner(JobStore(opened.database), tasks)
        services = Services(opened, Misdirecting(pool), jobs, Claims(opened.database), limits)
        arguments = RunPlannerArguments(scenarios=["preset:500"], configs=list(CONFIGS), seed=seed, wait_s=50)
        result = await run_planner(arguments, ToolCall(services, ignore))
        while result.state == "running":
            result = await run_planner(arguments, ToolCall(services, ignore))
        _count(result, tally)
    opened.close()


def server_call(workspace: Path, seed: int, *, full_disk: bool = False) -> subprocess.Popen[str]:
    """A server process that is asked for a batch."""
    arguments = json.dumps({"scenarios": ["preset:500"], "configs": CONFIGS, "seed": seed, "wait_s": 50})

    def no_room() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (FULL_AT_BYTES, FULL_AT_BYTES))

    return subprocess.Popen(
        [sys.executable, "-m", "plannerforge.server", "call", "run_planner", arguments, "--json"],
        env={**os.environ, "PLANNERFORGE_WORKSPACE": str(workspace), "PLANNERFORGE_WARM_UP": "false"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=no_room if full_disk else None,
    )


def drive_batch(workspace: Path, seed: int, chance: random.Random, tally: Tally) -> None:
    """Ask until the batch is whole; servers and workers are killed meanwhile, the first of them at once."""
    kills_left = 2
    for _ in range(MOST_CALLS):
        process = server_call(workspace, seed)
        until = time.monotonic() + chance.uniform(2.0, 8.0) if kills_left else math.inf
        while process.poll() is None and time.monotonic() < until:
            time.sleep(chance.uniform(0.2, 1.0))
            workers = workers_of_this_process()
            if workers and kills_left and chance.random() < 0.3:
                os.kill(chance.choice(workers).pid, signal.SIGKILL)
        if process.poll() is None:
            process.kill()
            process.communicate()
            kills_left -= 1
            tally.resumed += 1
            continue
        output, errors = process.communicate()
        if process.returncode != 0:
            _count_error(errors, tally)
            continue
        result = RunPlannerResult.model_validate_json(output)
        _count(result, tally)
        if result.batch_id and not result.lost:
            return
        kills_left = max(kills_left - 1, 0)
    tally.notes.append(f"the batch of seed {seed} was not whole after {MOST_CALLS} calls")


def full_disk(workspace: Path, seed: int, tally: Tally) -> None:
    """A batch in a process that cannot write."""
    process = server_call(workspace, seed, full_disk=True)
    output, errors = process.communicate()
    if process.returncode == 0:
        _count(RunPlannerResult.model_validate_json(output), tally)
    else:
        _count_error(errors, tally)


def _count(result: RunPlannerResult, tally: Tally) -> None:
    for cell in result.lost:
        _count_error(cell.error, tally)


def _count_error(text: str, tally: Tally) -> None:
    if "[" in text and "]" in text:
        tally.named_errors += 1
    else:
        tally.unnamed += 1
        tally.notes.append(text.strip()[-300:])


def stored_runs(workspace: Path) -> tuple[int, int]:
    """Runs in the workspace, and how many of them are there more than once."""
    connection = sqlite3.connect(workspace / "workspace.sqlite")
    query = "SELECT count(*), count(*) - count(DISTINCT digest) FROM artifacts WHERE kind = 'run'"
    total, double = connection.execute(query).fetchone()
    connection.close()
    return int(total), int(double)


def runnable_scenarios(workspace: Path) -> int:
    """How many starter scenarios a batch has, in a workspace that this makes."""
    command = [sys.executable, "-m", "plannerforge.server", "call", "find_scenarios", '{"limit": 1}', "--json"]
    environment = {**os.environ, "PLANNERFORGE_WORKSPACE": str(workspace), "PLANNERFORGE_WARM_UP": "false"}
    answer: dict[str, Any] = json.loads(
        subprocess.run(command, env=environment, capture_output=True, check=True).stdout
    )
    return int(answer["total"])


def measure(workspace: Path, runs: int) -> None:
    """Batches of all starter scenarios under three configurations, one a seed, until so many runs were asked for."""
    chance, tally = random.Random(1), Tally()  # noqa: S311 - moments of faults, no secret
    size = runnable_scenarios(workspace) * len(CONFIGS)
    batches = math.ceil(runs / size)
    full_disk(workspace, 0, tally)
    anyio.run(misdirected_batch, workspace, 0, tally)
    for seed in range(batches):
        drive_batch(workspace, seed, chance, tally)
        sys.stderr.write(f"{stored_runs(workspace)[0]} of {batches * size} runs\n")
    asked = batches * size
    results, double = stored_runs(workspace)
    figures = {
        "runs": asked,
        "results": results,
        "named_errors": tally.named_errors,
        "lost": asked - results + tally.unnamed,
        "double": double,
        "resumed": tally.resumed,
    }
    print_figures("Planner runs under faults", [(name, str(value)) for name, value in figures.items()], figures)
    for note in tally.notes:
        sys.stderr.write(f"{note}\n")


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description="Planner batches under faults.")
    parser.add_argument("--runs", type=int, default=1000)
    with tempfile.TemporaryDirectory() as folder:
        measure(Path(folder), parser.parse_args().runs)


if __name__ == "__main__":
    main()
