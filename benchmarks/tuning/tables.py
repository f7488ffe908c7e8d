"""Reproduces the paper's benchmark of planners on the presets of 50, 100 and all scenarios.

Every registered planner runs under its default configuration on all public scenarios (predictions ``constant_velocity``
and ``ground_truth``, recorded traffic); ``preset:50`` and ``preset:100`` are subsets. Runs that could not be attempted
are in no share. The tables go to standard error as Markdown, with Wilson's 95 % intervals and each planner's difference
in success from the first one on the scenarios that both attempted (95 % bootstrap interval).

Keys: ``success_PLANNER_N``, ``collisions_PLANNER_N``: shares of the runs under ``constant_velocity`` on the preset of N
scenarios; ``foreseen_success_PLANNER``: of all scenarios under ``ground_truth``; ``tabled``: number of runs.
"""

import sys
from collections.abc import Mapping, Sequence
from statistics import fmean

import anyio
import numpy as np
from mcp import Client
from scipy.stats import binomtest

from plannerforge.schemas.runs import Prediction, RunRecord
from plannerforge.server.assembly import create_server

from ..harness import (
    Figures,
    SeededBench,
    ask,
    attempted_runs,
    finished_batch,
    import_scenarios,
    scenario_files,
    settings_for,
)

PRESETS = (50, 100, 500)
"""Sizes of the presets, in the product's own order (500: all)."""
DRAWS = 4000
"""Draws of the bootstrap (chosen)."""
_HEAD = "| planner | N | reached the goal | collided | points to the first |\n| --- | --- | --- | --- | --- |\n"
PREDICTIONS: tuple[Prediction, ...] = ("constant_velocity", "ground_truth")


def measure(bench: SeededBench) -> Figures:
    """Return the keys above; with a limit, on so many scenarios."""
    return anyio.run(_measured, bench)


async def _measured(bench: SeededBench) -> Figures:
    folder, runs = bench.scratch / "tables", 0
    figures: dict[str, float | int | str] = {}
    async with Client(create_server(settings_for(folder, bench.shared, 2))) as client:
        await import_scenarios(client, scenario_files(bench.shared / "data" / "commonroad", bench.limit))
        planners = [one["name"] for one in (await ask(client, "list_planners"))["planners"]]
        given = {"configs": [f"{planner}:Default" for planner in planners]}
        for prediction in PREDICTIONS:
            sys.stderr.write(f"\n{prediction}\n\n{_HEAD}")
            for preset in PRESETS:
                scenarios = [f"preset:{preset}"]
                records = attempted_runs(
                    folder, await finished_batch(client, scenarios=scenarios, prediction=prediction, **given)
                )
                runs += len(records) if preset == PRESETS[-1] else 0
                own = {planner: [one for one in records if one.planner == planner] for planner in planners}
                sys.stderr.write(_rows(own, bench.seed))
                figures |= _figures(own, prediction, preset)
    return figures | {"tabled": runs}


def _rows(own: Mapping[str, Sequence[RunRecord]], seed: int) -> str:
    """Return a row of the table for each planner."""
    first = next(iter(own))
    lines = []
    for planner, records in own.items():
        against = "" if planner == first else _difference(own[first], records, seed)
        shares = " | ".join(_share(records, outcome) for outcome in ("goal_reached", "collision"))
        lines.append(f"| {planner} | {len(records)} | {shares} | {against} |\n")
    return "".join(lines)


def _figures(own: Mapping[str, Sequence[RunRecord]], prediction: Prediction, preset: int) -> dict[str, float]:
    """Return the keys of one prediction and preset."""
    found: dict[str, float] = {}
    for planner, records in own.items():
        reached, hit = (
            round(fmean(one.outcome == outcome for one in records), 4) for outcome in ("goal_reached", "collision")
        )
        if prediction == "constant_velocity":
            found |= {f"success_{planner}_{preset}": reached, f"collisions_{planner}_{preset}": hit}
        elif preset == PRESETS[-1]:
            found[f"foreseen_success_{planner}"] = reached
    return found


def _share(records: Sequence[RunRecord], outcome: str) -> str:
    """Return the share of an outcome in per cent with Wilson's interval."""
    count, of = sum(one.outcome == outcome for one in records), len(records)
    if not of:
        return "–"
    interval = binomtest(count, of).proportion_ci(method="wilson")
    return f"{100 * count / of:.1f} % ({100 * interval.low:.1f}–{100 * interval.high:.1f})"


def _difference(first: Sequence[RunRecord], other: Sequence[RunRecord], seed: int) -> str:
    """Return the success of the other minus that of the first, in points, over the scenarios of both."""
    sides = [{record.scenario_id: record.outcome == "goal_reached" for record in side} for side in (first, other)]
    flips = np.array([float(sides[1][name]) - sides[0][name] for name in sorted(sides[0].keys() & sides[1].keys())])
    if not len(flips):
        return "–"
    drawn = np.random.default_rng(seed).choice(flips, (DRAWS, len(flips))).mean(axis=1)
    low, high = np.quantile(drawn, (0.025, 0.975))
    return f"{100 * flips.mean():+.1f} ({100 * low:+.1f} to {100 * high:+.1f})"
