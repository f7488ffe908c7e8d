"""The tools that look at long work and stop it."""

from ..engine.execution import Job
from ..schemas.errors import NotPossible
from ..schemas.jobs import CancelJobArguments, GetJobArguments, JobResult
from .call import ToolCall

_NEXT = {
    "running": "call get_job again with the same job_id",
    "done": "use the finished ids, for instance in analyze_results",
    "failed": "correct what the error names and start again; what is finished is reused",
    "cancelled": "the finished results stay; the same call takes up the rest",
    "interrupted": "its server ended; the same call takes up the rest, what is finished is reused",
}
_NEXT_AFTER_IMPORT = "search with find_scenarios, or list what came in with list_artifacts"


async def get_job(arguments: GetJobArguments, call: ToolCall) -> JobResult:
    """Wait for the end of a job."""
    job = call.jobs.store.get(arguments.job_id)
    return _result(await call.wait_for(job.job_id, arguments.wait_s))


async def cancel_job(arguments: CancelJobArguments, call: ToolCall) -> JobResult:
    """Stop a job."""
    job = await call.jobs.cancel(call.jobs.store.get(arguments.job_id).job_id)
    if not job.ended:
        raise NotPossible(
            f"{job.job_id} runs in another server on this workspace",
            next_step="cancel it from the client that started it",
        )
    return _result(job)


def _result(job: Job) -> JobResult:
    return JobResult(
        job_id=job.job_id,
        kind=job.kind,
        state=job.state,
        share=round(job.share, 4),
        message=job.message,
        remaining_s=None if job.remaining_s is None else round(job.remaining_s, 1),
        results=job.results,
        error=job.error,
        next_step=_NEXT_AFTER_IMPORT if (job.kind, job.state) == ("import", "done") else _NEXT[job.state],
    )
