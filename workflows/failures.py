"""Search a scenario's surroundings for failures of a planner.

A search is a job. Every evaluated batch is stored, so an interrupted search, or a search with a larger budget,
continues where the last one stopped. The failures that it finds are ordinary edited scenarios with their runs.
"""

from collections.abc import Awaitable, Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import anyio

from ..engine.execution import JobProgress
from ..engine.planners import check_modes, check_world
from ..engine.workspace import Recipe, append_text, versions_of, write_text
from ..schemas.base import Model
from ..schemas.errors import NotPossible
from ..schemas.exploration import EncounterSetting, Evaluation, LogicalScenario
from ..schemas.failures import (
    EvaluatedPoint,
    FailureCell,
    FailureSearchRecord,
    FindFailuresArguments,
    FindFailuresResult,
    FoundFailure,
    ProposalsRequest,
    SearchSpace,
    ShrinkRequest,
    ShrunkFailure,
    SpacePointsRequest,
    SpaceRequest,
)
from ..schemas.modification import Edit, ModifyScenarioArguments
from ..schemas.planning import PlannerConfiguration
from ..schemas.text import counted
from ..schemas.worlds import world_of
from .boundaries import EXPLORED_FOLDER
from .configurations import resolve_configuration, store_configuration
from .context import WorkflowContext
from .modification import base_and_edits, modified_once
from .operations import EVALUATE_IN_SPACE, OPEN_SPACE, PROPOSE_POINTS, SHRINK_FAILURE
from .runs import Cell, CellResult, own_versions, run_cell, store_batch
from .scenarios import one_scenario

_TOOL = "find_failures"
_OPENING = 0.1
"""The share of a search's progress that the derivation of its space gets."""
_FOUND = "_found.json"
"""The end of the name of a finished search's record."""
_SEARCH = 3
"""The version of the search: another version proposes other points, so it cannot go on from stored ones."""
_MOST_TRIED = 6
"""A search ends after this many proposals per run, if most are implausible (chosen)."""


Report = Callable[[float, str], Awaitable[None]]
"""Receives the share that is done, and what is being done."""


class _Batch(Model):
    """A batch of a search, numbered from 0: one line of the file of evaluated points."""

    number: int
    points: tuple[EvaluatedPoint, ...]


@dataclass
class _Search:
    """A search in progress.

    ``digest`` identifies everything that determines its points, but not its budget. ``stored``: the runs of the
    failures stored so far, by id. ``is_whole``: the file of evaluated points is undamaged, so that batches can be
    appended.
    """

    arguments: FindFailuresArguments
    context: WorkflowContext
    scenario_id: str
    configuration: PlannerConfiguration
    setting: EncounterSetting
    digest: str
    space: SearchSpace | None = None
    batches: list[_Batch] = field(default_factory=list)
    stored: dict[str, tuple[Cell, CellResult]] = field(default_factory=dict)
    is_whole: bool = False

    @property
    def points(self) -> list[EvaluatedPoint]:
        """The evaluated points, in the order of their proposal."""
        return [point for batch in self.batches for point in batch.points]

    @property
    def runs(self) -> int:
        """The number of runs made."""
        return sum(point.score.value is not None for point in self.points)

    @property
    def path(self) -> Path:
        """The file of evaluated points: a line with the search space, then a line for each batch."""
        return self.context.workspace.root / EXPLORED_FOLDER / f"{self.digest}.jsonl"

    def cells(self, points: Sequence[EvaluatedPoint]) -> dict[FailureCell, list[EvaluatedPoint]]:
        """Return the failures among points by cell, in the order in which they were found."""
        cells: dict[FailureCell, list[EvaluatedPoint]] = {}
        for point in points:
            if point.score.cell is not None:
                cells.setdefault(point.score.cell, []).append(point)
        return cells

    @property
    def within_budget(self) -> list[EvaluatedPoint]:
        """The points up to the budget, or up to the first failure if that ends the search."""
        used, taken = 0, list[EvaluatedPoint]()
        for point in self.points:
            taken.append(point)
            used += point.score.value is not None
            if used >= self.arguments.runs or (self.arguments.until_first and point.score.cell is not None):
                break
        return taken

    @property
    def is_done(self) -> bool:
        """Whether the budget is used up, or the first failure was found if that ends the search."""
        if self.arguments.until_first and any(point.score.cell is not None for point in self.within_budget):
            return True
        return self.runs >= self.arguments.runs or len(self.points) >= _MOST_TRIED * self.arguments.runs

    def resume(self) -> None:
        """Read the points that an earlier search stored, up to a damaged line: later points depend on earlier ones.

        Two searches that ran at once may both have appended the same batch; the second one is passed over.
        """
        stored = self.path.read_bytes() if self.path.is_file() else b""
        lines = stored.splitlines(keepends=True)
        with suppress(ValueError):
            for number, line in enumerate(lines):
                if number == 0:
                    self.space = SearchSpace.model_validate_json(line)
                    continue
                batch = _Batch.model_validate_json(line)
                if batch.number > len(self.batches):
                    return
                if batch.number == len(self.batches):
                    self.batches.append(batch)
            self.is_whole = stored.endswith(b"\n")

    def keep(self) -> None:
        """Store the last batch; write the file anew if it is missing or damaged."""
        if self.space is None:
            return
        if self.is_whole and self.batches:
            append_text(self.path, f"{self.batches[-1].model_dump_json()}\n", "the search")
            return
        _write(self.path, (self.space, *self.batches), self.context)
        self.is_whole = True

    async def open(self, report: Report) -> SearchSpace:
        """Return the search space, from an earlier search or derived now.

        Raises:
            NotPossible: the planner fails in the unchanged base, or nothing plausible can be varied.
        """
        self.resume()
        if self.space is None:

            async def forward(share: float, message: str) -> None:
                await report(_OPENING * share, message)

            request = SpaceRequest(setting=self.setting, base_id=self.scenario_id)
            self.space = await self.context.services.workers.run(OPEN_SPACE, request, on_progress=forward)
            self.keep()
        self.check()
        return self.space

    def check(self) -> None:
        """Refuse a base that is known to be useless.

        Raises:
            NotPossible: the planner fails in the unchanged base, or nothing plausible can be varied.
        """
        if self.space is not None:
            _check(self.space, self.scenario_id, self.configuration.name)

    async def run(self, progress: JobProgress) -> FailureSearchRecord:
        """Search until the budget is used, store the failures, and return the record."""

        async def report(share: float, message: str) -> None:
            progress.report(share, message)

        space = await self.open(report)
        await self.search(space, report)
        return await self._record(space, progress)

    async def search(self, space: SearchSpace, report: Report) -> None:
        """Evaluate points until the budget is used, and store each batch."""
        while not self.is_done:
            await self.evaluate_batch(space)
            self.keep()
            share = min(self.runs / self.arguments.runs, 1.0)
            found = len(self.cells(self.points))
            await report(
                _OPENING + (0.9 - _OPENING) * share,
                f"{self.runs} of {self.arguments.runs} runs, {counted(found, 'distinct failure')}",
            )

    async def evaluate_batch(self, space: SearchSpace) -> None:
        """Propose one batch, and evaluate it on all workers."""
        sizes = tuple((stratum.name, len(stratum.parameters)) for stratum in space.strata)
        scores = tuple(one.score for one in self.points)
        proposed = await self.context.services.workers.run(
            PROPOSE_POINTS, ProposalsRequest(strata=sizes, seed=self.arguments.seed, scores=scores)
        )
        workers = max(min(self.context.services.workers.capacity, len(proposed.points)), 1)
        parts = [proposed.points[begin::workers] for begin in range(workers)]
        done: dict[int, tuple[EvaluatedPoint, ...]] = {}

        async def evaluate(number: int) -> None:
            named = {point.stratum for point in parts[number]}
            strata = tuple(stratum for stratum in space.strata if stratum.name in named)
            request = SpacePointsRequest(
                setting=self.setting, strata=strata, points=parts[number], recorded=space.recorded, drive=space.drive
            )
            done[number] = (await self.context.services.workers.run(EVALUATE_IN_SPACE, request)).points

        async with anyio.create_task_group() as tasks:
            for number in range(workers):
                tasks.start_soon(evaluate, number)
        points = (done[index % workers][index // workers] for index in range(len(proposed.points)))
        self.batches.append(_Batch(number=len(self.batches), points=tuple(points)))

    async def _record(self, space: SearchSpace, progress: JobProgress) -> FailureSearchRecord:
        points = self.within_budget
        numbers: dict[FailureCell, int] = {}
        used = 0
        for point in points:
            used += point.score.value is not None
            if point.score.cell is not None:
                numbers.setdefault(point.score.cell, used)
        store_configuration(self.context, self.configuration)
        failures = []
        for cell, hits in self.cells(points).items():
            failure = await self._stored(space, cell, hits, numbers[cell])
            failures.append(failure)
            progress.add_result(failure.run_id)
            progress.report(0.9, f"{len(failures)} of {len(numbers)} failures stored")
        return FailureSearchRecord(
            base_id=self.scenario_id,
            config_id=self.configuration.config_id,
            config_name=self.configuration.name,
            runs=used,
            implausible=sum(point.evaluation.outcome == "implausible" for point in points),
            unavoidable=sum(point.evaluation.outcome == "failed_unavoidably" for point in points),
            strata=tuple(stratum.name for stratum in space.strata),
            failures=tuple(failures),
            batch_id=self.together(failures),
            world=self.setting.world.in_words(),
        )

    async def _stored(
        self, space: SearchSpace, cell: FailureCell, hits: Sequence[EvaluatedPoint], number: int
    ) -> FoundFailure:
        """Store the clearest failure of a cell as a scenario with its run."""
        best = min(hits, key=lambda hit: hit.score.value or 0.0)
        stratum = next(one for one in space.strata if one.name == best.point.stratum)
        scenario_id, run_id = await self.store(best.edits)
        shrunk = None
        if self.arguments.shrink:
            request = ShrinkRequest(setting=self.setting, stratum=stratum, point=best.point, recorded=space.recorded)
            reduced = await self.context.run(SHRINK_FAILURE, request)
            small_id, small_run = await self.store(reduced.edits)
            parameters = {parameter.name: parameter for parameter in stratum.parameters}
            shrunk = ShrunkFailure(
                scenario_id=small_id,
                run_id=small_run,
                edits=reduced.edits,
                road_users_before=reduced.road_users_before,
                road_users=reduced.road_users,
                lanelets_before=reduced.lanelets_before,
                lanelets=reduced.lanelets,
                needed=tuple(parameters[name].stated(reduced.values[name]) for name in reduced.needed),
                runs=reduced.runs,
                is_minimal=reduced.is_minimal,
            )
        values = _values(stratum, best)
        return FoundFailure(
            scenario_id=scenario_id,
            run_id=run_id,
            cell=cell,
            change=_change(stratum, best),
            values=values,
            edits=best.edits,
            reason=best.evaluation.reason,
            time_s=best.evaluation.time_s,
            prevented_by=best.evaluation.avoided_by,
            found_after=number,
            hits=len(hits),
            shrunk=shrunk,
        )

    async def store(self, edits: Sequence[Edit]) -> tuple[str, str]:
        """Store an edited scenario and the planner's run on it, and return their ids."""
        arguments = ModifyScenarioArguments(
            scenario_id=self._base, edits=list(edits), on_conflict="refuse", seed=self.arguments.seed
        )
        made = await modified_once(arguments, self.context)
        scenario_id = str(made.scenario_id)
        cell = Cell(
            scenario_id,
            self.setting.problem_id,
            self.configuration,
            self.arguments.prediction,
            self.arguments.traffic,
            self.arguments.seed,
            self.setting.world,
        )
        result = await run_cell(self.context, cell)
        run_id = "" if result.record is None else result.record.run_id
        self.stored[run_id] = cell, result
        self.context.made("run", run_id)
        return scenario_id, run_id

    def together(self, failures: Sequence[FoundFailure]) -> str | None:
        """Store the runs of the failures, of the reduced ones if there are some, as a batch, and return its id."""
        runs = dict.fromkeys(one.run_id if one.shrunk is None else one.shrunk.run_id for one in failures)
        made = [self.stored[run_id] for run_id in runs if run_id in self.stored]
        if not made:
            return None
        batch = store_batch(self.context, [cell for cell, _ in made], [result for _, result in made])
        self.context.made("batch", batch.batch_id)
        return batch.batch_id

    @property
    def _base(self) -> str:
        problem = self.setting.problem_id
        return self.scenario_id if problem is None else f"{self.scenario_id}#{problem}"


def _values(stratum: LogicalScenario, found: EvaluatedPoint) -> dict[str, float]:
    """Return the parameters of a point by name."""
    return {
        parameter.name: round(parameter.at_share(share), 4)
        for parameter, share in zip(stratum.parameters, found.point.shares, strict=True)
    }


def _change(stratum: LogicalScenario, found: EvaluatedPoint) -> str:
    """Return text such as ``a car ahead brakes (deceleration 5 m/s², …)``."""
    values = _values(stratum, found)
    return f"{stratum.summary} ({', '.join(one.stated(values[one.name]) for one in stratum.parameters)})"


@dataclass(frozen=True)
class Encounter:
    """A point near a base: the change in words, its edits, how the planner fares, and the runs that found it."""

    change: str
    edits: tuple[Edit, ...]
    evaluation: Evaluation
    runs: int

    @property
    def has_failed(self) -> bool:
        """Whether the planner fails here although a careful driver would not."""
        return self.evaluation.outcome == "failed_avoidably"


async def most_critical(
    arguments: FindFailuresArguments, context: WorkflowContext, report: Report, *, failures: bool
) -> Encounter | None:
    """Search near a base, and return the encounter with the least margin; nothing but the evaluated points is stored.

    Args:
        arguments: those of the search; ``shrink`` has no effect.
        context: the resources of the workflow.
        report: receives the share that is done, and what is being done.
        failures: whether avoidable failures count; they are more critical than any margin.

    Returns:
        The encounter, or None if no point has this property.

    Raises:
        NotPossible: the planner fails in the unchanged base, or nothing plausible can be varied.
        InvalidRequest: the prediction does not fit the traffic or the world, or the planner does not fit the world.
    """
    search = _search(arguments, context)
    space = await search.open(report)
    await search.search(space, report)
    outcomes = ("safe", "failed_avoidably") if failures else ("safe",)
    candidates = [
        point
        for point in search.within_budget
        if point.score.value is not None and point.evaluation.outcome in outcomes
    ]
    if not candidates:
        return None
    best = min(candidates, key=lambda point: point.score.value or 0.0)
    stratum = next(one for one in space.strata if one.name == best.point.stratum)
    return Encounter(_change(stratum, best), best.edits, best.evaluation, search.runs)


def _check(space: SearchSpace, scenario_id: str, planner: str) -> None:
    if space.base.outcome in ("implausible", "invalid"):
        raise NotPossible(
            f"{planner} cannot be run in the unchanged {scenario_id}: {space.base.reason}",
            reason=f"base_{space.base.outcome}",
            next_step="choose another scenario; describe_scenario with detail 'checks' describes the state of this one",
        )
    if space.base.has_failed or space.base.outcome != "safe":
        raise NotPossible(
            f"{planner} already fails in the unchanged {scenario_id}: {space.base.reason}",
            reason=f"base_{space.base.outcome}",
            next_step="choose a scenario that it passes; run_planner and analyze_results explain this failure",
        )
    if not space.strata:
        raise NotPossible(
            f"nothing in {scenario_id} can be varied plausibly: no road user comes near, and no road user can be added",
            reason="no_variation",
            next_step="choose a scenario with more room or traffic",
        )


def _search(arguments: FindFailuresArguments, context: WorkflowContext) -> _Search:
    artifact, problem = one_scenario(arguments.scenario_id, context)
    configuration = resolve_configuration(arguments.config, context)
    world = world_of(arguments.world)
    check_modes(arguments.traffic, arguments.prediction, world)
    check_world(configuration.planner, world)
    base_id, earlier = base_and_edits(artifact)
    setting = EncounterSetting(
        xml=context.workspace.file("scenario", base_id, "scenario.xml"),
        configuration=configuration,
        problem_id=problem,
        earlier=earlier,
        traffic=arguments.traffic,
        prediction=arguments.prediction,
        world=world,
        seed=arguments.seed,
        horizon_s=arguments.horizon_s,
    )
    without_budget = _recipe(
        arguments.model_copy(update={"runs": 1, "until_first": False, "shrink": False}),
        artifact.artifact_id,
        problem,
        configuration,
    )
    return _Search(arguments, context, artifact.artifact_id, configuration, setting, without_budget.digest)


def _recipe(
    arguments: FindFailuresArguments, scenario_id: str, problem: int | None, configuration: PlannerConfiguration
) -> Recipe:
    world = world_of(arguments.world)
    return Recipe(
        tool=_TOOL,
        arguments={
            "scenario": scenario_id,
            "search": _SEARCH,
            "problem": problem,
            "config": configuration.config_id,
            "runs": arguments.runs,
            "until_first": arguments.until_first,
            "shrink": arguments.shrink,
            "horizon_s": arguments.horizon_s,
            "prediction": arguments.prediction,
            "traffic": arguments.traffic,
            **({} if world.is_perfect else {"world": world.stated}),
        },
        parents=(scenario_id, configuration.config_id),
        seed=arguments.seed,
        versions=versions_of("frenetix", "commonroad-io", "commonroad-drivability-checker", "libsumo", "numpy", "scipy")
        | own_versions([configuration.planner]),
    )


async def find_failures(arguments: FindFailuresArguments, context: WorkflowContext) -> FindFailuresResult:
    """Search, or return the failures that the same search found; while it runs, answer with its job.

    Raises:
        NotPossible: the planner fails in the unchanged base, or nothing plausible can be varied.
        InvalidRequest: the prediction does not fit the traffic or the world, or the planner does not fit the world.
    """
    search = _search(arguments, context)
    recipe = _recipe(arguments, search.scenario_id, search.setting.problem_id, search.configuration)

    async def work(progress: JobProgress) -> None:
        # What the job makes on the way is not the client's latest.
        apart = WorkflowContext(replace(context.services, recent=context.services.recent.copied()))
        done = await _search(arguments, apart).run(progress)
        _keep_record(done, recipe, apart)
        progress.report(1.0, f"{counted(len(done.failures), 'distinct failure')}; repeat the call for the results")

    record = _kept_record(recipe, context)
    if record is None:
        job = context.start_job("exploration", recipe, work)
        context.made("job", job.job_id)
        job = await context.wait_for(job.job_id, arguments.wait_s)
        record = _kept_record(recipe, context)
        if record is None:
            if job.state == "failed":
                # The refusal of a useless base answers the call with its code, not only as the job's text.
                search.resume()
                search.check()
            return FindFailuresResult(
                state=job.state,
                job_id=job.job_id,
                message=job.error or job.message,
                next_step=f"get_job with job_id '{job.job_id}', then repeat find_failures: evaluated runs are kept",
            )
    for failure in reversed(record.failures):  # an answer links what was made last
        context.made("scenario", failure.scenario_id)
        context.made("run", failure.run_id)
    if record.batch_id is not None:  # it lists all failures, of which an answer links only some
        context.made("batch", record.batch_id)
    following = (
        f"render ids=['{record.failures[0].run_id}'], or export_artifacts with ids ['{record.batch_id}'] and formats "
        "['suite'] to test later versions"
        if record.failures
        else "repeat with more runs, reactive traffic or another scenario"
    )
    return FindFailuresResult(state="done", search=record, next_step=following)


def found_failures(context: WorkflowContext) -> dict[str, FailureCell]:
    """Return the cells of the failures that searches found, by the ids of their scenarios and of the reduced ones."""
    cells: dict[str, FailureCell] = {}
    for path in sorted((context.workspace.root / EXPLORED_FOLDER).glob(f"*{_FOUND}")):
        with suppress(ValueError):  # a damaged file
            for one in FailureSearchRecord.model_validate_json(path.read_bytes()).failures:
                cells[one.scenario_id] = one.cell
                if one.shrunk is not None:
                    cells[one.shrunk.scenario_id] = one.cell
    return cells


def _record_path(recipe: Recipe, context: WorkflowContext) -> Path:
    return context.workspace.root / EXPLORED_FOLDER / f"{recipe.digest}{_FOUND}"


def _kept_record(recipe: Recipe, context: WorkflowContext) -> FailureSearchRecord | None:
    """Return the record of a finished search, or None if it is missing or one of its scenarios or runs is gone."""
    path = _record_path(recipe, context)
    if not path.is_file():
        return None
    try:
        record = FailureSearchRecord.model_validate_json(path.read_bytes())
    except ValueError:  # a damaged file: the search itself is kept apart
        return None
    stored = all(
        context.workspace.find("scenario", one.scenario_id) and context.workspace.find("run", one.run_id)
        for one in record.failures
    )
    return record if stored else None


def _keep_record(record: FailureSearchRecord, recipe: Recipe, context: WorkflowContext) -> None:
    """Store the record of a finished search."""
    _write(_record_path(recipe, context), (record,), context)


def _write(path: Path, lines: Iterable[Model], context: WorkflowContext) -> None:
    """Write a file of the workspace, replacing an earlier version as a whole.

    Raises:
        ResourceFailure: the disk is full.
    """
    with context.workspace.scratch() as folder:
        made = folder / path.name
        write_text(made, "".join(f"{line.model_dump_json()}\n" for line in lines), "the search")
        path.parent.mkdir(parents=True, exist_ok=True)
        made.replace(path)
