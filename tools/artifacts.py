"""The tools that list artifacts, and show and stop jobs."""

from ..schemas.artifacts import ListArtifactsArguments, ListArtifactsResult
from ..schemas.jobs import CancelJobArguments, GetJobArguments, JobResult
from ..workflows import artifacts
from .call import ToolCall


async def list_artifacts(arguments: ListArtifactsArguments, call: ToolCall) -> ListArtifactsResult:
    """List artifacts or jobs, newest first."""
    return await artifacts.list_artifacts(arguments, call)


async def get_job(arguments: GetJobArguments, call: ToolCall) -> JobResult:
    """Wait for the end of a job; a view shows its batch."""
    result = await artifacts.get_job(arguments, call)
    call.shows(*[key for key in result.results if key.startswith("batch_")][-1:])
    return result


async def cancel_job(arguments: CancelJobArguments, call: ToolCall) -> JobResult:
    """Stop a job."""
    return await artifacts.cancel_job(arguments, call)
