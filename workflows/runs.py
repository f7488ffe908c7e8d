"""Run the cells of a grid: one scenario's problem with one configuration each, run in a worker and stored.

A grid is a job. It continues after the call's answer and ends in a batch artifact. A cell's recipe is claimed while it
runs, so that overlapping batches and servers do not run it twice.
"""

import logging
import math
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import anyio

from ..engine.execution import JobProgress
from ..engine.planners import PLANNERS, planner_version
from ..engine.vehicles import MODEL_WORDS, ego_class, hardest_braking_mps2
from ..engine.workspace import Recipe, versions_of, write_text
from ..schemas.errors import InvalidRequest, NotPossible, PlannerForgeError, UnexpectedFailure
from ..schemas.jobs import JobState
from ..schemas.planning import (
    LISTED_FAILURES,
    LISTED_RUNS,
    ConfigurationSummary,
    PlannerConfiguration,
    RunLine,
    RunMoment,
    RunPlannerResult,
    RunRequest,
    RunResponse,
)
from ..schemas.reviews import RuleVerdict, RunReview
from ..schemas.runs import (
    BatchRecord,
    LostCell,
    Prediction,
    ReviewRequest,
    RunRecord,
    RunSteps,
    Traffic,
    excesses_in_words,
)
from ..schemas.scenarios import ScenarioRecord
from ..schemas.text import counted, shown_name
from ..schemas.worlds import PERFECT, World
from .configurations import resolve_configuration
from .context import Question, WorkflowContext
from .operations import REVIEW_RUNS, RUN_PLANNER
from .results import run_sources, scenario_sources, version_key

_SHOWN_BEYOND = _SHOWN_TRIGGERS = 3
"""How many runs a note lists (chosen)."""
_CLAIM_POLL_S = 0.1
"""How often to check for a run that another call or server makes (chosen)."""
MANY_RUNS = 200
"""The number of runs above which the user is asked (chosen: a quarter of an hour at some seconds per run on two
workers)."""
GO_ON, DO_NOT = "go on", "do not"
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Cell:
    """One run to make. A ``problem_id`` of None means the first planning problem."""

    scenario_id: str
    problem_id: int | None
    configuration: PlannerConfiguration
    prediction: Prediction = "constant_velocity"
    traffic: Traffic = "recorded"
    seed: int = 0
    world: World = PERFECT

    @property
    def scenario(self) -> str:
        """The scenario in the notation of a call: its id, with ``#`` and the planning problem if one is given."""
        return self.scenario_id if self.problem_id is None else f"{self.scenario_id}#{self.problem_id}"

    def recipe(self) -> Recipe:
        """Return the recipe of the run. Its digest is the run's id."""
        own = planner_version(self.configuration.planner)
        simulator = ["libsumo"] if self.traffic == "reactive" else []
        return Recipe(
            tool="run_planner",
            arguments={
                "scenario": self.scenario_id,
                "problem": self.problem_id,
                "config": self.configuration.config_id,
                "prediction": self.prediction,
                "traffic": self.traffic,
                **_world_argument(self.world),
            },
            parents=(self.scenario_id, self.configuration.config_id),
            seed=self.seed,
            versions=versions_of("frenetix", "commonroad-io", "commonroad-drivability-checker", *simulator)
            | ({self.own_planner: own} if own else {}),
        )

    @property
    def own_planner(self) -> str:
        """The planner's name in recipes if it is external."""
        return version_key(self.configuration.planner)


def _world_argument(world: World) -> dict[str, dict[str, float | str]]:
    """Return the recipe's argument for a world; empty for a perfect world, so that older ids stay valid."""
    return {} if world.is_perfect else {"world": world.stated}


@dataclass(frozen=True)
class CellResult:
    """A finished cell: its run, or its error; ``reused`` if the run was already stored."""

    record: RunRecord | None
    lost: LostCell | None = None
    reused: bool = False


async def run_cell(context: WorkflowContext, cell: Cell, *, notify_client: bool = False) -> CellResult:
    """Return the run of a cell: a stored one, or a new one, possibly from another call or server.

    Raises:
        PlannerForgeError: the scenario cannot be read, or the worker died or exceeded its time limit.
    """
    while True:
        result = await _attempt(context, cell, notify_client=notify_client)
        if result is not None:
            return result
        await anyio.sleep(_CLAIM_POLL_S)


async def run_grid(
    context: WorkflowContext, cells: Sequence[Cell], on_done: Callable[[CellResult], None]
) -> list[CellResult]:
    """Return the results of all cells, in order; one cell at a time runs on each worker.

    A cell that fails (a broken file, a dead or late worker, a full disk) is lost, and the others continue. A cell that
    another batch or server is running is checked again later.
    """
    results: list[CellResult | None] = [None] * len(cells)
    waiting = deque(enumerate(cells))

    async def work() -> None:
        while waiting:
            index, cell = waiting.popleft()
            result = await _isolated(context, cell)
            if result is None:
                waiting.append((index, cell))
                await anyio.sleep(_CLAIM_POLL_S)
                continue
            results[index] = result
            on_done(result)

    async with anyio.create_task_group() as tasks:
        for _ in range(min(context.services.workers.capacity, len(cells))):
            tasks.start_soon(work)
    return [result for result in results if result is not None]


async def _isolated(context: WorkflowContext, cell: Cell) -> CellResult | None:
    try:
        return await _attempt(context, cell, notify_client=False)
    except PlannerForgeError as error:
        if isinstance(error, UnexpectedFailure):
            logger.error("incident %s in the run of %s:\n%s", error.incident, cell.scenario, error.details)  # noqa: TRY400
        lost = LostCell(scenario_id=cell.scenario, config_id=cell.configuration.config_id, error=error.text)
        return CellResult(None, lost)


async def _attempt(context: WorkflowContext, cell: Cell, *, notify_client: bool) -> CellResult | None:
    """Return the cell's run, or None if another call or server is making this run."""
    recipe = cell.recipe()
    stored = context.workspace.find_by_recipe("run", recipe)
    if stored is not None:
        return CellResult(stored.read(RunRecord), reused=True)
    with context.services.claims.claimed(recipe.digest) as is_ours:
        if not is_ours:
            return None
        stored = context.workspace.find_by_recipe("run", recipe)  # another call may have stored it before the claim
        if stored is not None:
            return CellResult(stored.read(RunRecord), reused=True)
        return await _made(context, cell, recipe, notify_client=notify_client)


async def _made(context: WorkflowContext, cell: Cell, recipe: Recipe, *, notify_client: bool) -> CellResult:
    request = RunRequest(
        run_id=f"run_{recipe.digest}",
        scenario_path=str(context.workspace.file("scenario", cell.scenario_id, "scenario.xml")),
        scenario_id=cell.scenario_id,
        problem_id=cell.problem_id,
        configuration=cell.configuration,
        prediction=cell.prediction,
        traffic=cell.traffic,
        seed=cell.seed,
        planner_version=recipe.versions.get(cell.own_planner, ""),
        world=cell.world,
    )
    run = context.run if notify_client else context.services.workers.run
    response = await run(RUN_PLANNER, request)
    with context.workspace.scratch() as folder:
        files = {"steps.json": response.steps.model_dump_json(), "timing.json": response.timing.model_dump_json()}
        if response.series is not None:
            files["series.json"] = response.series.model_dump_json()
        if response.planner_log:
            files["planner.log"] = response.planner_log
        for name, content in files.items():
            write_text(folder / name, content, f"the run of {cell.scenario}")
        stored = context.workspace.put(
            "run",
            request.run_id,
            recipe=recipe,
            record=response.record,
            files={name: folder / name for name in files},
            name=f"{cell.scenario} {cell.configuration.name}",
        )
    return CellResult(stored.read(RunRecord))


async def resume_run(run_id: str, time_s: float, planner: str, context: WorkflowContext) -> RunResponse:
    """Continue a stored run from one of its times with another configuration; nothing is stored.

    The ego starts in its driven state at that time. The other road users follow their recordings.

    Args:
        run_id: the stored run.
        time_s: seconds since its start.
        planner: a configuration by id or name.
        context: the resources of the workflow.

    Raises:
        UnknownName: the run or the configuration is unknown.
        InvalidRequest: the run has no state at this time.
        NotPossible: its traffic was reactive, so the other road users are not on their recordings at that time.
    """
    record = context.workspace.get(run_id, "run").read(RunRecord)
    if record.traffic == "reactive":
        raise NotPossible(
            f"{run_id} has reactive traffic, which cannot start in the middle of a run",
            next_step="resume a run with traffic recorded",
        )
    steps = RunSteps.model_validate_json(context.workspace.file("run", run_id, "steps.json").read_bytes())
    step_s = context.workspace.get(record.scenario_id, "scenario").read(ScenarioRecord).facts.step_s
    last, index = len(steps.x_m) - 1, round(time_s / step_s)
    if not 0 <= index < last:
        raise InvalidRequest(
            f"{run_id} cannot be resumed at {time_s:g} s", valid=[f"0 to {step_s * (last - 1):g} s, before its end"]
        )
    turn_rad = math.remainder(steps.heading_rad[index] - steps.heading_rad[max(index - 1, 0)], math.tau)
    request = RunRequest(
        run_id=f"{run_id}_{steps.first_step + index}",
        scenario_path=str(context.workspace.file("scenario", record.scenario_id, "scenario.xml")),
        scenario_id=record.scenario_id,
        problem_id=record.problem_id,
        configuration=resolve_configuration(planner, context),
        prediction=record.prediction,
        seed=record.seed,
        world=record.world,
        begins_at=RunMoment(
            step=steps.first_step + index,
            x_m=steps.x_m[index],
            y_m=steps.y_m[index],
            heading_rad=steps.heading_rad[index],
            speed_mps=steps.speed_mps[index],
            acceleration_mps2=steps.acceleration_mps2[index],
            yaw_rate_radps=turn_rad / step_s,
        ),
    )
    return await context.run(RUN_PLANNER, request)


async def run_many(
    context: WorkflowContext, cells: Sequence[Cell], wait_s: float, notes: Sequence[str]
) -> RunPlannerResult:
    """Start the grid, or find its stored batch, and answer with the finished runs after ``wait_s``."""
    recipe = _batch_recipe(cells)
    stored = context.workspace.find_by_recipe("batch", recipe)
    if stored is not None:
        batch = stored.read(BatchRecord)
        _mark_latest(context, batch)
        results = [_stored(context, run_id) for run_id in batch.runs]
        return await answer_of(context, cells, results, batch_id=batch.batch_id, notes=notes)

    finished: list[CellResult] = []
    known = sum(context.workspace.find_by_recipe("run", cell.recipe()) is not None for cell in cells)

    if context.jobs.store.running(recipe) is None:
        await _confirm(context, len(cells) - known)

    async def work(progress: JobProgress) -> None:
        def on_done(result: CellResult) -> None:
            finished.append(result)
            if result.record is not None:
                progress.add_result(result.record.run_id)
            progress.report(own_share(finished, known, len(cells)), f"{len(finished)} of {len(cells)} runs")

        results = await run_grid(context, cells, on_done)
        batch = store_batch(context, cells, results)
        _mark_latest(context, batch)
        progress.add_result(batch.batch_id)

    job = context.start_job("batch", recipe, work)
    context.made("job", job.job_id)
    job = await context.wait_for(job.job_id, wait_s)
    batch_id = next((key for key in job.results if key.startswith("batch_")), None)
    if batch_id is not None:
        record = context.workspace.get(batch_id, "batch").read(BatchRecord)
        _mark_latest(context, record)
        lost = [CellResult(None, cell) for cell in record.lost]
        reused = {r.record.run_id for r in finished if r.record is not None and r.reused}
        results = [_stored(context, run_id, reused=run_id in reused) for run_id in record.runs] + lost
        return await answer_of(context, cells, results, batch_id=batch_id, notes=notes)
    results = [_stored(context, key, reused=False) for key in job.results if key.startswith("run_")]
    problem = [job.error] if job.error else []
    return answer(cells, results, job_id=job.job_id, state=job.state, notes=[*notes, *problem])


async def _confirm(context: WorkflowContext, runs: int) -> None:
    """Ask the user before very many runs; if the client cannot ask, or no answer comes, the runs go ahead.

    Raises:
        NotPossible: the user declines.
    """
    if runs <= MANY_RUNS:
        return
    question = f"This makes {runs:,} runs, which may take long. Continue?"
    if await context.ask(Question(question, (GO_ON, DO_NOT))) == DO_NOT:
        raise NotPossible(
            f"the user declined {runs:,} runs",
            next_step="use fewer scenarios or configurations, for instance scenarios ['preset:10']",
        )


def own_share(finished: Sequence[CellResult], known: int, total: int) -> float:
    """Return the completed share of the runs that were not stored before, since stored runs do not predict the rest."""
    reused = sum(result.reused for result in finished)
    return (len(finished) - min(reused, known)) / max(total - known, 1)


def _batch_recipe(cells: Sequence[Cell], lost: Sequence[str] = ()) -> Recipe:
    """Return the recipe of a grid. With lost cells it differs, so that a repeated call tries them again."""
    scenarios = list(dict.fromkeys(cell.scenario for cell in cells))
    configs = list(dict.fromkeys(cell.configuration.config_id for cell in cells))
    arguments = {
        "scenarios": scenarios,
        "configs": configs,
        "prediction": cells[0].prediction,
        "traffic": cells[0].traffic,
        **_world_argument(cells[0].world),
    }
    return Recipe(
        tool="run_planner",
        arguments=arguments | ({"lost": list(lost)} if lost else {}),
        parents=tuple(dict.fromkeys([*(cell.scenario_id for cell in cells), *configs])),
        seed=cells[0].seed,
        versions=_versions(cells),
    )


def _versions(cells: Sequence[Cell]) -> dict[str, str]:
    """Return the versions, by name, that the runs of a grid depend on, including those of all planners."""
    first = {cell.configuration.planner: cell for cell in reversed(cells)}
    return {name: version for cell in first.values() for name, version in cell.recipe().versions.items()}


def own_versions(planners: Iterable[str]) -> dict[str, str]:
    """Return the source digests of external planners, by their keys in recipes."""
    known = {version_key(name): planner_version(name) for name in planners}
    return {name: version for name, version in known.items() if version}


def _mark_latest(context: WorkflowContext, batch: BatchRecord) -> None:
    """Make a batch and its runs the client's latest batch and runs."""
    context.made("run", *batch.runs)
    context.made("batch", batch.batch_id)


def store_batch(context: WorkflowContext, cells: Sequence[Cell], results: Sequence[CellResult]) -> BatchRecord:
    """Store the finished grid as a batch, including its lost cells."""
    lost = tuple(result.lost for result in results if result.lost is not None)
    recipe = _batch_recipe(cells, [f"{cell.scenario_id} {cell.config_id}" for cell in lost])
    record = BatchRecord(
        batch_id=f"batch_{recipe.digest}",
        scenarios=tuple(recipe.arguments["scenarios"]),
        configs=tuple(recipe.arguments["configs"]),
        prediction=cells[0].prediction,
        traffic=cells[0].traffic,
        world=cells[0].world,
        runs=tuple(result.record.run_id for result in results if result.record is not None),
        lost=lost,
    )
    return context.workspace.put("batch", record.batch_id, recipe=recipe, record=record).read(BatchRecord)


def _stored(context: WorkflowContext, run_id: str, *, reused: bool = True) -> CellResult:
    return CellResult(context.workspace.get(run_id, "run").read(RunRecord), reused=reused)


async def answer_of(
    context: WorkflowContext,
    cells: Sequence[Cell],
    results: Sequence[CellResult],
    *,
    batch_id: str | None,
    notes: Sequence[str],
) -> RunPlannerResult:
    """Return the answer for a finished grid, with the key moments of a single run or of the listed failures."""
    records = [result.record for result in results if result.record is not None]
    looked_at = records if len(cells) == 1 else _failures(records)[:LISTED_FAILURES]
    reviews: dict[str, RunReview] = {}
    broken: dict[str, tuple[RuleVerdict, ...]] = {}
    if looked_at:
        request = ReviewRequest(
            runs=run_sources((record.run_id for record in looked_at), context),
            scenarios=scenario_sources((record.scenario_id for record in looked_at), context),
            with_rules=len(cells) == 1,
        )
        response = await context.services.workers.run(REVIEW_RUNS, request)
        reviews, broken = {review.run_id: review for review in response.reviews}, response.broken
    notice = "" if all(result.reused for result in results) else context.services.workers.notice
    return answer(cells, results, batch_id=batch_id, notes=notes, reviews=reviews, broken=broken, notice=notice)


def _failures(records: Sequence[RunRecord]) -> list[RunRecord]:
    return [record for record in records if record.outcome not in ("goal_reached", "invalid")]


def answer(
    cells: Sequence[Cell],
    results: Sequence[CellResult],
    *,
    batch_id: str | None = None,
    job_id: str | None = None,
    state: JobState = "done",
    notes: Sequence[str] = (),
    reviews: Mapping[str, RunReview] = MappingProxyType({}),
    broken: Mapping[str, tuple[RuleVerdict, ...]] = MappingProxyType({}),
    notice: str = "",
) -> RunPlannerResult:
    """Return the answer for a grid; ``results`` are the finished runs."""
    records = [result.record for result in results if result.record is not None]
    lost = [result.lost for result in results if result.lost is not None]
    return RunPlannerResult(
        state=state,
        total=len(cells),
        finished=len(records),
        reused=sum(result.reused for result in results),
        prediction=cells[0].prediction,
        traffic=cells[0].traffic,
        world=cells[0].world.in_words(),
        batch_id=batch_id,
        job_id=job_id,
        summary=_summary(records),
        runs=tuple(_line(record, reviews, broken) for record in records[:LISTED_RUNS]),
        failures=tuple(_line(record, reviews) for record in _failures(records)[:LISTED_FAILURES]),
        lost=tuple(lost[:10]),
        notes=(*notes, *_notes(records), *([notice] if notice else [])),
        next_step=_next_step(records, batch_id, job_id, state),
    )


def _notes(records: Sequence[RunRecord]) -> Iterator[str]:
    """Yield notes on deviations: predictions, reactive traffic, and starts off the lane's centre."""
    if off_the_lanes := [len(record.off_the_lanes) for record in records if record.off_the_lanes]:
        obstacles, runs = counted(sum(off_the_lanes), "obstacle"), counted(len(off_the_lanes), "run")
        yield f"lane prediction: constant velocity for {obstacles} off the lanes, in {runs}"
    if on_recording := [len(record.on_recording) for record in records if record.on_recording]:
        shown = f"{counted(sum(on_recording), 'obstacle')} in {len(on_recording)} of {len(records)} runs"
        yield f"reactive traffic: {shown} still followed the recording"
    invalid = {record.scenario_id: record.reason for record in records if record.outcome == "invalid"}
    if invalid and len(records) > 1:
        stated = [f"{scenario_id} ({reason})" for scenario_id, reason in list(invalid.items())[:_SHOWN_BEYOND]]
        more = f"; {len(invalid) - len(stated)} more" if len(invalid) > len(stated) else ""
        yield f"invalid for every planner: {'; '.join(stated)}{more}"
    if len(records) == 1:
        yield from (trigger.in_words() for trigger in records[0].triggers[:_SHOWN_TRIGGERS])
    elif waiting := [record.run_id for record in records if any(one.time_s is None for one in record.triggers)]:
        shown = ", ".join(waiting[:_SHOWN_BEYOND])
        yield f"a trigger never fired (trigger_not_fired) in {len(waiting)} of {len(records)} runs: {shown}"
    if lengths_m := sorted(record.eased_over_m for record in records if record.eased_over_m is not None):
        span = f"{lengths_m[0]:g} m" if lengths_m[0] == lengths_m[-1] else f"{lengths_m[0]:g} to {lengths_m[-1]:g} m"
        eased = "" if len(records) == 1 else f" in {counted(len(lengths_m), 'run')}"
        yield f"the ego does not start on its lane's centre line{eased}, but reaches it within {span}"
    for name in sorted({record.ego_class for record in records} - {"car"}):
        count = sum(record.ego_class == name for record in records)
        known, where = ego_class(name), "" if count == len(records) else f" in {counted(count, 'run')}"
        sizes = {(record.ego_length_m, record.ego_width_m) for record in records if record.ego_class == name}
        if sizes == {known.vehicle.size_m}:
            model = MODEL_WORDS[known.motion_model]
            yield f"the ego is a {known.in_words}{where} ({model} model); limits: {known.source}"
        else:
            yield f"the ego is a {name}{where}, with size or limits that the configuration states"
    for friction in sorted({record.friction for record in records if record.friction is not None}):
        count = sum(record.friction == friction for record in records)
        where = "" if count == len(records) else f" in {counted(count, 'run')}"
        most = hardest_braking_mps2(friction)
        yield f"road friction {friction:g}{where}: accelerations of at most {most:.2f} m/s²"
    versions = {record.planner: record.planner_version for record in records if record.planner not in PLANNERS}
    for planner, version in versions.items():
        yield f"{planner} has version {version}"
    beyond = [(record.run_id, record.beyond_vehicle) for record in records if record.beyond_vehicle]
    if len(records) == 1 and beyond:
        yield excesses_in_words(beyond[0][1])
    elif beyond:
        shown = ", ".join(run_id for run_id, _ in beyond[:_SHOWN_BEYOND])
        yield f"{len(beyond)} of {len(records)} driven motions exceed the vehicle's limits: {shown}"


def _summary(records: Sequence[RunRecord]) -> tuple[ConfigurationSummary, ...]:
    names = {record.config_id: shown_name(record.config_name) for record in records}
    counts = {key: Counter(record.outcome for record in records if record.config_id == key) for key in names}
    return tuple(
        ConfigurationSummary(config_id=key, config_name=name, outcomes=dict(counts[key].most_common()))
        for key, name in names.items()
    )


def _line(
    record: RunRecord,
    reviews: Mapping[str, RunReview],
    broken: Mapping[str, tuple[RuleVerdict, ...]] = MappingProxyType({}),
) -> RunLine:
    return RunLine(
        run_id=record.run_id,
        scenario_id=record.scenario_id,
        problem_id=record.problem_id,
        config_id=record.config_id,
        outcome=record.outcome,
        reason=record.reason,
        duration_s=None if record.metrics is None else record.metrics.duration_s,
        minimum_distance_m=None if record.metrics is None else record.metrics.minimum_distance_m,
        config_name=shown_name(record.config_name),
        review=reviews.get(record.run_id),
        broken_rules=broken.get(record.run_id, ()),
    )


def after_batch(batch_id: str, config_ids: Collection[str]) -> str:
    """Return the next step after a batch; only several configurations can be compared."""
    compare = " or compare_results" if len(config_ids) > 1 else ""
    return f"analyze_results{compare} with results ['{batch_id}']"


def _next_step(records: Sequence[RunRecord], batch_id: str | None, job_id: str | None, state: JobState) -> str:
    if state == "running":
        return f"get_job with job_id '{job_id}'"
    if state != "done":
        return "repeat run_planner: finished runs are reused"
    if batch_id:
        return after_batch(batch_id, {record.config_id for record in records})
    if not records:
        return "correct the error, then repeat run_planner"
    run = records[0]
    if run.outcome == "invalid":
        return f"describe_scenario of {run.scenario_id} with detail checks, then modify_scenario"
    if run.outcome == "goal_reached":
        return f"analyze_results with results ['{run.run_id}'], or render it"
    return f"analyze_results with results ['{run.run_id}'], detail timeline, or render it as an animation"
