"""Weights that are set but never cost anything."""

from plannerforge.engine.analysis.cost_shares import config_terms
from plannerforge.engine.analysis.evidence import Evidence
from plannerforge.schemas.results import Finding


def idle_weights(evidence: Evidence) -> list[Finding]:
    """Per configuration: positive weights whose term was 0 in every chosen candidate of every run."""
    found = []
    for config_id, records in evidence.by_config(evidence.valid).items():
        weights = next((config.weights for config in evidence.configs if config.config_id == config_id), {})
        terms = config_terms(evidence, records)
        idle = [name for name, weight in sorted(weights.items()) if weight > 0 and terms.get(name, 0.0) == 0]
        if not terms or not idle:
            continue
        runs = tuple(record.run_id for record in records if record.run_id in evidence.steps)
        statement = (
            f"{', '.join(idle)} of {records[0].config_name} cost nothing in any of {len(runs)} runs: changing "
            f"{'it' if len(idle) == 1 else 'them'} upward may do nothing on such scenarios."
        )
        found.append(Finding(name="idle_weights", statement=statement, run_ids=runs))
    return found
