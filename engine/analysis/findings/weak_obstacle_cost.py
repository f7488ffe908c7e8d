"""Collisions in which the cost of being near others hardly counted."""

from statistics import median

from plannerforge.engine.analysis.cost_shares import mean_terms, share_of
from plannerforge.engine.analysis.evidence import Evidence
from plannerforge.schemas.results import Finding, Suggestion
from plannerforge.schemas.runs import RunRecord

OBSTACLE_TERMS = ("prediction", "distance_to_obstacles", "responsibility")
LAST_S = 1.0
WEAK_SHARE = 0.10


def weak_obstacle_cost(evidence: Evidence) -> list[Finding]:
    """Per configuration: collisions with under 10 % of the cost on obstacles during the last second before them.

    The chosen candidate passed the collision check against what was predicted; a small share says that nothing but
    that check kept the ego away from others.
    """
    found = []
    hits = [record for record in evidence.failures if record.collision and record.collision.obstacle_id is not None]
    for config_id, records in evidence.by_config(hits).items():
        shares = {record.run_id: share for record in records if (share := _share(evidence, record)) is not None}
        weak = tuple(run_id for run_id, share in shares.items() if share < WEAK_SHARE)
        if not weak or len(weak) * 2 < len(shares):
            continue
        middle = 100 * median(shares[run_id] for run_id in weak)
        statement = (
            f"In {len(weak)} of {len(shares)} collisions of {records[0].config_name}, obstacles made up under "
            f"{100 * WEAK_SHARE:.0f} % of the chosen cost in the last second (median {middle:.1f} %)."
        )
        suggestion = _suggestion(evidence, config_id)
        found.append(Finding(name="weak_obstacle_cost", statement=statement, run_ids=weak, suggestion=suggestion))
    return found


def _share(evidence: Evidence, record: RunRecord) -> float | None:
    steps = evidence.steps.get(record.run_id)
    if steps is None or record.collision is None:
        return None
    terms = mean_terms(steps, since_step=record.collision.step - round(LAST_S / record.step_s))
    return share_of(terms, OBSTACLE_TERMS)


def _suggestion(evidence: Evidence, config_id: str) -> Suggestion | None:
    known = [(weight, name) for name in OBSTACLE_TERMS if (weight := evidence.weight(config_id, name)) is not None]
    if not known:
        return None
    name = next(name for _, name in known)
    why = f"it is {evidence.weight(config_id, name):g} now"
    return Suggestion(config_id=config_id, weight=name, direction="raise", why=why)
