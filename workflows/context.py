"""The resources that every workflow uses: the workspace, the workers, and the client's latest artifacts."""

import threading
from collections.abc import Awaitable, Callable, Collection
from copy import copy
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
from ..engine.workspace import ARTIFACT_KINDS, Artifact, ArtifactKind, Recipe, Workspace
from ..schemas.catalog import PACKAGED_MODEL
from ..schemas.errors import OutsideRoots, UnknownName, calling, instead, misspelt_names
from ..schemas.maps import MapServices
from ..schemas.text import plural, quoted

MadeKind = ArtifactKind | Literal["job"]
_MOST_RECENT = 1_000
"""How many artifacts and jobs of a session are remembered (chosen). Older artifacts need their id."""
RESULT_WORDS = ("latest_run", "previous_run", "latest_batch", "previous_batch")
"""The words for the newest results of a client and those before them."""
_KIND_WORDS = (*RESULT_WORDS, "latest_scenario")
"""The words that refer to artifacts of one kind."""
INDEX_FOLDER = "index"
"""The folder of the text index in the workspace."""


@dataclass(frozen=True)
class Question:
    """A question to the user: a sentence, and the possible answers."""

    text: str
    choices: tuple[str, ...]


Ask = Callable[[Question], Awaitable[str | None]]
"""Asks the user a question; returns None if the client cannot ask, or the user chose nothing."""


async def cannot_ask(question: Question) -> str | None:
    """Return None, the answer for a client that cannot ask its user."""
    del question
    return None


class Recent:
    """The artifacts and jobs that one client made or chose, the latest last; they define its ``latest`` and
    ``current``.

    A client is a session of the protocol. Other clients of the workspace do not affect it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._made: dict[tuple[MadeKind, str], None] = {}
        self._reported: set[MadeKind] = set()

    def note(self, kind: MadeKind, made_id: str) -> None:
        """Remember an artifact or a job as the latest of its kind."""
        with self._lock:
            self._made.pop((kind, made_id), None)
            self._made[kind, made_id] = None
            if len(self._made) > _MOST_RECENT:
                del self._made[next(iter(self._made))]

    def last(self, kinds: Collection[MadeKind]) -> list[tuple[MadeKind, str]]:
        """Return the kind and id of what the client made or chose of the given kinds, latest first."""
        with self._lock:
            return [entry for entry in reversed(self._made) if entry[0] in kinds]

    def copied(self) -> "Recent":
        """Return an independent copy."""
        copied = Recent()
        with self._lock:
            copied._made, copied._reported = dict(self._made), set(self._reported)
        return copied

    def is_first_report(self, kind: MadeKind) -> bool:
        """Return True only the first time, so that a client learns only once that a kind's newest item is not
        its own.
        """
        with self._lock:
            is_first_report = kind not in self._reported
            self._reported.add(kind)
            return is_first_report


@dataclass(frozen=True)
class Services:
    """The resources of a client's session: workspace, workers, jobs, claims on work, limits, latest artifacts."""

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
    """Whether answers link their artifacts."""
    owner: str = ""
    """The owner of the client's token; empty if no token is required, and everything belongs to the user."""


class WorkflowContext:
    """One use of a workflow: the session's services, progress reports, and questions to the user.

    Args:
        services: the resources of the client's session.
        send_progress: receives the share done in [0, 1] and the current work.
        ask: asks the user a question; most clients cannot ask, and the answer is then None.

    Attributes:
        remarks: sentences for the caller that belong to no single field of the result.
        made_here: what this use made or found again, in order.
    """

    def __init__(self, services: Services, send_progress: OnProgress = no_progress, ask: Ask = cannot_ask) -> None:
        self.services, self.ask = services, ask
        self.remarks: list[str] = []
        self.made_here: dict[tuple[MadeKind, str], None] = {}
        self._send_progress = send_progress

    @property
    def workspace(self) -> Workspace:
        """The workspace with the artifacts."""
        return self.services.workspace

    @property
    def jobs(self) -> JobRunner:
        """The job runner."""
        return self.services.jobs

    @property
    def limits(self) -> Limits:
        """The limits on files, time and memory."""
        return self.services.limits

    def made(self, kind: MadeKind, *made_ids: str) -> None:
        """Record what the client made, or requested again, in this order."""
        for made_id in made_ids:
            self.services.recent.note(kind, made_id)
            self.made_here[kind, made_id] = None

    def within(self, begin: float, end: float) -> "WorkflowContext":
        """Return this use for a part of its work, whose progress fills a share of the whole."""
        part = copy(self)

        async def forward(share: float, message: str) -> None:
            await self.progress(begin + (end - begin) * share, message)

        part._send_progress = forward
        return part

    def newest(self, *kinds: ArtifactKind, count: int = 1) -> list[Artifact]:
        """Return the client's latest artifacts of the given kinds, then those of other clients with a single remark."""
        last = self.services.recent.last(kinds)[:count]
        own = [self.workspace.get(key, kind) for kind, key in last if kind != "job"]
        if len(own) == count:
            return own
        known = {artifact.artifact_id for artifact in own}
        stored = [artifact for kind in kinds for artifact in self.workspace.newest(kind=kind, limit=count + len(own))]
        others = sorted((one for one in stored if one.artifact_id not in known), key=lambda one: -one.sequence)
        for artifact in others[: count - len(own)]:
            if not own:
                self.remark_source(artifact.kind, artifact.artifact_id)
        return [*own, *others[: count - len(own)]]

    def remark_source(self, kind: MadeKind, made_id: str, owner: str = "the workspace's") -> None:
        """Add a remark, once for each kind, that a word refers to something from outside this session."""
        if self.services.recent.is_first_report(kind):
            self.remarks.append(f"This session has no {plural(kind)} yet, so {owner} newest one, {made_id}, is used.")

    def artifact(self, word: str, kind: ArtifactKind) -> Artifact:
        """Return the artifact with this id; ``latest`` means the client's newest artifact of this kind.

        Raises:
            UnknownName: there is no such artifact; the error lists the nearest ids or, if the word refers to something
                of another kind, what belongs to it.
        """
        if word not in ("latest", f"latest_{kind}"):
            try:
                return self.workspace.get(word, kind)
            except UnknownName as refusal:
                other = self._other_meaning(word, kind)
                raise other or refusal.with_words(word, ("latest", f"latest_{kind}")) from refusal.__cause__
        newest = self.newest(kind)
        return newest[0] if newest else self.workspace.get("latest", kind)

    def _other_meaning(self, word: str, wanted: ArtifactKind) -> UnknownName | None:
        """Return the refusal of a word that refers, perhaps misspelt, to an artifact of another kind, or None."""
        known = self._of_another_kind(word, wanted)
        meant = word
        if known is None and (job := self.meant_job(word)) is not None:
            return job
        if known is None:
            own = ("latest", f"latest_{wanted}")
            meant = next(iter(misspelt_names(word, (*own, *_KIND_WORDS))), "")
            known = None if meant in own else self._of_another_kind(meant, wanted)
        if known is None:
            return None
        belonging = self._belonging_to(known, wanted)
        what = f"'{word}' is" if meant == word else f"there is no {wanted} '{word}'; {meant} is"
        return UnknownName(
            f"{what} a {known.kind}, not a {wanted}",
            valid=belonging,
            next_step=f"use the id of a {wanted}",
            remedies=[instead(word, belonging[0])] if len(belonging) == 1 else [],
        ).also(calling("list_artifacts", kind=wanted))

    def meant_job(self, word: str) -> UnknownName | None:
        """Return the refusal of a job's id in place of an artifact's, with the job's results; None for other words."""
        if not word.startswith("job_"):
            return None
        try:
            job = self.jobs.store.get(word)
        except UnknownName:
            return None
        results = sorted(job.results, key=lambda one: one.startswith("run_"))  # its batch or study comes first
        return UnknownName(
            f"{word} is a {job.kind} job, not an artifact, and {'has' if results else 'has no'} results",
            valid=results,
            next_step="use one of its results" if results else "repeat the call that started it to get its answer",
            remedies=[instead(word, one) for one in results[:1]],
        ).also(calling("get_job", job_id=word))

    def _of_another_kind(self, word: str, wanted: ArtifactKind) -> Artifact | None:
        """Return the artifact of another kind that an id or a word such as ``latest_batch`` refers to, or None."""
        if word in _KIND_WORDS:
            age, _, kind = word.partition("_")
            stored = self.newest(kind, count=1 if age == "latest" else 2)  # type: ignore[arg-type]
            return stored[-1] if stored and kind != wanted else None
        kinds = (kind for kind in ARTIFACT_KINDS if kind != wanted)
        found = (self.workspace.find(kind, word) for kind in kinds)  # type: ignore[arg-type]
        return next((one for one in found if one is not None), None)

    def _belonging_to(self, known: Artifact, wanted: ArtifactKind) -> list[str]:
        """Return the ids of the artifacts of a kind that belong to a run or a batch, each once."""
        key = {"scenario": "scenario_id", "config": "config_id"}.get(wanted)
        runs = [known] if known.kind == "run" else []
        if known.kind == "batch":
            found = (self.workspace.find("run", run_id) for run_id in known.record["runs"])
            runs = [run for run in found if run is not None]
        return list(dict.fromkeys(str(run.record[key]) for run in runs)) if key is not None else []

    def allowed_path(self, text: str) -> Path:
        """Return the path, if it is inside an allowed root and outside the workspace's own folders.

        Raises:
            InvalidRequest: no path is given.
            OutsideRoots: the path is elsewhere.
        """
        path = self.limits.allowed_path(text)
        if self.workspace.owns(path):
            raise OutsideRoots(
                f"{quoted(path)} belongs to the workspace; only tools may read and write its files",
                next_step="use another folder, or refer to stored artifacts by id",
            )
        return path

    async def progress(self, share: float, message: str = "") -> None:
        """Report the share done in [0, 1] of the whole call to the client."""
        await self._send_progress(share, message)

    def start_job(self, kind: str, recipe: Recipe, work: JobWork) -> Job:
        """Start the work as a job of the client, or join the job that already has this recipe."""
        return self.jobs.start(kind, recipe, work, self.services.owner)

    async def wait_for(self, job_id: str, wait_s: float) -> Job:
        """Show the client a job's progress, and return the job once it has ended or ``wait_s`` seconds have passed."""

        async def show(job: Job) -> None:
            await self.progress(job.share, job.message)

        return await self.jobs.wait(job_id, wait_s, show)

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, share: tuple[float, float] = (0.0, 1.0)
    ) -> Response:
        """Run an engine operation in a warm worker; its progress fills ``share`` of the call's progress.

        Raises:
            PlannerForgeError: the operation failed or timed out, or the worker died.
        """
        begin, end = share

        async def forward(done: float, message: str) -> None:
            await self.progress(begin + (end - begin) * done, message)

        return await self.services.workers.run(operation, request, on_progress=forward)
