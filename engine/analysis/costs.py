"""What the chosen candidates' cost is made of: weighted cost by term, of one run or of all runs of a configuration."""

from collections.abc import Sequence

import numpy as np

from ...schemas.results import CostShare
from ...schemas.runs import RunRecord, RunSteps
from .run_set import RunSet


def cost_shares(runs: RunSet) -> tuple[CostShare, ...]:
    """Terms by configuration, the largest first; terms that are always 0 are left out."""
    shares: list[CostShare] = []
    for config_id, records in runs.by_config(runs.valid).items():
        terms = config_terms(runs, records)
        shares += [
            CostShare(
                config_id=config_id,
                config_name=records[0].config_name,
                term=term,
                mean_weighted=mean,
                share=share_of(terms, [term]),
                runs=sum(record.run_id in runs.steps for record in records),
            )
            for term, mean in sorted(terms.items(), key=lambda item: (-item[1], item[0]))
            if mean != 0
        ]
    return tuple(shares)


def config_terms(runs: RunSet, records: Sequence[RunRecord]) -> dict[str, float]:
    """Mean over the runs of each term's mean; every run counts the same, however long it is."""
    means = [mean_terms(runs.steps[record.run_id]) for record in records if record.run_id in runs.steps]
    terms = sorted({term for mean in means for term in mean})
    return {term: float(np.mean([mean.get(term, 0.0) for mean in means])) for term in terms}


def mean_terms(steps: RunSteps, since_step: int | None = None) -> dict[str, float]:
    """Mean weighted cost of each term over the planning steps (from ``since_step`` on); empty without any."""
    chosen = [i for i, step in enumerate(steps.plan_steps) if since_step is None or step >= since_step]
    return {
        term: float(np.mean([values[i] for i in chosen if i < len(values)]))
        for term, values in sorted(steps.costs.items())
        if any(i < len(values) for i in chosen)
    }


def share_of(terms: dict[str, float], wanted: Sequence[str]) -> float | None:
    """Share of some terms in the total; None where the total is 0."""
    total = sum(terms.values())
    return sum(terms.get(term, 0.0) for term in wanted) / total if total > 0 else None
