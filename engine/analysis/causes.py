"""Causes of rates other than the planner: unpreventable collisions, and goals met without driving.

The two causes are reported next to the rate over all valid runs and never replace it. All runs with a stored review
(``RunLook``) are counted; a random sample of the remaining runs is examined and reported as a sample, with its
interval.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from ...schemas.results import BeyondVehicle, CauseMoment, CollisionCauses, Rate, TrivialGoals, TrivialKind
from ...schemas.reviews import Contact, LooksResponse, RunLook
from ...schemas.runs import ReviewRequest, RunRecord, drawn
from ..commonroad import kept_recording
from ..execution import ProgressReporter
from .moments import FROM_BEHIND, contact_of, review
from .reach import cannot_be_reached
from .run_set import RunSet, hit_another, most_frequent_first, reached_goal
from .statistics import rate

MOST_COLLISIONS, MOST_GOALS = 60, 200
"""Number of collisions and reached goals without a stored review that are examined (chosen): each reads its scenario,
and an answer has 50 s. Server and suites examine all of them in workers before they analyse.
"""
STOOD_M = 0.5
"""An ego that drove less than this stood still (chosen)."""


def look_at_runs(request: ReviewRequest, report: ProgressReporter) -> LooksResponse:
    """Examine each run once, and return its review, which is stored with the run."""
    runs = RunSet(request.runs, scenarios=request.scenarios)
    looks = []
    for number, record in enumerate(runs.records):
        looks.append(
            RunLook(
                review=review(runs, record),
                out_of_reach=record.outcome in ("timeout", "goal_late") and cannot_be_reached(runs, record),
                trivial=(_trivial_kind(runs, record) or "") if reached_goal(record) else "",
            )
        )
        report((number + 1) / len(runs.records), record.run_id)
    return LooksResponse(looks=tuple(looks))


def sample_of(runs: RunSet, records: Iterable[RunRecord], most: int) -> list[RunRecord]:
    """Return all runs if they are few or all have stored reviews, else a random sample of at least ``most``.

    More than ``most`` runs are included only as long as the further runs have stored reviews. The order of the runs is
    kept.
    """
    chosen: set[str] = set()
    wanted = list(records)
    for record in drawn(wanted):
        if len(chosen) >= most and runs.look(record) is None:
            break
        chosen.add(record.run_id)
    return [record for record in wanted if record.run_id in chosen]


def collision_causes(runs: RunSet, *, with_rate: bool = True) -> CollisionCauses | None:
    """Return collisions by kind and the number that no reference driver prevents; None if no collision is known.

    ``with_rate``: whether to add one rate over all these runs.
    """
    hits = [record for record in runs.valid if hit_another(record)]
    looked_at = sample_of(runs, hits, MOST_COLLISIONS)
    contacts = _contacts(runs, looked_at)
    if not contacts:
        return None
    judged = {run_id: contact for run_id, contact in contacts.items() if contact.prevention is not None}
    not_preventable = tuple(run_id for run_id, contact in judged.items() if contact.is_unpreventable)
    kinds = Counter(contact.kind for contact in contacts.values())
    share = runs.rate((one for one in looked_at if one.run_id in judged), _is_among(not_preventable))
    without = (
        _estimated_without(runs, len(hits), share)
        if len(looked_at) < len(hits)
        else runs.rate(record for record in runs.valid if record.run_id not in not_preventable)
    )
    return CollisionCauses(
        collisions=len(hits),
        looked_at=len(looked_at),
        judged=len(judged),
        kinds=dict(most_frequent_first(kinds)),
        not_preventable=not_preventable,
        unpreventable_share=share,
        from_behind=sum(contacts[run_id].kind in FROM_BEHIND for run_id in not_preventable),
        laid_to=dict(most_frequent_first(Counter(one.laid_to for one in contacts.values() if one.laid_to is not None))),
        recorded_traffic=any(record.traffic == "recorded" for record in hits if record.run_id in not_preventable),
        success_without=without if with_rate else None,
        evidence=tuple(
            CauseMoment(
                run_id=run_id,
                time_s=contact.time_s,
                kind=contact.kind,
                laid_to=contact.laid_to,
                fault=None if contact.fault is None else contact.fault.code,
                preventable=None if contact.prevention is None else contact.prevention.possible,
            )
            for run_id, contact in contacts.items()
        ),
    )


def _is_among(run_ids: Sequence[str]) -> Callable[[RunRecord], bool]:
    return lambda record: record.run_id in run_ids


def _estimated_without(runs: RunSet, hits: int, unpreventable: Rate) -> Rate:
    """Return the rate of goals without unpreventable collisions, estimated from a sample of the collisions.

    The interval covers the uncertainty of the rate and of the sample: each end uses the farther end of the sample's
    interval.
    """
    goals, valid = len(runs.successes), len(runs.valid)
    if unpreventable.share is None or unpreventable.low is None or unpreventable.high is None:
        return runs.rate(runs.valid)
    of = valid - round(unpreventable.share * hits)
    low = rate(goals, valid - round(unpreventable.low * hits)).low
    high = rate(goals, max(valid - round(unpreventable.high * hits), goals)).high
    return Rate(count=goals, of=of, share=goals / of if of else None, low=low, high=high)


def known_contacts(runs: RunSet) -> dict[str, Contact]:
    """Return the contacts of collisions with road users by run id, for all runs or a sample; runs without a known
    course are left out.
    """
    return _contacts(runs, sample_of(runs, (one for one in runs.valid if hit_another(one)), MOST_COLLISIONS))


def _contacts(runs: RunSet, records: Iterable[RunRecord]) -> dict[str, Contact]:
    seen = {record.run_id: contact_of(runs, record) for record in records}
    return {run_id: contact for run_id, contact in seen.items() if contact is not None}


def trivial_goals(runs: RunSet, *, with_rate: bool = True) -> TrivialGoals | None:
    """Return the reached goals that required no driving, or None if there are no such goals.

    ``with_rate``: whether to add one rate over all these runs.
    """
    looked_at = sample_of(runs, runs.successes, MOST_GOALS)
    kinds = {record.run_id: kind for record in looked_at if (kind := _trivial_kind(runs, record))}
    if not kinds:
        return None
    share = runs.rate(looked_at, _is_among(tuple(kinds)))
    without = runs.rate(record for record in runs.valid if record.run_id not in kinds)
    if len(looked_at) < len(runs.successes) and share.share is not None:
        left = round((1 - share.share) * len(runs.successes))
        without = rate(left, len(runs.valid) - len(runs.successes) + left)
    return TrivialGoals(
        kinds=dict(sorted(Counter(kinds.values()).items())),
        run_ids=tuple(kinds),
        goals=len(runs.successes),
        looked_at=len(looked_at),
        success_without=without if with_rate else None,
    )


def beyond_vehicle(runs: RunSet) -> BeyondVehicle | None:
    """Return the valid runs in which the driven motion exceeds a limit of the vehicle, or None if there are none."""
    judged = {one.run_id: one.beyond_vehicle for one in runs.valid if one.beyond_vehicle is not None}
    found = {run_id: excesses for run_id, excesses in judged.items() if excesses}
    if not found:
        return None
    limits = Counter(excess.name for excesses in found.values() for excess in excesses)
    return BeyondVehicle(limits=dict(most_frequent_first(limits)), run_ids=tuple(found), judged=len(judged))


def _trivial_kind(runs: RunSet, record: RunRecord) -> TrivialKind | None:
    """Return the first reason why a reached goal required no driving, or None if it required driving."""
    kept = runs.look(record)
    if kept is not None:
        return kept.trivial or None  # type: ignore[return-value]
    if record.metrics is None:
        return None
    if record.metrics.duration_s <= record.step_s * 1.5:
        return "at_the_start"
    if record.metrics.distance_m < STOOD_M:
        return "standing"
    path = runs.scenario_path(record)
    if path is None or not path.is_file():
        return None
    goal = kept_recording(path).loaded.problem(record.problem_id).goal
    placed = any(getattr(state, "position", None) is not None for state in goal.state_list)
    return None if placed else "by_time_alone"
