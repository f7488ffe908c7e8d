"""Runs without a feasible candidate: which constraint rejected them."""

from collections import Counter

from plannerforge.engine.analysis.evidence import Evidence
from plannerforge.schemas.results import Finding


def rejecting_constraint(evidence: Evidence) -> list[Finding]:
    """The constraint with the most rejected candidates over all infeasible runs."""
    stuck = [record for record in evidence.failures if record.outcome == "infeasible" and record.rejected_candidates]
    counts: Counter[str] = Counter()
    for record in stuck:
        counts.update(record.rejected_candidates)
    if not counts.total():
        return []
    name, count = min(counts.items(), key=lambda item: (-item[1], item[0]))
    statement = (
        f"In {len(stuck)} infeasible runs '{name}' rejected {count:,} of {counts.total():,} rejected candidates "
        f"({100 * count / counts.total():.0f} %)."
    )
    runs = tuple(record.run_id for record in stuck)
    next_step = f"analyze_results results=[{runs[0]}] detail=timeline"
    return [Finding(name="rejecting_constraint", statement=statement, run_ids=runs, next_step=next_step)]
