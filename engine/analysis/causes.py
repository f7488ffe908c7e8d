"""What decides the rates of a set of runs beside the planner: collisions that no ego prevents, goals met by nothing.

Both stand beside the rate over all valid runs and never in its place.
"""

from collections import Counter

from ...schemas.results import BeyondVehicle, CollisionCauses, TrivialGoals, TrivialKind
from ...schemas.runs import Contact, RunRecord
from ..commonroad import kept_recording
from .moments import FROM_BEHIND, contact_of
from .run_set import RunSet, most_frequent_first

MOST_COLLISIONS, MOST_GOALS = 60, 200
"""Collisions and reached goals that are looked at (chosen): each reads its scenario, and an answer has 50 s."""
STOOD_M = 0.5
"""An ego that drove less has stood (chosen)."""


def collision_causes(runs: RunSet) -> CollisionCauses | None:
    """Who hit whom, and how many of the collisions no reference driver prevents; None where none is known."""
    hits = [record for record in runs.valid if record.collision is not None]
    if not hits:
        return None
    contacts = known_contacts(runs)
    if not contacts:
        return None
    judged = {run_id: contact.prevention for run_id, contact in contacts.items() if contact.prevention is not None}
    not_preventable = tuple(run_id for run_id, prevention in judged.items() if not prevention.possible)
    kinds = Counter(contact.kind for contact in contacts.values())
    return CollisionCauses(
        collisions=len(hits),
        judged=len(judged),
        kinds=dict(most_frequent_first(kinds)),
        not_preventable=not_preventable,
        from_behind=sum(contacts[run_id].kind in FROM_BEHIND for run_id in not_preventable),
        laid_to=dict(most_frequent_first(Counter(one.laid_to for one in contacts.values() if one.laid_to is not None))),
        recorded_traffic=any(record.traffic == "recorded" for record in hits if record.run_id in not_preventable),
        success_without=runs.rate(record for record in runs.valid if record.run_id not in not_preventable),
    )


def known_contacts(runs: RunSet) -> dict[str, Contact]:
    """Who hit whom by run id, of the first 60 collisions of valid runs; those of an unknown course are left out."""
    hits = [record for record in runs.valid if record.collision is not None]
    seen = {record.run_id: contact_of(runs, record) for record in hits[:MOST_COLLISIONS]}
    return {run_id: contact for run_id, contact in seen.items() if contact is not None}


def trivial_goals(runs: RunSet) -> TrivialGoals | None:
    """The reached goals that asked for no driving; None where there is none."""
    kinds = {record.run_id: kind for record in runs.successes[:MOST_GOALS] if (kind := _trivial_kind(runs, record))}
    if not kinds:
        return None
    return TrivialGoals(
        kinds=dict(sorted(Counter(kinds.values()).items())),
        run_ids=tuple(kinds),
        success_without=runs.rate(record for record in runs.valid if record.run_id not in kinds),
    )


def beyond_vehicle(runs: RunSet) -> BeyondVehicle | None:
    """The valid runs whose driven motion exceeds a limit of the vehicle; None where there is none."""
    judged = {one.run_id: one.beyond_vehicle for one in runs.valid if one.beyond_vehicle is not None}
    found = {run_id: excesses for run_id, excesses in judged.items() if excesses}
    if not found:
        return None
    limits = Counter(excess.name for excesses in found.values() for excess in excesses)
    return BeyondVehicle(limits=dict(most_frequent_first(limits)), run_ids=tuple(found), judged=len(judged))


def _trivial_kind(runs: RunSet, record: RunRecord) -> TrivialKind | None:
    """Why a reached goal asked for no driving: the first reason that holds; None: it did."""
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
