"""Generate many scenarios for a coverage plan: combinations of site types, densities, classes and turns.

A plan is a job that any server on the workspace can resume. Its rows are stored in the database before they are
generated, with the result of each. Existing scenarios in the workspace count too, including those of an earlier call
with the same ``cover``, whatever its ``count``.
"""

import logging
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import anyio

from ...engine.execution import Job, JobProgress
from ...engine.generation import TRIES, Hopeless, PlanCounts, PlanRow, PlanRows, RowState, combinations_in
from ...engine.maps import MapEntry, MapMatch
from ...schemas.errors import InvalidRequest, NotPossible, PlannerForgeError, ResourceFailure
from ...schemas.generation import (
    CannotBe,
    Combination,
    CoverageReport,
    CoverageRequest,
    GenerateScenariosArguments,
    GenerateScenariosResult,
    GenerationSpec,
    PlanRecord,
    PlanSummary,
    ScenarioType,
)
from ...schemas.jobs import JobState
from ...schemas.text import counted, one_line
from ..context import WorkflowContext
from ..operations import COUNT_SITES, PLAN_COVERAGE
from .cover_words import RequestedPlan, existing_levels, impossible_turns
from .making import make_scenario
from .map_choice import AssignedSite, nth_site, request_for

logger = logging.getLogger(__name__)
WAIT_S = 45.0
"""The call answers after this time at most (chosen to be shorter than clients wait)."""
_FIRST, _AT_ONCE = 250, 2000
"""How many rows are planned together (chosen): as many as were generated so far, within these bounds. Many rows per map
let workers read a map once, and build the network of a site once. The first batches are small, because their results
show which maps to skip."""
_ROUNDS_BEYOND = 2
"""Rounds of traffic for a row beyond full coverage (chosen; a faultless one ends them). Three more rounds, and other
sites for them, cost more than another row."""
_ROWS_READ = 64
"""How many rows are read from the database together (chosen)."""
_MOST_PASSED = 2
"""How many sites per map of a group one row may skip, on average and at most (chosen)."""
_GIVEN_UP_AFTER = 20
"""How many consecutive rows beyond full coverage may be refused before a plan ends early (chosen: with three of ten
refused, as on real maps, chance makes no such sequence)."""
_LISTED = 50
"""How many impossible and open combinations the structured answer lists (chosen)."""
_CAUSES = 3
"""How many impossible levels a refused plan names (chosen)."""
_LONGEST_REASON = 160
"""The maximum length of a refusal in the answer, in characters (chosen)."""


@dataclass(frozen=True)
class Spot:
    """A group of possible sites of a row, with the number of sites per map."""

    words: str
    maps: tuple[tuple[MapMatch, int], ...]

    def turns(
        self, turns: dict[str, int], levels: Sequence[int], hopeless: Hopeless, seed: int
    ) -> Iterator[tuple[MapMatch, int, int, RowState]]:
        """Yield the map, the site and the seed of the next rows, after those that rows with these levels skip.

        All sites take turns, with a different seed each time. Sites of a map that does not suit one of the levels are
        skipped, at most ``_MOST_PASSED`` times the number of maps, and not at all if no map suits them.

        Args:
            turns: the number of turns taken, by the words for sites; updated here.
            levels: the levels of the row.
            hopeless: levels that have failed on a map and need no further attempts.
            seed: the seed of the plan.
        """
        unfit = {
            map_id
            for match, _ in self.maps
            for map_id in [match.entry.facts.map_id]
            if any((self.words, map_id, factor, level) in hopeless for factor, level in enumerate(levels))
        }
        most = _MOST_PASSED * len(self.maps) if len(unfit) < len(self.maps) else 0
        for passed in range(most + 1):
            turn = turns.get(self.words, 0)
            turns[self.words] = turn + 1
            place, site, lap = nth_site([count for _, count in self.maps], turn)
            match = self.maps[place][0]
            if passed == most or match.entry.facts.map_id not in unfit:
                yield match, site, seed + lap, "waiting"
                return
            yield match, site, seed + lap, "passed"

    def match(self, map_id: str) -> MapMatch:
        """Return the match of one of its maps, by map id."""
        return next(match for match, _ in self.maps if match.entry.facts.map_id == map_id)


async def cover_combinations(
    arguments: GenerateScenariosArguments,
    spec: GenerationSpec,
    context: WorkflowContext,
    entries: Sequence[MapEntry],
    notes: Sequence[str],
) -> GenerateScenariosResult:
    """Continue a coverage plan up to the requested number, and answer with its progress after at most 45 s.

    Raises:
        InvalidRequest: the plan is invalid.
        UnknownName: no map contains the place.
    """
    plan = await RequestedPlan.of(arguments, spec, context, entries)
    notes = [*spec.notes, *plan.notes, *notes]
    context.made("plan", plan.plan_id)
    rows = PlanRows(context.workspace.database, plan.plan_id)
    job: Job | None = None
    refusals: list[NotPossible] = []
    if not _is_enough(plan, rows) or context.workspace.find("plan", plan.plan_id) is None:

        async def work(progress: JobProgress) -> None:
            try:
                await _PlanWork(plan, WorkflowContext(context.services), progress).carry_on()
            except NotPossible as refusal:
                refusals.append(refusal)
                raise

        job = context.start_job("plan", plan.recipe, work)
        context.made("job", job.job_id)
        job = await context.wait_for(job.job_id, WAIT_S)
    if refusals:
        raise refusals[0]
    return await _answer(plan, context, rows, job, notes)


def _is_enough(plan: RequestedPlan, rows: PlanRows) -> bool:
    return plan.wanted is not None and rows.counts().made >= plan.wanted


class _PlanWork:
    """The job of a plan: count sites, plan rows, and generate one row at a time on each worker."""

    def __init__(self, plan: RequestedPlan, context: WorkflowContext, progress: JobProgress) -> None:
        self._plan, self._call, self._progress = plan, context, progress
        self._rows = PlanRows(context.workspace.database, plan.plan_id)
        self._tally = PlanCounts()

    async def carry_on(self) -> None:
        """Generate rows until there are enough, or no more are possible."""
        self._progress.add_result(self._plan.plan_id)
        self._progress.report(0.0, "examining the maps and the workspace")
        record = await self._record()
        spots = {words: self._spot(words, group, record) for group, words in self._groups()}
        self._rows.prepare(existing_levels(self._plan, self._call))
        self._tally = self._rows.counts()
        while not self._has_enough(0):
            if not self._tally.waiting and not await self._plan_more(record, spots):
                return
            await self._make_waiting(spots)

    def _has_enough(self, under_way: int) -> bool:
        """Return whether there will be enough scenarios once those in progress are done."""
        return self._plan.wanted is not None and self._tally.made + under_way >= self._plan.wanted

    def _groups(self) -> list[tuple[dict[int, int], str]]:
        return [(group, self._plan.words(group)) for group in self._plan.of_spot()]

    def _spot(self, words: str, group: Mapping[int, int], record: PlanRecord) -> Spot:
        by_id = {match.entry.facts.map_id: match for match in self._plan.matches(group)}
        return Spot(words, tuple((by_id[map_id], count) for map_id, count in record.spots.get(words, ())))

    async def _record(self) -> PlanRecord:
        """Return the plan's record, stored or computed from the maps."""
        plan, workspace = self._plan, self._call.workspace
        stored = workspace.find("plan", plan.plan_id)
        if stored is not None:
            return stored.read(PlanRecord)
        spots: dict[str, tuple[tuple[str, int], ...]] = {}
        barred = dict(impossible_turns(plan))
        for group, words in self._groups():
            if any(set(key) <= set(group.items()) for key in barred):
                continue
            spots[words] = await self._sites(group)
            if not spots[words]:
                barred[tuple(sorted(group.items()))] = "no map there has a site like this"
        if not any(spots.values()):
            raise _no_site(plan, barred)
        record = PlanRecord(
            plan_id=plan.plan_id,
            cover=tuple(plan.recipe.arguments["cover"]),
            factors=plan.factors,
            strength=plan.strength,
            barred=tuple(barred.items()),
            spots=spots,
        )
        workspace.put("plan", record.plan_id, recipe=plan.recipe, record=record, name="; ".join(record.cover))
        return record

    async def _sites(self, group: Mapping[int, int]) -> tuple[tuple[str, int], ...]:
        """Return the maps with sites for the given levels, each with its number of sites, indexed or counted."""
        spec = self._plan.row_spec(group)
        kind, found = spec.scenario_type, []
        for match in self._plan.matches(group):
            facts = match.entry.facts
            if kind == "any" or spec.road_classes or spec.bbox is not None or match.streets or match.box:
                count = await self._counted(spec, match)
            else:
                count = facts.sites.get(kind, 0)
            if count:
                found.append((facts.map_id, count))
        return tuple(found)

    async def _counted(self, spec: GenerationSpec, match: MapMatch) -> int:
        kind: ScenarioType = spec.scenario_type
        if kind not in ("any", *match.entry.facts.sites):
            return 0
        try:
            return (await self._call.run(COUNT_SITES, request_for(spec, AssignedSite(match), 0))).count
        except NotPossible:
            return 0

    async def _plan_more(self, record: PlanRecord, spots: Mapping[str, Spot]) -> bool:
        """Plan the next rows; return False if there are enough, or no more are possible."""
        wanted = self._plan.wanted
        at_once = min(max(self._tally.made, _FIRST), _AT_ONCE)
        missing = at_once if wanted is None else min(wanted - self._tally.made, at_once)
        if _is_exhausted(self._rows):
            return False
        lap = self._rows.last_lap()
        report = await self._call.run(PLAN_COVERAGE, coverage_request(record, self._rows, lap=lap + 1, most=missing))
        if not report.rows or (not report.left and wanted is None):
            return False
        self._rows.add(self._placed(report.rows, spots, lap=0 if report.left else lap + 1))
        self._tally = self._rows.counts()
        return True

    def _placed(self, rows: Sequence[tuple[int, ...]], spots: Mapping[str, Spot], lap: int) -> Iterator[PlanRow]:
        """Yield the rows, each with a map and a site: the next site of the row's group."""
        turns, number, hopeless = self._rows.turns(), self._rows.next_number(), self._rows.hopeless(TRIES)
        saying = list(next(self._plan.of_spot()))
        for levels in rows:
            words = self._plan.words({factor: levels[factor] for factor in saying})
            for match, site, seed, state in spots[words].turns(turns, levels, hopeless, self._plan.arguments.seed):
                facts = match.entry.facts
                yield PlanRow(number, lap, levels, words, facts.place, facts.map_id, site, seed, state)
                number += 1

    async def _make_waiting(self, spots: Mapping[str, Spot]) -> None:
        """Generate all waiting rows; record the refusal of a row that fails."""
        taken: deque[PlanRow] = deque()
        begun: set[int] = set()

        def next_row() -> PlanRow | None:
            if self._has_enough(len(begun)):
                return None
            if not taken:
                taken.extend(row for row in self._rows.waiting(_ROWS_READ + len(begun)) if row.number not in begun)
            return taken.popleft() if taken else None

        async def work() -> None:
            while (row := next_row()) is not None:
                begun.add(row.number)
                state, reused = await self._make(row, spots[row.spot].match(row.map_id))
                begun.discard(row.number)
                self._tally = self._tally.after(state, reused=reused)
                self._report_progress()

        async with anyio.create_task_group() as tasks:
            for _ in range(self._call.services.workers.capacity + 1):  # one stores while the others compute
                tasks.start_soon(work)

    async def _make(self, row: PlanRow, match: MapMatch) -> tuple[RowState, bool]:
        """Generate a row's scenario, and record and return the result, with whether the scenario existed already."""
        spec = self._plan.row_spec(dict(enumerate(row.levels))).model_copy(update={"seed": row.seed})
        request = request_for(spec, AssignedSite(match, row.site_index), 0)
        if row.lap:  # everything is covered: a row that fails, or that could be better, costs more than another row
            request = request.model_copy(update={"most_sites": 1, "most_rounds": _ROUNDS_BEYOND})
        try:
            made = await make_scenario(self._call, request, (0.0, 1.0))
        except NotPossible as refusal:
            self._rows.end(row, "refused", reason=one_line(refusal.message, _LONGEST_REASON))
            return "refused", False
        except (InvalidRequest, ResourceFailure):
            raise
        except PlannerForgeError as failure:
            logger.warning("row %s of %s failed: %s", row.number, self._plan.plan_id, failure.text)
            self._rows.end(row, "failed", reason=one_line(failure.message, _LONGEST_REASON))
            return "failed", False
        self._rows.end(row, "made", scenario_id=made.scenario_id, reused=made.reused)
        return "made", made.reused

    def _report_progress(self) -> None:
        tally, wanted = self._tally, self._plan.wanted
        lost = tally.refused + tally.failed
        share = tally.made / wanted if wanted else (tally.made + lost) / max(tally.made + lost + tally.waiting, 1)
        message = f"{tally.made:,}{f' of {wanted:,}' if wanted else ''} generated, {counted(lost, 'attempt')} discarded"
        self._progress.report(min(share, 1.0), message)


def _no_site(plan: RequestedPlan, barred: Mapping[Combination, str]) -> NotPossible:
    """Return the refusal of a plan without any site: which levels are impossible, and which site types remain."""
    usual = f"scenario_type={plan.arguments.scenario_type}"
    named = {plan.words(dict(key)) or usual: why for key, why in barred.items()}
    causes = [f"{words} ({why})" for words, why in named.items()]
    more = f"; {len(causes) - _CAUSES} more" if len(causes) > _CAUSES else ""
    there = {kind for match in plan.matches({}) for kind in match.entry.facts.sites}
    return NotPossible(
        f"every combination is impossible: {'; '.join(causes[:_CAUSES])}{more}",
        valid=[f"scenario_type={kind}" for kind in plan.other_types(there)],
        next_step="use another scenario_type or place, or other levels in cover",
    )


def _is_exhausted(rows: PlanRows) -> bool:
    """Return whether everything is covered and the last rows beyond that were all refused."""
    return rows.refused_in_a_row() >= _GIVEN_UP_AFTER and rows.counts().waiting == 0


def coverage_request(record: PlanRecord, rows: PlanRows, *, lap: int, most: int) -> CoverageRequest:
    """Return the progress of a plan from the results of its rows."""
    covered = {key for levels in rows.made() for key in combinations_in(levels, record.strength)}
    refused: Counter[Combination] = Counter()
    for levels, times, _ in rows.refused():
        refused.update({key: times for key in combinations_in(levels, record.strength) if key not in covered})
    return CoverageRequest(
        factors=record.factors,
        strength=record.strength,
        barred=tuple(key for key, _ in record.barred),
        covered=tuple(sorted(covered)),
        refused=tuple(sorted(refused.items())),
        lap=lap,
        most=most,
    )


async def _answer(
    plan: RequestedPlan, context: WorkflowContext, rows: PlanRows, job: Job | None, notes: Sequence[str]
) -> GenerateScenariosResult:
    """Return the progress of the plan from its rows, which every server shares."""
    state: JobState = "done" if job is None else job.state
    stored = context.workspace.find("plan", plan.plan_id)
    messages = [*notes, *([job.error] if job is not None and job.error else []), context.services.workers.notice]
    messages = [note for note in messages if note]
    if stored is None:
        if job is not None and job.state == "failed":
            raise NotPossible(f"{job.job_id} failed: “{job.error}”")
        messages.append("the sites of the maps are being counted; no scenario exists yet")
        return GenerateScenariosResult(
            scenarios=[], notes=messages, attribution=[], plan=None, job_id=job.job_id if job else "", state=state
        )
    record = stored.read(PlanRecord)
    summary = await _summary(plan, context, record, rows)
    if state == "done" and plan.wanted is not None and summary.made < plan.wanted:
        messages += _why_fewer(summary, rows)
    ids = {map_id for maps in record.spots.values() for map_id, _ in maps}
    shown = (match.entry.facts for match in plan.matches({}))
    sources = sorted({facts.attribution for facts in shown if facts.map_id in ids})
    return GenerateScenariosResult(
        scenarios=[], notes=messages, attribution=sources, plan=summary, job_id=job.job_id if job else "", state=state
    )


def _why_fewer(summary: PlanSummary, rows: PlanRows) -> list[str]:
    """Return why the finished job of a plan made too few scenarios; its figures tell if all are impossible."""
    if not summary.allowed:
        return []
    if _is_exhausted(rows):
        return [f"no more are possible: the last {_GIVEN_UP_AFTER} rows were all refused"]
    return ["the previous job had a smaller count: repeat this call to continue"]


async def _summary(plan: RequestedPlan, context: WorkflowContext, record: PlanRecord, rows: PlanRows) -> PlanSummary:
    report = await context.run(PLAN_COVERAGE, coverage_request(record, rows, lap=0, most=0))
    counts = rows.counts()
    cannot = [*record.barred, *zip(report.cannot, _reasons(report, record, rows), strict=True)]
    return PlanSummary(
        plan_id=record.plan_id,
        strength=record.strength,
        asked=plan.wanted,
        made=counts.made,
        reused=counts.reused,
        refused=counts.refused,
        failed=counts.failed,
        waiting=counts.waiting,
        allowed=report.allowed,
        covered=report.covered,
        left_total=len(report.left),
        left=tuple(plan.words(dict(key)) for key in report.left[:_LISTED]),
        cannot_total=len(cannot),
        cannot=tuple(CannotBe(combination=plan.words(dict(key)), reason=why) for key, why in cannot[:_LISTED]),
        places=dict(list(rows.places().items())[:_LISTED]),
    )


def _reasons(report: CoverageReport, record: PlanRecord, rows: PlanRows) -> list[str]:
    """Return the reason why each combination is impossible: a refusal of a row with it, or an impossible part."""
    reasons: dict[Combination, str] = {}
    tries: Counter[Combination] = Counter()
    for levels, times, reason in rows.refused():
        for key in combinations_in(levels, record.strength):
            reasons.setdefault(key, reason)
            tries[key] += times
    return [
        f"{reasons[key]}; {tries[key]} tries"
        if tries[key] >= TRIES
        else "possible only together with an impossible combination"
        for key in report.cannot
    ]
