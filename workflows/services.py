"""Opens what workflows work with, the workspace, the workers, the jobs, and closes it at the end."""

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
    """What services are opened with.

    Args:
        workspace: folder for everything that is made.
        limits: bounds on files, time and memory.
        workspace_bytes: what the workspace may take; 0 is no bound.
        cluster: address or file of a Dask scheduler that runs and generation go to; empty for this machine alone.
        planners: programs that are planners, by name.
        map_folders: folders with maps, in addition to the built-in ones.
        with_starter: put the starter scenarios into a new workspace.
        embedding_model: ranks scenarios by text.
        online: whether and how maps are asked for on the net.
        links: whether answers link what they made.
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
"""Given how jobs are run, returns how they are run instead, for instance observed."""


@asynccontextmanager
async def open_services(
    options: ServiceOptions, threads: CallThreads, jobs_apart: JobsApart = lambda run_apart, _: run_apart
) -> AsyncIterator[tuple[Services, WorkerPool]]:
    """Open workspace, workers and jobs (in these threads), and close them at the end of the block.

    Yields the services, and the workers of this machine, which a cluster may stand in for.

    Raises:
        NotPossible: a cluster is asked for, and the packages for it are not installed.
    """
    limits, root = options.limits, options.workspace
    make_private(root)
    for missing in (folder for folder in limits.roots if not folder.is_dir()):
        logger.warning("the root %s does not exist (yet): nothing can be read from there", missing)
    workspace = Workspace(root)
    if options.workspace_bytes:
        workspace.limit_room(Quota(workspace, options.workspace_bytes).admit)
    try:
        with programs_named(options.planners):
            async with (
                WorkerPool.open(limits, root / "logs" / "workers.log") as workers,
                carried_out(options.cluster, workers, limits) as executor,
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
async def carried_out(cluster: str, here: WorkerPool, limits: Limits) -> AsyncIterator[Executor]:
    """Yield what carries operations out: this machine's workers, or a cluster if one is named.

    Raises:
        NotPossible: a cluster is named, and the packages for it are not installed.
    """
    if not cluster:
        yield here
        return
    try:
        from ..engine.execution import ClusterExecutor
    except ImportError as error:
        raise NotPossible(
            f"the setting cluster asks for {cluster}, and the packages for it are not installed",
            next_step="pip install 'plannerforge-mcp[cluster]', or leave the setting out",
        ) from error
    async with ClusterExecutor.open(cluster, here, limits) as executor:
        yield executor
