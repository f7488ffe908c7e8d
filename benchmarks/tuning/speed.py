"""The cost of a run and its stages, the gain of two workers, and the delay of a batch's first run.

Frenetix with ``Default`` and ``constant_velocity`` runs the same public scenarios on a server with one worker, on one
with two, and, for the shares of the stages, in this process with timed functions. A few runs come first, so that
everything is loaded. Processor times accompany the wall times, which say little on a busy machine. Last, the bench
requests a new batch of several presets and cancels it once its first run is stored.

Keys:

- ``run_median_s``: median time of a run in its worker; ``run_processor_s``: processor time of the worker per run.
- ``server_processor_s``: of the server per run, to claim, hand out, read and store it.
- ``two_worker_speedup``: time of the batch with one worker over that with two; ``two_worker_processor``: processor time
  per run with two workers over that with one.
- ``first_run_s``: from the call to the start of the first of ``first_run_of`` runs.
- ``stage_…``: shares of the time of a run; ``stage_core`` holds the core's, which ``stage_planner`` excludes.
"""

import functools
import os
import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from unittest import mock

import anyio
import psutil
from mcp import Client

from plannerforge.engine.execution import silent
from plannerforge.engine.planners import Plan, run_planner
from plannerforge.engine.tuning import tuning_of
from plannerforge.engine.workspace import Workspace
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.planning import RunRequest
from plannerforge.schemas.runs import BatchRecord, RunTiming
from plannerforge.server.assembly import create_server

from ..analysis.public_runs import DEFAULT, PREDICTION
from ..harness import (
    Figures,
    SeededBench,
    ask,
    drawn,
    finished_batch,
    import_scenarios,
    read_run_file,
    scenario_files,
    settings_for,
)

RUNS = 72
"""Enough runs that the last one, alone on one of two workers, hardly counts (chosen)."""
STAGED = 24
"""Number of runs with timed stages (chosen)."""
_WARMING = 6
_LOOK_S = 0.01
_RUNS, _LOOP = "plannerforge.engine.planners.runs", "plannerforge.engine.planners.simulation"
_CORE = "core"
STAGES = {
    "reading": (f"{_RUNS}.kept_recording",),
    "traffic": (f"{_RUNS}.open_traffic",),
    "path": (f"{_LOOP}.path_to", f"{_LOOP}.build_road"),
    "observing": (f"{_LOOP}.observe",),
    "planner": ("plannerforge.engine.planners.Frenetix.reset", "plannerforge.engine.planners.Frenetix.plan"),
    "judging": (f"{_LOOP}.Judge.before_the_run", f"{_LOOP}.Judge.after_step"),
    "metrics": (f"{_RUNS}.drive_criticality", f"{_RUNS}.run_steps"),
}
"""The stages of a run, and the product's functions in each, which do not call each other."""


def measure(bench: SeededBench) -> Figures:
    """Return the keys above; with a limit, of so many runs."""
    files = scenario_files(bench.shared / "data" / "commonroad", bench.limit or RUNS)
    one, two = (anyio.run(_batch, bench, files, workers) for workers in (1, 2))
    return {
        "run_median_s": one["median_s"],
        "run_processor_s": one["worker_s"],
        "server_processor_s": one["server_s"],
        "two_worker_speedup": round(one["took_s"] / two["took_s"], 2),
        "two_worker_processor": round(two["worker_s"] / one["worker_s"], 3),
        "first_run_s": one["first_s"],
        "first_run_of": len(files) * len(_presets()),
        **{f"stage_{name}": value for name, value in _stages(files[:STAGED], bench.folder("recordings")).items()},
    }


def _presets() -> list[str]:
    return [f"frenetix:{name}" for name in tuning_of("frenetix").presets if name != "Default"]


async def _batch(bench: SeededBench, files: Sequence[Path], workers: int) -> dict[str, float]:
    """Return times of a batch on a number of workers, and of the first run of another one."""
    folder = bench.scratch / f"speed {workers}"
    async with Client(create_server(settings_for(folder, bench.shared, workers))) as client:
        await import_scenarios(client, files)
        names = _names(folder)
        warming = names[: workers * _WARMING]
        await finished_batch(client, scenarios=warming, configs=[DEFAULT], prediction="ground_truth")
        before, began = _processor_s(), time.perf_counter()
        batch_id = await finished_batch(client, scenarios=names, configs=[DEFAULT], prediction=PREDICTION)
        took_s, after = time.perf_counter() - began, _processor_s()
        first_s = await _first_run_s(client, folder, names)
    workspace = Workspace(folder)
    batch = workspace.get(batch_id, "batch").read(BatchRecord)
    walls = [read_run_file(workspace, run_id, "timing.json", RunTiming).wall_s for run_id in batch.runs]
    workspace.close()
    server_s, worker_s = ((after[name] - before[name]) / len(walls) for name in ("server", "workers"))
    return {
        "median_s": round(statistics.median(walls), 3),
        "worker_s": round(worker_s, 4),
        "server_s": round(server_s, 4),
        "took_s": took_s,
        "first_s": round(first_s, 3),
    }


def _processor_s() -> dict[str, float]:
    """Return the processor time of this process, which contains the server, and of its workers."""
    own = psutil.Process()
    workers = [child.cpu_times() for child in own.children() if child.status() != psutil.STATUS_ZOMBIE]
    return {"server": time.process_time(), "workers": sum(times.user + times.system for times in workers)}


async def _first_run_s(client: Client, folder: Path, names: Sequence[str]) -> float:
    """Return the time from the call for a batch to the start of its first run, and cancel the batch."""
    known, began = set((folder / "runs").rglob("timing.json")), time.time()
    job = await ask(
        client, "run_planner", scenarios=list(names), configs=_presets(), prediction="ground_truth", wait_s=0
    )
    while not (new := set((folder / "runs").rglob("timing.json")) - known):
        await anyio.sleep(_LOOK_S)
    first = min(new, key=lambda path: path.stat().st_mtime_ns)
    wall_s = RunTiming.model_validate_json(first.read_bytes()).wall_s
    await ask(client, "cancel_job", job_id=job["job_id"])
    return float(first.stat().st_mtime - wall_s - began)


def _names(folder: Path) -> list[str]:
    workspace = Workspace(folder)
    names = [artifact.artifact_id for artifact in workspace.newest(kind="scenario", limit=1000)]
    workspace.close()
    return drawn(names, None)


def _stages(files: Sequence[Path], recordings: Path) -> dict[str, float]:
    """Return the share of each stage in the time of runs in this process, which keeps recordings as a worker does."""
    with mock.patch.dict(os.environ, {"PLANNERFORGE_RECORDINGS": str(recordings)}):
        for path in files:
            _run(path)
    spent: dict[str, float] = defaultdict(float)
    began = time.perf_counter()
    with _timed(spent):
        for path in files:
            _run(path)
    spent["planner"] -= spent[_CORE]
    whole = time.perf_counter() - began
    shares = {name: round(spent[name] / whole, 3) for name in (_CORE, *STAGES)}
    return shares | {"rest": round(1.0 - sum(shares.values()), 3)}


def _run(path: Path) -> None:
    request = RunRequest(
        run_id="run_0",
        scenario_path=str(path),
        scenario_id=path.stem,
        configuration=built_in(DEFAULT),
        prediction=PREDICTION,
    )
    run_planner(request, silent)


@contextmanager
def _timed(spent: dict[str, float]) -> Iterator[None]:
    """Sum the time of each stage within the block, with the core's as the plans report it."""
    with ExitStack() as patches:
        for stage, targets in STAGES.items():
            for target in targets:
                patches.enter_context(mock.patch(target, _timing(resolve_name(target), stage, spent)))
        yield


def _timing(function: Callable[..., Any], stage: str, spent: dict[str, float]) -> Callable[..., Any]:
    @functools.wraps(function)
    def timed(*arguments: Any, **options: Any) -> Any:
        began = time.perf_counter()
        try:
            answer = function(*arguments, **options)
        finally:
            spent[stage] += time.perf_counter() - began
        if isinstance(answer, Plan):
            spent[_CORE] += answer.core_s
        return answer

    return timed
