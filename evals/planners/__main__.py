"""``make bench-planners``: how the planners fare on every scenario of a folder, and what the loop costs.

Keys: ``runs``, ``lost`` (cells without a run), ``solvable`` (not invalid), ``success_<preset>_<prediction>``
(share of the solvable problems that reach the goal), ``trap_infeasible`` (infeasible runs that look like a heading
wrap: the yaw rate rejected the most candidates of the last attempt), ``step_over_core`` (planning step ÷ its time in
the core, median), ``run_median_s`` (a run in a single warm worker, nothing else at work: the median wall time of the
runs with which the throughput of one worker is measured), ``two_worker_speedup``, ``weights_acting`` (those of Default
whose raising changes the first choice in one of some scenarios), ``rear_scenarios`` (scenarios with a follower),
``recorded_rear_hits`` and ``reactive_rear_hits`` (braked egos that were
hit from behind, over all planners; the whole measurement is ``make bench-reactive``).
"""

import argparse
import statistics
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import anyio
from mcp import Client
from rich.console import Console
from rich.table import Table

from ...engine.commonroad import read_scenario
from ...engine.workspace import Workspace
from ...schemas.base import Model
from ...schemas.runs import BatchRecord, RunRecord, RunSteps, RunTiming
from ...server.assembly import create_server
from ..harness import (
    built_in,
    drawn,
    existing,
    finished_batch,
    import_scenarios,
    print_figures,
    rate_text,
    scenario_files,
    settings_for,
    shared_scenarios,
    spread,
)
from .acting_weights import acting_weights
from .failure_causes import cause, rejections
from .reactive import hits, rows
from .rear_hits import BrakedRun, braked_runs

CONFIGS = {"default": "frenetix:Default", "safety": "frenetix:Safety-Conservative"}
PREDICTIONS = {"gt": "ground_truth", "cv": "constant_velocity"}
TIMED_RUNS = 72
"""Enough that the time in which one of two workers has the last run alone hardly counts (chosen)."""
SITUATIONS = 12
"""Scenarios whose starts decide which weights act (chosen)."""
WORKERS = 2
Content = TypeVar("Content", bound=Model)


@dataclass(frozen=True)
class _Measured:
    """All that is printed: records, lost cells, causes of failures, step and run times, and the braked runs."""

    runs: tuple[RunRecord, ...]
    lost: int
    trapped: int
    failures: tuple[tuple[RunRecord, str], ...]
    timings: tuple[RunTiming, ...]
    acting: int
    wall_s: tuple[float, ...]
    speedup: float
    braked: tuple[BrakedRun, ...]


async def _throughput(
    workspace: Path, folder: Path, scenarios: Sequence[str], workers: int
) -> tuple[float, tuple[float, ...]]:
    """Runs a second of warm workers, and the wall time of each run in its worker.

    The number of workers is the seed, so that nothing is reused.
    """
    grid = {"configs": [CONFIGS["default"]], "prediction": PREDICTIONS["cv"]}
    async with Client(create_server(settings_for(workspace, folder, workers))) as client:
        await finished_batch(client, scenarios=list(scenarios[:4]), seed=100 + workers, **grid)
        started = time.perf_counter()
        batch_id = await finished_batch(client, scenarios=list(scenarios), seed=workers, **grid)
        pace = len(scenarios) / (time.perf_counter() - started)
    opened = Workspace(workspace)
    batch = opened.get(batch_id, "batch").read(BatchRecord)
    walls = tuple(_file(opened, run_id, "timing.json", RunTiming).wall_s for run_id in batch.runs)
    opened.close()
    return pace, walls


async def _measure(workspace: Path, folder: Path, limit: int | None) -> None:
    """Import, run, print."""
    files = scenario_files(folder, limit)
    async with Client(create_server(settings_for(workspace, folder, WORKERS))) as client:
        await import_scenarios(client, files)
        batches = [
            await finished_batch(
                client, scenarios=["preset:500"], configs=list(CONFIGS.values()), prediction=prediction
            )
            for prediction in PREDICTIONS.values()
        ]
    opened = Workspace(workspace)
    records = [opened.get(batch_id, "batch").read(BatchRecord) for batch_id in batches]
    runs = tuple(opened.get(key, "run").read(RunRecord) for batch in records for key in batch.runs)
    driven = [run for run in runs if run.outcome != "invalid"]
    timings = tuple(_file(opened, run.run_id, "timing.json", RunTiming) for run in driven)
    failures = tuple((run, _cause(opened, run)) for run in _of(runs, "default", "gt") if run.outcome != "goal_reached")
    traps = sum(trapped(run, _steps(opened, run)) for run in driven if run.outcome == "infeasible")
    timed = drawn(sorted({run.scenario_id for run in driven}), TIMED_RUNS)
    acting = _weights_acting(opened, timed[:SITUATIONS])
    opened.close()
    one, walls = await _throughput(workspace, folder, timed, 1)
    two, _ = await _throughput(workspace, folder, timed, 2)
    braked = tuple(braked_runs(files, WORKERS))
    lost = sum(len(batch.lost) for batch in records)
    _print(_Measured(runs, lost, traps, failures, timings, acting, walls, two / one, braked))


def _cause(workspace: Workspace, run: RunRecord) -> str:
    return cause(run, _steps(workspace, run), workspace.file("scenario", run.scenario_id, "scenario.xml"))


def _steps(workspace: Workspace, run: RunRecord) -> RunSteps:
    return _file(workspace, run.run_id, "steps.json", RunSteps)


def _file(workspace: Workspace, run_id: str, name: str, model: type[Content]) -> Content:
    return model.model_validate_json(workspace.file("run", run_id, name).read_text(encoding="utf-8"))


def _weights_acting(workspace: Workspace, scenarios: Sequence[str]) -> int:
    files = (workspace.file("scenario", scenario_id, "scenario.xml") for scenario_id in scenarios)
    return len(acting_weights(built_in(CONFIGS["default"]), [read_scenario(file) for file in files]))


def _of(runs: Sequence[RunRecord], preset: str, prediction: str) -> list[RunRecord]:
    return [run for run in runs if run.config_name == CONFIGS[preset] and run.prediction == PREDICTIONS[prediction]]


def trapped(run: RunRecord, steps: RunSteps) -> bool:
    """Whether a run looks as if a heading wrap had made it infeasible: the yaw rate rejected more than all else did.

    The last attempt counts, however long the run went well before. At a wrap the heading leaps by 2π, which only the
    check of the yaw rate sees as such. Where a curve is too tight, the curvature rate or the acceleration rejects more.
    """
    counts = {name: values[-1] for name, values in steps.rejected.items()}
    return run.outcome == "infeasible" and counts.get("yaw_rate", 0) > max(
        (count for name, count in counts.items() if name != "yaw_rate"), default=0
    )


def _print_outcomes(runs: Sequence[RunRecord]) -> dict[str, float]:
    """Print the table of outcomes; returns the success of each group."""
    outcomes = [name for name, _ in Counter(run.outcome for run in runs).most_common()]
    table = Table("configuration", "prediction", *outcomes, "success of the solvable (95 % Wilson)", title="Outcomes")
    success: dict[str, float] = {}
    for preset, config in CONFIGS.items():
        for short, prediction in PREDICTIONS.items():
            counts = Counter(run.outcome for run in _of(runs, preset, short))
            reached, solvable = counts["goal_reached"], counts.total() - counts["invalid"]
            success[f"success_{preset}_{short}"] = round(reached / solvable, 4) if solvable else 0.0
            share = rate_text(reached, solvable)
            table.add_row(config, prediction, *(str(counts[name]) for name in outcomes), share)
    Console(width=160).print(table)
    return success


def _print_failures(failures: Sequence[tuple[RunRecord, str]]) -> None:
    title = f"Not reached by {CONFIGS['default']} with {PREDICTIONS['gt']}"
    table = Table("outcome", "scenario", "cause", "candidates rejected most by", title=title)
    for run, why in sorted(failures, key=lambda item: (item[0].outcome, item[0].scenario_id)):
        table.add_row(run.outcome, run.scenario_id, why, rejections(run))
    Console(width=180).print(table)


def _print(measured: _Measured) -> None:
    success = _print_outcomes(measured.runs)
    _print_failures(measured.failures)
    ratios = [t.planning_step_median_ms / t.core_step_median_ms for t in measured.timings if t.core_step_median_ms]
    print_figures(
        "Planner loop",
        [
            ("planning step ÷ core", spread(ratios, "×") if ratios else "the planner has no core"),
            ("a run, in one warm worker", spread(measured.wall_s, "s")),
            ("throughput of two workers ÷ one", f"{measured.speedup:.2f} ×"),
            *rows(measured.braked),
        ],
        {
            "runs": len(measured.runs),
            "lost": measured.lost,
            "solvable": sum(run.outcome != "invalid" for run in _of(measured.runs, "default", "gt")),
            **success,
            "trap_infeasible": measured.trapped,
            "step_over_core": round(statistics.median(ratios), 3) if ratios else 0.0,
            "run_median_s": round(statistics.median(measured.wall_s), 3),
            "two_worker_speedup": round(measured.speedup, 3),
            "weights_acting": measured.acting,
            "rear_scenarios": len({run.scenario_id for run in measured.braked}),
            "reactive_rear_hits": hits(measured.braked, "reactive"),
            "recorded_rear_hits": hits(measured.braked, "recorded"),
        },
    )


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description="Measure the planner loop on a folder of CommonRoad scenarios.")
    parser.add_argument("--folder", type=Path, default=shared_scenarios())
    parser.add_argument("--limit", type=int, default=None, help="only a sample of this many files")
    arguments = parser.parse_args()
    folder = existing(arguments.folder, parser, "--folder")
    with tempfile.TemporaryDirectory() as workspace:
        anyio.run(_measure, Path(workspace), folder, arguments.limit)


if __name__ == "__main__":
    main()
