"""Measures how often the product's closed form agrees with CommonRoad's ``valid_solution`` about a motion.

``acceptance_agree`` is the share of at least 2,000 motions on which they agree (with a limit: six per scenario). The
motions are those of built-in planners on the public scenarios and variants that narrowly meet or miss the criteria: a
path that bulges to the side, wavering headings or speeds, wrong steering angles, a missing end. The size of a change is
drawn evenly in its logarithm, and the start stays that of the problem. Other road users are left out, because a
collision ends a run in any case. The judge is that of the part ``official``.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.planners.driving.acceptance import DrivenStates, refusal
from plannerforge.engine.vehicles import vehicle_of
from plannerforge.schemas.runs import RunSteps

from ..harness import Figures, SeededBench
from .official import JudgedRun, official_verdict, runs

_PLANNERS = ("frenetix:Default", "idm:Default")
_CHANGED = 5
"""Variants of each driven motion: 2 planners, 191 scenarios, 1 + 5 motions are 2,292."""
Column = NDArray[np.float64]


def measure(bench: SeededBench) -> Figures:
    """Ask both of every motion."""
    generator = np.random.default_rng(bench.seed)
    agreed = asked = 0
    pairs: Counter[tuple[str, str]] = Counter()
    for planner in _PLANNERS:
        for run in runs(bench, planner, "constant_velocity"):
            for kind, steps in _motions(run, generator):
                ours, theirs = _ours(run, steps), _theirs(run, steps)
                asked += 1
                agreed += (ours == "valid") == (theirs == "valid")
                pairs[ours, theirs] += 1
                if (ours == "valid") != (theirs == "valid"):
                    sys.stderr.write(f"{run.scenario} {planner} {kind}: ours {ours}, theirs {theirs}\n")
    sys.stderr.write(f"acceptance: {agreed} of {asked} agree; (ours, theirs): {dict(pairs)}\n")
    return {"acceptance_agree": agreed / max(asked, 1)}


def _motions(run: JudgedRun, generator: np.random.Generator) -> Iterator[tuple[str, RunSteps]]:
    """Yield the driven motion and changed ones."""
    yield "driven", run.response.steps
    for name in generator.choice(sorted(_CHANGES), size=_CHANGED, replace=False).tolist():
        yield name, _CHANGES[name](run, generator)


def _bulge(run: JudgedRun, generator: np.random.Generator) -> RunSteps:
    """Return a way that bulges to the side by 3 mm to 3 m, with the headings as they were."""
    steps = run.response.steps
    aside = _size(generator, 3e-3, 3.0) * _hump(len(steps.x_m), generator)
    heading = np.array(steps.heading_rad)
    x, y = np.array(steps.x_m) - aside * np.sin(heading), np.array(steps.y_m) + aside * np.cos(heading)
    return _with(run, x_m=x, y_m=y)


def _wavering_headings(run: JudgedRun, generator: np.random.Generator) -> RunSteps:
    steps = run.response.steps
    noise = _size(generator, 1e-3, 0.3) * generator.standard_normal(len(steps.x_m))
    noise[0] = 0.0
    return _with(run, heading_rad=np.array(steps.heading_rad) + noise)


def _wavering_speeds(run: JudgedRun, generator: np.random.Generator) -> RunSteps:
    steps = run.response.steps
    noise = _size(generator, 1e-2, 3.0) * generator.standard_normal(len(steps.x_m))
    noise[0] = 0.0
    return _with(run, speed_mps=np.maximum(np.array(steps.speed_mps) + noise, 0.0))


def _wavering_places(run: JudgedRun, generator: np.random.Generator) -> RunSteps:
    steps = run.response.steps
    noise = _size(generator, 1e-3, 0.1) * generator.standard_normal((2, len(steps.x_m)))
    noise[:, 0] = 0.0
    return _with(run, x_m=np.array(steps.x_m) + noise[0], y_m=np.array(steps.y_m) + noise[1])


def _other_steering(run: JudgedRun, generator: np.random.Generator) -> RunSteps:
    """Return steering angles that are off by 0.01 to 1 rad at some moments."""
    vehicle = vehicle_of(run.configuration.settings)
    angles = np.array(run.response.steps.steering_rad)
    off = _size(generator, 1e-2, 1.0) * _hump(len(angles), generator)
    return _with(run, steering_rad=np.clip(angles + off, -vehicle.maximum_steering_rad, vehicle.maximum_steering_rad))


def _without_end(run: JudgedRun, generator: np.random.Generator) -> RunSteps:
    """Return the steps without the last one or more."""
    count = len(run.response.steps.x_m)
    kept = max(count - int(generator.integers(1, max(count // 2, 2))), 2)
    return _with(run, kept=kept)


_CHANGES: dict[str, Callable[[JudgedRun, np.random.Generator], RunSteps]] = {
    "bulge": _bulge,
    "headings": _wavering_headings,
    "speeds": _wavering_speeds,
    "places": _wavering_places,
    "steering": _other_steering,
    "end": _without_end,
}


def _size(generator: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(generator.uniform(np.log(low), np.log(high))))


def _hump(count: int, generator: np.random.Generator) -> Column:
    """Return a smooth hump between two moments, 0 at the start."""
    begin = generator.uniform(0.0, 0.6) * count
    share = np.clip((np.arange(count) - begin) / max(0.4 * count, 1.0), 0.0, 1.0)
    hump: Column = np.sin(np.pi * share) ** 2
    return hump


def _with(run: JudgedRun, kept: int | None = None, **columns: Column) -> RunSteps:
    """Return the run's steps with other columns, or only so many of them; the planning steps play no part."""
    steps = run.response.steps
    names = ("x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2", "steering_rad")
    told = {name: tuple(np.asarray(columns.get(name, getattr(steps, name)), dtype=float)[:kept]) for name in names}
    if columns and "steering_rad" not in columns:
        told["steering_rad"] = ()
    return RunSteps(first_step=steps.first_step, plan_steps=(), costs={}, **told)


def _ours(run: JudgedRun, steps: RunSteps) -> str:
    """Return the verdict of the product's closed form."""
    loaded = read_scenario(run.path)
    problem = loaded.problem(run.response.record.problem_id)
    vehicle = vehicle_of(run.configuration.settings)
    driven = DrivenStates.of(steps, vehicle, loaded.step_s)
    refused = refusal(driven, problem.goal, loaded.scenario.lanelet_network, vehicle, loaded.step_s)
    return "valid" if refused is None else refused.code


def _theirs(run: JudgedRun, steps: RunSteps) -> str:
    """Return the verdict of ``valid_solution`` on an empty road."""
    scenario, problems = run.opened
    for obstacle in list(scenario.obstacles):
        scenario.remove_obstacle(obstacle)
    changed = replace(run, response=run.response.model_copy(update={"steps": steps}))
    return official_verdict(scenario, problems, changed.solution)
