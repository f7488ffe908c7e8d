"""Many files as a job: it goes on when the call has answered, and the same call takes up what a crash left."""

from collections.abc import Sequence
from pathlib import Path

from plannerforge.engine.execution.job_runner import JobProgress
from plannerforge.engine.execution.jobs import Job
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.importing import ImportFilesArguments, ImportFilesResult
from plannerforge.tools.call import ToolCall
from plannerforge.tools.importing_many import ImportKind, Tally, take_in

WAIT_S = 45.0


async def import_as_job(
    call: ToolCall, arguments: ImportFilesArguments, files: Sequence[tuple[Path, ImportKind]]
) -> ImportFilesResult:
    """Start the import, or join the one that runs, and answer with what is done after 45 s at most."""
    tally = Tally(len(files))

    async def work(progress: JobProgress) -> None:
        async def tell(share: float, message: str) -> None:
            progress.report(share, message)

        await take_in(ToolCall(call.services, _nobody_hears), files, arguments, tally, tell)
        progress.report(1.0, tally.result().to_line())

    async def tell_client(job: Job) -> None:
        await call.progress(job.share, job.message)

    resolved = {"path": str(call.allowed_path(arguments.path))}
    recipe = Recipe(tool="import_files", arguments=arguments.model_dump(mode="json") | resolved)
    job = call.jobs.start("import", recipe, work)
    job = await call.jobs.wait(job.job_id, WAIT_S, tell_client)
    result = tally.result(job.job_id, job.state)
    return result.model_copy(update={"note": job.error or ("" if tally.done else job.message)})


async def _nobody_hears(share: float, message: str) -> None:
    """The call that started the job may have been answered already."""
    del share, message
