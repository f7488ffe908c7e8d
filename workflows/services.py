"""Open and close the resources of workflows: the workspace, the workers and the jobs."""

import logging
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

import anyio

from ..engine.execution import (
    CallThreads,
    Claims,
    Executor,
    JobRunner,
    JobStore,
    Limits,
    ReachableExecutor,
    RunApart,
    WorkerPool,
)
from ..engine.planners import programs_named
from ..engine.workspace import Quota, Workspace, make_private
from ..schemas.catalog import PACKAGED_MODEL
from ..schemas.errors import NotPossible
from ..schemas.maps import MapServices
from ..schemas.planning import CommandPlanner
from .context import Services

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ServiceOptions:
    """The options of the services.

    Args:
        workspace: folder for all artifacts.
        limits: limits on files, time and memory.
        workspace_bytes: maximum size of the workspace; 0 means no limit.
        cluster: address or file of a Dask scheduler for runs and generation; empty uses only this machine.
        planners: external planner programs, by name.
        map_folders: folders with maps, in addition to the built-in ones.
        with_starter: put the starter scenarios into a new workspace.
        embedding_model: ranks scenarios by text.
        online: whether and how to request maps from online services.
        links: whether answers link their artifacts.
    """

    workspace: Path
    limits: Limits
    workspace_bytes: int = 0
    cluster: str = ""
    planners: Mapping[str, CommandPlanner] = field(default_factory=dict)
    map_folders: tuple[Path, ...] = ()
    with_starter: bool = True
    embedding_model: str = PACKAGED_MODEL
    online: MapServices = field(default_factory=MapServices)
    links: bool = True


JobsApart = Callable[[RunApart, JobStore], RunApart]
"""Wraps how jobs are run, for example to observe them."""


@asynccontextmanager
async def open_services(
    options: ServiceOptions, threads: CallThreads, jobs_apart: JobsApart = lambda run_apart, _: run_apart
) -> AsyncIterator[tuple[Services, WorkerPool]]:
    """Open workspace, workers and jobs (in these threads), and close them at the end of the block.

    Yields the services, and the workers of this machine, which a cluster may replace.

    Raises:
        NotPossible: a cluster is requested, but its packages are not installed.
    """
    limits, root = options.limits, options.workspace
    make_private(root)
    for missing in (folder for folder in limits.roots if not folder.is_dir()):
        logger.warning("the root %s does not exist (yet), so nothing can be read from it", missing)
    workspace = Workspace(root)
    if options.workspace_bytes:
        workspace.limit_room(Quota(workspace, options.workspace_bytes).admit)
    try:
        with programs_named(options.planners):
            async with (
                WorkerPool.open(limits, root / "logs" / "workers.log") as workers,
                operation_executor(options.cluster, workers, limits) as executor,
                anyio.create_task_group() as tasks,
            ):
                store = JobStore(workspace.database)
                services = Services(
                    workspace,
                    ReachableExecutor(executor),
                    JobRunner(store, tasks, jobs_apart(threads.run, store)),
                    Claims(workspace.database),
                    limits,
                    options.map_folders,
                    options.with_starter,
                    options.embedding_model,
                    online=options.online,
                    links=options.links,
                )
                yield services, workers
                tasks.cancel_scope.cancel()
    finally:
        workspace.close()


@asynccontextmanager
async def operation_executor(cluster: str, here: WorkerPool, limits: Limits) -> AsyncIterator[Executor]:
    """Yield the executor of operations: this machine's workers, or a cluster if one is given.

    Raises:
        NotPossible: a cluster is given, but its packages are not installed.
    """
    if not cluster:
        yield here
        return
    try:
        from ..engine.execution import ClusterExecutor
    except ImportError as error:
        raise NotPossible(
            f"the setting cluster requests {cluster}, but its packages are not installed",
            next_step="pip install 'plannerforge-mcp[cluster]', or leave the setting out",
        ) from error
    async with ClusterExecutor.open(cluster, here, limits) as executor:
        yield executor
