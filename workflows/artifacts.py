"""List artifacts and jobs; wait for jobs and stop them."""

from collections import Counter
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime

from ..engine.execution import Job
from ..engine.generation import PlanRows
from ..engine.planners import PLANNERS
from ..engine.workspace import Artifact
from ..schemas.artifacts import (
    RESOURCE_SCHEME,
    BatchSummary,
    ConfigSuccess,
    ListArtifactsArguments,
    ListArtifactsResult,
    ListedArtifact,
    SuccessRequest,
)
from ..schemas.catalog import SearchRecord
from ..schemas.errors import NotPossible, UnknownName
from ..schemas.jobs import CancelJobArguments, GetJobArguments, JobResult
from ..schemas.runs import BatchRecord, LostCell, RunRecord, configuration_id
from ..schemas.text import counted
from .context import WorkflowContext
from .maps import inventory_of_read_maps
from .operations import SUCCESS_RATES
from .paging import check_offset
from .rendering import named_artifact
from .results import lineages, run_record, with_versions
from .runs import after_batch

_NEXT = {
    "running": "repeat get_job with the same job_id",
    "done": "analyze_results with the runs and batches above, run_planner with the configurations",
    "failed": "correct the error and repeat the call; finished work is reused",
    "cancelled": "to resume, repeat the call that started the job; finished results are kept",
    "interrupted": "repeat the call that started the job, because its server stopped; finished work is reused",
}
_MOST_NAMED = 100
"""How many of a token's latest jobs are searched for running ones (chosen)."""
_NEXT_AFTER = {
    "import": "search with find_scenarios, or list the imported files with list_artifacts",
    "exploration": "repeat the find_failures call to get its failures",
    "trial": "repeat the analyze_results call to get its result",
}
"""The next step after a job of each kind that is done."""


async def list_artifacts(arguments: ListArtifactsArguments, context: WorkflowContext) -> ListArtifactsResult:
    """Return artifacts or jobs, newest first.

    Raises:
        InvalidRequest: the offset skips all of them.
        UnknownName: there is no artifact or map with the id in ``parent``.
    """
    if arguments.parent:
        arguments = arguments.model_copy(update={"parent": _parent_id(arguments.parent, context)})
    if arguments.kind == "job":
        return _jobs(arguments, context)
    if arguments.offset:
        total = context.workspace.count(kind=arguments.kind, parent=arguments.parent, text=arguments.text)
        check_offset(arguments.offset, total, "matching artifacts", arguments.limit)
    artifacts = context.workspace.newest(
        kind=arguments.kind,
        parent=arguments.parent,
        text=arguments.text,
        limit=arguments.limit + 1,
        offset=arguments.offset,
    )
    shown = artifacts[: arguments.limit]
    listed = tuple(_listed(artifact) for artifact in shown)
    records = [artifact.read(BatchRecord) for artifact in shown if artifact.kind == "batch"]
    if records:
        summaries = iter(await _summaries(records, context))
        listed = tuple(
            item.model_copy(update={"batch": next(summaries)}) if item.kind == "batch" else item for item in listed
        )
    return ListArtifactsResult(
        artifacts=listed,
        more=len(artifacts) > arguments.limit,
        kind=arguments.kind,
        is_filtered=_is_filtered(arguments),
    )


def _is_filtered(arguments: ListArtifactsArguments) -> bool:
    return bool(arguments.parent or arguments.text)


def _parent_id(parent: str, context: WorkflowContext) -> str:
    """Return the id of a stored artifact or a map, or of what a word such as ``latest_batch`` refers to.

    Raises:
        UnknownName: there is nothing with this id.
    """
    if context.workspace.count(parent=parent) or any(
        one.facts.map_id == parent for one in inventory_of_read_maps(context).entries
    ):
        return parent
    return named_artifact(parent, context).artifact_id


async def _summaries(batches: Sequence[BatchRecord], context: WorkflowContext) -> list[BatchSummary]:
    """Return a summary of each batch, configurations in order of their runs, with the rates of ``analyze_results``.

    A run missing from the workspace counts as lost: an archive may have omitted it, or its batch may be forged.
    """
    run_ids = dict.fromkeys(run_id for batch in batches for run_id in batch.runs)
    stored = (context.workspace.find("run", run_id) for run_id in run_ids)
    known = {record.run_id: record for record in with_versions(run_record(run) for run in stored if run is not None)}
    there = [[known[run_id] for run_id in batch.runs if run_id in known] for batch in batches]
    roots = {one.scenario_id: one.root for one in lineages((run.scenario_id for run in known.values()), context)}
    groups = [_by_config(runs) for runs in there]
    sets = tuple(
        tuple((roots.get(run.scenario_id, run.scenario_id), run.outcome == "goal_reached") for run in _valid(runs))
        for group in groups
        for runs in group.values()
    )
    rates = iter((await context.run(SUCCESS_RATES, SuccessRequest(sets=sets))).rates if sets else ())
    names = _config_names(known.values())
    return [
        BatchSummary(
            prediction=batch.prediction,
            traffic=batch.traffic,
            world=batch.world.in_words(),
            scenarios=len(scenarios := _scenarios_of(runs_of_batch, batch.lost)),
            scenario_id=scenarios[0] if len(scenarios) == 1 else "",
            configs=tuple(
                ConfigSuccess(
                    config_id=configuration_id(config_id),
                    config_name=names[config_id],
                    success=next(rates),
                    invalid=len(runs) - len(_valid(runs)),
                )
                for config_id, runs in group.items()
            ),
            lost=len(batch.lost) + len(batch.runs) - len(runs_of_batch),
        )
        for batch, runs_of_batch, group in zip(batches, there, groups, strict=True)
    ]


def _scenarios_of(runs: Iterable[RunRecord], lost: Iterable[LostCell]) -> list[str]:
    return sorted({*(run.scenario_id for run in runs), *(cell.scenario_id for cell in lost)})


def _valid(runs: Sequence[RunRecord]) -> list[RunRecord]:
    return [run for run in runs if run.outcome != "invalid"]


def _by_config(runs: Iterable[RunRecord]) -> dict[str, list[RunRecord]]:
    groups: dict[str, list[RunRecord]] = {}
    for run in runs:
        groups.setdefault(run.config_id, []).append(run)
    return groups


def _config_names(runs: Iterable[RunRecord]) -> dict[str, str]:
    """Return the names of configurations by id; names that several configurations share get the id added."""
    names = {run.config_id: run.config_name for run in runs}
    often = Counter(names.values())
    return {config_id: name if often[name] == 1 else f"{name} {config_id}" for config_id, name in names.items()}


def _listed(artifact: Artifact) -> ListedArtifact:
    return ListedArtifact(
        artifact_id=artifact.artifact_id,
        kind=artifact.kind,
        name=_name(artifact),
        made_by=artifact.recipe.tool,
        parents=artifact.recipe.parents,
        made_at=artifact.made_at,
        uri=f"{RESOURCE_SCHEME}{artifact.kind}/{artifact.artifact_id}/record",
    )


def _name(artifact: Artifact) -> str:
    """Return the name of an artifact.

    A search is described by its conditions and number of matches, and a run of an external planner by its version.
    """
    if artifact.kind == "run":
        record = run_record(artifact)
        return artifact.name if record.planner in PLANNERS else f"{artifact.name} {record.planner_version}"
    if artifact.kind != "search":
        return artifact.name
    search = artifact.read(SearchRecord)
    count = len(search.scenario_ids) if search.total is None else search.total
    return f"{search.arguments.in_words()}: {counted(count, 'match')}"


def _jobs(arguments: ListArtifactsArguments, context: WorkflowContext) -> ListArtifactsResult:
    store = context.jobs.store
    total = store.count()
    jobs = store.newest(arguments.limit + 1, arguments.offset)
    if _is_filtered(arguments):
        fitting = [job for job in store.newest(total) if _is_wanted(job, arguments)]
        total, jobs = len(fitting), fitting[arguments.offset :][: arguments.limit + 1]
    if arguments.offset:
        check_offset(arguments.offset, total, "jobs", arguments.limit)
    listed = tuple(
        ListedArtifact(
            artifact_id=job.job_id,
            kind="job",
            name=f"{job.state}, {job.share:.0%}",
            made_by=job.recipe.tool,
            parents=job.recipe.parents,
            made_at=datetime.fromtimestamp(job.started_at, UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
            uri="",
        )
        for job in jobs[: arguments.limit]
    )
    return ListArtifactsResult(
        artifacts=listed, more=len(jobs) > arguments.limit, kind="job", is_filtered=_is_filtered(arguments)
    )


def _is_wanted(job: Job, arguments: ListArtifactsArguments) -> bool:
    """Return whether a job has the requested parent, and the text in its id or recipe."""
    if arguments.parent and arguments.parent not in job.recipe.parents:
        return False
    return (arguments.text or "").lower() in f"{job.job_id} {job.recipe.model_dump_json()}".lower()


async def get_job(arguments: GetJobArguments, context: WorkflowContext) -> JobResult:
    """Wait for the end of a job."""
    job_id = _job_id(arguments.job_id, context)
    job = await context.wait_for(job_id, arguments.wait_s)
    return _job_result(job, context)


async def cancel_job(arguments: CancelJobArguments, context: WorkflowContext) -> JobResult:
    """Stop a job."""
    job_id = _own_job_id(arguments.job_id, context)
    if context.jobs.store.get(job_id).ended:
        context.remarks.append(f"{job_id} had already ended, so nothing was cancelled.")
    job = await context.jobs.cancel(job_id)
    if not job.ended:
        raise NotPossible(
            f"{job.job_id} runs in another server on this workspace",
            next_step="cancel it from the client that started it",
        )
    return _job_result(job, context)


def _job_id(word: str, context: WorkflowContext) -> str:
    """Return the id of a job; ``latest`` is the client's latest job, or else the workspace's newest, with a remark."""
    if word != "latest":
        return _job(word, context).job_id
    own = _own_latest(context)
    if own is not None:
        return own
    newest = context.jobs.store.get(word)
    context.remark_source("job", newest.job_id)
    return newest.job_id


def _job(word: str, context: WorkflowContext) -> Job:
    """Return the job with this id; a refusal also names ``latest`` if the word may misspell it."""
    try:
        return context.jobs.store.get(word)
    except UnknownName as refusal:
        raise refusal.with_words(word, ["latest"]) from refusal.__cause__


def _own_latest(context: WorkflowContext) -> str | None:
    """Return the id of the client's latest job, otherwise of the latest job started with its token, with a remark."""
    last = context.services.recent.last(["job"])
    if last:
        return last[0][1]
    owner = context.services.owner
    before = context.jobs.store.newest_of(owner, 1) if owner else []
    if not before:
        return None
    context.remark_source("job", before[0].job_id, "this token's")
    return before[0].job_id


def _own_job_id(word: str, context: WorkflowContext) -> str:
    """Return the id of a job that the client may stop: any job if there are no tokens, otherwise one of its token's
    jobs.

    Raises:
        NotPossible: another token started it; the refusal lists running jobs of this token.
        UnknownName: there is no such job.
    """
    owner = context.services.owner
    if not owner:
        return _job_id(word, context)
    own = _own_latest(context) if word == "latest" else word
    if own is None:
        raise UnknownName("no job was started with this token", next_step="get_job and list_artifacts show other jobs")
    job = _job(own, context)
    if job.owner != owner:
        running = [each.job_id for each in context.jobs.store.newest_of(owner, _MOST_NAMED) if not each.ended]
        raise NotPossible(
            f"{job.job_id} was not started with this token",
            valid=running,
            next_step="cancel it with the token that started it; get_job shows its progress",
        )
    return job.job_id


def _job_result(job: Job, context: WorkflowContext) -> JobResult:
    return JobResult(
        job_id=job.job_id,
        kind=job.kind,
        state=job.state,
        share=round(job.share, 4),
        message=job.message,
        remaining_s=None if job.remaining_s is None else round(job.remaining_s, 1),
        results=job.results,
        error=job.error,
        next_step=_next_step(job, is_empty_plan=job.kind == "plan" and job.state == "done" and _is_empty(job, context)),
    )


def _is_empty(job: Job, context: WorkflowContext) -> bool:
    """Return whether the plan of a job has no scenario."""
    return not PlanRows(context.workspace.database, job.results[0]).counts().made


def _batches(job: Job) -> list[str]:
    return [key for key in job.results if key.startswith("batch_")]


def _next_step(job: Job, *, is_empty_plan: bool = False) -> str:
    if job.state != "done":
        return _NEXT[job.state]
    if job.kind == "plan":
        plan_id = job.results[0]
        return "repeat the call for the reasons" if is_empty_plan else f"run_planner with scenarios ['{plan_id}']"
    if job.kind == "boundary" and job.results:
        return f"render ids ['{job.results[-1]}'], or repeat explore_boundary for the safe and unsafe shares"
    if job.kind == "study":
        return f"repeat the optimize_planner call with scenarios ['{job.job_id}'] to get the study"
    batches = _batches(job)
    if batches and job.kind == "batch":
        return after_batch(batches[-1], [key for key in job.recipe.parents if key.startswith("cfg_")])
    return _NEXT_AFTER[job.kind] if job.kind in _NEXT_AFTER else _NEXT["done"]
