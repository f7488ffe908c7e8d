"""``make bench-planners``: how Frenetix fares on every scenario of a folder, and what its loop costs.

Keys: ``runs``, ``lost`` (cells without a run), ``solvable`` (not invalid), ``success_<preset>_<prediction>``
(share of the solvable problems that reach the goal), ``trap_infeasible`` (runs that a heading wrap stopped at their
first step: all candidates rejected by the yaw rate), ``step_over_core`` (planning step ÷ its time in the core, median),
``run_median_s``, ``two_worker_speedup``, ``weights_acting``.
"""

import argparse
import hashlib
import os
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import anyio
from mcp import Client
from rich.console import Console
from rich.table import Table

from plannerforge.engine.analysis.intervals import rate
from plannerforge.engine.tuning.configurations import named_configuration
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.evals.bench_output import print_figures, spread
from plannerforge.schemas.runs import BatchRecord, RunRecord, RunTiming
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

CONFIGS = {"default": "frenetix:Default", "safety": "frenetix:Safety-Conservative"}
PREDICTIONS = {"gt": "ground_truth", "cv": "constant_velocity"}
TIMED_RUNS = 24
POLL_S = 50


def scenario_files(folder: Path, limit: int | None) -> list[Path]:
    """The scenario files of a folder; with a limit, always the same sample."""
    found = sorted(path for path in folder.rglob("*.xml") if not path.name.endswith(".net.xml"))
    if limit is None:
        return found
    return sorted(found, key=lambda path: hashlib.sha256(path.name.encode()).hexdigest())[:limit]


async def ask(client: Client, tool: str, **arguments: Any) -> Any:
    """The structured answer of a tool.

    Raises:
        RuntimeError: the tool refused.
    """
    result = await client.call_tool(tool, arguments)
    if result.is_error or result.structured_content is None:
        raise RuntimeError(f"{tool}: {result.content}")
    return result.structured_content


async def finished_batch(client: Client, **arguments: Any) -> str:
    """Run a grid to its end and give the id of the batch."""
    result = await ask(client, "run_planner", wait_s=0, **arguments)
    while result.get("batch_id") is None:
        job = await ask(client, "get_job", job_id=result["job_id"], wait_s=POLL_S)
        sys.stderr.write(f"{arguments['prediction']}: {job['message']}\n")
        if job["state"] not in ("running", "done"):
            raise RuntimeError(f"the batch ended as {job['state']}: {job['error']}")
        if job["state"] == "done":
            return str(job["results"][-1])
    return str(result["batch_id"])


def settings_for(workspace: Path, folder: Path, workers: int) -> Settings:
    """A server on the bench's own workspace."""
    return Settings(workspace=workspace, roots=(folder,), workers=workers, starter=False, warm_up=False, journal=False)


async def throughput(workspace: Path, folder: Path, scenarios: Sequence[str], workers: int) -> float:
    """Runs a second of warm workers; the number of workers is the seed, so that nothing is reused."""
    grid = {"configs": [CONFIGS["default"]], "prediction": PREDICTIONS["cv"]}
    async with Client(create_server(settings_for(workspace, folder, workers))) as client:
        await finished_batch(client, scenarios=list(scenarios[:4]), seed=100 + workers, **grid)
        started = time.perf_counter()
        await finished_batch(client, scenarios=list(scenarios), seed=workers, **grid)
        return len(scenarios) / (time.perf_counter() - started)


async def measure(workspace: Path, folder: Path, limit: int | None) -> None:
    """Import, run, print."""
    async with Client(create_server(settings_for(workspace, folder, 2))) as client:
        for path in scenario_files(folder, limit):
            result = await client.call_tool("import_files", {"path": str(path)})
            if result.is_error:
                sys.stderr.write(f"{path.name} is left out: {result.content}\n")
        batches = {
            short: await finished_batch(
                client, scenarios=["preset:500"], configs=list(CONFIGS.values()), prediction=prediction
            )
            for short, prediction in PREDICTIONS.items()
        }
        acting = _weights_acting(await ask(client, "list_planners", config_id=CONFIGS["default"]))
    opened = Workspace(workspace)
    records = {short: opened.get(batch_id, "batch").read(BatchRecord) for short, batch_id in batches.items()}
    runs = [opened.get(key, "run").read(RunRecord) for batch in records.values() for key in batch.runs]
    timings = [_timing(opened, run) for run in runs if run.outcome != "invalid"]
    scenarios = sorted({run.scenario_id for run in runs if run.outcome != "invalid"})
    timed = sorted(scenarios, key=lambda key: hashlib.sha256(key.encode()).hexdigest())[:TIMED_RUNS]
    opened.close()
    one = await throughput(workspace, folder, timed, 1)
    two = await throughput(workspace, folder, timed, 2)
    _print(runs, sum(len(batch.lost) for batch in records.values()), timings, acting, two / one)


def _timing(workspace: Workspace, run: RunRecord) -> RunTiming:
    return RunTiming.model_validate_json(workspace.file("run", run.run_id, "timing.json").read_text(encoding="utf-8"))


def _weights_acting(listed: Any) -> int:
    configuration = named_configuration(CONFIGS["default"])
    own = set(configuration.weights) if configuration else set()
    return sum(entry["acts"] for entry in listed["weights"] if entry["name"] in own)


def _of(runs: Sequence[RunRecord], preset: str, prediction: str) -> list[RunRecord]:
    return [run for run in runs if run.config_name == CONFIGS[preset] and run.prediction == PREDICTIONS[prediction]]


def _trapped(run: RunRecord) -> bool:
    at_first_step = run.metrics is not None and run.metrics.duration_s == 0.0
    return run.outcome == "infeasible" and at_first_step and set(run.rejected_candidates) == {"yaw_rate"}


def _print(runs: Sequence[RunRecord], lost: int, timings: Sequence[RunTiming], acting: int, speedup: float) -> None:
    console = Console(width=160)
    groups = {(preset, short): _of(runs, preset, short) for preset in CONFIGS for short in PREDICTIONS}
    outcomes = [name for name, _ in Counter(run.outcome for run in runs).most_common()]
    table = Table("configuration", "prediction", *outcomes, "success of the solvable (95 % Wilson)", title="Outcomes")
    success: dict[str, float] = {}
    for (preset, short), group in groups.items():
        counts = Counter(run.outcome for run in group)
        reached = rate(counts["goal_reached"], len(group) - counts["invalid"])
        success[f"success_{preset}_{short}"] = round(reached.share or 0.0, 4)
        told = "-" if reached.share is None else f"{reached.share:.1%} ({reached.low:.1%} to {reached.high:.1%})"
        table.add_row(CONFIGS[preset], PREDICTIONS[short], *(str(counts[name]) for name in outcomes), told)
    console.print(table)
    main = groups["default", "gt"]
    console.print("Failures of Default with ground truth, and problems that nobody can solve:")
    for run in sorted(main, key=lambda run: (run.outcome, run.scenario_id)):
        if run.outcome != "goal_reached":
            console.print(f"  {run.outcome:12} {run.scenario_id}: {run.reason}", soft_wrap=True, highlight=False)
    ratios = [t.planning_step_median_ms / t.core_step_median_ms for t in timings if t.core_step_median_ms]
    walls = [timing.wall_s for timing in timings]
    print_figures(
        "Planner loop",
        [
            ("planning step ÷ core", spread(ratios, "×") if ratios else "the planner has no core"),
            ("a run, in the worker", spread(walls, "s")),
            ("throughput of two workers ÷ one", f"{speedup:.2f} ×"),
        ],
        {
            "runs": len(runs),
            "lost": lost,
            "solvable": sum(run.outcome != "invalid" for run in main),
            **success,
            "trap_infeasible": sum(_trapped(run) for run in runs),
            "step_over_core": round(statistics.median(ratios), 3) if ratios else 0.0,
            "run_median_s": round(statistics.median(walls), 3),
            "two_worker_speedup": round(speedup, 3),
            "weights_acting": acting,
        },
    )


def main() -> None:
    """Read the command line and measure."""
    beside = Path(__file__).resolve().parent.parent.parent / "shared"
    shared = Path(os.environ.get("PLANNERFORGE_SHARED", beside))
    parser = argparse.ArgumentParser(description="Measure the planner loop on a folder of CommonRoad scenarios.")
    parser.add_argument("--folder", type=Path, default=shared / "data" / "commonroad")
    parser.add_argument("--limit", type=int, default=None, help="only a sample of so many files")
    arguments = parser.parse_args()
    if not arguments.folder.is_dir():
        parser.error(f"there is no folder {arguments.folder}: name one with --folder, or set PLANNERFORGE_SHARED")
    with tempfile.TemporaryDirectory() as workspace:
        anyio.run(measure, Path(workspace), arguments.folder.resolve(), arguments.limit)


if __name__ == "__main__":
    main()
