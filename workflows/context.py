"""What every workflow works with: the workspace, the workers, and the client's own newest artifacts."""

import threading
from collections.abc import Awaitable, Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from ..engine.execution import (
    Claims,
    Executor,
    Job,
    JobRunner,
    JobWork,
    Limits,
    OnProgress,
    Operation,
    Request,
    Response,
    no_progress,
)
from ..engine.workspace import Artifact, ArtifactKind, Recipe, Workspace
from ..schemas.catalog import PACKAGED_MODEL
from ..schemas.errors import OutsideRoots
from ..schemas.maps import MapServices
from ..schemas.text import quoted

MadeKind = ArtifactKind | Literal["job"]
_MOST_RECENT = 1_000
"""What is remembered of a session (chosen): what was made so long ago is asked for by its id."""
INDEX_FOLDER = "index"
"""The folder of the text index in the workspace."""


@dataclass(frozen=True)
class Question:
    """What a tool asks the person behind the client: a sentence, and the answers that there are."""

    text: str
    choices: tuple[str, ...]


Ask = Callable[[Question], Awaitable[str | None]]
"""Puts a question to the person; None if the client cannot ask, or the person chose nothing."""


async def ask_nobody(question: Question) -> str | None:
    """In place of a client that cannot ask."""
    del question
    return None


class Recent:
    """What one client made or chose, the last one last: what its ``latest`` and ``current`` mean.

    A client is a session of the protocol. What others on the workspace make does not move it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._made: dict[tuple[MadeKind, str], None] = {}
        self._told: set[MadeKind] = set()

    def note(self, kind: MadeKind, made_id: str) -> None:
        """Remember an artifact or a job as the last one."""
        with self._lock:
            self._made.pop((kind, made_id), None)
            self._made[kind, made_id] = None
            if len(self._made) > _MOST_RECENT:
                del self._made[next(iter(self._made))]

    def last(self, kinds: Collection[MadeKind]) -> list[tuple[MadeKind, str]]:
        """Return what the client made or chose of some kinds, the last one first."""
        with self._lock:
            return [entry for entry in reversed(self._made) if entry[0] in kinds]

    def copied(self) -> "Recent":
        """Return the same, which goes on apart from it."""
        copied = Recent()
        with self._lock:
            copied._made, copied._told = dict(self._made), set(self._told)
        return copied

    def is_untold(self, kind: MadeKind) -> bool:
        """Return whether the client was not told yet that something of a kind is not its own; from now on it was."""
        with self._lock:
            is_untold = kind not in self._told
            self._told.add(kind)
            return is_untold


@dataclass(frozen=True)
class Services:
    """What lives as long as a client's session with the server: the workspace, the workers, the jobs, the claims on
    work, the bounds, and what the client made last.
    """

    workspace: Workspace
    workers: Executor
    jobs: JobRunner
    claims: Claims
    limits: Limits
    map_folders: tuple[Path, ...] = ()
    with_starter: bool = True
    embedding_model: str = PACKAGED_MODEL
    recent: Recent = field(default_factory=Recent)
    online: MapServices = field(default_factory=MapServices)
    links: bool = True
    """Whether answers link what they made."""
    owner: str = ""
    """Whose token the client has; empty if none is asked for, and everything is the user's own."""


class WorkflowContext:
    """One use of a workflow: the services, the way to report progress, and the way to ask the person who waits.

    Args:
        services: what lives as long as the client's session.
        send_progress: told the share done in [0, 1] and what is being done.
        ask: puts a question to the person; most clients cannot ask, and the answer is then None.

    Attributes:
        remarks: sentences for the caller that belong to no single field of the result.
        made_here: what this use made or found again, in this order.
    """

    def __init__(self, services: Services, send_progress: OnProgress = no_progress, ask: Ask = ask_nobody) -> None:
        self.services, self.ask = services, ask
        self.remarks: list[str] = []
        self.made_here: dict[tuple[MadeKind, str], None] = {}
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

    def made(self, kind: MadeKind, *made_ids: str) -> None:
        """Take note of what the client made, or asked for again, in this order."""
        for made_id in made_ids:
            self.services.recent.note(kind, made_id)
            self.made_here[kind, made_id] = None

    def newest(self, *kinds: ArtifactKind, count: int = 1) -> list[Artifact]:
        """What the client made or chose last of some kinds, newest first; then what others made, which is told once."""
        last = self.services.recent.last(kinds)[:count]
        own = [self.workspace.get(key, kind) for kind, key in last if kind != "job"]
        if len(own) == count:
            return own
        known = {artifact.artifact_id for artifact in own}
        stored = [artifact for kind in kinds for artifact in self.workspace.newest(kind=kind, limit=count + len(own))]
        others = sorted((one for one in stored if one.artifact_id not in known), key=lambda one: -one.sequence)
        for artifact in others[: count - len(own)]:
            if not own:
                self.tell_whose(artifact.kind, artifact.artifact_id)
        return [*own, *others[: count - len(own)]]

    def tell_whose(self, kind: MadeKind, made_id: str, whose: str = "the workspace's") -> None:
        """Have the answer say, once for each kind, that what a word meant was not made in this session."""
        if self.services.recent.is_untold(kind):
            self.remarks.append(f"{made_id}: {whose} newest {kind}, as this session has made none.")

    def artifact(self, word: str, kind: ArtifactKind) -> Artifact:
        """Return the artifact with this id; ``latest`` is the client's last one of the kind.

        Raises:
            UnknownName: with the nearest ids that exist.
        """
        if word != "latest":
            return self.workspace.get(word, kind)
        newest = self.newest(kind)
        return newest[0] if newest else self.workspace.get(word, kind)

    def allowed_path(self, text: str) -> Path:
        """Return the path, if it lies inside an allowed root and not where the workspace keeps its own.

        Raises:
            InvalidRequest: no path is given.
            OutsideRoots: it lies elsewhere.
        """
        path = self.limits.allowed_path(text)
        if self.workspace.owns(path):
            raise OutsideRoots(
                f"{quoted(path)} belongs to the workspace, and only tools read and write its files",
                next_step="name another folder; what is stored already is used by its id",
            )
        return path

    async def progress(self, share: float, message: str = "") -> None:
        """Tell the client the share done in [0, 1] of the whole call."""
        await self._send_progress(share, message)

    def start_job(self, kind: str, recipe: Recipe, work: JobWork) -> Job:
        """Start the work as a job of the client's, or join the one that already makes this recipe."""
        return self.jobs.start(kind, recipe, work, self.services.owner)

    async def wait_for(self, job_id: str, wait_s: float) -> Job:
        """Return the job once it has ended, or as it is after ``wait_s`` seconds; the client is shown its progress."""

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
