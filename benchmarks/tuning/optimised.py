"""Checks whether a search finds weights that are better on unseen roads.

For three seeds of the split, ``optimize_planner`` searches six weights of Frenetix from its default, for success under
constant-velocity prediction, on half of a hundred public scenarios. The found configuration, the default and
Safety-Conservative then run on the other half. This module counts goals and collisions from the stored runs. A scenario
held out by several splits counts once, with its mean. The interval is a bootstrap over places.

Keys:

- ``optimised_gain``: mean difference of success, found − default; ``optimised_gain_low``, ``optimised_gain_high``: its
  95 % interval.
- ``optimised_collision_change``: mean difference of the share of collisions.
- ``optimised_over_safety``: difference of success, found − Safety-Conservative; ``safety_gain``: Safety-Conservative −
  default on the same.
- ``default_success``, ``safety_success``, ``optimised_success``, and the same with ``_collisions``: the shares
  themselves, that is, the paper's table of presets and the found one.
- ``optimised_told``: searches with an answer that says *is better*; ``optimised_found``: searches with an improvement
  in training; ``optimised_scenarios``: number of held-out scenarios.
"""

import random
import sys
from collections.abc import Mapping
from pathlib import Path
from statistics import fmean
from typing import Any

import anyio
from mcp import Client

from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.runs import BatchRecord
from plannerforge.server.assembly import create_server

from ..analysis.advice import road_of
from ..harness import (
    Figures,
    SeededBench,
    ask,
    ask_to_the_end,
    attempted_runs,
    finished_batch,
    import_scenarios,
    scenario_files,
    settings_for,
)

DEFAULT, SAFETY = "frenetix:Default", "frenetix:Safety-Conservative"
VARIED = (
    "prediction",
    "distance_to_obstacles",
    "responsibility",
    "velocity_offset",
    "distance_to_reference_path",
    "longitudinal_jerk",
)
"""Searched weights (chosen: the three of safety, and their counterweights)."""
SPLITS, SCENARIOS, TRIALS, DRAWS = 3, 100, 16, 4000
"""Seeds of the split, scenarios, candidates a search, draws of the bootstrap (chosen: a quarter of an hour)."""
_Ends = Mapping[str, tuple[bool, bool]]
"""By scenario: whether it reached the goal, whether it collided."""


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above; a limit restricts the number of scenarios."""
    return anyio.run(_measured, bench)


async def _measured(bench: SeededBench) -> Figures:
    folder = bench.scratch / "optimised"
    shares: dict[str, list[tuple[float, ...]]] = {}
    told = found = 0
    async with Client(create_server(settings_for(folder, bench.shared, 2))) as client:
        await import_scenarios(client, scenario_files(bench.shared / "data" / "commonroad", bench.limit or SCENARIOS))
        for seed in range(bench.seed, bench.seed + SPLITS):
            study = await _study(client, seed)
            held_out = study["held_out"]
            sys.stderr.write(f"seed {seed}: {study['best_name']}: {held_out and held_out['verdict']}\n")
            if held_out is None:
                continue
            found += 1
            told += held_out["gain"]["low"] > 0
            batch = _batch(folder, held_out["batch_id"])
            safety = await finished_batch(
                client, scenarios=list(batch.scenarios), configs=[SAFETY], prediction="constant_velocity"
            )
            base, best = (_ends(folder, held_out["batch_id"], study[key]) for key in ("base_id", "best_id"))
            for name, row in _rows(base, best, _ends(folder, safety, None)).items():
                shares.setdefault(name, []).append(row)
    means = {name: tuple(fmean(column) for column in zip(*rows, strict=True)) for name, rows in shares.items()}
    low, high = place_interval({name: row[4] - row[0] for name, row in means.items()}, bench.seed)
    reached, hit, safe_reached, safe_hit, best_reached, best_hit = (
        fmean(row[i] for row in means.values()) if means else 0.0 for i in range(6)
    )
    return {
        "optimised_gain": round(best_reached - reached, 4),
        "optimised_gain_low": low,
        "optimised_gain_high": high,
        "optimised_collision_change": round(best_hit - hit, 4),
        "optimised_over_safety": round(best_reached - safe_reached, 4),
        "safety_gain": round(safe_reached - reached, 4),
        "default_success": round(reached, 4),
        "safety_success": round(safe_reached, 4),
        "optimised_success": round(best_reached, 4),
        "default_collisions": round(hit, 4),
        "safety_collisions": round(safe_hit, 4),
        "optimised_collisions": round(best_hit, 4),
        "optimised_told": told,
        "optimised_found": found,
        "optimised_scenarios": len(means),
    }


async def _study(client: Client, seed: int) -> Any:
    given = {
        "scenarios": ["preset:500"],
        "base": DEFAULT,
        "vary": list(VARIED),
        "max_trials": TRIALS,
        "seed": seed,
        "prediction": "constant_velocity",
    }
    answer = await ask(client, "optimize_planner", **given, wait_s=0)
    if answer["state"] == "running":
        await ask_to_the_end(client, "get_job", job_id=answer["job_id"], wait_s=0)
        answer = await ask(client, "optimize_planner", **given)
    if answer["study"] is None:
        raise RuntimeError(f"the search ended as {answer['state']}: {answer['message']}")
    return answer["study"]


def _batch(folder: Path, batch_id: str) -> BatchRecord:
    workspace = Workspace(folder)
    batch = workspace.get(batch_id, "batch").read(BatchRecord)
    workspace.close()
    return batch


def _ends(folder: Path, batch_id: str, config_id: str | None) -> _Ends:
    """Return the ends of a batch's runs, of one configuration if given, without those not attempted."""
    return {
        record.scenario_id: (record.outcome == "goal_reached", record.outcome == "collision")
        for record in attempted_runs(folder, batch_id)
        if config_id in (None, record.config_id)
    }


def _rows(base: _Ends, best: _Ends, safety: _Ends) -> dict[str, tuple[float, ...]]:
    """Return goal and collision of the default, of Safety-Conservative and of the found configuration, by scenario."""
    return {
        name: tuple(float(end) for end in (*base[name], *safety[name], *best[name]))
        for name in sorted(base)
        if name in best and name in safety
    }


def place_interval(gains: Mapping[str, float], seed: int) -> tuple[float, float]:
    """Return the 95 % interval of a mean over scenarios, with places drawn with replacement."""
    places: dict[str, list[float]] = {}
    for name, gain in gains.items():
        places.setdefault(road_of(name), []).append(gain)
    if not places:
        return 0.0, 0.0
    choice, groups = random.Random(seed), list(places.values())  # noqa: S311 - no secret
    drawn = [choice.choices(groups, k=len(groups)) for _ in range(DRAWS)]
    means = sorted(sum(map(sum, groups)) / sum(map(len, groups)) for groups in drawn)
    return round(means[int(0.025 * DRAWS)], 4), round(means[int(0.975 * DRAWS)], 4)
