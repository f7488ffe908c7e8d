"""What runs have in common, in words with the runs behind them: findings, in the order in which they are told.

Adding one: a function ``(evidence) -> list of findings`` here, its name in ``FINDINGS``, one test.
"""

from collections import Counter
from collections.abc import Callable
from statistics import median

from ...schemas.results import Finding, Suggestion
from ...schemas.runs import RunRecord
from .costs import config_terms, mean_terms, share_of
from .evidence import Evidence

# ---------- weak_obstacle_cost
# Collisions in which the cost of being near others hardly counted.

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


# ---------- uncomfortable_turns
# Runs that reached the goal with more lateral acceleration than passengers like.

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


# ---------- rejecting_constraint
# Runs without a feasible candidate: which constraint rejected them.


def rejecting_constraint(evidence: Evidence) -> list[Finding]:
    """The constraint with the most rejected candidates over all infeasible runs."""
    stuck = [record for record in evidence.failures if record.outcome == "infeasible" and record.rejected_candidates]
    counts: Counter[str] = Counter()
    for record in stuck:
        counts.update(record.rejected_candidates)
    if not counts.total():
        return []
    name, count = min(counts.items(), key=lambda item: (-item[1], item[0]))
    statement = (
        f"In {len(stuck)} infeasible runs '{name}' rejected {count:,} of {counts.total():,} rejected candidates "
        f"({100 * count / counts.total():.0f} %)."
    )
    runs = tuple(record.run_id for record in stuck)
    next_step = f"analyze_results results=[{runs[0]}] detail=timeline"
    return [Finding(name="rejecting_constraint", statement=statement, run_ids=runs, next_step=next_step)]


# ---------- near_misses
# Successes that were close.

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


# ---------- main_failure
# Which way of failing is the most frequent.


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


# ---------- idle_weights
# Weights that are set but never cost anything.


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


# ---------- held_back
# Runs out of time or too late: which cost term outweighed progress.

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


# ---------- hard_scenarios
# Scenarios that no configuration masters.


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


# ---------- dominating_cost
# One cost term decides nearly everything.

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


# ---------- registry
# What runs have in common, in words with the runs behind them: findings, in the order in which they are told.
#
# Adding one: a function ``(evidence) -> list of findings`` here, its name in ``FINDINGS``, one test.

FINDINGS: tuple[Callable[[Evidence], list[Finding]], ...] = (
    main_failure,
    weak_obstacle_cost,
    held_back,
    rejecting_constraint,
    near_misses,
    uncomfortable_turns,
    dominating_cost,
    idle_weights,
    hard_scenarios,
)


def find_all(evidence: Evidence) -> tuple[Finding, ...]:
    """What every finding has to say about these runs."""
    return tuple(finding for find in FINDINGS for finding in find(evidence))
