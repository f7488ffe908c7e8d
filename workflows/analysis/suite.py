"""Run test suites of planners: their scenarios and configurations, the runs, and the verdicts on limits.

The runs are those of ``run_planner``. Stored runs are found again, so an interrupted suite resumes.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...engine.analysis import Judged, Limit, parse_limit
from ...engine.tuning import from_file, read_weight_file
from ...engine.workspace import Workspace
from ...schemas.analysis.comparison import CompareRequest, Side, SuccessTest
from ...schemas.analysis.suite import (
    FAILED_OUTCOMES,
    LimitVerdict,
    Suite,
    SuiteBaseline,
    SuiteCase,
    SuiteConfiguration,
    SuiteFiles,
    SuiteProgress,
    SuiteReport,
    SuiteWeightFile,
)
from ...schemas.artifacts import ImportFilesArguments
from ...schemas.catalog import FindScenariosArguments
from ...schemas.errors import Faults, InvalidRequest, NotPossible, PlannerForgeError, UnknownName, closest
from ...schemas.planning import PlannerConfiguration
from ...schemas.reviews import RunReview
from ...schemas.runs import BatchRecord, ReviewRequest, RunRecord, RunSource, ending
from ...schemas.text import counted, is_utf8, quoted, shown_name
from ..catalog import find_scenarios
from ..configurations import resolve_configuration, store_configuration
from ..context import WorkflowContext
from ..critical_scenarios import generate_scenarios
from ..importing import import_files
from ..operations import COMPARE, REVIEW_RUNS
from ..planners import configure_planner
from ..results import lineages, run_sources, scenario_sources
from ..runs import Cell, CellResult, run_grid, store_batch
from ..scenarios import choose_scenarios

_AT_ONCE = 20
"""How many runs one operation reviews (chosen): each reads its scenario, and an operation has 50 s."""
ReportProgress = Callable[[int, int, str], None]
"""Receives the number of finished runs, the total, and the current activity."""


def limits_of(suite: Suite) -> list[Limit]:
    """Return the limits, including a default limit on lost runs, because a gate cannot judge lost runs.

    Raises:
        InvalidRequest, UnknownName: there are invalid limits; all are reported together.
    """
    faults, limits = Faults(), []
    for text in suite.limits:
        with faults.collecting():
            limits.append(parse_limit(text))
    faults.raise_all()
    limits_lost = any(limit.text.startswith("lost") for limit in limits)
    return limits if limits_lost else [*limits, parse_limit("lost == 0")]


async def carry_out(suite: Suite, folder: Path, context: WorkflowContext, report: ReportProgress) -> SuiteReport:
    """Run a suite and judge its limits.

    Args:
        suite: the runs and limits.
        folder: the base of its relative paths.
        context: the resources, with a workspace and workers.
        report: receives the progress.

    Raises:
        PlannerForgeError: a scenario, configuration or baseline is missing; no run has started.
    """
    limits = limits_of(suite)
    report(0, 0, "looking up scenarios and configurations")
    configurations = await _configurations(suite, folder, context)
    _check_names(limits, configurations)
    baselines = {limit.baseline: _baseline(limit.baseline, folder, context) for limit in limits if limit.baseline}
    words, notes = await _scenarios(suite, folder, context)
    choice = choose_scenarios(words, context)
    cells = [
        Cell(one.scenario_id, one.problem_id, configuration, suite.prediction, suite.traffic, suite.seed, suite.world)
        for configuration in configurations.values()
        for one in choice.scenarios
    ]
    results = await _run(context, cells, report)
    report(len(cells), len(cells), "judging")
    groups = {
        name: results[i * len(choice.scenarios) :][: len(choice.scenarios)] for i, name in enumerate(configurations)
    }
    reviews = await _reviews(context, [record for result in results if (record := result.record) is not None])
    batch = store_batch(context, cells, results)
    verdicts = await _verdicts(limits, groups, reviews, baselines, context)
    return SuiteReport(
        suite=suite.name,
        batch_id=batch.batch_id,
        cases=tuple(_case(name, cells, i, result, reviews) for i, (name, result) in enumerate(_named(groups))),
        verdicts=tuple(verdicts),
        reused=sum(result.reused for result in results),
        lost=batch.lost,
        notes=(*notes, *choice.notes, *_other_versions(groups, baselines)),
        progress=tuple(_progress(groups, baselines)),
        runs=SuiteBaseline(
            suite=suite.name,
            configurations={
                name: tuple(result.record for result in group if result.record is not None)
                for name, group in groups.items()
            },
        ),
    )


def _other_versions(groups: Mapping[str, Sequence[CellResult]], baselines: Mapping[str, "_Baseline"]) -> Iterable[str]:
    """Yield a sentence for each configuration with another planner version in a baseline."""
    for name, group in groups.items():
        now = {one.record.planner_version for one in group if one.record is not None} - {""}
        for word, baseline in baselines.items():
            before = {source.record.planner_version for source in baseline.of(name)} - {""}
            if before and now and before != now:
                yield f"{name}: {', '.join(sorted(before))} ran in {word}, {', '.join(sorted(now))} now"


def _progress(
    groups: Mapping[str, Sequence[CellResult]], baselines: Mapping[str, "_Baseline"]
) -> Iterable[SuiteProgress]:
    """Yield for each configuration and baseline which scenarios' failures are fixed, left or new."""
    for name, group in groups.items():
        now = {_pair(one.record): one.record.outcome in FAILED_OUTCOMES for one in group if one.record is not None}
        for word, baseline in baselines.items():
            before = {_pair(source.record): source.record.outcome in FAILED_OUTCOMES for source in baseline.of(name)}
            changes = [(key[0], before[key], fails) for key, fails in now.items() if key in before]
            if changes:
                yield SuiteProgress(
                    configuration=name,
                    baseline=word,
                    fixed=tuple(test for test, failed, fails in changes if failed and not fails),
                    still_failing=tuple(test for test, failed, fails in changes if failed and fails),
                    newly_failing=tuple(test for test, failed, fails in changes if fails and not failed),
                )


_Pair = tuple[str, int]


def _pair(record: RunRecord) -> _Pair:
    """Return what identifies the same test in two versions: its scenario and planning problem."""
    return record.scenario_id, record.problem_id


def _named(groups: Mapping[str, Sequence[CellResult]]) -> Iterable[tuple[str, CellResult]]:
    return ((name, result) for name, group in groups.items() for result in group)


async def _run(context: WorkflowContext, cells: Sequence[Cell], report: ReportProgress) -> list[CellResult]:
    done = 0

    def on_done(result: CellResult) -> None:
        nonlocal done
        done += 1
        ended = "lost" if result.record is None else result.record.outcome.replace("_", " ")
        report(done, len(cells), f"{result.record.scenario_id if result.record else 'a run'}: {ended}")

    report(0, len(cells), f"running {counted(len(cells), 'run')}")
    return await run_grid(context, cells, on_done)


async def _configurations(suite: Suite, folder: Path, context: WorkflowContext) -> dict[str, PlannerConfiguration]:
    """Return the configurations by their names in the suite.

    Raises:
        InvalidRequest: two of them have the same name.
        UnknownName: a weight file is missing.
    """
    found: dict[str, PlannerConfiguration] = {}
    for entry in suite.configurations:
        if isinstance(entry, SuiteConfiguration):
            made = await configure_planner(entry.arguments, context)
            configuration, name = resolve_configuration(made.config_id, context), entry.name or made.name
        elif isinstance(entry, SuiteWeightFile):
            configuration = _weight_file(entry, folder, context)
            name = entry.name or configuration.name
        else:
            configuration = resolve_configuration(entry, context)
            name = configuration.name
        if name in found:
            raise InvalidRequest(f"two configurations have the name {quoted(name)}", next_step="rename one of them")
        store_configuration(context, configuration)
        found[name] = configuration
    return found


def _weight_file(entry: SuiteWeightFile, folder: Path, context: WorkflowContext) -> PlannerConfiguration:
    path = context.allowed_path(str(folder / entry.file))
    if not path.is_file():
        raise UnknownName(
            f"there is no weight file {quoted(entry.file)} next to the suite",
            next_step="correct its path, or write one with export_artifacts, formats ['yaml'], of a configuration",
        )
    return from_file(read_weight_file(path))


def _check_names(limits: Sequence[Limit], configurations: Mapping[str, object]) -> None:
    for limit in limits:
        if limit.only and limit.only not in configurations:
            valid = closest(limit.only, list(configurations))
            raise UnknownName(f"{quoted(limit.text)} is for a configuration that is not in the suite", valid=valid)


async def _scenarios(suite: Suite, folder: Path, context: WorkflowContext) -> tuple[list[str], list[str]]:
    """Return the scenarios as ids or arguments of ``run_planner``, and notes.

    Raises:
        NotPossible: a search finds nothing, or no file could be imported.
    """
    words: list[str] = []
    notes: list[str] = []
    for entry in suite.scenarios:
        if isinstance(entry, str):
            words.append(entry)
        elif isinstance(entry, SuiteFiles):
            ids, messages = await _imported(folder / entry.path, context)
            words += ids if entry.problem is None else [f"{key}#{entry.problem}" for key in ids]
            notes += messages
        elif isinstance(entry, FindScenariosArguments):
            found = await find_scenarios(entry, context)
            if not found.matches:
                raise NotPossible(f"no scenario meets {entry.in_words()}", next_step="relax the search")
            words += [match.scenario_id for match in found.matches]
        else:
            generated = await generate_scenarios(entry, context)
            words += [scenario.scenario_id for scenario in generated.scenarios]
            notes += generated.notes
    return words, notes


async def _imported(path: Path, context: WorkflowContext) -> tuple[list[str], list[str]]:
    """Return the ids of the scenario files at a path, each imported separately, and the refusals."""
    files = (
        [path]
        if not path.is_dir()
        else sorted(file for file in path.rglob("*.xml") if ".net." not in file.name and is_utf8(str(file)))
    )
    if not files:
        raise NotPossible(f"{path} contains no CommonRoad file", valid=["*.xml"])
    ids, refused = [], []
    for file in files:
        try:
            answer = await import_files(ImportFilesArguments(path=str(file), kind="scenario"), context)
            ids += [item.artifact_id for item in answer.items]
        except PlannerForgeError as refusal:
            if len(files) == 1:
                raise
            refused.append(f"{shown_name(file.name)} was refused: {refusal.message}")
    if not ids:
        raise NotPossible(f"all files at {path} ({len(files)}) were refused: {refused[0]}")
    return ids, refused


@dataclass(frozen=True)
class _Baseline:
    """Runs of a baseline by configuration, and whether they are stored here with their steps."""

    by_configuration: Mapping[str, tuple[RunSource, ...]]

    def of(self, configuration: str) -> tuple[RunSource, ...]:
        """Return the runs of a configuration, or all runs if the baseline has only one configuration."""
        if len(self.by_configuration) == 1:
            return next(iter(self.by_configuration.values()))
        return self.by_configuration.get(configuration, ())


def _baseline(word: str, folder: Path, context: WorkflowContext) -> _Baseline:
    """Return the runs of a baseline: a file that ``--save-baseline`` wrote, or a stored batch.

    Raises:
        UnknownName: there is no such file or batch.
        InvalidRequest: the file is not a baseline.
    """
    if word.startswith("batch_"):
        return _Baseline(_by_name(word, context.workspace, context))
    path = context.allowed_path(str(folder / word))
    if not path.is_file():
        raise UnknownName(
            f"there is no baseline {quoted(word)} next to the suite",
            next_step=f"create it with: plannerforge test SUITE --save-baseline {word}",
        )
    try:
        kept = SuiteBaseline.model_validate_json(path.read_bytes())
    except ValueError as error:
        raise InvalidRequest(f"{shown_name(path.name)} is not a baseline", next_step="create it again") from error
    return _Baseline(
        {name: tuple(RunSource(record=record) for record in records) for name, records in kept.configurations.items()}
    )


def _by_name(batch_id: str, workspace: Workspace, context: WorkflowContext) -> dict[str, tuple[RunSource, ...]]:
    groups: dict[str, list[RunSource]] = {}
    for source in run_sources(workspace.get(batch_id, "batch").read(BatchRecord).runs, context):
        groups.setdefault(source.record.config_name, []).append(source)
    return {name: tuple(group) for name, group in groups.items()}


async def _reviews(context: WorkflowContext, records: Sequence[RunRecord]) -> dict[str, RunReview]:
    """Return the reviews of the runs that did not reach the goal, by run."""
    failed = [record for record in records if record.outcome not in ("goal_reached", "invalid")]
    reviews: dict[str, RunReview] = {}
    for begin in range(0, len(failed), _AT_ONCE):
        some = failed[begin : begin + _AT_ONCE]
        request = ReviewRequest(
            runs=run_sources((record.run_id for record in some), context),
            scenarios=scenario_sources((record.scenario_id for record in some), context),
        )
        response = await context.services.workers.run(REVIEW_RUNS, request)
        reviews |= {review.run_id: review for review in response.reviews}
    return reviews


async def _verdicts(
    limits: Sequence[Limit],
    groups: Mapping[str, Sequence[CellResult]],
    reviews: Mapping[str, RunReview],
    baselines: Mapping[str, _Baseline],
    context: WorkflowContext,
) -> list[LimitVerdict]:
    """Return the verdict on every limit for every configuration that it applies to."""
    verdicts = []
    for name, group in groups.items():
        records = [result.record for result in group if result.record is not None]
        own = [limit for limit in limits if limit.only in ("", name)]
        against = {
            word: await _compared(name, records, baselines[word], context)
            for word in dict.fromkeys(limit.baseline for limit in own if limit.baseline)
        }
        runs = Judged(
            configuration=name,
            records=records,
            lost=len(group) - len(records),
            unpreventable=frozenset(run_id for run_id, review in reviews.items() if _is_unpreventable(review)),
            against=against,
            roots={one.scenario_id: one.root for one in lineages((record.scenario_id for record in records), context)},
        )
        verdicts += [limit.judge(runs) for limit in own]
    return verdicts


def _is_unpreventable(review: RunReview) -> bool:
    """Return whether no reference driver prevents the collision; without a verdict it counts as preventable."""
    return review.contact is not None and review.contact.is_unpreventable


async def _compared(
    name: str, records: Sequence[RunRecord], baseline: _Baseline, context: WorkflowContext
) -> tuple[SuccessTest, tuple[str, ...]]:
    """Return the paired test of the runs against a baseline, and the scenarios that only the baseline solved."""
    before = baseline.of(name)
    now = run_sources((record.run_id for record in records), context)
    if not before or not now:
        return _UNTESTED, ()
    request = CompareRequest(
        sides=tuple(
            Side(
                label=label,
                config_id=side[0].record.config_id,
                config_name=name,
                run_ids=tuple(source.record.run_id for source in side),
            )
            for label, side in (("baseline", before), ("now", now))
        ),
        runs=tuple({source.record.run_id: source for source in (*before, *now)}.values()),
        lineage=lineages((source.record.scenario_id for source in now), context),
        limit=100,
    )
    try:
        (compared,) = (await context.run(COMPARE, request)).comparisons
    except NotPossible:  # no common scenario: the limit does not hold, with the reason
        return _UNTESTED, ()
    lost = tuple(f"{flip.after_run} on {flip.scenario_id}" for flip in compared.to_failure)
    return compared.success, lost


_UNTESTED = SuccessTest(
    pairs=0, both=0, only_before=0, only_after=0, neither=0, difference=None, low=None, high=None, p=None, p_holm=None
)


def _case(
    name: str, cells: Sequence[Cell], index: int, result: CellResult, reviews: Mapping[str, RunReview]
) -> SuiteCase:
    record, cell = result.record, cells[index]
    if record is None:
        error = result.lost.error if result.lost is not None else "no result"
        return SuiteCase(
            configuration=name,
            scenario_id=cell.scenario_id,
            problem_id=cell.problem_id,
            run_id=None,
            outcome="lost",
            ended=error,
        )
    return SuiteCase(
        configuration=name,
        scenario_id=record.scenario_id,
        problem_id=record.problem_id,
        run_id=record.run_id,
        outcome=record.outcome,
        ended=ending(record.outcome, record.reason, reviews.get(record.run_id)),
        duration_s=None if record.metrics is None else record.metrics.duration_s,
    )
