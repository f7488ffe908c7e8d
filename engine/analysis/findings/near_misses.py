"""Successes that were close."""

from plannerforge.engine.analysis.evidence import Evidence
from plannerforge.schemas.results import Finding, Suggestion
from plannerforge.schemas.runs import RunRecord

CRITICAL_GAP_M = 0.5
CRITICAL_TIME_TO_COLLISION_S = 1.5
"""Encounters below it are critical (van der Horst and Hogema 1993, "Time-to-collision and collision avoidance")."""


def near_misses(evidence: Evidence) -> list[Finding]:
    """Per configuration: runs that reached the goal with a gap under 0.5 m or a time to collision under 1.5 s."""
    found = []
    for config_id, records in evidence.by_config(evidence.successes).items():
        close = [record for record in records if _is_close(record)]
        if not close:
            continue
        statement = (
            f"{len(close)} of {len(records)} successes of {records[0].config_name} came closer than "
            f"{CRITICAL_GAP_M} m or {CRITICAL_TIME_TO_COLLISION_S} s to a collision."
        )
        weight = evidence.weight(config_id, "distance_to_obstacles")
        suggestion = None
        if weight is not None:
            why = f"it is {weight:g} now"
            suggestion = Suggestion(config_id=config_id, weight="distance_to_obstacles", direction="raise", why=why)
        runs = tuple(record.run_id for record in close)
        found.append(Finding(name="near_misses", statement=statement, run_ids=runs, suggestion=suggestion))
    return found


def _is_close(record: RunRecord) -> bool:
    if record.metrics is None:
        return False
    gap, time = record.metrics.minimum_distance_m, record.metrics.minimum_time_to_collision_s
    return (gap is not None and gap < CRITICAL_GAP_M) or (time is not None and time < CRITICAL_TIME_TO_COLLISION_S)
