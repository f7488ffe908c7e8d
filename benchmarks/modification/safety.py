"""The paper's safety table: how a fixed recipe of each kind of edit changes an ego's risk.

Recipes. B: the three nearest vehicles become aggressive. T: the nearest vehicle with another branch within reach takes
it. P: a car is added 15 m ahead of the ego in its lane at half its speed. G: the goal moves to the nearest other
reachable lanelet. The risk score (0 collision … 5 negligible) is that of an ordinarily driving ego, or of the planner
if one ran. Vehicles that hit the ordinary ego from behind on their recording are left out, because they cannot react;
the table still states in how many scenarios an ego collides before any edit.
"""

import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plannerforge.engine.commonroad import derived_benchmark_id
from plannerforge.engine.cosimulation import not_drivable
from plannerforge.engine.edits import apply_edits
from plannerforge.engine.edits.references import reachable_lanelets
from plannerforge.engine.execution import silent
from plannerforge.engine.planners import run_planner
from plannerforge.engine.scene import Scene
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.modification import Edit, ModificationRequest
from plannerforge.schemas.planning import RunRequest
from plannerforge.schemas.runs import NO_TRAJECTORY, RunRecord

PLANNER = "frenetix:Default"
NEAREST, AHEAD_M = 3, 15.0
"""Values of the recipes B and P (see above)."""
RESAMPLES = 2000
"""Draws of the bootstrap (chosen)."""
MOST_TRIES = 6
"""Number of nearest vehicles and lanelets that a recipe tries (chosen)."""
DIGEST = "b"
"""Replaces the digest of the request in the id of an edited scenario."""
NEGLIGIBLE = 5


@dataclass(frozen=True)
class Shift:
    """Risk scores of one scenario before and after the recipe of a task, of an ordinary ego and of a planner."""

    task: str
    before: int
    after: int
    planner_before: int | None = None
    planner_after: int | None = None


def new_id(path: Path) -> str:
    """Return the id of an edited scenario with its source's country, which a planner needs to read traffic signs."""
    return derived_benchmark_id(path.stem, DIGEST)


def shifts_of(path: Path, scene: Scene, folder: Path, base: RunRecord | None) -> tuple[Shift, ...]:
    """Return one shift for each recipe that the scenario allows, with a base run also of the planner."""
    recipes: tuple[tuple[str, Callable[[Scene], Iterator[Edit]]], ...] = (
        ("B", _aggressive),
        ("T", _other_branch),
        ("P", _slow_car_ahead),
        ("G", _other_goal),
    )
    found = [_shift(path, folder, task, recipe(scene), base) for task, recipe in recipes]
    return tuple(one for one in found if one is not None)


def executed(path: Path, base: RunRecord) -> bool | None:
    """Return whether the planner drives an edited file to an end; None if it does not drive its source either."""
    return None if base.outcome in NO_TRAJECTORY else planner_run(path).outcome not in NO_TRAJECTORY


def safety_rows(shifts: Sequence[Shift]) -> list[tuple[str, str]]:
    """Return the table: mean score before → after with the interval of the mean difference, and collisions."""
    rows = []
    for task in ("B", "T", "P", "G"):
        mine = [one for one in shifts if one.task == task]
        ordinary = [(one.before, one.after) for one in mine]
        planner = [(one.planner_before, one.planner_after) for one in mine]
        rows += [(f"risk {task}, ordinary ego", _row(ordinary)), (f"risk {task}, {PLANNER}", _row(planner))]
    return rows


def difference_interval(differences: Sequence[float], seed: int = 0) -> tuple[float, float]:
    """Return the 95 % interval of a mean by the percentile bootstrap (Efron 1979)."""
    drawn = np.random.default_rng(seed).choice(differences, size=(RESAMPLES, len(differences)))
    low, high = np.quantile(drawn.mean(axis=1), [0.025, 0.975])
    return float(low), float(high)


def _row(pairs: Sequence[tuple[int | None, int | None]]) -> str:
    scored = [(before, after) for before, after in pairs if before is not None and after is not None]
    if not scored:
        return "not measured"
    low, high = difference_interval([after - before for before, after in scored])
    before, after = (statistics.fmean(values) for values in zip(*scored, strict=True))
    hits, known = sum(after == 0 < before for before, after in scored), sum(before == 0 for before, _ in scored)
    more = sum(after < before for before, after in scored)
    less = sum(after > before for before, after in scored)
    return (
        f"{before:.2f} → {after:.2f} (difference {low:+.2f} … {high:+.2f}), {hits} new collisions, "
        f"{more} more and {less} less critical of {len(scored)} ({known} collide before)"
    )


def _shift(path: Path, folder: Path, task: str, edits: Iterator[Edit], base: RunRecord | None) -> Shift | None:
    for edit in edits:
        request = ModificationRequest(xml=path, edits=(edit,), benchmark_id=new_id(path), output=folder)
        try:
            outcome = apply_edits(request, silent)
        except PlannerForgeError:
            continue
        before, after = outcome.ego_before, outcome.ego_after
        if outcome.xml is None or before is None or after is None:
            return None
        then = None if base is None else planner_run(outcome.xml)
        return Shift(task, _score(before.risk_score), _score(after.risk_score), _risk(base), _risk(then))
    return None


def planner_run(path: Path) -> RunRecord:
    """Return a run of the default planner among recorded traffic."""
    request = RunRequest(
        run_id="bench",
        scenario_path=str(path),
        scenario_id=path.stem,
        configuration=built_in(PLANNER),
        prediction="constant_velocity",
    )
    return run_planner(request, silent).record


def _risk(record: RunRecord | None) -> int | None:
    return None if record is None or record.metrics is None else _score(record.metrics.risk_score)


def _score(value: int | None) -> int:
    """Return a risk score; without a road user nearby, the risk is negligible."""
    return NEGLIGIBLE if value is None else value


def _aggressive(scene: Scene) -> Iterator[Edit]:
    for count in range(min(NEAREST, len(scene.tracks)), 0, -1):
        yield Edit(op="set_behaviour", vehicles=[f"nearest:{count}"], preset="aggressive")


def _other_branch(scene: Scene) -> Iterator[Edit]:
    if scene.ego is None:
        return
    here = scene.ego.position
    away = {
        key: float(((track.positions[0] - here) ** 2).sum())
        for key, track in scene.tracks.items()
        if not not_drivable(scene, key) and track.first_step == scene.ego.step
    }
    for key in sorted(away, key=lambda key: (away[key], key))[:MOST_TRIES]:
        way = scene.matches[key].sequence
        near = [lanelet for lanelet in reachable_lanelets(scene, way[:1])[:MOST_TRIES] if lanelet not in way]
        yield from (Edit(op="reroute", vehicles=[str(key)], to=[str(lanelet)]) for lanelet in near[:1])


def _slow_car_ahead(scene: Scene) -> Iterator[Edit]:
    if scene.ego is not None:
        half = f"{scene.ego.speed_mps / 2:.2f}m/s"
        yield Edit(op="add_vehicle", vehicle_class="car", at="ego", offset_m=AHEAD_M, speed=half)


def _other_goal(scene: Scene) -> Iterator[Edit]:
    if scene.ego is not None and scene.ego.lanelets:
        for key in reachable_lanelets(scene, scene.ego.lanelets[:1])[1:MOST_TRIES]:
            yield Edit(op="set_goal", to=[str(key)])
