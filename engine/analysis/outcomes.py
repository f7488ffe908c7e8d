"""Outcome rates, in total and by group; invalid items stand apart and are in no denominator."""

from collections import Counter
from collections.abc import Callable

from plannerforge.engine.analysis.evidence import Evidence, country_of
from plannerforge.engine.analysis.intervals import rate
from plannerforge.schemas.results import Breakdown, Group, InvalidItem, OutcomeShare, Rate
from plannerforge.schemas.runs import RunRecord

SHOWN_RUNS = 5
_BINS = ((0, 0), (1, 4), (5, 9), (10, 19), (20, 49), (50, 10**6))


def success_rate(evidence: Evidence) -> Rate:
    """Runs that reached the goal among the valid ones."""
    return rate(len(evidence.successes), len(evidence.valid))


def outcome_shares(evidence: Evidence) -> tuple[OutcomeShare, ...]:
    """Every outcome that occurred among the valid runs, the most frequent first."""
    counts = Counter(record.outcome for record in evidence.valid)
    return tuple(
        OutcomeShare(
            outcome=outcome,
            rate=rate(count, len(evidence.valid)),
            run_ids=tuple(record.run_id for record in evidence.valid if record.outcome == outcome)[:SHOWN_RUNS],
        )
        for outcome, count in sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    )


def invalid_items(evidence: Evidence) -> tuple[InvalidItem, ...]:
    """Runs that could not be attempted, with the reason."""
    return tuple(
        InvalidItem(run_id=record.run_id, scenario_id=record.scenario_id, reason=record.reason)
        for record in evidence.runs
        if record.outcome == "invalid"
    )


def groups(evidence: Evidence, breakdown: Breakdown) -> tuple[Group, ...]:
    """Outcome rates by group; a scenario with several obstacle classes is in the group of each."""
    if breakdown == "none":
        return ()
    members: dict[str, list[RunRecord]] = {}
    for record in evidence.runs:
        for name in _GROUPERS[breakdown](evidence, record):
            members.setdefault(name, []).append(record)
    order = [name for name in _BIN_NAMES if name in members] if breakdown == "obstacle_count" else sorted(members)
    order += [name for name in sorted(members) if name not in order]
    return tuple(_group(name, members[name]) for name in order)


def _group(name: str, records: list[RunRecord]) -> Group:
    valid = [record for record in records if record.outcome != "invalid"]
    counts = Counter(record.outcome for record in valid)
    return Group(
        name=name,
        success=rate(counts["goal_reached"], len(valid)),
        outcomes=dict(sorted(counts.items(), key=lambda item: (-item[1], item[0]))),
        invalid=len(records) - len(valid),
    )


def _bin_name(count: int) -> str:
    low, high = next((low, high) for low, high in _BINS if low <= count <= high)
    return f"{low} obstacles" if low == high else f"{low}+ obstacles" if high == 10**6 else f"{low}–{high} obstacles"


_BIN_NAMES = tuple(_bin_name(low) for low, _ in _BINS)


def _by_count(evidence: Evidence, record: RunRecord) -> list[str]:
    found = evidence.obstacles.get(record.scenario_id)
    return ["unknown"] if found is None else [_bin_name(sum(found.values()))]


def _by_class(evidence: Evidence, record: RunRecord) -> list[str]:
    found = evidence.obstacles.get(record.scenario_id)
    return ["unknown"] if found is None else [f"with {kind}" for kind in found] or ["no obstacles"]


_GROUPERS: dict[str, Callable[[Evidence, RunRecord], list[str]]] = {
    "planner": lambda _, record: [record.planner],
    "config": lambda _, record: [f"{record.config_name} ({record.config_id})"],
    "prediction": lambda _, record: [record.prediction],
    "country": lambda _, record: [country_of(record.scenario_id)],
    "scenario": lambda _, record: [record.scenario_id],
    "obstacle_count": _by_count,
    "obstacle_class": _by_class,
}
