"""Compare A with B, paired per scenario (or its edited version), problem, prediction, traffic and seed.

The scenario is the unit of all tests (``statistics.py``). Success is tested by McNemar's exact test or, if scenarios
have several pairs, by flipping the signs of scenarios; each metric is tested by Wilcoxon's signed-rank test on the
scenarios' means. All p values of one answer are adjusted together (``_with_holm``), including those between the sides
of a ranking. Headline, table and ranking therefore cannot contradict each other. The verdict states what happened, then
what the tests show about it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, islice
from statistics import median
from typing import Literal

from ...schemas.analysis.comparison import (
    CompareRequest,
    CompareResultsResult,
    Comparison,
    EditedPair,
    Flip,
    HeadlineCode,
    MetricsCode,
    MetricTest,
    PairedRun,
    RankedSide,
    Side,
    Stratum,
    SuccessTest,
    UncomparedCost,
    WeightChange,
)
from ...schemas.errors import InvalidRequest, NotPossible
from ...schemas.measures import metric_words
from ...schemas.planning import PlannerSettings
from ...schemas.results import ConfigWeights, MetricName
from ...schemas.runs import Lineage, RunRecord, configuration_id
from ...schemas.text import counted, figure, measured, p_figure, p_in_words
from ..execution import ProgressReporter
from .moments import contact_of, review
from .run_set import METRICS, MetricSpec, RunSet, reached_goal
from .statistics import FEWEST_PAIRS, LEVEL, cluster_means, holm, needed_scenarios, paired_shares, signed_rank

_CONDITIONS = ("prediction", "traffic", "seed", "world")
"""The conditions that paired runs share in addition to scenario and problem."""
_MARGIN = 0.10
"""Ten points of success (chosen): two planners that differ by less are alike for most purposes."""
_EXPLAINED = 6
"""Number of flips with an examined collision (chosen): each reads its scenario, and an answer has 50 s."""
_CHECKED = 8
"""Number of runs listed as evidence for a headline (chosen)."""
_LISTED_EDITED = 10
"""Number of pairs by lineage for which the structured answer lists the edits (chosen)."""
_COST: MetricName = "mean_total_cost"
_Pairs = Sequence[tuple[RunRecord, RunRecord]]
"""(before, after) of each pair."""


def compare(request: CompareRequest, report: ProgressReporter) -> CompareResultsResult:
    """Compare every side with the first side, or the pairs of sides that the request gives.

    Raises:
        NotPossible: there are fewer than two sides, or they have no pair in common.
        InvalidRequest: a side contains the same problem twice.
    """
    sides = request.sides
    if len(sides) < 2:
        raise NotPossible(
            f"there is nothing to compare '{sides[0].label if sides else 'nothing'}' with",
            next_step="give two runs or batches, or one batch with several configurations",
        )
    runs = RunSet(request.runs, request.configs, request.scenarios, request.lineage)
    records = {record.run_id: record for record in runs.records}
    couples = request.couples or tuple((0, place) for place in range(1, len(sides)))
    drafts, unrelated = list[_Draft](), list[str]()
    for number, (first, second) in enumerate(couples):
        try:
            drafts.append(_drafted(sides[first], sides[second], runs, records, request))
        except NotPossible:
            if not request.couples or (number + 1 == len(couples) and not drafts):
                raise
            unrelated.append(f"{sides[second].label} and {sides[first].label} have no problem in common")
        report((number + 1) / (len(couples) + 1), f"{sides[second].label} against {sides[first].label}")
    lineages = {lineage.scenario_id: lineage for lineage in runs.lineage}
    ranked = list(combinations(range(len(sides)), 2)) if len(sides) > 2 and not request.couples else []
    others = {
        couple: _success(_pair(sides[couple[0]], sides[couple[1]], records, lineages).pairs, runs)
        for couple in ranked
        if couple not in couples
    }
    own: list[SuccessTest | MetricTest] = []
    for draft in drafts:
        own += [draft.success, *draft.metrics]
    adjusted = iter(_with_holm([*own, *others.values()]))
    comparisons = [_finished(draft, adjusted, runs, request) for draft in drafts]
    tests = {couple: one.success for couple, one in zip(couples, comparisons, strict=False)}
    tests |= {couple: test for couple, test in zip(others, adjusted, strict=True) if isinstance(test, SuccessTest)}
    report(1.0, "compared")
    return CompareResultsResult(
        sides=sides,
        comparisons=tuple(comparisons),
        ranking=_ranking(sides, runs, records, {couple: tests[couple] for couple in ranked}) if ranked else (),
        notes=(*unrelated, *_notes(request), *_across_rules(request, records)),
    )


def _is_shown(test: "SuccessTest") -> bool:
    """Return True if both the exact test (after Holm's adjustment) and the interval show a difference in success."""
    if test.p_holm is None or test.low is None or test.high is None:
        return False
    return test.p_holm < LEVEL and not test.low <= 0 <= test.high


def _ranking(
    sides: Sequence[Side], runs: RunSet, records: dict[str, RunRecord], tests: Mapping[tuple[int, int], SuccessTest]
) -> tuple[RankedSide, ...]:
    """Rank the sides by success; adjusted tests of each pair of sides decide which are tied."""
    worse: dict[int, list[int]] = {}
    for (first, second), test in tests.items():
        if _is_shown(test):
            loser, winner = (first, second) if (test.difference or 0) > 0 else (second, first)
            worse.setdefault(loser, []).append(winner)
    ranked = [
        RankedSide(
            label=side.label,
            rank=1 + len(worse.get(index, [])),
            success=runs.rate(one for run_id in side.run_ids if (one := records[run_id]).outcome != "invalid"),
            worse_than=tuple(sides[winner].label for winner in worse.get(index, [])),
        )
        for index, side in enumerate(sides)
    ]
    return tuple(sorted(ranked, key=lambda side: (side.rank, -(side.success.share or 0.0))))


@dataclass(frozen=True)
class _Draft:
    """A comparison before its tests are adjusted: the pairing, and the tests of success and of each metric."""

    sides: tuple[Side, Side]
    pairing: "_Pairing"
    success: SuccessTest
    metrics: tuple[MetricTest, ...]


def _drafted(before: Side, after: Side, runs: RunSet, records: dict[str, RunRecord], request: CompareRequest) -> _Draft:
    """Pair two sides and test them; return the comparison before its tests are adjusted.

    Raises:
        NotPossible: they have no problem in common.
    """
    pairing = _pair(before, after, records, {lineage.scenario_id: lineage for lineage in request.lineage})
    if not pairing.pairs and not pairing.invalid:
        raise _nothing_shared(before, after, records)
    incomparable = before.config_id != after.config_id or any(
        name.startswith(("prediction", "world")) for name in pairing.differing
    )
    specs = [spec for spec in METRICS if _is_requested(spec, request, incomparable=incomparable)]
    metrics = tuple(_metric(spec, pairing.pairs, runs) for spec in specs)
    return _Draft((before, after), pairing, _success(pairing.pairs, runs), metrics)


def _finished(
    draft: _Draft, adjusted: "Iterator[SuccessTest | MetricTest]", runs: RunSet, request: CompareRequest
) -> Comparison:
    """Complete a draft comparison with its adjusted tests, which are the next ones in the iterator."""
    (before, after), pairing = draft.sides, draft.pairing
    own = list(islice(adjusted, 1 + len(draft.metrics)))
    (success,) = (test for test in own if isinstance(test, SuccessTest))
    metrics = [_judged(test, pairing.pairs) for test in own if isinstance(test, MetricTest)]
    lineages = {lineage.scenario_id: lineage for lineage in request.lineage}
    strata = _strata(pairing.pairs)
    edited = [pair for pair in pairing.pairs if pair[0].scenario_id != pair[1].scenario_id]
    to_success = [pair for pair in pairing.pairs if _mastered(pair) == (False, True)]
    to_failure = [pair for pair in pairing.pairs if _mastered(pair) == (True, False)]
    return Comparison(
        before=before.label,
        after=after.label,
        success=success,
        metrics=tuple(metrics),
        cost=_cost(pairing, (before, after), metrics, request),
        to_success=tuple(_flip(pair, runs, i) for i, pair in enumerate(to_success[: request.limit])),
        to_success_count=len(to_success),
        to_failure=tuple(_flip(pair, runs, i) for i, pair in enumerate(to_failure[: request.limit])),
        to_failure_count=len(to_failure),
        weights=_weight_changes(before.config_id, after.config_id, request.configs),
        conditions=(*pairing.differing, *_versions(before, after)),
        unpaired=pairing.unpaired,
        invalid_pairs=pairing.invalid,
        strata=strata,
        headline_code=_headline_code(success, pairing.pairs, strata),
        metrics_code=_metrics_code(metrics),
        verdict=_verdict(success, metrics, pairing.pairs, strata),
        run_ids=_evidence([*to_success, *to_failure], metrics, pairing.pairs),
        run_count=2 * len(pairing.pairs),
        least_differing=FEWEST_PAIRS,
        paired=_paired(before, after, pairing),
        edited=tuple(_edited(pair, lineages) for pair in edited[:_LISTED_EDITED]),
        edited_count=len(edited),
        single=_single(pairing.pairs[0], request) if len(pairing.pairs) == 1 else None,
    )


def _versions(before: Side, after: Side) -> tuple[str, ...]:
    """Return a note if the two sides used different versions of the same planner, else an empty tuple."""
    versions = (before.planner_version, after.planner_version)
    if (
        "" in versions
        or versions[0] == versions[1]
        or before.config_name.split(":")[0] != after.config_name.split(":")[0]
    ):
        return ()
    return (f"planner version: {versions[0]} → {versions[1]}",)


def _paired(before: Side, after: Side, pairing: "_Pairing") -> str:
    """Return a note on the paired configurations if the sides come from two results."""
    if before.result_id == after.result_id:
        return ""
    named = [f"{side.config_name} of {side.result_id}" for side in (before, after)]
    scenarios = len({pair[0].scenario_id for pair in pairing.pairs})
    same = f"{len(pairing.pairs)} {'pair' if len(pairing.pairs) == 1 else 'pairs'} on {scenarios} common "
    return f"{named[0]} (baseline) with {named[1]}: {same}{'scenario' if scenarios == 1 else 'scenarios'}"


def _evidence(flipped: _Pairs, metrics: Sequence[MetricTest], pairs: _Pairs) -> tuple[str, ...]:
    """Return runs as evidence for a headline: those that flipped, else the pairs that differ most, else the first."""
    clearest = [pair for one in metrics if one.run_ids for pair in pairs if pair[0].run_id == one.run_ids[0]]
    chosen = {pair[0].run_id: pair for pair in (flipped or clearest or pairs)}
    return tuple(record.run_id for pair in list(chosen.values())[: _CHECKED // 2] for record in pair)


_HORIZON = "horizon_s"


def _cost(
    pairing: "_Pairing", sides: tuple[Side, Side], tested: Sequence[MetricTest], request: CompareRequest
) -> UncomparedCost | None:
    """Return the two sides' costs if they are not comparable; None if they were compared or a side has no cost."""
    if any(one.name == _COST and one.pairs for one in tested) or (request.metrics and _COST not in request.metrics):
        return None
    changed = {one.weight: one for one in _weight_changes(sides[0].config_id, sides[1].config_id, request.configs)}
    costs = [[one.metrics.mean_total_cost for one in runs if one.metrics] for runs in zip(*pairing.pairs, strict=True)]
    first, second = ([cost for cost in runs if cost is not None] for runs in costs or ([], []))
    if not first or not second:
        return None
    if _HORIZON in changed:
        plans = f"{figure(changed[_HORIZON].before)} and {figure(changed[_HORIZON].after)} s"
        why = f"the plans last {plans}, and cost terms add up over the plan"
    elif len({configuration_id(side.config_id) for side in sides}) > 1:
        why = "the configurations use different weights or settings"
    elif len({side.config_id for side in sides}) > 1:
        why = "another version of the planner may weigh the terms differently"
    elif any(name.startswith("prediction") for name in pairing.differing):
        why = "the predictions differ"
    elif any(name.startswith("world") for name in pairing.differing):
        why = "the costs count the road users that the sensors report, and the worlds differ"
    else:
        why = "no pair reaches the goal on both sides"
    return UncomparedCost(before=median(first), after=median(second), why=why)


def _notes(request: CompareRequest) -> tuple[str, ...]:
    notes = []
    if _COST in request.metrics and len({side.config_id for side in request.sides}) > 1:
        notes.append("mean_total_cost depends on the weights and is not comparable across configurations")
    return tuple(notes)


def _across_rules(request: CompareRequest, records: dict[str, RunRecord]) -> tuple[str, ...]:
    """Return a note if the sides' runs were judged by different success rules."""
    rules = {side.label: sorted({records[run_id].success_rule for run_id in side.run_ids}) for side in request.sides}
    if len({rule for named in rules.values() for rule in named}) < 2:
        return ()
    used = ", ".join(f"{label} by {' and '.join(named)}" for label, named in rules.items())
    difference = (
        "driven@1 counts a goal after any motion, accepted@2 only one that CommonRoad's benchmark accepts, and "
        "accepted@3 one with an initial state outside the lanelets too"
    )
    again = "rerun the older side before you compare rates"
    return (f"different success rules: {used}; {difference}: {again}",)


def _weight_changes(before: str, after: str, configs: Sequence[ConfigWeights]) -> tuple[WeightChange, ...]:
    """Return the weights and settings that differ, by name; empty if one of the configurations is unknown.

    The value is None for a weight that the planner does not have, for a setting without a default, and for a vehicle
    that is not stated, because the ego's class then decides.
    """
    given = {name for config in configs if config.config_id in (before, after) for name in config.settings}
    given -= {"vehicle"}
    defaults = {name: value for name, value in PlannerSettings().model_dump(exclude_none=True).items() if name in given}
    known = {config.config_id: config.weights | defaults | config.settings for config in configs}
    if before not in known or after not in known:
        return ()
    first, second = known[before], known[after]
    return tuple(
        WeightChange(weight=name, before=first.get(name), after=second.get(name))
        for name in sorted({*first, *second})
        if first.get(name) != second.get(name)
    )


def _success(pairs: _Pairs, runs: RunSet) -> SuccessTest:
    mastered = [_mastered(pair) for pair in pairs]
    only_before, only_after = mastered.count((True, False)), mastered.count((False, True))
    roots = [runs.root(before) for before, _ in pairs]
    flips = [int(after) - int(before) for before, after in mastered]
    shares = paired_shares(zip(roots, flips, strict=True)) if pairs else None
    unclear = shares is not None and shares.p >= LEVEL and not -_MARGIN <= shares.low <= shares.high <= _MARGIN
    return SuccessTest(
        pairs=len(pairs),
        scenarios=len(set(roots)),
        differing=sum(mean != 0 for mean in cluster_means(zip(roots, flips, strict=True))),
        both=mastered.count((True, True)),
        only_before=only_before,
        only_after=only_after,
        neither=mastered.count((False, False)),
        difference=shares.difference if shares else None,
        low=shares.low if shares else None,
        high=shares.high if shares else None,
        p=shares.p if shares else None,
        p_holm=None,
        needed=needed_scenarios((only_before + only_after) / len(pairs), _MARGIN) if unclear else None,
    )


def _mode(record: RunRecord) -> str:
    """Return text such as ``lane/reactive``, followed by the world if it is imperfect."""
    world = [] if record.world.is_perfect else [record.world.in_words()]
    return "/".join([record.prediction, record.traffic, *world])


def _strata(pairs: _Pairs) -> tuple[Stratum, ...]:
    """Return the pairs grouped by prediction, traffic mode and world; empty if all pairs are in one group."""
    groups: dict[str, list[tuple[bool, bool]]] = {}
    for pair in pairs:
        groups.setdefault(_mode(pair[1]), []).append(_mastered(pair))
    if len(groups) < 2:
        return ()
    return tuple(
        Stratum(
            name=name,
            pairs=len(mastered),
            only_before=mastered.count((True, False)),
            only_after=mastered.count((False, True)),
            difference=(mastered.count((False, True)) - mastered.count((True, False))) / len(mastered),
        )
        for name, mastered in sorted(groups.items())
    )


def _metric(spec: MetricSpec, pairs: _Pairs, runs: RunSet) -> MetricTest:
    kept = [pair for pair in pairs if _counts(spec, pair)]
    values = [(runs.root(pair[0]), spec.value(pair[0]), spec.value(pair[1])) for pair in kept]
    defined = [(root, first, second) for root, first, second in values if first is not None and second is not None]
    means = cluster_means((root, spec.difference(first, second)) for root, first, second in defined)
    test = signed_rank(means) if means else None
    return MetricTest(
        name=spec.name,
        unit=spec.unit,
        pairs=len(defined),
        scenarios=len(means),
        basis=spec.basis,
        median_before=median(first for _, first, _ in defined) if defined else None,
        median_after=median(second for _, _, second in defined) if defined else None,
        shift=test.shift if test else None,
        low=test.low if test else None,
        high=test.high if test else None,
        effect=test.effect if test else None,
        p=test.p if test and test.pairs >= FEWEST_PAIRS else None,
        p_holm=None,
        better=None,
        higher=sum(mean > 0 for mean in means),
        lower=sum(mean < 0 for mean in means),
        direction=_direction(spec, *defined[0][1:]) if len(pairs) == 1 and defined else None,
    )


def _direction(spec: MetricSpec, before: float, after: float) -> Literal["better", "worse", "same", "changed"]:
    """Return the direction from before to after; values that agree in the three displayed digits count as equal."""
    if spec.difference(before, after) == 0 or figure(before) == figure(after):
        return "same"
    if spec.better is None:
        return "changed"
    return "better" if (after > before) == (spec.better == "higher") else "worse"


def _edited(pair: tuple[RunRecord, RunRecord], lineages: Mapping[str, Lineage]) -> EditedPair:
    """Return the edits in which a pair's scenarios differ; the two scenarios were edited from a common ancestor."""
    before, after = (_lineage(record, lineages) for record in pair)
    shared = 0
    for first, second in zip(before.edits, after.edits, strict=False):
        if first != second:
            break
        shared += 1
    ancestors = (after.scenario_id, *after.ancestors)
    common = next(name for name in (before.scenario_id, *before.ancestors) if name in ancestors)
    return EditedPair(
        before=before.scenario_id,
        after=after.scenario_id,
        common=common,
        undone=before.edits[shared:],
        done=after.edits[shared:],
    )


def _lineage(record: RunRecord, lineages: Mapping[str, Lineage]) -> Lineage:
    own = lineages.get(record.scenario_id)
    return own if own is not None else Lineage(scenario_id=record.scenario_id, ancestors=(), edits=())


def _single(pair: tuple[RunRecord, RunRecord], request: CompareRequest) -> tuple[PairedRun, PairedRun]:
    """Return both runs of the only pair, with their outcomes and reviews."""
    runs = RunSet(request.runs, request.configs, request.scenarios)
    before, after = (
        PairedRun(run_id=one.run_id, outcome=one.outcome, reason=one.reason, review=review(runs, one)) for one in pair
    )
    return before, after


def _with_holm(tests: "Sequence[SuccessTest | MetricTest]") -> "list[SuccessTest | MetricTest]":
    """Return the tests of one answer with Holm's adjustment within success and within the metrics.

    These two families share the level evenly (Bonferroni), so an answer with many metrics can still show a difference
    in success. At most 5% of the answers in which nothing differs report a difference. A test that cannot fall below 5
    %, regardless of the signs of its differences, is not counted and has no adjusted p (Tarone 1990, "A modified
    Bonferroni method for discrete data").
    """
    families = [
        [place for place, test in enumerate(tests) if isinstance(test, kind) and _can_show(test)]
        for kind in (SuccessTest, MetricTest)
    ]
    share = sum(bool(family) for family in families)
    done = list(tests)
    for family in families:
        adjusted = holm([p for place in family if (p := tests[place].p) is not None])
        for place, p in zip(family, adjusted, strict=True):
            done[place] = tests[place].model_copy(update={"p_holm": min(1.0, share * p)})
    return done


def _can_show(test: "SuccessTest | MetricTest") -> bool:
    """Return True if enough scenarios differ for the test to be significant at all."""
    differing = test.differing if isinstance(test, SuccessTest) else test.higher + test.lower
    return test.p is not None and differing >= FEWEST_PAIRS


_SPECS = {spec.name: spec for spec in METRICS}


def _judged(test: MetricTest, pairs: _Pairs) -> MetricTest:
    """Return the test; if it shows a difference, add the better side and the pair with the largest difference."""
    if not _is_significant(test):
        return test
    spec, shift = _SPECS[test.name], test.shift or 0.0
    better: Literal["before", "after"] | None = None
    if spec.better is not None:
        better = "after" if (shift > 0) == (spec.better == "higher") else "before"

    def moved(pair: tuple[RunRecord, RunRecord]) -> float:
        before, after = spec.value(pair[0]), spec.value(pair[1])
        return 0.0 if before is None or after is None else (after - before) * (1 if shift > 0 else -1)

    most = max((pair for pair in pairs if _counts(spec, pair)), key=moved)
    return test.model_copy(update={"better": better, "run_ids": (most[0].run_id, most[1].run_id)})


def _is_significant(test: MetricTest) -> bool:
    """Return True if a metric's difference is significant (Holm), exceeds the metric's resolution, and has an interval
    without 0.
    """
    if test.p_holm is None or test.shift is None:
        return False
    return test.p_holm < LEVEL and _excludes_zero(test) and abs(test.shift) > _SPECS[test.name].tolerance


def _excludes_zero(test: MetricTest) -> bool:
    """Return True if the interval of the shift does not include 0."""
    return test.low is not None and test.high is not None and not test.low <= 0 <= test.high


def _counts(spec: MetricSpec, pair: tuple[RunRecord, RunRecord]) -> bool:
    """Return True if the metric is compared on this pair."""
    return spec.basis == "valid" or _mastered(pair) == (True, True)


def _is_requested(spec: MetricSpec, request: CompareRequest, *, incomparable: bool) -> bool:
    if request.metrics:
        return spec.name in request.metrics
    return not (spec.within_one_configuration and incomparable)


def _mastered(pair: tuple[RunRecord, RunRecord]) -> tuple[bool, bool]:
    """Return whether the run before and the run after reached the goal."""
    return reached_goal(pair[0]), reached_goal(pair[1])


def _flip(pair: tuple[RunRecord, RunRecord], runs: RunSet, place: int) -> Flip:
    before, after = pair
    failed = after if reached_goal(before) else before
    contact = contact_of(runs, failed) if failed.collision is not None and place < _EXPLAINED else None
    return Flip(
        scenario_id=before.scenario_id,
        before=before.outcome,
        after=after.outcome,
        before_run=before.run_id,
        after_run=after.run_id,
        after_scenario_id="" if after.scenario_id == before.scenario_id else after.scenario_id,
        why="" if contact is None else contact.in_words(),
        contact=contact,
    )


def _nothing_shared(before: Side, after: Side, records: dict[str, RunRecord]) -> NotPossible:
    """Return the refusal of two sides without a pair; it states in what they differ."""
    sides = [[records[run_id] for run_id in side.run_ids] for side in (before, after)]
    scenarios = [sorted({record.scenario_id for record in side}) for side in sides]
    if set(scenarios[0]).isdisjoint(scenarios[1]):
        rule, differing = ("only runs on one scenario, or on a single edited version of it, can be paired", scenarios)
    else:
        rule = "only runs of the same planning problem under the same conditions can be paired"
        differing = [
            sorted(
                {f"{record.scenario_id}#{record.problem_id}, {_mode(record)}, seed {record.seed}" for record in side}
            )
            for side in sides
        ]
    where = [f"{side.label} ran on {_some(names)}" for side, names in zip((before, after), differing, strict=True)]
    is_same = before.config_id == after.config_id
    return NotPossible(
        f"{rule}; {', and '.join(where)}",
        next_step=f"run {'another configuration' if is_same else 'both configurations'} on the same scenarios with "
        "run_planner, or use analyze_results",
    )


def _some(names: Sequence[str]) -> str:
    """Return the first two names, and how many more there are."""
    return " and ".join([*names[:2], *([f"{len(names) - 2} more"] if len(names) > 2 else [])])


@dataclass(frozen=True)
class _Pairing:
    """Pairs (before, after) in the order of their scenarios, with counts of what could not be paired.

    ``invalid``: pairs in which a run could not be attempted; ``differing``: conditions in which the sides as a whole
    differ, such as ``prediction: constant_velocity → ground_truth``.
    """

    pairs: tuple[tuple[RunRecord, RunRecord], ...]
    unpaired: int
    invalid: int
    differing: tuple[str, ...]


def _pair(before: Side, after: Side, records: dict[str, RunRecord], lineages: Mapping[str, Lineage]) -> _Pairing:
    """Pair runs on the same scenario and planning problem under the same prediction, traffic mode, world and seed.

    A condition that has one value in all runs of one side and a different value in all runs of the other side is the
    subject of the comparison: it is left out of the key and reported. The remaining runs are paired by lineage: each
    with the only run of the opposite side on a scenario with the same root. If there are several candidates, the run
    stays unpaired.

    Raises:
        InvalidRequest: a side contains two runs of the same problem under the same conditions.
    """
    sides = [[records[run_id] for run_id in side.run_ids] for side in (before, after)]
    differing = tuple(name for name in _CONDITIONS if _differ_as_a_whole(name, *sides))
    shared_conditions = tuple(name for name in _CONDITIONS if name not in differing)
    first, second = (
        _by_key(side.label, side_records, shared_conditions)
        for side, side_records in zip((before, after), sides, strict=True)
    )
    shared = sorted(first.keys() & second.keys(), key=repr)
    both = [(first[key], second[key]) for key in shared]
    alone = [[record for key, record in side.items() if key not in shared] for side in (first, second)]
    both += _by_lineage(alone[0], alone[1], lineages, shared_conditions)
    valid = tuple(pair for pair in both if "invalid" not in (pair[0].outcome, pair[1].outcome))
    return _Pairing(
        pairs=valid,
        unpaired=len(first) + len(second) - 2 * len(both),
        invalid=len(both) - len(valid),
        differing=tuple(f"{name}: {_shown(name, sides[0][0])} → {_shown(name, sides[1][0])}" for name in differing),
    )


def _shown(condition: str, record: RunRecord) -> str:
    """Return the condition of a run as an argument states it."""
    return record.world.in_words() if condition == "world" else str(getattr(record, condition))


def _by_lineage(
    before: Sequence[RunRecord],
    after: Sequence[RunRecord],
    lineages: Mapping[str, Lineage],
    conditions: tuple[str, ...],
) -> list[tuple[RunRecord, RunRecord]]:
    """Return pairs of runs on scenarios with the same root; each run is its side's only run for that root."""

    def by_root(records: Sequence[RunRecord]) -> dict[tuple[object, ...], list[RunRecord]]:
        groups: dict[tuple[object, ...], list[RunRecord]] = {}
        for record in records:
            root = _lineage(record, lineages).root
            key = (root, record.problem_id, *(getattr(record, name) for name in conditions))
            groups.setdefault(key, []).append(record)
        return groups

    first, second = by_root(before), by_root(after)
    shared = sorted(first.keys() & second.keys(), key=repr)
    return [(first[key][0], second[key][0]) for key in shared if len(first[key]) == len(second[key]) == 1]


def _differ_as_a_whole(condition: str, first: list[RunRecord], second: list[RunRecord]) -> bool:
    before, after = ({getattr(record, condition) for record in side} for side in (first, second))
    return len(before) == 1 and len(after) == 1 and before != after


def _by_key(label: str, side: list[RunRecord], conditions: tuple[str, ...]) -> dict[tuple[object, ...], RunRecord]:
    by_key: dict[tuple[object, ...], RunRecord] = {}
    for record in side:
        key = (record.scenario_id, record.problem_id, *(getattr(record, name) for name in conditions))
        other = by_key.setdefault(key, record)
        if other.run_id != record.run_id:
            raise InvalidRequest(
                f"{label} contains both {other.run_id} and {record.run_id} on {record.scenario_id}",
                next_step="compare batches, or give single runs",
            )
    return by_key


def _headline_code(success: SuccessTest, pairs: _Pairs, strata: Sequence[Stratum]) -> HeadlineCode:
    """Return the ``HeadlineCode`` that summarises what the pairs show about success."""
    if not pairs:
        return "no_valid_pair"
    if len(pairs) == 1:
        before, after = _mastered(pairs[0])
        return "one_pair_same" if before == after else "one_pair_better" if after else "one_pair_worse"
    if _is_shown(success):
        if _turned(success, strata):
            return "mixed"
        return "better" if (success.difference or 0) > 0 else "worse"
    if success.only_before + success.only_after == 0:
        return "tie"
    if _is_alike(success):
        return "alike"
    return "flips_too_few" if success.differing < FEWEST_PAIRS else "no_difference_shown"


def _is_alike(test: SuccessTest) -> bool:
    """Return True if the interval of the difference is within ± the margin."""
    return test.low is not None and test.high is not None and -_MARGIN <= test.low <= test.high <= _MARGIN


def _metrics_code(metrics: Sequence[MetricTest]) -> MetricsCode:
    """Return the ``MetricsCode`` for the metrics that differ significantly."""
    if all(test.p is None for test in metrics):
        return "untested"
    telling = [test for test in metrics if _is_significant(test)]
    sides = {test.better for test in telling} - {None}
    if not sides:
        return "changed" if telling else "none"
    return "mixed" if len(sides) == 2 else "better" if "after" in sides else "worse"


def _verdict(success: SuccessTest, metrics: Sequence[MetricTest], pairs: _Pairs, strata: Sequence[Stratum]) -> str:
    """Return what happened and what the tests show: success first, then the metrics that differ."""
    code = _headline_code(success, pairs, strata)
    if code == "no_valid_pair":
        return "No valid pair to compare."
    if len(pairs) == 1:
        return _about_one(pairs[0])
    return " ".join([_about_success(code, success), *_about_strata(success, strata), *_about_metrics(success, metrics)])


def _about_one(pair: tuple[RunRecord, RunRecord]) -> str:
    """Return what a single pair shows; its metrics are listed separately, because no test supports them."""
    only = "one pair supports no general conclusion."
    mastered = _mastered(pair)
    if mastered[0] != mastered[1]:
        return f"{'better' if mastered[1] else 'worse'} here: {pair[0].outcome} → {pair[1].outcome}; {only}"
    return f"same outcome: {'both reach the goal' if mastered[1] else _both_fail(pair)}; {only}"


def _both_fail(pair: tuple[RunRecord, RunRecord]) -> str:
    before, after = pair[0].outcome, pair[1].outcome
    return f"{before} in both" if before == after else f"neither reaches the goal ({before} → {after})"


def _about_success(code: HeadlineCode, test: SuccessTest) -> str:
    """Return the flips, and then the result of the exact test."""
    fact = _flipped(test)
    if code in ("better", "worse", "mixed"):
        return f"{code.capitalize()}: {fact}."
    if _is_alike(test):
        return f"{fact}; the success rates differ by less than {100 * _MARGIN:.0f} percentage points (95%)."
    if test.scenarios < FEWEST_PAIRS:
        return f"{fact}; too few {'pairs' if test.scenarios == test.pairs else 'scenarios'} for a test."
    if code == "flips_too_few":
        return f"{fact}; too few flips for a test, which needs {FEWEST_PAIRS} scenarios that differ."
    enough = f"about {test.needed} scenarios are needed to show a difference of {100 * _MARGIN:.0f} percentage points"
    if code == "tie":
        return f"{fact}; {enough}."
    if test.p is not None and test.p < LEVEL:
        alone = f"{p_in_words(test.p)} alone, {p_figure(test.p_holm)} adjusted for all tests (Holm)"
        return f"{fact}; this may be chance ({alone})."
    return f"{fact}; chance alone often gives such a difference ({p_in_words(test.p)}); {enough}."


def _flipped(test: SuccessTest) -> str:
    """Return text such as ``3 of 4 pairs flipped to success, 1 to failure``, or that no pair flipped."""
    if test.only_after == test.only_before == 0:
        return f"success differs in 0 of {counted(test.pairs, 'pair')}"
    if test.only_after == 0:
        return f"{test.only_before} of {test.pairs} pairs flipped to failure"
    back = f", {test.only_before} to failure" if test.only_before else ""
    return f"{test.only_after} of {test.pairs} pairs flipped to success{back}"


def _turned(test: SuccessTest, strata: Sequence[Stratum]) -> list[str]:
    """Return the strata in which the difference has the opposite sign."""
    whole = test.difference or 0.0
    return [stratum.name for stratum in strata if stratum.difference * whole < 0]


def _about_strata(test: SuccessTest, strata: Sequence[Stratum]) -> list[str]:
    """Return a warning if the difference changes sign in some of the strata."""
    turned = _turned(test, strata)
    unrelated = {stratum.difference > 0 for stratum in strata if stratum.difference}
    if turned:
        return [f"The sign is opposite under {', '.join(turned)}: the difference depends on the mix."]
    return ["The sign differs between predictions or traffic modes: see the strata."] if len(unrelated) > 1 else []


def _about_metrics(success: SuccessTest, metrics: Sequence[MetricTest]) -> list[str]:
    """Return sentences on the metrics that differ, with the better side, and on those that differ in some scenarios."""
    telling = [test for test in metrics if _is_significant(test)]
    sides = {"after": " (better)", "before": " (worse)", None: ""}
    words = [
        f"{metric_words(test.name)} {'rises' if (test.shift or 0) > 0 else 'falls'} by {measured(abs(test.shift or 0))}"
        f"{'' if test.unit == '1' else f' {test.unit}'}{sides[test.better]}"
        for test in telling
    ]
    sentences = [f"After Holm's adjustment, these metrics differ: {'; '.join(words)}."] if words else []
    differing = [test for test in metrics if test.p_holm is not None and test.p_holm < LEVEL and test not in telling]
    small = [test for test in differing if _excludes_zero(test)]
    few = [test for test in differing if test not in small]
    if few:
        sentences.append(
            f"These differ in some scenarios, but the interval of the shift includes 0: {_counted_by_sign(few)}."
        )
    if small:
        sentences.append(f"The shift of these does not exceed their resolution: {_counted_by_sign(small)}.")
    if sentences:
        return sentences
    tested = [test for test in metrics if test.p is not None]
    return ["No metric differs significantly."] if tested and success.pairs >= FEWEST_PAIRS else []


def _counted_by_sign(tests: Sequence[MetricTest]) -> str:
    """Return each metric with the number of scenarios in which it rises and falls."""
    return "; ".join(f"{metric_words(one.name)} (higher in {one.higher}, lower in {one.lower})" for one in tests)
