"""Which features go with success: Spearman's rank correlation, only where there are enough runs."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from plannerforge.engine.analysis.evidence import Evidence
from plannerforge.engine.analysis.paired_tests import holm, mean_ranks
from plannerforge.schemas.results import Correlation
from plannerforge.schemas.runs import RunRecord

FEWEST_RUNS = 12
"""Below this a rank correlation must exceed 0.58 to differ from 0 at 5 %: too coarse to report."""


def correlations(evidence: Evidence) -> tuple[tuple[Correlation, ...], str]:
    """Correlations of scenario features with success, the strongest first, and a note where there are none.

    Features are known before a run (traffic, speed at the start), never results of it.
    """
    valid = evidence.valid
    if len(valid) < FEWEST_RUNS:
        return (), f"no correlations: {len(valid)} valid runs, at least {FEWEST_RUNS} are needed"
    if not evidence.failures or not evidence.successes:
        return (), "no correlations: all valid runs ended alike"
    found = []
    for name, feature in _FEATURES.items():
        pairs = [
            (value, float(r.outcome == "goal_reached")) for r in valid if (value := feature(evidence, r)) is not None
        ]
        tested = _spearman(pairs)
        if tested is not None:
            found.append((name, len(pairs), *tested))
    adjusted = holm([p for *_, p in found])
    listed = [
        Correlation(feature=name, n=n, rho=rho, p=p, p_holm=p_holm)
        for (name, n, rho, p), p_holm in zip(found, adjusted, strict=True)
    ]
    return tuple(sorted(listed, key=lambda item: (-abs(item.rho), item.feature))), ""


def _spearman(pairs: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """ρ and its two-sided p by the t distribution with n − 2 degrees of freedom; None where a side is constant."""
    from scipy import stats

    if len(pairs) < FEWEST_RUNS:
        return None
    first, second = (mean_ranks(np.array(side)) for side in zip(*pairs, strict=True))
    if np.ptp(first) == 0 or np.ptp(second) == 0:
        return None
    rho = float(np.clip(np.corrcoef(first, second)[0, 1], -1, 1))
    freedom = len(pairs) - 2
    t = rho * math.sqrt(freedom / max(1 - rho * rho, 1e-12))
    return rho, float(2 * stats.t.sf(abs(t), freedom))


def _obstacles(evidence: Evidence, record: RunRecord) -> float | None:
    found = evidence.obstacles.get(record.scenario_id)
    return None if found is None else float(sum(found.values()))


def _large_vehicles(evidence: Evidence, record: RunRecord) -> float | None:
    found = evidence.obstacles.get(record.scenario_id)
    return None if found is None else float(found.get("truck", 0) + found.get("bus", 0))


def _initial_speed(evidence: Evidence, record: RunRecord) -> float | None:
    steps = evidence.steps.get(record.run_id)
    return steps.speed_mps[0] if steps is not None and steps.speed_mps else None


_FEATURES: dict[str, Callable[[Evidence, RunRecord], float | None]] = {
    "obstacles": _obstacles,
    "trucks_and_buses": _large_vehicles,
    "initial_speed_mps": _initial_speed,
}
