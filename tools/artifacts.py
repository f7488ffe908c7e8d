"""The tools that list what was made, and look at and stop what is being made."""

from ..engine.execution import Job
from ..engine.workspace import Artifact
from ..resources.templates import SCHEME
from ..schemas.artifacts import ListArtifactsArguments, ListArtifactsResult, ListedArtifact
from ..schemas.catalog import SearchRecord
from ..schemas.errors import NotPossible
from ..schemas.jobs import CancelJobArguments, GetJobArguments, JobResult
from ..schemas.text import counted
from .call import ToolCall

_NEXT = {
    "running": "call get_job again with the same job_id",
    "done": "use the finished ids, for instance in analyze_results",
    "failed": "correct what the error names and start again; what is finished is reused",
    "cancelled": "the finished results stay; the same call takes up the rest",
    "interrupted": "its server ended; the same call takes up the rest, what is finished is reused",
}
_NEXT_AFTER_IMPORT = "search with find_scenarios, or list what came in with list_artifacts"


async def list_artifacts(arguments: ListArtifactsArguments, call: ToolCall) -> ListArtifactsResult:
    """Artifacts or jobs, newest first."""
    if arguments.kind == "job":
        return _jobs(arguments, call)
    artifacts = call.workspace.newest(
        kind=arguments.kind,
        parent=arguments.parent,
        text=arguments.text,
        limit=arguments.limit + 1,
        offset=arguments.offset,
    )
    listed = tuple(_listed(artifact) for artifact in artifacts[: arguments.limit])
    return ListArtifactsResult(artifacts=listed, more=len(artifacts) > arguments.limit)


def _listed(artifact: Artifact) -> ListedArtifact:
    return ListedArtifact(
        artifact_id=artifact.artifact_id,
        kind=artifact.kind,
        name=_name(artifact),
        made_by=artifact.recipe.tool,
        parents=artifact.recipe.parents,
        made_at=artifact.made_at,
        uri=f"{SCHEME}{artifact.kind}/{artifact.artifact_id}/record",
    )


def _name(artifact: Artifact) -> str:
    """What an artifact is called; a search by its conditions and the number of its matches."""
    if artifact.kind != "search":
        return artifact.name
    search = artifact.read(SearchRecord)
    count = len(search.scenario_ids) if search.total is None else search.total
    return f"{search.arguments.in_words()}: {counted(count, 'match')}"


def _jobs(arguments: ListArtifactsArguments, call: ToolCall) -> ListArtifactsResult:
    jobs = call.jobs.store.newest(arguments.limit + 1, arguments.offset)
    listed = tuple(
        ListedArtifact(
            artifact_id=job.job_id,
            kind="job",
            name=f"{job.state}, {job.share:.0%}",
            made_by=job.recipe.tool,
            parents=job.recipe.parents,
            made_at="",
            uri="",
        )
        for job in jobs[: arguments.limit]
    )
    return ListArtifactsResult(artifacts=listed, more=len(jobs) > arguments.limit)


async def get_job(arguments: GetJobArguments, call: ToolCall) -> JobResult:
    """Wait for the end of a job."""
    job_id = _job_id(arguments.job_id, call)
    return _job_result(await call.wait_for(job_id, arguments.wait_s))


async def cancel_job(arguments: CancelJobArguments, call: ToolCall) -> JobResult:
    """Stop a job."""
    job = await call.jobs.cancel(_job_id(arguments.job_id, call))
    if not job.ended:
        raise NotPossible(
            f"{job.job_id} runs in another server on this workspace",
            next_step="cancel it from the client that started it",
        )
    return _job_result(job)


def _job_id(word: str, call: ToolCall) -> str:
    """The id of a job; ``latest`` is the one that the client started last, else the newest, which is told."""
    own = call.services.recent.last(["job"])
    if word == "latest" and own:
        return own[0][1]
    job = call.jobs.store.get(word)
    if word == "latest":
        call.tell_whose("job", job.job_id)
    return job.job_id


def _job_result(job: Job) -> JobResult:
    return JobResult(
        job_id=job.job_id,
        kind=job.kind,
        state=job.state,
        share=round(job.share, 4),
        message=job.message,
        remaining_s=None if job.remaining_s is None else round(job.remaining_s, 1),
        results=job.results,
        error=job.error,
        next_step=_next_step(job),
    )


def _next_step(job: Job) -> str:
    if job.state != "done":
        return _NEXT[job.state]
    if job.kind == "plan":
        return f"run_planner with scenarios ['{job.results[0]}']"
    batches = [key for key in job.results if key.startswith("batch_")]
    if batches:
        return f"analyze_results or compare_results with results ['{batches[-1]}']"
    return _NEXT_AFTER_IMPORT if job.kind == "import" else _NEXT[job.state]
