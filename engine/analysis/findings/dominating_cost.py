"""One cost term decides nearly everything."""

from plannerforge.engine.analysis.cost_shares import config_terms, share_of
from plannerforge.engine.analysis.evidence import Evidence
from plannerforge.schemas.results import Finding

DOMINATING_SHARE = 0.8


def dominating_cost(evidence: Evidence) -> list[Finding]:
    """Per configuration: a term with over 80 % of the chosen candidates' cost; other weights hardly matter then."""
    found = []
    for records in evidence.by_config(evidence.valid).values():
        terms = config_terms(evidence, records)
        for term in terms:
            share = share_of(terms, [term])
            if share is not None and share > DOMINATING_SHARE:
                statement = (
                    f"{term} is {100 * share:.0f} % of the cost under {records[0].config_name}: the other weights "
                    "hardly decide anything here."
                )
                runs = tuple(record.run_id for record in records if record.run_id in evidence.steps)
                found.append(Finding(name="dominating_cost", statement=statement, run_ids=runs))
    return found
