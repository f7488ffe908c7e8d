"""Batches on two real Dask workers, compared with the same batch in one process of this machine.

The scheduler and its workers are processes of Dask's command line, with one thread each, the settings of
docs/cluster.md, and without nannies, so that a killed process stays dead. The same runs are made five times, each in
its own workspace: by one worker process of the server, by one Dask worker, by two, by two with one killed after a third
of the runs, and by two with their scheduler killed at that point.

Keys:

- ``dask_same_rows``: share of the runs of all four cluster batches with the same record and steps, byte for byte, as in
  one process; ``dask_lost``: missing runs of those batches.
- ``dask_speedup``: time of the batch on one Dask worker over that on two, after a few other runs; ``dask_by_process``:
  the same over that in one process of the server.
- ``dask_runs``: runs of a batch.
"""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import anyio
from mcp import Client

from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.runs import BatchRecord, RunRecord
from plannerforge.server.assembly import create_server

from ..analysis.public_runs import DEFAULT, PREDICTION
from ..harness import Figures, SeededBench, finished_batch, import_scenarios, scenario_files, settings_for, share

RUNS = 120
"""Runs of a batch (chosen: about a minute on one process)."""
_WARMING = 8
"""Number of runs before the timing, so that workers have loaded everything (chosen)."""
_KILL_AT = 3
"""The kill comes once one in this many runs is done."""
_LOOK_S = 0.05
UNOBSERVED = {
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "1s",
    "DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__INTERVAL": "5s",
}
"""Settings that reduce the self-monitoring of Dask's processes; see docs/cluster.md."""
Rows = dict[str, tuple[bytes, bytes]]
"""By run id: the stored record and steps."""


@dataclass
class _Cluster:
    """A scheduler and workers as processes; ``address`` of the scheduler."""

    address: str
    scheduler: "subprocess.Popen[bytes]"
    workers: list["subprocess.Popen[bytes]"] = field(default_factory=list)


@contextlib.contextmanager
def _cluster(folder: Path, workers: int) -> Iterator[_Cluster]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"

    def started(name: str, *arguments: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-P", "-m", "distributed.cli." + arguments[0], *arguments[1:]]
        with (folder / f"{name}.log").open("wb") as log:
            return subprocess.Popen(command, cwd=folder, env={**os.environ, **UNOBSERVED}, stdout=log, stderr=log)

    host = ("--host", "127.0.0.1", "--no-dashboard")
    cluster = _Cluster(address, started("scheduler", "dask_scheduler", *host, "--port", str(port)))
    try:
        for number in range(workers):
            own = ("--nthreads", "1", "--no-nanny", "--local-directory", str(folder / f"worker {number}"))
            cluster.workers.append(started(f"worker {number}", "dask_worker", address, *host, *own))
        yield cluster
    finally:
        for process in (*cluster.workers, cluster.scheduler):
            process.kill()
            process.wait()


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above; a limit restricts the number of runs."""
    count = bench.limit or RUNS
    truth, alone_s = anyio.run(_batch, bench, "alone", count, "")
    made: list[Rows] = []
    times: dict[str, float] = {}
    for name, workers in (("one", 1), ("two", 2), ("worker killed", 2), ("scheduler killed", 2)):
        with _cluster(bench.folder(f"cluster {name}"), workers) as cluster:
            victim = {"worker killed": cluster.workers[0], "scheduler killed": cluster.scheduler}.get(name)
            rows, times[name] = anyio.run(_batch, bench, name, count, cluster.address, victim)
            made.append(rows)
        sys.stderr.write(f"{name}: {len(rows)} of {len(truth)} runs in {times[name]:.1f} s\n")
    return {
        "dask_same_rows": share(rows.get(run_id) == row for rows in made for run_id, row in truth.items()),
        "dask_lost": sum(run_id not in rows for rows in made for run_id in truth),
        "dask_speedup": round(times["one"] / times["two"], 2),
        "dask_by_process": round(alone_s / times["two"], 2),
        "dask_runs": len(truth),
    }


async def _batch(
    bench: SeededBench, name: str, count: int, address: str, victim: "subprocess.Popen[bytes] | None" = None
) -> tuple[Rows, float]:
    """Return the rows of a batch in a workspace of that name, and the seconds it took."""
    folder = bench.scratch / name
    settings = settings_for(folder, bench.shared, 1).model_copy(update={"cluster": address})
    async with Client(create_server(settings)) as client:
        await import_scenarios(client, scenario_files(bench.shared / "data" / "commonroad", count))
        names = _names(folder)
        await finished_batch(client, scenarios=names[:_WARMING], configs=[DEFAULT], prediction="ground_truth")
        started = time.perf_counter()
        async with anyio.create_task_group() as tasks:
            if victim is not None:
                tasks.start_soon(_kill, victim, folder, _WARMING + count // _KILL_AT)
            batch_id = await finished_batch(client, scenarios=names, configs=[DEFAULT], prediction=PREDICTION)
            took_s = time.perf_counter() - started
            tasks.cancel_scope.cancel()
    return _rows(folder, batch_id), took_s


async def _kill(victim: "subprocess.Popen[bytes]", folder: Path, at: int) -> None:
    """Kill a process without notice once so many runs are stored."""
    runs = folder / "runs"
    while sum(1 for _ in runs.rglob("steps.json")) < at:
        await anyio.sleep(_LOOK_S)
    os.kill(victim.pid, signal.SIGKILL)
    sys.stderr.write(f"killed {victim.args!r}\n"[:100] + "\n")


def _names(folder: Path) -> list[str]:
    workspace = Workspace(folder)
    names = sorted(artifact.artifact_id for artifact in workspace.newest(kind="scenario", limit=1000))
    workspace.close()
    return names


def _rows(folder: Path, batch_id: str) -> Rows:
    workspace = Workspace(folder)
    batch = workspace.get(batch_id, "batch").read(BatchRecord)
    rows = {
        run_id: (
            workspace.get(run_id, "run").read(RunRecord).model_dump_json().encode(),
            workspace.file("run", run_id, "steps.json").read_bytes(),
        )
        for run_id in batch.runs
    }
    workspace.close()
    return rows
