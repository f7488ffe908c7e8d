"""Runs out of time or too late: which cost term outweighed progress."""

from plannerforge.engine.analysis.cost_shares import config_terms, share_of
from plannerforge.engine.analysis.evidence import Evidence
from plannerforge.schemas.results import Finding, Suggestion

PROGRESS_TERM = "velocity_offset"


def held_back(evidence: Evidence) -> list[Finding]:
    """Per configuration: the largest cost term of the runs that ended by the time limit or came too late.

    Where it is the speed offset itself, the planner pays for being slow and still is: its weight is too small against
    the rest. Where it is another, that one is what holds the ego back.
    """
    found = []
    late = [record for record in evidence.failures if record.outcome in ("timeout", "goal_late")]
    slow = [record for record in late if record.run_id in evidence.steps]
    for config_id, records in evidence.by_config(slow).items():
        terms = config_terms(evidence, records)
        if not terms:
            continue
        largest = max(terms, key=lambda term: (terms[term], term))
        share = share_of(terms, [largest])
        if share is None:
            continue
        raising = largest == PROGRESS_TERM
        weight = evidence.weight(config_id, largest)
        suggestion = None
        if weight is not None:
            direction = "raise" if raising else "lower"
            why = f"it is {weight:g} now"
            suggestion = Suggestion(config_id=config_id, weight=largest, direction=direction, why=why)
        statement = (
            f"{len(records)} of the runs of {records[0].config_name} ran out of time or came too late; {largest} "
            f"was {100 * share:.0f} % of their cost."
        )
        runs = tuple(record.run_id for record in records)
        found.append(Finding(name="held_back", statement=statement, run_ids=runs, suggestion=suggestion))
    return found
