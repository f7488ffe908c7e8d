"""Whether found failures hold: made and driven again from their recipe, judged apart, and reduced.

The failures are those of planted weaknesses in IDM. Each one's edits are applied to the base's file by ``apply_edits``,
written, read with commonroad-io, and driven again by a planner in a fresh evaluator. ``plausibility`` judges the
written file alone.

Keys: ``reproduced`` (share with the same outcome, counterpart and time), ``plausible``, ``shrink_users`` and
``shrink_runs`` (medians), ``shrink_same`` (share that is still the same failure), ``sound_failures``.
"""

import sys
import tempfile
from pathlib import Path
from statistics import median

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
from .plausibility import problem_of

_WEAKNESSES = ("blind_to_crossing", "slow_to_notice", "blind_to_cyclists", "blind_to_pedestrians")
_RUNS = 60


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
        return (
            "nothing was written" if written is None else problem_of(case.path, written, point.evaluation.time_s or 0)
        )
