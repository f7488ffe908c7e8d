"""Checks that a decisive weight and an inert one are reported as such.

Synthetic: one of six weights decides beyond some value whether a synthetic scenario is mastered, four matter little,
one does nothing; roles and values are drawn. Real: IDM on public scenarios, where the desired acceleration affects the
comfort of nearly all and ``sampling_level`` has no effect. (It does not affect the duration clearly: 38 of 47 scenarios
do not change, six change one way and three the other.) Both use Morris, with another design for each seed.

Keys: ``sensitivity_planted``: share of the synthetic and real cases with both weights reported correctly;
``sensitivity_made``, ``sensitivity_real``: the same for either; ``sensitivity_cases``: number of cases.
"""

import random
from statistics import fmean
from typing import Any

import anyio
from mcp import Client

from plannerforge.engine.execution import silent
from plannerforge.engine.tuning import dimensions, sensitivity_design, sensitivity_effects, values_at
from plannerforge.schemas.analysis.optimization import DesignRequest, EffectsRequest
from plannerforge.server.assembly import create_server

from ..harness import Figures, SeededBench, ask, ask_to_the_end, import_scenarios, scenario_files, settings_for, share

CASES, REAL_CASES, MADE_SCENARIOS, REAL_SCENARIOS = 10, 3, 40, 24
"""Seeds of synthetic and of real cases, and scenarios of either (chosen: a real case takes minutes)."""
_NAMES = ("prediction", "velocity_offset", "distance_to_obstacles", "jerk", "responsibility", "path_length")


def measure(bench: SeededBench) -> Figures:
    """Return the keys above; with a limit, of so many seeds."""
    seeds = range(bench.seed, bench.seed + (bench.limit or CASES))
    made = [_made(seed) for seed in seeds]
    real = anyio.run(_real, bench, list(seeds[:REAL_CASES]))
    return {
        "sensitivity_planted": share([*made, *real]),
        "sensitivity_made": share(made),
        "sensitivity_real": share(real),
        "sensitivity_cases": len(made) + len(real),
    }


def _made(seed: int) -> bool:
    choice = random.Random(seed)  # noqa: S311 - no secret
    matters, idle, *others = choice.sample(_NAMES, len(_NAMES))
    limits = [10 ** choice.uniform(-1, 1) for _ in range(MADE_SCENARIOS)]
    needed = {name: [choice.random() < 0.05 for _ in range(MADE_SCENARIOS)] for name in others}

    def reached(values: dict[str, float]) -> tuple[float, ...]:
        return tuple(
            float(values[matters] >= limits[i] and not any(needed[name][i] and values[name] > 1 for name in others))
            for i in range(MADE_SCENARIOS)
        )

    space = dimensions("frenetix", _NAMES)
    design = DesignRequest(method="morris", names=_NAMES, most=70, seed=seed)
    points = sensitivity_design(design, silent).points
    scores = tuple(reached(values_at(space, point)) for point in points)
    request = EffectsRequest(
        design=design,
        values=tuple(map(fmean, scores)),
        scores=scores,
        units=tuple(f"made {number}" for number in range(MADE_SCENARIOS)),
    )
    effects = sensitivity_effects(request, silent).effects
    verdicts = {one.name: one.verdict for one in effects}
    return (effects[0].name, verdicts[matters], verdicts[idle]) == (matters, "matters", "none")


async def _real(bench: SeededBench, seeds: list[int]) -> list[bool]:
    found = []
    async with Client(create_server(settings_for(bench.scratch / "idm", bench.shared, 1))) as client:
        await import_scenarios(client, scenario_files(bench.shared / "data" / "commonroad", REAL_SCENARIOS))
        for seed in seeds:
            verdicts = {one["name"]: one["verdict"] for one in await _effects(client, seed)}
            found.append(verdicts == {"acceleration_mps2": "matters", "sampling_level": "none"})
    return found


async def _effects(client: Client, seed: int) -> Any:
    given = {
        "scenarios": ["preset:500"],
        "base": "idm:Default",
        "method": "morris",
        "vary": ["acceleration_mps2", "sampling_level"],
        "objective": ["comfort"],
        "max_trials": 30,
        "seed": seed,
    }
    answer = await ask(client, "optimize_planner", **given)
    if answer["state"] == "running":
        await ask_to_the_end(client, "get_job", job_id=answer["job_id"], wait_s=0)
        answer = await ask(client, "optimize_planner", **given)
    return answer["study"]["effects"]
