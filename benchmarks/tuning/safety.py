"""Why Safety-Conservative gains little over Default here: how far it changes what is driven, and what could be gained.

Public scenarios under constant-velocity prediction with Default, Safety-Conservative, and Safety-Conservative with its
three terms of safety ten times as heavy; then the first two with the recording itself as prediction. All figures are
counted here from the stored runs, but who hit whom and what prevents it, which is the product's.

Keys, each of the runs that could be attempted: ``safety_scenarios``: how many; ``safety_default_other``: share of
Default's runs that neither reach the goal nor collide; ``safety_default_collisions``: share that collide;
``safety_unpreventable``: of these, the share that no reference driver prevents; ``safety_to_success``,
``safety_to_failure``: flips from Default; ``heavy_to_success``, ``heavy_to_failure``: of the tenfold one;
``truth_to_success``, ``truth_to_failure``: flips from Default to Safety-Conservative where both know the recording;
``truth_known_to_success``: flips of Default by knowing the recording; ``safety_same_way``: share whose courses stay
within half a metre; ``share_prediction``, ``share_obstacles``, ``share_responsibility``: mean shares of the three terms
in the cost of Safety-Conservative's chosen candidates; ``share_speed``: that of the desired speed.
"""

import math
from collections.abc import Mapping
from statistics import fmean

import anyio
from mcp import Client

from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.runs import BatchRecord, Prediction, RunRecord, RunSteps
from plannerforge.server.assembly import create_server

from ..harness import (
    Figures,
    SeededBench,
    ask,
    finished_batch,
    import_scenarios,
    read_run_file,
    scenario_files,
    settings_for,
    share,
)
from .optimised import DEFAULT, SAFETY, SCENARIOS

HEAVY = ("prediction*10", "distance_to_obstacles*10", "responsibility*10")
_NEAR_M = 0.5
"""How far apart two courses may be and still be the same way (chosen: a quarter of a car's width and more)."""
_TERMS = {
    "share_prediction": "prediction",
    "share_obstacles": "distance_to_obstacles",
    "share_responsibility": "responsibility",
    "share_speed": "velocity_offset",
}
_Runs = Mapping[str, tuple[RunRecord, RunSteps]]
"""By scenario: the run and its steps."""


def measure(bench: SeededBench) -> Figures:
    """The keys above; with a limit, on so many scenarios."""
    return anyio.run(_measured, bench)


async def _measured(bench: SeededBench) -> Figures:
    async with Client(create_server(settings_for(bench.scratch / "safety", bench.shared, 1))) as client:
        files = scenario_files(bench.shared / "data" / "commonroad", bench.limit or SCENARIOS)
        await import_scenarios(client, files)
        heavy = (await ask(client, "configure_planner", base=SAFETY, weights=list(HEAVY)))["config_id"]
        guessed: Prediction = "constant_velocity"
        known: Prediction = "ground_truth"
        default, safety, heavier, knowing, knowing_safety = [
            await _runs(bench, client, config, prediction)
            for config, prediction in (
                (DEFAULT, guessed),
                (SAFETY, guessed),
                (heavy, guessed),
                (DEFAULT, known),
                (SAFETY, known),
            )
        ]
        collided = [run.run_id for run, _ in default.values() if run.outcome == "collision"]
        unpreventable = set()
        if collided:
            answer = await ask(client, "analyze_results", results=collided)
            unpreventable = set((answer["causes"] or {}).get("not_preventable", ()))
    figures: dict[str, float] = {
        "safety_scenarios": len(default),
        "safety_default_collisions": share(run.outcome == "collision" for run, _ in default.values()),
        "safety_default_other": share(run.outcome not in ("collision", "goal_reached") for run, _ in default.values()),
        "safety_unpreventable": share(run_id in unpreventable for run_id in collided),
        "safety_same_way": share(
            _apart_m(default[name][1], safety[name][1]) <= _NEAR_M for name in default if name in safety
        ),
    }
    sides = {
        "safety": (default, safety),
        "heavy": (default, heavier),
        "truth": (knowing, knowing_safety),
        "truth_known": (default, knowing),
    }
    for key, (before, after) in sides.items():
        figures[f"{key}_to_success"], figures[f"{key}_to_failure"] = _flips(before, after)
    return figures | {key: _term_share(safety, term) for key, term in _TERMS.items()}


async def _runs(bench: SeededBench, client: Client, config: str, prediction: Prediction) -> _Runs:
    batch_id = await finished_batch(client, scenarios=["preset:500"], configs=[config], prediction=prediction)
    workspace = Workspace(bench.scratch / "safety")
    batch = workspace.get(batch_id, "batch").read(BatchRecord)
    records = [workspace.get(run_id, "run").read(RunRecord) for run_id in batch.runs]
    found = {
        record.scenario_id: (record, read_run_file(workspace, record.run_id, "steps.json", RunSteps))
        for record in records
        if record.outcome != "invalid"
    }
    workspace.close()
    return found


def _flips(before: _Runs, after: _Runs) -> tuple[int, int]:
    """How many scenarios became successes, and how many failures."""
    reached = [
        (before[name][0].outcome == "goal_reached", after[name][0].outcome == "goal_reached")
        for name in before
        if name in after
    ]
    return reached.count((False, True)), reached.count((True, False))


def _apart_m(first: RunSteps, second: RunSteps) -> float:
    """The largest distance of two courses at the same time, while both drive."""
    both = zip(first.x_m, first.y_m, second.x_m, second.y_m, strict=False)
    return max((math.hypot(a - c, b - d) for a, b, c, d in both), default=0.0)


def _term_share(runs: _Runs, term: str) -> float:
    """The mean share of a term in the cost of the chosen candidates, over runs with any cost."""
    shares = []
    for _, steps in runs.values():
        sums = {name: sum(values) for name, values in steps.costs.items()}
        if sum(sums.values()) > 0:
            shares.append(sums.get(term, 0.0) / sum(sums.values()))
    return round(fmean(shares), 4) if shares else 0.0
