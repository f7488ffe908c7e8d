"""Runs that reached the goal with more lateral acceleration than passengers like."""

from plannerforge.engine.analysis.evidence import Evidence
from plannerforge.schemas.results import Finding, Suggestion

COMFORTABLE_MPS2 = 3.0
"""Largest lateral acceleration that a lane keeping system may cause (ISO 11270:2014)."""


def uncomfortable_turns(evidence: Evidence) -> list[Finding]:
    """Per configuration: successes above 3 m/s² of lateral acceleration."""
    found = []
    for config_id, records in evidence.by_config(evidence.successes).items():
        values = {r.run_id: r.metrics.maximum_lateral_acceleration_mps2 for r in records if r.metrics is not None}
        harsh = tuple(run_id for run_id, value in values.items() if value > COMFORTABLE_MPS2)
        if not harsh:
            continue
        statement = (
            f"{len(harsh)} of {len(values)} successes of {records[0].config_name} exceeded {COMFORTABLE_MPS2:g} m/s² "
            f"of lateral acceleration (largest {max(values.values()):.1f})."
        )
        weight = evidence.weight(config_id, "lateral_jerk")
        suggestion = None
        if weight is not None:
            why = f"it is {weight:g} now"
            suggestion = Suggestion(config_id=config_id, weight="lateral_jerk", direction="raise", why=why)
        found.append(Finding(name="uncomfortable_turns", statement=statement, run_ids=harsh, suggestion=suggestion))
    return found
