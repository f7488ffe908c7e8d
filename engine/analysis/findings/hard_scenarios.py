"""Scenarios that no configuration masters."""

from plannerforge.engine.analysis.evidence import Evidence
from plannerforge.schemas.results import Finding
from plannerforge.schemas.runs import RunRecord


def hard_scenarios(evidence: Evidence) -> list[Finding]:
    """Scenarios that failed under all of two or more configurations: weights are not what is missing."""
    by_scenario: dict[str, list[RunRecord]] = {}
    for record in evidence.valid:
        by_scenario.setdefault(record.scenario_id, []).append(record)
    tried = {key: records for key, records in by_scenario.items() if len({r.config_id for r in records}) > 1}
    hard = {key: records for key, records in tried.items() if all(r.outcome != "goal_reached" for r in records)}
    if not hard:
        return []
    names = sorted(hard)
    shown = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
    statement = f"{len(hard)} of {len(tried)} scenarios failed under every configuration tried: {shown}."
    runs = tuple(record.run_id for key in names for record in hard[key])
    next_step = f"describe_scenario scenario_id={names[0]} detail=checks"
    return [Finding(name="hard_scenarios", statement=statement, run_ids=runs, next_step=next_step)]
