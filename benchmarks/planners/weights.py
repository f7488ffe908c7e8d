"""``make bench-weights``: how an increased weight of Frenetix changes its own term in the closed loop.

Thirty fixed scenarios are driven with Default and, for each of the thirteen weights, with Default and ten times that
weight (1 if Default has 0). The value of a run is the mean of the unweighted term over its planning steps. The table
shows the means over the runs, the median shift (Hodges–Lehmann) with its 95 % interval, and the number of runs in which
the term fell or rose. Weights that are 0 in Default are 1e-6 here, so that their term is recorded.

In the closed loop a term may rise with its own weight, because another trajectory leads into other situations. A test
checks that it never rises in the same situation.

Keys: ``scenarios``, ``runs``, ``lost``, ``falls`` and ``rises`` (weights with an interval below or above 0), and
``shift_<weight>`` (median shift ÷ mean under Default).
"""

import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from statistics import fmean

import anyio
from mcp import Client
from rich.console import Console
from rich.table import Table

from plannerforge.engine.analysis.run_set import mean_terms
from plannerforge.engine.analysis.statistics import SignedRank, signed_rank
from plannerforge.engine.workspace import Workspace
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.planning import PlannerConfiguration
from plannerforge.schemas.runs import BatchRecord, RunRecord, RunSteps
from plannerforge.server.assembly import create_server

from ..harness import (
    ask,
    finished_batch,
    import_scenarios,
    print_figures,
    read_run_file,
    scenario_arguments,
    scenario_files,
    settings_for,
)

BASE = "frenetix:Default"
PREDICTION = "constant_velocity"
FACTOR, INSTEAD_OF_ZERO, RECORDED = 10.0, 1.0, 1e-6
"""The factor on a weight, its value if it was 0, and the weight at which a term is only recorded."""
SCENARIOS, WORKERS = 30, 2


def _raised(value: float) -> float:
    """Return the weight that is compared with Default's."""
    return FACTOR * value or INSTEAD_OF_ZERO


def _difference(before: float, after: float) -> float:
    """Return the change of a term, 0 if it is only rounding."""
    return 0.0 if math.isclose(before, after, rel_tol=1e-9, abs_tol=1e-9) else after - before


async def _measure(workspace: Path, folder: Path, scenarios: int | None) -> None:
    """Make the configurations, run the grid, print."""
    weights = built_in(BASE).weights
    recorded = [f"{name}={RECORDED:g}" for name, value in weights.items() if not value]
    async with Client(create_server(settings_for(workspace, folder, WORKERS))) as client:
        await import_scenarios(client, scenario_files(folder, scenarios))
        base = await ask(client, "configure_planner", base=BASE, weights=recorded)
        configs = {"": str(base["config_id"])}
        for name, value in weights.items():
            made = await ask(client, "configure_planner", base=configs[""], weights=[f"{name}={_raised(value):g}"])
            configs[name] = str(made["config_id"])
        batch_id = await finished_batch(
            client, scenarios=["preset:500"], configs=list(configs.values()), prediction=PREDICTION
        )
    opened = Workspace(workspace)
    batch = opened.get(batch_id, "batch").read(BatchRecord)
    terms = _own_terms(opened, batch)
    opened.close()
    _print(weights, configs, terms, batch)


def _own_terms(workspace: Workspace, batch: BatchRecord) -> dict[tuple[str, str], dict[str, float]]:
    """Return (configuration, scenario) → unweighted mean of each term over the planning steps of the run."""
    terms = {}
    for run_id in batch.runs:
        record = workspace.get(run_id, "run").read(RunRecord)
        configuration = workspace.get(record.config_id, "config").read(PlannerConfiguration)
        means = mean_terms(read_run_file(workspace, run_id, "steps.json", RunSteps))
        if means:
            raw = {name: means.get(name, 0.0) / weight for name, weight in configuration.weights.items()}
            terms[record.config_id, record.scenario_id] = raw
    return terms


def _print(
    weights: Mapping[str, float],
    configs: Mapping[str, str],
    terms: Mapping[tuple[str, str], Mapping[str, float]],
    batch: BatchRecord,
) -> None:
    table = Table("weight", "from", "to", "term before", "term after", "median shift (95 %)", "fell", "rose", "runs")
    tests: dict[str, SignedRank] = {}
    shifts: dict[str, float] = {}
    for name, value in weights.items():
        both = [
            (terms[configs[""], scenario][name], terms[configs[name], scenario][name])
            for scenario in batch.scenarios
            if (configs[""], scenario) in terms and (configs[name], scenario) in terms
        ]
        differences = [_difference(before, after) for before, after in both]
        tests[name] = test = signed_rank(differences)
        before, after = fmean(pair[0] for pair in both), fmean(pair[1] for pair in both)
        shifts[f"shift_{name}"] = round(test.shift / before, 4) if before else 0.0
        interval = "" if test.low is None or test.high is None else f" ({test.low:.3g} to {test.high:.3g})"
        fell, rose = sum(d < 0 for d in differences), sum(d > 0 for d in differences)
        table.add_row(
            name,
            f"{value:g}",
            f"{_raised(value):g}",
            f"{before:.4g}",
            f"{after:.4g}",
            f"{test.shift:.3g}{interval}",
            str(fell),
            str(rose),
            str(len(both)),
        )
    Console(width=150).print(table)
    figures = {
        "scenarios": len(batch.scenarios),
        "runs": len(batch.runs),
        "lost": len(batch.lost),
        "falls": sum(test.high is not None and test.high < 0 for test in tests.values()),
        "rises": sum(test.low is not None and test.low > 0 for test in tests.values()),
    }
    print_figures(
        "A raised weight and its own term", {**figures, **shifts}, [(key, str(value)) for key, value in figures.items()]
    )


if __name__ == "__main__":
    scenarios, most = scenario_arguments(__doc__, "--scenarios", SCENARIOS)
    with tempfile.TemporaryDirectory() as scratch:
        anyio.run(_measure, Path(scratch), scenarios, most)
