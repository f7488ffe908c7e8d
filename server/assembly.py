"""Assembles a server from its settings."""

import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import anyio

from ..engine.execution import CallThreads, MemoryTrimmer, WorkerPool
from ..engine.workspace import Workspace
from ..schemas.catalog import BuildIndexRequest
from ..schemas.errors import PlannerForgeError, error_to_report
from ..tools.registry import TOOLS, ToolSpec, only_reading
from ..workflows.context import INDEX_FOLDER, Services
from ..workflows.services import open_services as open_workflow_services
from .application import MOST_CALLS, OnEnd, PlannerForgeServer
from .observing.journal import JOURNAL, Journal
from .observing.logs import log_call, log_to_stderr
from .settings import Settings

if TYPE_CHECKING:
    from .observing.telemetry import Telemetry

logger = logging.getLogger(__name__)
_SERVER_MB, _CALL_MB = 128, 16
"""Data memory of an idle server (80 to 115 MB), and of a call: its thread, and an answer of some megabytes in its
forms. Measured: a server of 256 MB with 44 simultaneous calls and two jobs ends with 222 MB in use.
"""
_WARM_UP_DELAY_S = 1.0
"""The first answers come before the first worker: both need the same cores."""


def create_server(
    settings: Settings, start_folder: Path | None = None, *, extra_tools: tuple[ToolSpec, ...] = ()
) -> PlannerForgeServer:
    """Return a server for the given settings; its services start with its first connection and end with it.

    Args:
        start_folder: the base of relative paths; default: the working folder.
        extra_tools: additional tools.
    """
    log_to_stderr(settings.log_level, settings.log_format, settings.journal_redact)
    workspace_root = settings.workspace.expanduser().resolve()
    folder = start_folder or Path.cwd()
    journal_path = workspace_root / JOURNAL
    journal = (
        Journal(journal_path, settings.journal_mb * 1024**2, settings.journal_redact) if settings.journal else None
    )

    threads, telemetry = CallThreads(), _telemetry_of(settings)

    @asynccontextmanager
    async def services() -> AsyncIterator[Services]:
        try:
            async with open_services(settings, folder, threads, telemetry) as opened:
                yield opened
        finally:
            threads.close()
            ends = [each.close for each in (telemetry, journal) if each is not None]
            with anyio.CancelScope(shield=True):
                async with anyio.create_task_group() as tasks:  # immediately: a client kills the server after 2 s
                    for end in ends:
                        tasks.start_soon(_ended, end)

    heaps = MemoryTrimmer()
    on_end: list[OnEnd] = [log_call, lambda _: heaps.after_work()]
    if telemetry is not None:
        on_end.append(telemetry.call_ended)
    tools, most_calls = (*offered_tools(settings), *extra_tools), calls_within(settings.server_memory_mb)
    return PlannerForgeServer(tools, services, threads, journal, on_end, most_calls)


def calls_within(memory_mb: int) -> int:
    """Return the number of simultaneous calls that this data memory of the server's process allows; 0 means no bound.

    Native libraries end the process if they get no memory, so calls wait for their turn instead.
    """
    return max(1, min(MOST_CALLS, (memory_mb - _SERVER_MB) // _CALL_MB)) if memory_mb else MOST_CALLS


async def _ended(end: Callable[[], None]) -> None:
    """Shut down a part of the server in a separate thread, or in the current thread if no thread can be started."""
    try:
        await anyio.to_thread.run_sync(end)
    except RuntimeError:
        end()


def _telemetry_of(settings: Settings) -> "Telemetry | None":
    if not settings.telemetry_endpoint:
        return None
    from .observing.telemetry import Telemetry

    return Telemetry.sending_to(settings.telemetry_endpoint)


@asynccontextmanager
async def open_services(
    settings: Settings, start_folder: Path, threads: CallThreads, telemetry: "Telemetry | None" = None
) -> AsyncIterator[Services]:
    """Open the resources of tools according to the settings, and close them at the end of the block."""
    jobs_apart = telemetry.jobs_apart if telemetry is not None else lambda run_apart, _: run_apart
    async with (
        open_workflow_services(settings.service_options(start_folder), threads, jobs_apart) as (opened, pool),
        anyio.create_task_group() as tasks,
    ):
        if settings.warm_up:
            tasks.start_soon(_warmed_up, pool, opened.workspace, threads, settings.embedding_model)
        if telemetry is not None:
            watched = telemetry.watched(opened.workers, lambda: len(pool.worker_pids))
            opened = replace(opened, workers=watched)
        yield opened
        tasks.cancel_scope.cancel()


def offered_tools(settings: Settings) -> tuple[ToolSpec, ...]:
    """Return the tools that the settings offer, in registry order; the small set has no rare arguments."""
    offered = [spec for spec in TOOLS if settings.tools == "all" or spec.essential]
    if settings.tools != "all":
        offered = [replace(spec, unlisted=spec.seldom) for spec in offered]
    return only_reading(offered) if settings.read_only else tuple(offered)


async def _warmed_up(workers: WorkerPool, workspace: Workspace, threads: CallThreads, model: str) -> None:
    """Warm up; log failures, because the first call that needs a failed part tries it again."""
    try:
        await warm_up(workers, workspace, threads, model)
    except Exception as raised:  # noqa: BLE001 - no call depends on this, and the server works without it
        logger.warning("the warm-up failed: %s", error_to_report(raised, "warm-up").text)


async def warm_up(
    workers: WorkerPool, workspace: Workspace, threads: CallThreads, model: str, *, delay_s: float = _WARM_UP_DELAY_S
) -> None:
    """Import the tools, start a worker of each lane and build the text index, before they are needed.

    Failures are logged.
    """
    await anyio.sleep(delay_s)
    await threads.run(_import_tools)
    from ..workflows.operations import BUILD_INDEX  # its models are not needed before the first answers

    await workers.warm_up("compute")
    await workers.warm_up("retrieval")
    request = BuildIndexRequest(database=workspace.database.path, index=workspace.root / INDEX_FOLDER, model=model)
    try:
        built = await workers.run(BUILD_INDEX, request)
        if built.mended:
            logger.warning("the text index in %s was damaged and is being rebuilt", request.index)
    except PlannerForgeError as error:  # not needed yet: a search by text gets the error
        logger.warning("the text index could not be prepared: %s", error.text)


async def _import_tools() -> None:
    """Load what the first calls need; other threads get the processor in between."""
    for spec in TOOLS:
        spec.load_function()
