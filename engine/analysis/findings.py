"""Findings: statements on what runs have in common, with the runs behind them.

A finding is a generator ``(runs) -> findings`` that has its name. To add one, write the function, put it into
``FINDINGS`` where its statement shall stand among the others, and test it.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from statistics import median

from ...schemas.results import Finding, Suggestion
from ...schemas.runs import RunRecord
from .run_set import RunSet, config_terms, mean_terms, share_of


def find_all(runs: RunSet) -> tuple[Finding, ...]:
    """What every finding states of these runs, in the order of the registry."""
    return tuple(finding for find in FINDINGS for finding in find(runs))


def _main_failure(runs: RunSet) -> Iterator[Finding]:
    """The most frequent failure mode with both denominators: the failures and the valid runs."""
    failures = runs.failures
    if not failures:
        return
    counts = Counter(record.outcome for record in failures)
    outcome, count = min(counts.items(), key=lambda item: (-item[1], item[0]))
    run_ids = tuple(record.run_id for record in failures if record.outcome == outcome)
    words = outcome.replace("_", " ")
    statement = f"{words}: {count} of {len(failures)} failures, {count} of {len(runs.valid)} valid runs."
    next_step = f"render kind=animation ids=[{run_ids[0]}]"
    yield Finding(name="main_failure", statement=statement, run_ids=run_ids, next_step=next_step)


_OBSTACLE_TERMS = ("prediction", "distance_to_obstacles", "responsibility")
"""Cost terms that keep the ego away from others, the one that is suggested first at the front."""
_LAST_S = 1.0
"""Span before a collision over which cost is looked at (chosen): in it the ego could still have braked or steered."""
_WEAK_SHARE = 0.10
"""Share of the cost below which the obstacle terms hardly counted (chosen)."""


def _weak_obstacle_cost(runs: RunSet) -> Iterator[Finding]:
    """Per configuration: collisions with under 10 % of the cost on obstacles during the last second before them.

    The chosen candidate passed the collision check against what was predicted; a small share says that nothing but
    that check kept the ego away from others. Stated only where it holds for at least half of the collisions.
    """
    hits = [record for record in runs.failures if record.collision and record.collision.obstacle_id is not None]
    for config_id, records in runs.by_config(hits).items():
        shares = {record.run_id: share for record in records if (share := _obstacle_share(runs, record)) is not None}
        weak = tuple(run_id for run_id, share in shares.items() if share < _WEAK_SHARE)
        if not weak or len(weak) * 2 < len(shares):
            continue
        middle = 100 * median(shares[run_id] for run_id in weak)
        statement = (
            f"In {len(weak)} of {len(shares)} collisions of {records[0].config_name}, obstacles made up under "
            f"{100 * _WEAK_SHARE:.0f} % of the chosen cost in the last second (median {middle:.1f} %)."
        )
        known = [name for name in _OBSTACLE_TERMS if name in runs.weights(config_id)]
        suggestion = _suggestion(runs, config_id, known[0]) if known else None
        yield Finding(name="weak_obstacle_cost", statement=statement, run_ids=weak, suggestion=suggestion)


def _obstacle_share(runs: RunSet, record: RunRecord) -> float | None:
    """The obstacle terms' share of the cost in the last second before a collision."""
    steps = runs.steps.get(record.run_id)
    if steps is None or record.collision is None:
        return None
    terms = mean_terms(steps, since_step=record.collision.step - round(_LAST_S / record.step_s))
    return share_of(terms, _OBSTACLE_TERMS)


_PROGRESS_TERM = "velocity_offset"
"""The cost term of driving slower than wanted."""


def _held_back(runs: RunSet) -> Iterator[Finding]:
    """Per configuration: the largest cost term of the runs that ended by the time limit or came too late.

    Where it is the speed offset itself, the planner pays for being slow and still is: its weight is too small against
    the rest. Where it is another, that one is what holds the ego back.
    """
    late = [record for record in runs.failures if record.outcome in ("timeout", "goal_late")]
    slow = [record for record in late if record.run_id in runs.steps]
    for config_id, records in runs.by_config(slow).items():
        terms = config_terms(runs, records)
        if not terms:
            continue
        largest = max(terms, key=lambda term: (terms[term], term))
        share = share_of(terms, [largest])
        if share is None:
            continue
        statement = (
            f"{len(records)} of the runs of {records[0].config_name} ran out of time or came too late; {largest} "
            f"was {100 * share:.0f} % of their cost."
        )
        run_ids = tuple(record.run_id for record in records)
        suggestion = _suggestion(runs, config_id, largest, lower=largest != _PROGRESS_TERM)
        yield Finding(name="held_back", statement=statement, run_ids=run_ids, suggestion=suggestion)


def _rejecting_constraint(runs: RunSet) -> Iterator[Finding]:
    """The constraint with the most rejected candidates over all infeasible runs."""
    stuck = [record for record in runs.failures if record.outcome == "infeasible" and record.rejected_candidates]
    counts: Counter[str] = Counter()
    for record in stuck:
        counts.update(record.rejected_candidates)
    if not counts.total():
        return
    name, count = min(counts.items(), key=lambda item: (-item[1], item[0]))
    statement = (
        f"In {len(stuck)} infeasible runs '{name}' rejected {count:,} of {counts.total():,} rejected candidates "
        f"({100 * count / counts.total():.0f} %)."
    )
    run_ids = tuple(record.run_id for record in stuck)
    next_step = f"analyze_results results=[{run_ids[0]}] detail=timeline"
    yield Finding(name="rejecting_constraint", statement=statement, run_ids=run_ids, next_step=next_step)


_CRITICAL_GAP_M = 0.5
"""Gap between rectangles below which a run was close (chosen)."""
CRITICAL_TIME_TO_COLLISION_S = 1.5
"""Encounters below it are critical (van der Horst and Hogema 1993, "Time-to-collision and collision avoidance")."""


def _near_misses(runs: RunSet) -> Iterator[Finding]:
    """Per configuration: runs that reached the goal with a gap under 0.5 m or a time to collision under 1.5 s."""
    for config_id, records in runs.by_config(runs.successes).items():
        close = tuple(record.run_id for record in records if _is_close(record))
        if not close:
            continue
        statement = (
            f"{len(close)} of {len(records)} successes of {records[0].config_name} came closer than "
            f"{_CRITICAL_GAP_M} m or {CRITICAL_TIME_TO_COLLISION_S} s to a collision."
        )
        suggestion = _suggestion(runs, config_id, "distance_to_obstacles")
        yield Finding(name="near_misses", statement=statement, run_ids=close, suggestion=suggestion)


def _is_close(record: RunRecord) -> bool:
    if record.metrics is None:
        return False
    gap, time = record.metrics.minimum_distance_m, record.metrics.minimum_time_to_collision_s
    return (gap is not None and gap < _CRITICAL_GAP_M) or (time is not None and time < CRITICAL_TIME_TO_COLLISION_S)


_COMFORTABLE_MPS2 = 3.0
"""Largest lateral acceleration that a lane keeping system may cause (ISO 11270:2014)."""


def _uncomfortable_turns(runs: RunSet) -> Iterator[Finding]:
    """Per configuration: successes above 3 m/s² of lateral acceleration."""
    for config_id, records in runs.by_config(runs.successes).items():
        values = {r.run_id: r.metrics.maximum_lateral_acceleration_mps2 for r in records if r.metrics is not None}
        harsh = tuple(run_id for run_id, value in values.items() if value > _COMFORTABLE_MPS2)
        if not harsh:
            continue
        statement = (
            f"{len(harsh)} of {len(values)} successes of {records[0].config_name} exceeded {_COMFORTABLE_MPS2:g} m/s² "
            f"of lateral acceleration (largest {max(values.values()):.1f})."
        )
        suggestion = _suggestion(runs, config_id, "lateral_jerk")
        yield Finding(name="uncomfortable_turns", statement=statement, run_ids=harsh, suggestion=suggestion)


_DOMINATING_SHARE = 0.8
"""Share of the cost above which one term decides nearly everything (chosen)."""


def _dominating_cost(runs: RunSet) -> Iterator[Finding]:
    """Per configuration: a term with over 80 % of the chosen candidates' cost; other weights hardly matter then."""
    for records in runs.by_config(runs.valid).values():
        terms = config_terms(runs, records)
        run_ids = tuple(record.run_id for record in records if record.run_id in runs.steps)
        for term in terms:
            share = share_of(terms, [term])
            if share is not None and share > _DOMINATING_SHARE:
                statement = (
                    f"{term} is {100 * share:.0f} % of the cost under {records[0].config_name}: the other weights "
                    "hardly decide anything here."
                )
                yield Finding(name="dominating_cost", statement=statement, run_ids=run_ids)


def _idle_weights(runs: RunSet) -> Iterator[Finding]:
    """Per configuration: positive weights whose term was 0 in every chosen candidate of every run."""
    for config_id, records in runs.by_config(runs.valid).items():
        terms = config_terms(runs, records)
        weights = sorted(runs.weights(config_id).items())
        idle = [name for name, weight in weights if weight > 0 and terms.get(name, 0.0) == 0]
        if not terms or not idle:
            continue
        run_ids = tuple(record.run_id for record in records if record.run_id in runs.steps)
        statement = (
            f"{', '.join(idle)} of {records[0].config_name} cost nothing in any of {len(run_ids)} runs: changing "
            f"{'it' if len(idle) == 1 else 'them'} upward may do nothing on such scenarios."
        )
        yield Finding(name="idle_weights", statement=statement, run_ids=run_ids)


def _hard_scenarios(runs: RunSet) -> Iterator[Finding]:
    """Scenarios that failed under all of two or more configurations: weights are not what is missing."""
    by_scenario: dict[str, list[RunRecord]] = {}
    for record in runs.valid:
        by_scenario.setdefault(record.scenario_id, []).append(record)
    tried = {key: records for key, records in by_scenario.items() if len({r.config_id for r in records}) > 1}
    hard = {key: records for key, records in tried.items() if all(r.outcome != "goal_reached" for r in records)}
    if not hard:
        return
    names = sorted(hard)
    shown = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
    statement = f"{len(hard)} of {len(tried)} scenarios failed under every configuration tried: {shown}."
    run_ids = tuple(record.run_id for key in names for record in hard[key])
    next_step = f"describe_scenario scenario_id={names[0]} detail=checks"
    yield Finding(name="hard_scenarios", statement=statement, run_ids=run_ids, next_step=next_step)


def _suggestion(runs: RunSet, config_id: str, weight: str, *, lower: bool = False) -> Suggestion | None:
    """To raise (or lower) a weight of a configuration; None where its value is unknown."""
    value = runs.weights(config_id).get(weight)
    if value is None:
        return None
    direction = "lower" if lower else "raise"
    return Suggestion(config_id=config_id, weight=weight, direction=direction, why=f"it is {value:g} now")


FINDINGS: tuple[Callable[[RunSet], Iterable[Finding]], ...] = (
    _main_failure,
    _weak_obstacle_cost,
    _held_back,
    _rejecting_constraint,
    _near_misses,
    _uncomfortable_turns,
    _dominating_cost,
    _idle_weights,
    _hard_scenarios,
)
"""The findings in the order in which they are stated."""
