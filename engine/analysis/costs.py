"""What the chosen candidates' cost is made of."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from ...schemas.results import Correlation, CostShare
from ...schemas.runs import RunRecord, RunSteps
from .evidence import Evidence
from .statistics import holm, mean_ranks

# ---------- correlations
# Which features go with success: Spearman's rank correlation, only where there are enough runs.

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


# ---------- cost_shares
# What the chosen candidates' cost is made of.


def mean_terms(steps: RunSteps, since_step: int | None = None) -> dict[str, float]:
    """Mean weighted cost of each term over the planning steps (from ``since_step`` on); empty without any."""
    chosen = [i for i, step in enumerate(steps.plan_steps) if since_step is None or step >= since_step]
    return {
        term: float(np.mean([values[i] for i in chosen if i < len(values)]))
        for term, values in sorted(steps.costs.items())
        if any(i < len(values) for i in chosen)
    }


def config_terms(evidence: Evidence, records: Sequence[RunRecord]) -> dict[str, float]:
    """Mean over the runs of each term's mean; every run counts the same, however long it is."""
    means = [mean_terms(evidence.steps[record.run_id]) for record in records if record.run_id in evidence.steps]
    terms = sorted({term for mean in means for term in mean})
    return {term: float(np.mean([mean.get(term, 0.0) for mean in means])) for term in terms}


def share_of(terms: dict[str, float], wanted: Sequence[str]) -> float | None:
    """Share of some terms in the total; None where the total is 0."""
    total = sum(terms.values())
    return sum(terms.get(term, 0.0) for term in wanted) / total if total > 0 else None


def cost_shares(evidence: Evidence) -> tuple[CostShare, ...]:
    """Terms by configuration, the largest first; terms that are always 0 are left out."""
    found: list[CostShare] = []
    for config_id, records in evidence.by_config(evidence.valid).items():
        terms = config_terms(evidence, records)
        runs = sum(record.run_id in evidence.steps for record in records)
        found += [
            CostShare(
                config_id=config_id,
                config_name=records[0].config_name,
                term=term,
                mean_weighted=mean,
                share=share_of(terms, [term]),
                runs=runs,
            )
            for term, mean in sorted(terms.items(), key=lambda item: (-item[1], item[0]))
            if mean != 0
        ]
    return tuple(found)
