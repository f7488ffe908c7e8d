"""Findings: statements about what runs have in common, with the runs behind them and alternative explanations.

A finding is a generator ``(evidence) -> findings`` that carries the finding's name. To add one, write the function,
insert it into ``FINDINGS`` at the right position in the order of statements, and test it. Statements describe single
runs: a share is that of the median run, not of a sum that one run may dominate. What other road users do to the ego is
not attributed to its planner.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from statistics import median

import numpy as np

from ...schemas.results import Finding, FindingMoment, Suggestion
from ...schemas.reviews import Contact, Encounter, PaceCode, PaceMoment, RunReview
from ...schemas.runs import CRITICAL_GAP_M, CRITICAL_TIME_TO_COLLISION_S, RunRecord, is_close
from ...schemas.text import counted, p_figure
from ..geometry import wrap_angles
from .causes import sample_of
from .moments import FROM_BEHIND, contact_of, review
from .pace import pace_of
from .reach import cannot_be_reached
from .run_set import RunSet, ego_track, hit_another, mean_terms, most_frequent_first, reached_goal, share_of
from .statistics import LEVEL, fisher_exact, holm

_MOST_LOOKED_AT = 60
"""Number of runs per kind that are examined if they have no stored review, chosen at random (chosen): an answer has 50
s.
"""


class Evidence:
    """The runs that findings are derived from, and their contacts, reviews and pace stretches."""

    def __init__(self, runs: RunSet) -> None:
        self.runs = runs
        self._contacts: dict[str, Contact | None] = {}
        self._reviews: dict[str, RunReview] = {}
        self._paces: dict[str, tuple[PaceMoment, ...]] = {}

    def contact(self, record: RunRecord) -> Contact | None:
        """Return how a run's collision came about, or None if there is no collision or it is not in the sample."""
        if record.run_id not in self._contacts:
            sampled = not hit_another(record) or record.run_id in self._sampled_hits
            self._contacts[record.run_id] = contact_of(self.runs, record) if sampled else None
        return self._contacts[record.run_id]

    def review(self, record: RunRecord) -> RunReview:
        """Return the decisive moments of a run."""
        if record.run_id not in self._reviews:
            self._reviews[record.run_id] = review(self.runs, record)
        return self._reviews[record.run_id]

    def pace(self, record: RunRecord) -> tuple[PaceMoment, ...]:
        """Return the stretches in which the ego of a run stood, was held up or braked, each with its cause."""
        if record.run_id not in self._paces:
            self._paces[record.run_id] = pace_of(self.runs, record)
        return self._paces[record.run_id]

    def sample(self, records: Iterable[RunRecord]) -> list[RunRecord]:
        """Return all of the given runs, or a random sample if there are many."""
        return sample_of(self.runs, records, _MOST_LOOKED_AT)

    def hits(self) -> list[RunRecord]:
        """Return the runs that ended in a collision with another road user, or a random sample of these runs."""
        return [one for one in self.runs.failures if hit_another(one) and one.run_id in self._sampled_hits]

    @cached_property
    def _sampled_hits(self) -> frozenset[str]:
        return frozenset(one.run_id for one in self.sample(filter(hit_another, self.runs.failures)))

    def is_known(self, record: RunRecord) -> bool:
        """Return whether a collision is in the examined sample."""
        return record.run_id in self._sampled_hits

    @cached_property
    def among_hits(self) -> str:
        """A note for statements about collisions if only a sample was examined; empty if all were."""
        hits = sum(map(hit_another, self.runs.failures))
        return "" if len(self._sampled_hits) == hits else f" (a random {len(self._sampled_hits)} of {hits} collisions)"

    @cached_property
    def sampled_hits(self) -> dict[str, float]:
        """The figures in the note of ``among_hits``."""
        hits = sum(map(hit_another, self.runs.failures))
        return _sample_figures(len(self._sampled_hits), collisions=hits)

    def is_others_fault(self, record: RunRecord) -> bool:
        """Return True if another vehicle hit the ego from behind, or if no reference driver prevents the collision.

        A collision that the ego caused is not attributed to the other road users.
        """
        contact = self.contact(record)
        if contact is None or contact.laid_to == "ego":
            return False
        return contact.kind in FROM_BEHIND or contact.is_unpreventable


def find_all(runs: RunSet) -> tuple[Finding, ...]:
    """Return the findings on these runs, in the order of the registry.

    A finding without moments of its own lists the ends of its runs.
    """
    evidence = Evidence(runs)
    ends = {
        record.run_id: FindingMoment(run_id=record.run_id, time_s=record.metrics.duration_s, code=record.outcome)
        for record in runs.valid
        if record.metrics is not None
    }
    return tuple(
        finding
        if finding.moments
        else finding.model_copy(update={"moments": tuple(ends[key] for key in finding.run_ids if key in ends)})
        for find in FINDINGS
        for finding in (_by_configuration(find, evidence) if find in _OF_ONE_CONFIGURATION else find(evidence))
    )


def _by_configuration(find: "_Find", evidence: Evidence) -> Iterator[Finding]:
    """Yield the findings of a function, separately for each configuration if there are several."""
    runs = evidence.runs
    if runs.is_of_one_configuration:
        yield from find(evidence)
        return
    for own in runs.by_configuration.values():
        for finding in find(Evidence(own)):
            yield finding.model_copy(update={"statement": f"{own.records[0].config_name}: {finding.statement}"})


def _main_failure(evidence: Evidence) -> Iterator[Finding]:
    """Yield the most frequent failure mode with both denominators: the failures and the valid runs."""
    failures = evidence.runs.failures
    if not failures:
        return
    counts = Counter(record.outcome for record in failures)
    outcome, count = most_frequent_first(counts)[0]
    run_ids = _ids(record for record in failures if record.outcome == outcome)
    refused = Counter(
        record.refusal or "not stated" for record in failures if outcome == record.outcome == "goal_refused"
    )
    codes = ", ".join(f"{code.replace('_', ' ')} {number}" for code, number in most_frequent_first(refused))
    words = outcome.replace("_", " ") + (f" ({codes})" if codes else "")
    valid = counted(len(evidence.runs.valid), "valid run")
    statement = f"{words} in {count} of {counted(len(failures), 'failure')} and {count} of {valid}."
    # An animation does not show why the benchmark refuses a motion; the run's own answer states it.
    shown = f"analyze_results results=[{run_ids[0]}]" if refused else f"render kind=animation ids=[{run_ids[0]}]"
    ends = tuple(
        FindingMoment(run_id=record.run_id, time_s=record.metrics.duration_s, code=record.outcome)
        for record in failures
        if record.outcome == outcome and record.metrics is not None
    )
    yield Finding(
        name="main_failure",
        statement=statement,
        figures={"runs": count, "failures": len(failures), "valid_runs": len(evidence.runs.valid)},
        run_ids=run_ids,
        moments=ends,
        next_step=shown,
    )


_FEW = 2
"""Fewest runs for a statement about several (chosen): a single run is better described by its own answer."""


def _unforeseen(evidence: Evidence) -> Iterator[Finding]:
    """Yield collisions that would not have happened if the other road user had moved as predicted."""
    hits = [one for one in evidence.hits() if not evidence.is_others_fault(one) and one.prediction != "ground_truth"]
    known = [one for one in hits if (contact := evidence.contact(one)) and contact.predicted_gap_m is not None]
    missed = [one for one in known if (contact := evidence.contact(one)) and contact.unforeseen]
    if len(missed) * 2 < max(len(known), 1) or not missed:
        return
    gaps = [evidence.contact(one).predicted_gap_m or 0.0 for one in missed]  # type: ignore[union-attr]
    yield Finding(
        name="unforeseen",
        statement=(
            f"In {len(missed)} of {len(known)} collisions that the ego could have prevented, the other vehicle did not "
            f"move as predicted 1 s earlier; if it had, the gap would have been "
            f"{median(gaps):.1f} m (median){evidence.among_hits}."
        ),
        figures={"runs": len(missed), "of": len(known), "median_gap_m": median(gaps), **evidence.sampled_hits},
        run_ids=_ids(missed),
        moments=_hits_of(evidence, missed),
        alternatives="the plan left no margin for a wrong prediction",
        next_step="run_planner with prediction=ground_truth on the same scenarios, then compare_results",
    )


def _unseen(evidence: Evidence) -> Iterator[Finding]:
    """Yield collisions in which the sensors of an imperfect world reported the other road user too late to brake.

    Too late is after the latest time at which full braking prevents the collision.
    """
    hits = [one for one in evidence.hits() if not evidence.is_others_fault(one) and not one.world.is_perfect]
    known = [(one, contact) for one in hits if (contact := evidence.contact(one)) and contact.laid_to is not None]
    unseen = [(one, contact) for one, contact in known if contact.laid_to == "perception" and contact.sight]
    if not unseen:
        return
    codes = Counter(str(contact.sight.code) for _, contact in unseen if contact.sight is not None)
    record, example = unseen[0]
    sight = "" if example.sight is None else example.sight.in_words(example.other, example.time_s)
    yield Finding(
        name="unseen",
        subject=_most(codes),
        statement=(
            f"In {len(unseen)} of {len(known)} collisions that the ego could have prevented, the sensors reported the "
            f"other road user too late to brake; in {record.run_id}, {sight}{evidence.among_hits}."
        ),
        figures={"runs": len(unseen), "of": len(known), **codes, **evidence.sampled_hits},
        run_ids=_ids(one for one, _ in unseen),
        moments=_hits_of(evidence, (one for one, _ in unseen)),
        alternatives="a planner that slows down where it cannot see would have had time",
        next_step="run_planner with world=perfect on the same scenarios, then compare_results",
    )


_GUARDS: Mapping[str, tuple[str, ...]] = {
    "collision": ("prediction", "distance_to_obstacles", "responsibility"),
    "off_road": ("lane_center_offset", "distance_to_reference_path"),
    "timeout": ("velocity_offset", "velocity"),
    "goal_late": ("velocity_offset", "velocity"),
}
"""The cost terms that work against each failure."""
_OFF = 0.2
"""A weight below a fifth of the planner's default counts as off (chosen)."""


def _weight_off(evidence: Evidence) -> Iterator[Finding]:
    """Yield, per configuration, weights that are off although they would prevent failures of its runs."""
    runs = evidence.runs
    defaults = {config.config_id: config.default_weights for config in runs.configs}
    for config_id, records in runs.by_config(runs.valid).items():
        weights = runs.weights(config_id)
        off = {
            name: value
            for name, value in (defaults.get(config_id) or {}).items()
            if value > 0 and weights.get(name, value) < _OFF * value
        }
        for name, default in off.items():
            outcomes = [outcome for outcome, guards in _GUARDS.items() if name in guards]
            failed = [one for one in records if one.outcome in outcomes and not evidence.is_others_fault(one)]
            failed = [one for one in failed if not hit_another(one) or evidence.is_known(one)]
            if len(failed) < _FEW or len(failed) * 10 < len(records):
                continue
            words = " or ".join(outcome.replace("_", " ") for outcome in outcomes)
            yield Finding(
                name="weight_off",
                subject=name,
                statement=(
                    f"{name} is {weights.get(name, 0.0):g} in {records[0].config_name} ({default:g} by default); "
                    f"{len(failed)} of {len(records)} runs fail in a way that it should prevent ({words})"
                    f"{evidence.among_hits}."
                ),
                figures={
                    "weight": weights.get(name, 0.0),
                    "default_weight": default,
                    "runs": len(failed),
                    "of": len(records),
                    **evidence.sampled_hits,
                },
                run_ids=_ids(failed),
                alternatives="these scenarios may be hard with the default too: run it for comparison",
                suggestion=_suggestion(runs, config_id, name),
            )


_LAST_S = 1.0
"""Time before a collision over which cost is examined (chosen): the ego could still have braked or steered."""
_WEAK_SHARE = 0.10
"""Share of the cost below which the obstacle terms hardly counted (chosen)."""


def _weak_obstacle_cost(evidence: Evidence) -> Iterator[Finding]:
    """Yield, per configuration, collisions in which obstacles made up under 10% of the cost in the last second.

    The chosen candidate passed the collision check against the prediction; a small share means that only that check
    kept the ego away from other road users. The finding needs at least half of the collisions that the ego could have
    prevented.
    """
    runs = evidence.runs
    hits = [record for record in evidence.hits() if not evidence.is_others_fault(record)]
    for config_id, records in runs.by_config(hits).items():
        shares = {record.run_id: share for record in records if (share := _obstacle_share(runs, record)) is not None}
        weak = tuple(run_id for run_id, share in shares.items() if share < _WEAK_SHARE)
        if not weak or len(weak) * 2 < len(shares):
            continue
        middle = median(shares[run_id] for run_id in weak)
        known = [name for name in _GUARDS["collision"] if name in runs.weights(config_id)]
        yield Finding(
            name="weak_obstacle_cost",
            statement=(
                f"In {len(weak)} of {len(shares)} collisions of {records[0].config_name} that the ego could have "
                f"prevented, obstacles made up under {100 * _WEAK_SHARE:.0f}% of the plan's cost in the last second "
                f"(median {100 * middle:.1f}%){evidence.among_hits}."
            ),
            figures={
                "runs": len(weak),
                "of": len(shares),
                "most_share": _WEAK_SHARE,
                "median_share": middle,
                **evidence.sampled_hits,
            },
            run_ids=weak,
            moments=_hits_of(evidence, (record for record in records if record.run_id in weak)),
            alternatives="the other was not predicted to be there, so no weight could have helped",
            suggestion=_suggestion(runs, config_id, known[0]) if known else None,
        )


def _obstacle_share(runs: RunSet, record: RunRecord) -> float | None:
    """Return the share of the obstacle terms in the cost of the last second before a collision."""
    steps = runs.steps.get(record.run_id)
    if steps is None or record.collision is None:
        return None
    terms = mean_terms(steps, since_step=record.collision.step - round(_LAST_S / record.step_s))
    return share_of(terms, _GUARDS["collision"])


_PROGRESS_TERM = "velocity_offset"
"""The cost term for driving slower than desired."""
_HELD_UP_SHARE = 0.4
"""Smallest share of a drive behind a slower vehicle that explains a late arrival (chosen)."""


_LATE: tuple[tuple[str, tuple[PaceCode, ...], str, str], ...] = (
    (
        "stood_late",
        ("stood_at_green", "stood_without_cause"),
        "stood at a green light or with nothing to wait for",
        "the planner waits for something that is not in the scenario file",
    ),
    (
        "waited_late",
        ("stood_at_red", "stood_before_red", "stood_at_light", "stood_at_stop_sign", "stood_to_give_way"),
        "stood at lights or stop signs, or while others crossed their path",
        "an ego that arrived earlier would have passed; whether it stopped to give way is unknown",
    ),
    (
        "held_up",
        ("held_up", "stood_in_queue", "stood_behind_vehicle"),
        "were behind a slower vehicle",
        "an ego that overtakes, or that starts closer, would be on time",
    ),
)
"""Why a run is late: name of the finding, codes of stretches that count, text, and alternative explanations."""


def _late(evidence: Evidence) -> Iterator[Finding]:
    """Yield findings on late runs: goals out of reach, what egos waited for, and what delayed the remaining runs.

    Each run is attributed to the first cause that holds: a goal out of reach, then the cause in ``_LATE`` that took
    most of the drive, if it took at least 40%. The remaining runs are reported per configuration with the median run's
    largest cost term. If that term is the speed offset, the planner is slow despite the cost, so the weight is too
    small. Any other term holds the ego back.
    """
    runs = evidence.runs
    late = [record for record in runs.failures if record.outcome in ("timeout", "goal_late")]
    looked_at = evidence.sample(late)
    sample = "" if len(looked_at) == len(late) else f"a random {len(looked_at)} of "
    of = f"{sample}{len(late)} late runs"
    all_late = {"of": len(looked_at), **_sample_figures(len(looked_at), late_runs=len(late))}
    too_far = [record for record in looked_at if cannot_be_reached(runs, record)]
    rest = [record for record in looked_at if record not in too_far]
    if too_far:
        yield Finding(
            name="goal_out_of_reach",
            statement=(
                f"{len(too_far)} of {of} could not be on time: the goal is out of reach for an ego that accelerates "
                "to the speed limit and keeps it."
            ),
            figures={"runs": len(too_far), **all_late},
            run_ids=_ids(too_far),
            moments=tuple(FindingMoment(run_id=one.run_id, time_s=0.0, code="goal_out_of_reach") for one in too_far),
            next_step="modify_scenario set_goal with a later time or a nearer goal",
        )
    delays = {record.run_id: _late_by(evidence, record) for record in rest}
    for name, codes, words, alternatives in _LATE:
        members = [record for record in rest if delays[record.run_id] == name]
        if members:
            yield Finding(
                name=name,
                statement=f"{len(members)} of {of} {words} for {100 * _HELD_UP_SHARE:.0f}% or more of the drive.",
                figures={"runs": len(members), **all_late, "least_share": _HELD_UP_SHARE},
                run_ids=_ids(members),
                moments=_paces_of(evidence, members, codes),
                alternatives=alternatives,
                next_step=f"render kind=animation ids=[{members[0].run_id}]",
            )
    others = [record for record in rest if not delays[record.run_id]]
    for config_id, records in runs.by_config(others).items():
        yield from _findings_on_late_runs(runs, config_id, records)


def _late_by(evidence: Evidence, record: RunRecord) -> str:
    """Return the cause that took most of a late drive and at least 40% of it, else an empty string."""
    if record.metrics is None or record.metrics.duration_s <= 0:
        return ""
    moments = evidence.pace(record)
    shares = {
        name: sum(one.duration_s for one in moments if one.code in codes) / record.metrics.duration_s
        for name, codes, _, _ in _LATE
    }
    most = max(shares, key=lambda name: shares[name])
    return most if shares[most] >= _HELD_UP_SHARE - 1e-9 else ""


def _own_doing(evidence: Evidence) -> Iterator[Finding]:
    """Yield, per configuration, failures in which the ego stood or braked hard without a reason on the road."""
    runs = evidence.runs
    failed = [one for one in runs.failures if one.outcome in _SLOW_ENDS or hit_another(one)]
    looked_at = evidence.sample(failed)
    sample = "" if len(looked_at) == len(failed) else f" (a random {len(looked_at)} of {len(failed)})"
    for records in runs.by_config(looked_at).values():
        for name, codes, words in _OWN:
            members = [one for one in records if any(moment.code in codes for moment in evidence.pace(one))]
            if not members:
                continue
            moments = [(m, one.run_id) for one in members for m in evidence.pace(one) if m.code in codes]
            worst, run_id = max(moments, key=lambda item: item[0].largest_mps2 or item[0].duration_s)
            yield Finding(
                name=name,
                statement=(
                    f"In {len(members)} of {len(records)} late or collided runs of {records[0].config_name}{sample} "
                    f"the ego {words}; in {run_id} it {worst.in_words()}."
                ),
                figures={
                    "runs": len(members),
                    "of": len(records),
                    **_sample_figures(len(looked_at), failures=len(failed)),
                    **_figures_of(worst),
                },
                run_ids=_ids(members),
                moments=_paces_of(evidence, members, codes),
                alternatives="the reason is not on the road: a prediction, or the desired speed",
                next_step=f"analyze_results results=[{run_id}] detail=timeline where=['time_s={_around(worst)}']",
            )


def _figures_of(moment: PaceMoment) -> dict[str, float]:
    """Return the figures for the text about a stretch."""
    names = ("since_s", "until_s", "largest_mps2", "distance_m", "obstacle_id")
    return {name: value for name in names if (value := getattr(moment, name)) is not None}


def _sample_figures(looked_at: int, **of: int) -> dict[str, float]:
    """Return the number of examined runs as a figure; empty if all runs were examined."""
    (count,) = of.values()
    return {} if looked_at == count else {"looked_at": looked_at, **of}


def _around(moment: PaceMoment) -> str:
    return f"{max(moment.since_s - 1.0, 0.0):.1f}..{moment.until_s:.1f}"


_SLOW_ENDS = ("timeout", "goal_late", "goal_missed", "infeasible")
_OWN: tuple[tuple[str, tuple[PaceCode, ...], str], ...] = (
    ("stood_without_cause", ("stood_at_green", "stood_without_cause"), "stood with nothing to wait for"),
    ("braked_without_cause", ("braked_without_cause", "braked_too_hard"), "braked without a reason on the road"),
)
"""Findings on what the ego did without a reason: name, codes of moments, text."""


def _paces_of(evidence: Evidence, records: Iterable[RunRecord], codes: Iterable[PaceCode]) -> tuple[FindingMoment, ...]:
    """Return the first stretch of each run that has one of the codes."""
    wanted = tuple(codes)
    found = []
    for record in records:
        first = next((moment for moment in evidence.pace(record) if moment.code in wanted), None)
        if first is not None:
            found.append(FindingMoment(run_id=record.run_id, time_s=first.since_s, code=first.code))
    return tuple(found)


def _hits_of(evidence: Evidence, records: Iterable[RunRecord]) -> tuple[FindingMoment, ...]:
    """Return the time of each run's collision."""
    return tuple(
        FindingMoment(run_id=record.run_id, time_s=record.collision.time_s, code=contact.kind)
        for record in records
        if record.collision is not None and (contact := evidence.contact(record)) is not None
    )


def _findings_on_late_runs(runs: RunSet, config_id: str, records: list[RunRecord]) -> Iterator[Finding]:
    terms = _median_shares(runs, records)
    if not terms:
        return
    largest = max(terms, key=lambda term: (terms[term], term))
    yield Finding(
        name="held_back",
        subject=largest,
        statement=(
            f"{counted(len(records), 'run')} of {records[0].config_name} ran out of time or arrived too late; "
            f"{largest} made up {100 * terms[largest]:.0f}% of the cost in the median run."
        ),
        figures={"runs": len(records), "median_share": terms[largest]},
        run_ids=_ids(records),
        alternatives="the goal's time requires another speed, or traffic blocks the road",
        suggestion=_suggestion(runs, config_id, largest, lower=largest != _PROGRESS_TERM),
    )


def _median_shares(runs: RunSet, records: Iterable[RunRecord]) -> dict[str, float]:
    """Return each term's share of the cost in the median run; runs without a cost are left out."""
    terms = [mean_terms(runs.steps[record.run_id]) for record in records if record.run_id in runs.steps]
    shares = [{term: value / total for term, value in mean.items()} for mean in terms if (total := sum(mean.values()))]
    names = sorted({term for share in shares for term in share})
    return {term: median(share.get(term, 0.0) for share in shares) for term in names}


def _rejecting_constraint(evidence: Evidence) -> Iterator[Finding]:
    """Yield the constraint that rejects most candidates in most of the infeasible runs."""
    stuck = [one for one in evidence.runs.failures if one.outcome == "infeasible" and one.rejected_candidates]
    first = Counter(_most(one.rejected_candidates) for one in stuck)
    if not first:
        return
    name = _most(first)
    count = first[name]
    if count * 2 <= len(stuck):
        return
    shares = [one.rejected_candidates.get(name, 0) / sum(one.rejected_candidates.values()) for one in stuck]
    run_ids = _ids(stuck)
    yield Finding(
        name="rejecting_constraint",
        subject=name,
        statement=(
            f"In {count} of {len(stuck)} infeasible runs, {name} rejected most candidates: "
            f"{100 * median(shares):.0f}% of the rejected ones in the median run."
        ),
        figures={"runs": count, "of": len(stuck), "median_share": median(shares)},
        run_ids=run_ids,
        alternatives="the sampling contains no candidate that is feasible here: raise sampling_level",
        next_step=f"analyze_results results=[{run_ids[0]}] detail=timeline",
    )


def _most(counts: Mapping[str, int]) -> str:
    """Return the name with the largest count; if counts are equal, the first in alphabetical order."""
    return min(counts, key=lambda name: (-counts[name], name))


_ROLLING_MPS = 2.0
"""Below this speed the ego queues or creeps (chosen): being close to others is then no near miss."""


def _near_misses(evidence: Evidence) -> Iterator[Finding]:
    """Yield, per configuration, successes in which the moving ego came close to a road user ahead or crossing.

    Road users that are behind, alongside or oncoming in their own lane control the distance themselves. They are
    counted separately.
    """
    runs = evidence.runs
    for config_id, records in runs.by_config(runs.successes).items():
        near = [record for record in records if is_close(record)]
        close = evidence.sample(near)
        own = [record for record in close if _caused_near_miss(evidence.review(record))]
        if not own:
            continue
        others = f"; in {len(close) - len(own)} more, others came close to it" if len(close) > len(own) else ""
        of = f"{len(records)} successes"
        if len(close) < len(near):
            of = f"a random {len(close)} of the {len(near)} close ones among {len(records)} successes"
        yield Finding(
            name="near_misses",
            statement=(
                f"In {len(own)} of {of} of {records[0].config_name}, the ego came within "
                f"{CRITICAL_GAP_M} m or {CRITICAL_TIME_TO_COLLISION_S} s of another road user ahead or crossing"
                f"{others}."
            ),
            figures={
                "runs": len(own),
                "of": len(records),
                "gap_m": CRITICAL_GAP_M,
                "time_to_collision_s": CRITICAL_TIME_TO_COLLISION_S,
                "by_others": len(close) - len(own),
                **_sample_figures(len(close), close_runs=len(near)),
            },
            run_ids=_ids(own),
            moments=tuple(
                FindingMoment(run_id=one.run_id, time_s=moment.time_s, code="near_miss")
                for one in own
                for moment in _own_near(evidence.review(one))[:1]
            ),
            alternatives="the other braked or cut in, and the ego handled it",
            suggestion=_suggestion(runs, config_id, "distance_to_obstacles"),
        )


def _caused_near_miss(looked_at: RunReview) -> bool:
    """Return True if the ego itself caused one of the close approaches of a run."""
    return bool(_own_near(looked_at))


def _own_near(looked_at: RunReview) -> list[Encounter]:
    """Return the close approaches of a run that the ego itself caused."""
    closest, urgent = looked_at.closest, looked_at.most_urgent
    near = closest is not None and closest.gap_m < CRITICAL_GAP_M and _is_the_egos(closest)
    time = None if urgent is None else urgent.time_to_collision_s
    soon = time is not None and time < CRITICAL_TIME_TO_COLLISION_S
    found = [closest] if near else []
    found += [urgent] if urgent is not None and soon and _is_the_egos(urgent) else []
    return [moment for moment in found if moment is not None]


def _is_the_egos(moment: Encounter) -> bool:
    ahead = moment.side == "front" and moment.direction in ("same", "crossing", "standing")
    return ahead and moment.ego_speed_mps > _ROLLING_MPS


_COMFORTABLE_MPS2 = 3.0
"""Largest lateral acceleration that a lane keeping system may cause (ISO 11270:2014)."""


def _uncomfortable_turns(evidence: Evidence) -> Iterator[Finding]:
    """Yield, per configuration, successes with over 3 m/s² lateral acceleration if they are at least a quarter."""
    runs = evidence.runs
    for config_id, records in runs.by_config(runs.successes).items():
        values = {r.run_id: r.metrics.maximum_lateral_acceleration_mps2 for r in records if r.metrics is not None}
        harsh = tuple(run_id for run_id, value in values.items() if value > _COMFORTABLE_MPS2)
        if not harsh or len(harsh) * 4 < len(values):
            continue
        yield Finding(
            name="uncomfortable_turns",
            statement=(
                f"{len(harsh)} of {len(values)} successful runs of {records[0].config_name} exceeded a lateral "
                f"acceleration of {_COMFORTABLE_MPS2:g} m/s² (largest {max(values.values()):.1f})."
            ),
            figures={
                "runs": len(harsh),
                "of": len(values),
                "limit_mps2": _COMFORTABLE_MPS2,
                "largest_mps2": max(values.values()),
            },
            run_ids=harsh,
            moments=_sharpest(runs, harsh),
            alternatives="the path to the goal is too tight for the speed that the goal's time requires",
            suggestion=_suggestion(runs, config_id, "lateral_jerk"),
        )


def _sharpest(runs: RunSet, run_ids: Iterable[str]) -> tuple[FindingMoment, ...]:
    """Return the times at which the lateral acceleration of runs was largest."""
    found = []
    for record in runs.valid:
        steps = runs.steps.get(record.run_id)
        if record.run_id in run_ids and steps is not None and len(steps.x_m) > 1:
            ego = ego_track(record, steps)
            felt = np.abs(ego.speeds_mps[1:] * wrap_angles(np.diff(ego.headings_rad)))
            time_s = round((int(felt.argmax()) + 1) * record.step_s, 9)
            found.append(FindingMoment(run_id=record.run_id, time_s=time_s, code="largest_lateral_acceleration"))
    return tuple(found)


_DOMINATING_SHARE = 0.8
"""Share of the cost above which one term decides nearly everything (chosen)."""


def _dominating_cost(evidence: Evidence) -> Iterator[Finding]:
    """Yield, per configuration, a term with over 80% of the chosen candidates' cost in the median run."""
    runs = evidence.runs
    for records in runs.by_config(runs.valid).values():
        for term, share in _median_shares(runs, records).items():
            if share > _DOMINATING_SHARE:
                yield Finding(
                    name="dominating_cost",
                    subject=term,
                    statement=(
                        f"{term} is {100 * share:.0f}% of the cost in the median run of {records[0].config_name}."
                    ),
                    figures={"median_share": share},
                    run_ids=_ids(record for record in records if record.run_id in runs.steps),
                    alternatives=(
                        "the term may be the same for all candidates, and then decides nothing, however large; the "
                        "differences between candidates are not recorded"
                    ),
                )


def _idle_weights(evidence: Evidence) -> Iterator[Finding]:
    """Yield, per configuration, positive weights with a cost term of 0 in every chosen candidate of every run.

    Parameters that are not cost weights have no term. If no weight has the name of a term, the planner names its terms
    differently, and nothing is known about its weights.
    """
    runs = evidence.runs
    for config_id, records in runs.by_config(runs.valid).items():
        terms = _median_shares(runs, records)
        seen = {term for one in records if one.run_id in runs.steps for term, value in _costs(runs, one) if value}
        weights, held_by = runs.cost_weights(config_id), runs.cost_terms(config_id)
        idle = [name for name, weight in sorted(weights.items()) if weight > 0 and held_by[name] not in seen]
        if not idle or not weights.keys() & terms.keys():
            continue
        run_ids = _ids(record for record in records if record.run_id in runs.steps)
        yield Finding(
            name="idle_weights",
            statement=(
                f"{', '.join(idle)} of {records[0].config_name} cost nothing in any of {len(run_ids)} runs: raising "
                f"{'it' if len(idle) == 1 else 'them'} may have no effect on such scenarios."
            ),
            figures={"runs": len(run_ids)},
            run_ids=run_ids,
            alternatives="it may have added cost to candidates that were not chosen",
        )


def _costs(runs: RunSet, record: RunRecord) -> Iterable[tuple[str, float]]:
    return mean_terms(runs.steps[record.run_id]).items()


_HARDER_POINTS = 0.2
"""Smallest difference in success that is reported (chosen)."""


def _harder_group(evidence: Evidence) -> Iterator[Finding]:
    """Yield the classes of obstacles and kinds of road for which scenarios fail more often than other scenarios.

    The difference is tested by Fisher's exact test. A scenario counts once, and as a success if most of its runs
    reached the goal. The p values of all groups are adjusted by Holm. Collisions that are attributed to other road
    users are left out.
    """
    runs = evidence.runs
    reached: dict[str, list[bool]] = {}
    groups: dict[str, set[str]] = {}
    for record in runs.valid:
        if hit_another(record) and (not evidence.is_known(record) or evidence.is_others_fault(record)):
            continue
        root, known = runs.root(record), runs.scenario(record)
        reached.setdefault(root, []).append(reached_goal(record))
        for kind in runs.obstacles.get(record.scenario_id, {}):
            groups.setdefault(f"with a {kind}", set()).add(root)
        if known is not None and known.road:
            groups.setdefault(f"tagged {known.road}", set()).add(root)
    mastered = {root for root, goals in reached.items() if sum(goals) * 2 > len(goals)}
    counts = {name: _two_groups(members, set(reached), mastered) for name, members in groups.items()}
    tested = {name: pair for name, pair in counts.items() if min(pair[0][1], pair[1][1]) >= _FEWEST_OF_A_GROUP}
    adjusted = holm([fisher_exact(*pair) for pair in tested.values()])
    for (name, (inside, outside)), p in sorted(zip(tested.items(), adjusted, strict=True), key=lambda item: item[1]):
        if p >= LEVEL or outside[0] / outside[1] - inside[0] / inside[1] < _HARDER_POINTS:
            continue
        members = groups[name] - mastered
        yield Finding(
            name="harder_group",
            subject=name.split()[-1],
            statement=(
                f"Scenarios {name} are harder: {inside[0]} of {inside[1]} reach the goal, {outside[0]} of {outside[1]} "
                f"of the others (Fisher's exact test, Holm p {p_figure(p)})."
            ),
            figures={
                "reached": inside[0],
                "of": inside[1],
                "reached_by_others": outside[0],
                "of_others": outside[1],
                "p_holm": p,
            },
            run_ids=_ids(record for record in runs.failures if runs.root(record) in members),
            alternatives="something that goes with it, such as density: see the correlations with it held fixed",
            next_step="analyze_results breakdown=obstacle_class",
        )


_FEWEST_OF_A_GROUP = 4
"""Fewest scenarios per side; with fewer, an exact test finds little (chosen)."""


def _two_groups(members: set[str], seen: set[str], mastered: set[str]) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return (mastered, total) inside and outside a group."""
    inside, outside = members & seen, seen - members
    return (len(inside & mastered), len(inside)), (len(outside & mastered), len(outside))


_HARD = "the goal cannot be reached, or the prediction misses what happens there"
_REFUSED_AT_GOAL = "the ego reaches the goal, but CommonRoad's benchmark refuses the motion for the reason in each run"
"""Possible explanations of scenarios that always fail."""


def _hard_scenarios(evidence: Evidence) -> Iterator[Finding]:
    """Yield the scenarios that failed under every one of two or more configurations: better weights will not help.

    Scenarios are left out if all their failures are attributed to other road users that follow a recording.
    """
    runs = evidence.runs
    by_scenario: dict[str, list[RunRecord]] = {}
    for record in runs.valid:
        by_scenario.setdefault(record.scenario_id, []).append(record)
    tried = {key: records for key, records in by_scenario.items() if len({r.config_id for r in records}) > 1}
    hard = {key: records for key, records in tried.items() if not any(map(reached_goal, records))}
    fair = {key: records for key, records in hard.items() if not all(map(evidence.is_others_fault, records))}
    if not fair:
        return
    names = sorted(fair)
    shown = ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")
    others = len(hard) - len(fair)
    apart = f" ({others} more by collisions that others caused or that no reference driver prevents)" if others else ""
    ended = {record.outcome for records in fair.values() for record in records}
    why, following = (
        (_REFUSED_AT_GOAL, f"analyze_results results=[{fair[names[0]][0].run_id}]")
        if ended == {"goal_refused"}
        else (_HARD, f"describe_scenario scenario_id={names[0]} detail=checks")
    )
    yield Finding(
        name="hard_scenarios",
        statement=f"{len(fair)} of {len(tried)} scenarios failed under every configuration tried{apart}: {shown}.",
        figures={"scenarios": len(fair), "of": len(tried), "by_others": others},
        run_ids=_ids(record for key in names for record in fair[key]),
        alternatives=why,
        next_step=following,
    )


def _ids(records: Iterable[RunRecord]) -> tuple[str, ...]:
    return tuple(record.run_id for record in records)


def _suggestion(runs: RunSet, config_id: str, weight: str, *, lower: bool = False) -> Suggestion | None:
    """Return the suggestion to raise (or lower) a weight of a configuration, or None if its value is unknown."""
    value = runs.weights(config_id).get(weight)
    if value is None or (lower and value == 0):
        return None
    direction = "lower" if lower else "raise"
    return Suggestion(config_id=config_id, weight=weight, direction=direction, why=f"it is {value:g} now", value=value)


_Find = Callable[[Evidence], Iterable[Finding]]
_OF_ONE_CONFIGURATION: tuple[_Find, ...] = (_main_failure, _unseen, _unforeseen, _late, _rejecting_constraint)
"""Findings that count runs of any configuration: with several, each is stated for one configuration at a time."""
FINDINGS: tuple[_Find, ...] = (
    _main_failure,
    _weight_off,
    _unseen,
    _unforeseen,
    _harder_group,
    _late,
    _own_doing,
    _weak_obstacle_cost,
    _rejecting_constraint,
    _near_misses,
    _uncomfortable_turns,
    _dominating_cost,
    _idle_weights,
    _hard_scenarios,
)
"""The findings in the order in which they are stated."""
