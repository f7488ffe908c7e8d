"""How much any weights of Frenetix could gain: the failures of its default under many random weights.

The default runs on a hundred public scenarios under constant-velocity prediction; what it fails is run under random
weights, all thirteen at 0 or evenly in the logarithm from 0.01 to 100. What a configuration loses elsewhere is not
counted, so these are upper bounds of its gain.

Keys: ``bound_best``: the largest gain in success that any of them could have; ``bound_mean``: the mean;
``bound_any``: the gain if every scenario were given the weights that suit it; ``bound_configurations``,
``bound_failures``: of how many.
"""

import math
import random
from statistics import fmean

import anyio
from mcp import Client

from ...engine.tuning import preset_configuration
from ...engine.workspace import Workspace
from ...schemas.runs import BatchRecord, RunRecord
from ...server.assembly import create_server
from ..analysis.bench import AnalysisBench
from ..harness import Figures, ask, finished_batch, import_scenarios, scenario_files, settings_for
from .optimised import DEFAULT, SCENARIOS

CONFIGURATIONS = 40
"""Random weights (chosen)."""


def measure(bench: AnalysisBench) -> Figures:
    """The keys above; with a limit, of so many random configurations."""
    return anyio.run(_measured, bench)


async def _measured(bench: AnalysisBench) -> Figures:
    choice = random.Random(bench.seed)  # noqa: S311 - no secret
    folder = bench.scratch / "random"
    async with Client(create_server(settings_for(folder, bench.shared, 2))) as client:
        await import_scenarios(client, scenario_files(bench.shared / "data" / "commonroad", SCENARIOS))
        first = await finished_batch(
            client, scenarios=["preset:500"], configs=[DEFAULT], prediction="constant_velocity"
        )
        runs = [run for run in _runs(bench, first) if run.outcome != "invalid"]
        failed = [run.scenario_id for run in runs if run.outcome != "goal_reached"]
        configs = []
        for _ in range(bench.limit or CONFIGURATIONS):
            words = [f"{name}={_drawn(choice)}" for name in preset_configuration("frenetix").weights]
            configs.append((await ask(client, "configure_planner", base=DEFAULT, weights=words))["config_id"])
        batch = await finished_batch(client, scenarios=failed, configs=configs, prediction="constant_velocity")
    mended: dict[str, set[str]] = {config: set() for config in configs}
    for run in _runs(bench, batch):
        if run.outcome == "goal_reached":
            mended[run.config_id].add(run.scenario_id)
    return {
        "bound_best": round(max(map(len, mended.values())) / len(runs), 4),
        "bound_mean": round(fmean(map(len, mended.values())) / len(runs), 4),
        "bound_any": round(len(set().union(*mended.values())) / len(runs), 4),
        "bound_configurations": len(configs),
        "bound_failures": len(failed),
    }


def _drawn(choice: random.Random) -> float:
    """A weight: 0 in one of four, else even in the logarithm."""
    return 0.0 if choice.random() < 0.25 else float(f"{math.exp(choice.uniform(math.log(0.01), math.log(100))):.3g}")


def _runs(bench: AnalysisBench, batch_id: str) -> list[RunRecord]:
    workspace = Workspace(bench.scratch / "random")
    batch = workspace.get(batch_id, "batch").read(BatchRecord)
    records = [workspace.get(run_id, "run").read(RunRecord) for run_id in batch.runs]
    workspace.close()
    return records
