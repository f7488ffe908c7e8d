"""Servers that are asked for a grid of runs while they, their workers and their disk are struck by faults."""

import json
import os
import random
import re
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from plannerforge.evals.bench_faults import workers_of_this_process
from plannerforge.schemas.errors import UnexpectedFailure, error_classes
from plannerforge.schemas.planning import RunPlannerResult

FULL_AT_BYTES = 1024
"""A server with this limit on the size of its files cannot write its database or a run: a full disk, as it sees it."""
FULL_FOR_S = (0.3, 1.5)
BETWEEN_FAULTS_S = (1.0, 5.0)
FAULTS = {"worker_killed": 12, "server_killed": 3, "disk_full": 4}
"""Every kind of fault with its share among all."""
MOST_CALLS = 40


@dataclass
class Grid:
    """Scenarios × configurations."""

    scenarios: tuple[str, ...]
    configs: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of runs."""
        return len(self.scenarios) * len(self.configs)


@dataclass
class Tally:
    """What was done, and what was seen of it: faults by kind, codes of errors, and what has none."""

    faults: Counter[str] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    unnamed: list[str] = field(default_factory=list)
    calls: int = 0

    def see(self, text: str) -> None:
        """Count an error by the code it names; a defect of ours is none."""
        code = next((word for word in re.findall(r"\[(\w+)\]", text) if word in error_classes()), "")
        if code and code != UnexpectedFailure.code:
            self.errors[code] += 1
        else:
            self.unnamed.append(text.strip()[-500:])


def drive(workspace: Path, grid: Grid, chance: random.Random, tally: Tally, faults: int) -> None:
    """Ask until the grid is whole; so many faults strike meanwhile, at random moments.

    Raises:
        RuntimeError: it never was.
    """
    for _ in range(MOST_CALLS):
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
    raise RuntimeError(f"a grid was not whole after {MOST_CALLS} calls")


def _server(workspace: Path, grid: Grid) -> subprocess.Popen[str]:
    arguments: dict[str, Sequence[str] | int] = {"scenarios": grid.scenarios, "configs": grid.configs, "wait_s": 50}
    return subprocess.Popen(
        [sys.executable, "-m", "plannerforge.server", "call", "run_planner", json.dumps(arguments), "--json"],
        env={**os.environ, "PLANNERFORGE_WORKSPACE": str(workspace), "PLANNERFORGE_WARM_UP": "false"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _strike(process: subprocess.Popen[str], chance: random.Random, tally: Tally, most: int) -> int:
    """Strike a server again and again until it has ended or enough was done; gives the number of faults."""
    struck = 0
    while struck < most and _still_runs(process, chance.uniform(*BETWEEN_FAULTS_S)):
        fault = chance.choices(list(FAULTS), weights=list(FAULTS.values()))[0]
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
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (FULL_AT_BYTES, most))
    if _still_runs(process, chance.uniform(*FULL_FOR_S)):
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (most, most))


def _still_runs(process: subprocess.Popen[str], after_s: float) -> bool:
    until = time.monotonic() + after_s
    while time.monotonic() < until and process.poll() is None:
        time.sleep(0.05)
    return process.poll() is None
