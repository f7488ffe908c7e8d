"""What a tool function is given beside its arguments, and what it may answer."""

from dataclasses import dataclass
from pathlib import Path

from ..engine.execution import (
    Claims,
    Executor,
    Job,
    JobRunner,
    Limits,
    OnProgress,
    Operation,
    Request,
    Response,
    no_progress,
)
from ..engine.workspace import Workspace
from ..schemas.catalog import PACKAGED_MODEL
from ..schemas.errors import OutsideRoots
from ..schemas.text import quoted

INDEX_FOLDER = "index"
"""The folder of the text index in the workspace."""


@dataclass(frozen=True)
class Services:
    """What lives as long as the server: the workspace, the workers, the jobs, the claims on work and the bounds."""

    workspace: Workspace
    workers: Executor
    jobs: JobRunner
    claims: Claims
    limits: Limits
    map_folders: tuple[Path, ...] = ()
    with_starter: bool = True
    embedding_model: str = PACKAGED_MODEL


class ToolCall:
    """One call of a tool: the services, and the way to report progress to the client."""

    def __init__(self, services: Services, send_progress: OnProgress = no_progress) -> None:
        self.services = services
        self._send_progress = send_progress

    @property
    def workspace(self) -> Workspace:
        """The artifacts."""
        return self.services.workspace

    @property
    def jobs(self) -> JobRunner:
        """The jobs."""
        return self.services.jobs

    @property
    def limits(self) -> Limits:
        """The bounds on files, time and memory."""
        return self.services.limits

    def allowed_path(self, text: str) -> Path:
        """The path, if it lies inside an allowed root and not where the workspace keeps its own.

        Raises:
            InvalidRequest: no path is given.
            OutsideRoots: it lies elsewhere.
        """
        path = self.limits.allowed_path(text)
        if self.workspace.owns(path):
            raise OutsideRoots(
                f"{quoted(path)} belongs to the workspace, whose files tools alone read and write",
                next_step="name another folder; what is stored already is used by its id",
            )
        return path

    async def progress(self, share: float, message: str = "") -> None:
        """Tell the client the share done in [0, 1] of the whole call."""
        await self._send_progress(share, message)

    async def wait_for(self, job_id: str, wait_s: float) -> Job:
        """The job once it has ended, or as it is after ``wait_s`` seconds; the client is shown its progress."""

        async def show(job: Job) -> None:
            await self.progress(job.share, job.message)

        return await self.jobs.wait(job_id, wait_s, show)

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, share: tuple[float, float] = (0.0, 1.0)
    ) -> Response:
        """Run an engine operation in a warm worker; its progress fills ``share`` of the call's.

        Raises:
            PlannerForgeError: what the operation raised, a time-out, or the death of the worker.
        """
        begin, end = share

        async def forward(done: float, message: str) -> None:
            await self.progress(begin + (end - begin) * done, message)

        return await self.services.workers.run(operation, request, on_progress=forward)


@dataclass(frozen=True)
class Image:
    """A picture of an answer: its file and media type."""

    path: Path
    mime_type: str


@dataclass(frozen=True)
class ImageAnswer:
    """The answer of a tool that shows pictures: such a tool has no output schema, or hosts drop the pictures.

    ``links`` are resource URIs where the same can be fetched.
    """

    text: str
    images: tuple[Image, ...]
    links: tuple[str, ...] = ()
