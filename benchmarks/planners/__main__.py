"""``make bench-planners``: the planners' outcomes on every scenario of a folder, and the cost of the loop.

Keys:

- ``runs``, ``lost`` (cells without a run), ``solvable`` (valid problems).
- ``success_<preset>_<prediction>``: share of the solvable problems that reach the goal.
- ``trap_infeasible``: infeasible runs that look like a heading wrap, because the yaw rate rejected the most candidates
  of the last attempt.
- ``step_over_core``: planning step over its time in the core, median.
- ``run_median_s``: median wall time of a run in a single warm worker without other load (the runs that measure the
  throughput of one worker); ``two_worker_speedup``.
- ``weights_acting``: weights of Default that change the first choice in one of some scenarios if increased.
- ``rear_scenarios`` (scenarios with a follower); ``recorded_rear_hits``, ``reactive_rear_hits`` (braking egos hit from
  behind, over all planners; ``make bench-reactive`` measures this in full).

``--fresh SEED`` drives newly drawn problems, ``--count`` for each seed: any recorded car as the ego, from any step, to
its last recorded position. Keys: ``seeds``, ``fresh_problems``, ``fresh_lost`` (runs that raised), ``fresh_solvable``
(valid), ``fresh_success_<preset>_<prediction>`` and ``fresh_trap_infeasible`` as above.
"""

import statistics
import tempfile
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import anyio
from mcp import Client
from rich.console import Console
from rich.table import Table

from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.workspace import Workspace
from plannerforge.evals.results.rates import rate_text
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.runs import BatchRecord, Prediction, RunRecord, RunSteps, RunTiming
from plannerforge.server.assembly import create_server

from ..harness import (
    drawn,
    existing,
    finished_batch,
    import_scenarios,
    print_figures,
    read_run_file,
    scenario_files,
    settings_for,
    shared_scenarios,
    spread,
)
from .acting_weights import acting_weights
from .failure_causes import cause, is_wrap, rejections
from .fresh import Drive, fresh_drives
from .reactive import braked_runs, rear_hits, rows

CONFIGS = {"default": "frenetix:Default", "safety": "frenetix:Safety-Conservative"}
PREDICTIONS: dict[str, Prediction] = {"gt": "ground_truth", "cv": "constant_velocity"}
TIMED_RUNS = 72
"""Enough runs that the last one, alone on one of two workers, hardly counts (chosen)."""
SITUATIONS = 12
"""Number of scenarios with a start that tests which weights act (chosen)."""
WORKERS = 2


async def _throughput(
    workspace: Path, folder: Path, scenarios: Sequence[str], workers: int
) -> tuple[float, tuple[float, ...]]:
    """Return runs per second of warm workers, and the wall time of each run in its worker.

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
    walls = tuple(read_run_file(opened, run_id, "timing.json", RunTiming).wall_s for run_id in batch.runs)
    opened.close()
    return pace, walls


async def _measure(workspace: Path, folder: Path, limit: int | None) -> None:
    """Import, run, print."""
    files = scenario_files(folder, limit)
    async with Client(create_server(settings_for(workspace, folder, WORKERS))) as client:
        await import_scenarios(client, files)
        batch_ids = [
            await finished_batch(
                client, scenarios=["preset:500"], configs=list(CONFIGS.values()), prediction=prediction
            )
            for prediction in PREDICTIONS.values()
        ]
    opened = Workspace(workspace)
    batches = [opened.get(batch_id, "batch").read(BatchRecord) for batch_id in batch_ids]
    runs = [opened.get(run_id, "run").read(RunRecord) for batch in batches for run_id in batch.runs]
    success = _print_outcomes(runs)
    _print_failures(opened, [run for run in _select_runs(runs, "default", "gt") if run.outcome != "goal_reached"])
    driven = [run for run in runs if run.outcome != "invalid"]
    timings = [read_run_file(opened, run.run_id, "timing.json", RunTiming) for run in driven]
    ratios = [t.planning_step_median_ms / t.core_step_median_ms for t in timings if t.core_step_median_ms]
    trapped = sum(is_trapped(run, _steps(opened, run)) for run in driven if run.outcome == "infeasible")
    timed = drawn({run.scenario_id for run in driven}, TIMED_RUNS)
    situations = [read_scenario(opened.file("scenario", key, "scenario.xml")) for key in timed[:SITUATIONS]]
    acting = acting_weights(built_in(CONFIGS["default"]), situations)
    opened.close()
    pace, walls_s = await _throughput(workspace, folder, timed, 1)
    pace_of_two, _ = await _throughput(workspace, folder, timed, 2)
    braked = braked_runs(files, WORKERS)
    print_figures(
        "Planner loop",
        {
            "runs": len(runs),
            "lost": sum(len(batch.lost) for batch in batches),
            "solvable": sum(run.outcome != "invalid" for run in _select_runs(runs, "default", "gt")),
            **success,
            "trap_infeasible": trapped,
            "step_over_core": round(statistics.median(ratios), 3) if ratios else 0.0,
            "run_median_s": round(statistics.median(walls_s), 3),
            "two_worker_speedup": round(pace_of_two / pace, 3),
            "weights_acting": len(acting),
            "rear_scenarios": len({run.scenario_id for run in braked}),
            "reactive_rear_hits": rear_hits(braked, "reactive"),
            "recorded_rear_hits": rear_hits(braked, "recorded"),
        },
        [
            ("planning step ÷ core", spread(ratios, "×") if ratios else "the planner has no core"),
            ("a run, in one warm worker", spread(walls_s, "s")),
            ("throughput of two workers ÷ one", f"{pace_of_two / pace:.2f} ×"),
            *rows(braked),
        ],
    )


def _steps(workspace: Workspace, run: RunRecord) -> RunSteps:
    return read_run_file(workspace, run.run_id, "steps.json", RunSteps)


def _select_runs(runs: Sequence[RunRecord], preset: str, prediction: str) -> list[RunRecord]:
    return [run for run in runs if run.config_name == CONFIGS[preset] and run.prediction == PREDICTIONS[prediction]]


def is_trapped(run: RunRecord, steps: RunSteps) -> bool:
    """Return True if a heading wrap seems to have made a run infeasible (``is_wrap``).

    The last attempt counts, however long the run went well before.
    """
    return run.outcome == "infeasible" and is_wrap({name: values[-1] for name, values in steps.rejected.items()})


def _print_outcomes(runs: Sequence[RunRecord]) -> dict[str, float]:
    """Print the table of outcomes; returns the success of each group."""
    outcomes = [name for name, _ in Counter(run.outcome for run in runs).most_common()]
    table = Table("configuration", "prediction", *outcomes, "success of the solvable (95 % Wilson)", title="Outcomes")
    success: dict[str, float] = {}
    for preset, config in CONFIGS.items():
        for short, prediction in PREDICTIONS.items():
            counts = Counter(run.outcome for run in _select_runs(runs, preset, short))
            reached, solvable = counts["goal_reached"], counts.total() - counts["invalid"]
            success[f"success_{preset}_{short}"] = round(reached / solvable, 4) if solvable else 0.0
            shown = (str(counts[name]) for name in outcomes)
            table.add_row(config, prediction, *shown, rate_text(reached, solvable))
    Console(width=160).print(table)
    return success


def _print_failures(workspace: Workspace, failures: Sequence[RunRecord]) -> None:
    title = f"Not reached by {CONFIGS['default']} with {PREDICTIONS['gt']}"
    table = Table("outcome", "scenario", "cause", "candidates rejected most by", title=title)
    for run in sorted(failures, key=lambda run: (run.outcome, run.scenario_id)):
        why = cause(run, _steps(workspace, run), workspace.file("scenario", run.scenario_id, "scenario.xml"))
        table.add_row(run.outcome, run.scenario_id, why, rejections(run))
    Console(width=180).print(table)


def _measure_fresh(files: Sequence[Path], seeds: Sequence[int], count: int) -> None:
    draws = [f"{seed} {number}" for seed in seeds for number in range(count)]
    drives = fresh_drives(files, draws, list(CONFIGS.values()), list(PREDICTIONS.values()), WORKERS)
    figures, rows = fresh_figures(drives)
    told = {"seeds": " ".join(map(str, seeds)), **figures}
    print_figures("Planner loop, one of the recorded cars as the ego", told, rows)


def fresh_figures(drives: Sequence[Drive]) -> tuple[dict[str, float | int], list[tuple[str, str]]]:
    """Return figures of drawn problems by key, and rows: success with its interval, and the reasons of failures."""
    success, rows = dict[str, float](), list[tuple[str, str]]()
    for preset, config in CONFIGS.items():
        for short, prediction in PREDICTIONS.items():
            outcomes = Counter(one.outcome for one in drives if (one.config, one.prediction) == (config, prediction))
            reached, solvable = outcomes["goal_reached"], outcomes.total() - outcomes["invalid"]
            success[f"fresh_success_{preset}_{short}"] = round(reached / solvable, 4) if solvable else 0.0
            rows.append((f"{config}, {prediction}", rate_text(reached, solvable)))
            rows += [(f"  {outcome}", str(number)) for outcome, number in outcomes.most_common()]
    first = [one for one in drives if (one.config, one.prediction) == (CONFIGS["default"], PREDICTIONS["gt"])]
    rows += [(one.name, f"{one.outcome}: {one.reason}") for one in first if one.outcome != "goal_reached"]
    figures = {
        "fresh_problems": len(first),
        "fresh_lost": sum(one.is_lost for one in drives),
        "fresh_solvable": sum(one.outcome != "invalid" for one in first),
        **success,
        "fresh_trap_infeasible": sum(one.trapped for one in drives),
    }
    return figures, rows


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=shared_scenarios())
    parser.add_argument("--limit", type=int, help="only a sample of this many files")
    parser.add_argument("--fresh", type=int, nargs="+", metavar="SEED", help="draw problems from these files")
    parser.add_argument("--count", type=int, default=100, help="with --fresh: problems of each seed")
    given = parser.parse_args()
    scenarios = existing(given.folder)
    if given.fresh is None:
        with tempfile.TemporaryDirectory() as scratch:
            anyio.run(_measure, Path(scratch), scenarios, given.limit)
    else:
        _measure_fresh(scenario_files(scenarios, given.limit), given.fresh, given.count)
