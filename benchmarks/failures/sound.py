"""Whether found failures hold: made and driven again from their recipe, judged apart, and reduced.

The failures are those of planted weaknesses in IDM. Each one's edits are applied to the base's file by ``apply_edits``,
written, read with commonroad-io, and driven again by a planner in a fresh evaluator. Plausibility is judged here from
the written file alone: no two others overlap before the failure, no added or changed road user overlaps the ego at the
start or would reach it within 2 s, and accelerations stay below 9 m/s².

Keys: ``reproduced`` (share with the same outcome, counterpart and time), ``plausible``, ``shrink_users`` and
``shrink_runs`` (medians), ``shrink_same`` (share that is still the same failure), ``sound_failures``.
"""

import sys
import tempfile
from itertools import combinations
from pathlib import Path
from statistics import median

import numpy as np
import shapely
from commonroad.common.file_reader import CommonRoadFileReader

from plannerforge.engine.edits import apply_edits
from plannerforge.engine.execution import silent
from plannerforge.engine.exploration import Evaluator
from plannerforge.engine.exploration.finding import is_same_failure
from plannerforge.schemas.exploration import Evaluation
from plannerforge.schemas.failures import EvaluatedPoint, ShrinkRequest
from plannerforge.schemas.modification import ModificationRequest

from ..harness import Figures, share
from .bench import FailuresBench
from .cases import Case
from .peers import searched

_WEAKNESSES = ("blind_to_crossing", "slow_to_notice", "blind_to_cyclists", "blind_to_pedestrians")
_RUNS = 60
_LEAST_TTC_S, _HARDEST_MPS2 = 2.0, 9.0


def measure(bench: FailuresBench) -> Figures:
    """Search each case once, and judge the first failure of each cell."""
    reproduced, plausible, users, runs, same = [], [], [], [], []
    for number, base in enumerate(bench.idm_bases):
        case = Case(base, _WEAKNESSES[number % len(_WEAKNESSES)])
        if not case.is_possible:
            sys.stderr.write(f"{case.path.stem}: fails unchanged with {case.weakness}\n")
            base.close()
            continue
        searched("ours", case.strata, bench.first_seed, case.judge, _RUNS)
        firsts: dict[str, EvaluatedPoint] = {}
        for point in case.seen:
            if point.score.cell is not None:
                firsts.setdefault(point.score.cell.key, point)
        for cell, point in firsts.items():
            reproduced.append(_reproduced(case, point))
            problem = _problem(case, point)
            plausible.append(not problem)
            stratum = next(one for one in case.space.strata if one.name == point.point.stratum)
            request = ShrinkRequest(
                setting=case.setting, stratum=stratum, point=point.point, recorded=case.space.recorded
            )
            reduced = case.shrunk(request)
            users.append(reduced.road_users)
            runs.append(reduced.runs)
            same.append(is_same_failure(point.evaluation, reduced.evaluation))
            sys.stderr.write(
                f"{case.path.stem} {cell}: {reduced.road_users_before} -> {reduced.road_users} road users, "
                f"{reduced.runs} runs, same {same[-1]}, reproduced {reproduced[-1]} {problem}\n"
            )
        base.close()
    return {
        "reproduced": share(reproduced),
        "plausible": share(plausible),
        "shrink_users": median(users) if users else "none",
        "shrink_runs": median(runs) if runs else "none",
        "shrink_same": share(same),
        "sound_failures": len(same),
    }


def _reproduced(case: Case, point: EvaluatedPoint) -> bool:
    """Return True if a fresh evaluator gives every value of the evaluation again."""
    with Evaluator(case.setting, case.drives) as fresh:
        again: Evaluation = fresh.evaluate(point.edits)
    return again == point.evaluation


def _problem(case: Case, point: EvaluatedPoint) -> str:
    """Return why the written scenario is implausible, or an empty text."""
    with tempfile.TemporaryDirectory() as folder:
        request = ModificationRequest(
            xml=case.path, edits=point.edits, benchmark_id=case.path.stem, output=Path(folder)
        )
        written = apply_edits(request, silent).xml
        scenario, problems = CommonRoadFileReader(str(written)).open()
        before, _ = CommonRoadFileReader(str(case.path)).open()
    start = next(iter(problems.planning_problem_dict.values())).initial_state
    first, step_s = int(start.time_step), float(scenario.dt)
    last = first + round((point.evaluation.time_s or 0.0) / step_s)
    known = {one.obstacle_id for one in before.dynamic_obstacles}
    for step in range(first, last + 1):
        shapes = _bodies(scenario, step)
        recorded = _bodies(before, step)
        for one, other in combinations(sorted(shapes), 2):
            if shapes[one].intersection(shapes[other]).area > 0.05:
                was = one in recorded and other in recorded and recorded[one].intersects(recorded[other])
                if not was:
                    return f"{one} and {other} overlap at step {step}"
    ego = np.asarray(start.position), float(start.orientation), float(start.velocity)
    for obstacle in scenario.dynamic_obstacles:
        if obstacle.obstacle_id in known:
            continue
        states = [obstacle.initial_state, *obstacle.prediction.trajectory.state_list]
        speeds = np.array([float(state.velocity) for state in states])
        if len(speeds) > 1 and obstacle.obstacle_type.value != "pedestrian":
            hardest = float(np.abs(np.diff(speeds)).max()) / step_s
            if hardest > _HARDEST_MPS2:
                return f"{obstacle.obstacle_id} accelerates by {hardest:.1f} m/s²"
        seconds = _reached_after(ego, states[0], float(obstacle.obstacle_shape.length))
        if seconds < _LEAST_TTC_S:
            return f"{obstacle.obstacle_id} begins {seconds:.1f} s from the ego"
    return ""


def _bodies(scenario: object, step: int) -> dict[int, shapely.Polygon]:
    found = {}
    for obstacle in scenario.obstacles:  # type: ignore[attr-defined] # commonroad-io has no types
        occupancy = obstacle.occupancy_at_time(step)
        if occupancy is not None and hasattr(occupancy.shape, "vertices"):
            found[int(obstacle.obstacle_id)] = shapely.Polygon(occupancy.shape.vertices)
    return found


def _reached_after(ego: tuple[np.ndarray, float, float], state: object, length_m: float) -> float:
    """Return the time in which an ego that keeps lane and speed reaches a road user's first place, or infinity."""
    position, heading, speed = ego
    away = np.asarray(state.position) - position  # type: ignore[attr-defined]
    ahead = float(away[0] * np.cos(heading) + away[1] * np.sin(heading)) - 2.3 - length_m / 2
    aside = abs(float(away[1] * np.cos(heading) - away[0] * np.sin(heading)))
    turned = float(state.orientation) - heading  # type: ignore[attr-defined]
    closing = speed - float(state.velocity) * float(np.cos(turned))  # type: ignore[attr-defined]
    return ahead / closing if aside < 1.5 and ahead > 0.0 and closing > 0.0 else float("inf")
