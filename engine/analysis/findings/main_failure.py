"""Which way of failing is the most frequent."""

from collections import Counter

from plannerforge.engine.analysis.evidence import Evidence
from plannerforge.schemas.results import Finding


def main_failure(evidence: Evidence) -> list[Finding]:
    """The most frequent failure mode with both denominators: the failures and the valid runs."""
    failures = evidence.failures
    if not failures:
        return []
    counts = Counter(record.outcome for record in failures)
    outcome, count = min(counts.items(), key=lambda item: (-item[1], item[0]))
    runs = tuple(record.run_id for record in failures if record.outcome == outcome)
    words = outcome.replace("_", " ")
    statement = f"{words}: {count} of {len(failures)} failures, {count} of {len(evidence.valid)} valid runs."
    next_step = f"render kind=animation ids=[{runs[0]}]"
    return [Finding(name="main_failure", statement=statement, run_ids=runs, next_step=next_step)]
