"""Runs asynchronous workflows for synchronous callers; the caller's own planners run in the caller's thread.

An event loop in a separate thread owns the workspace, the workers and the jobs. While the caller waits for a workflow,
its thread executes what only this process can do: runs of planners that are the caller's objects. A breakpoint in
``plan()`` therefore stops in the caller's own thread.
"""

import asyncio
import queue
import threading
import weakref
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar, cast

import anyio
from anyio.from_thread import BlockingPortal

from ..engine.execution import (
    CallThreads,
    Executor,
    ExecutorAround,
    OnProgress,
    Operation,
    Request,
    Response,
    no_progress,
    silent,
)
from ..engine.planners import is_planner_object
from ..schemas.boundaries import PointsRequest
from ..schemas.errors import NotPossible, PlannerFailure, PlannerForgeError
from ..schemas.planning import ReplayRequest, RunRequest
from ..workflows.context import Services, WorkflowContext
from ..workflows.services import ServiceOptions, open_services

_Answer = TypeVar("_Answer")


@dataclass
class _Errand:
    """Work for the caller's thread, and the future that receives its result."""

    work: Callable[[], Any]
    done: "Future[Any]" = field(default_factory=Future)

    def carry_out(self) -> None:
        if not self.done.set_running_or_notify_cancel():
            return
        try:
            self.done.set_result(self.work())
        except Exception as error:  # noqa: BLE001 - the thread that waits for the result raises it
            self.done.set_exception(error)
        except BaseException as stopped:  # ends the caller's wait; an event loop must not see it
            self.done.set_exception(PlannerFailure(f"the run was ended by {type(stopped).__name__}", reason="died"))
            raise


class _CallersExecutor(ExecutorAround):
    """An executor that runs the caller's own planners in the caller's thread, and everything else in the workers."""

    def __init__(self, workers: Executor, errands: "queue.SimpleQueue[_Errand | None]") -> None:
        super().__init__(workers)
        self._errands = errands

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, on_progress: OnProgress = no_progress
    ) -> Response:
        """Return the response of the operation.

        Raises:
            PlannerForgeError: The operation raised it.
        """
        run = request.run if isinstance(request, ReplayRequest) else request
        if not (isinstance(run, RunRequest | PointsRequest) and is_planner_object(run.configuration.planner)):
            return await self._inner.run(operation, request, on_progress=on_progress)
        errand = _Errand(lambda: operation.load()(request, silent))
        self._errands.put(errand)
        return cast("Response", await asyncio.wrap_future(errand.done))


@contextmanager
def _portal() -> Iterator[BlockingPortal]:
    """Yield a portal into an event loop in a daemon thread, which does not keep the program alive."""
    opened: Future[BlockingPortal] = Future()

    async def serve() -> None:
        async with BlockingPortal() as portal:
            opened.set_result(portal)
            await portal.sleep_until_stopped()

    thread = threading.Thread(target=anyio.run, args=(serve,), name="plannerforge", daemon=True)
    thread.start()
    portal = opened.result()
    try:
        yield portal
    finally:
        portal.call(portal.stop)
        thread.join()


class Caller:
    """Opens the services on first use and runs workflows on them until it is closed."""

    def __init__(self, options: ServiceOptions) -> None:
        self._options = options
        self._stack = ExitStack()
        self._is_closed = False
        weakref.finalize(self, self._stack.close)  # closes a workspace that is still open when the program ends
        self._lock = threading.RLock()
        self._errands: queue.SimpleQueue[_Errand | None] = queue.SimpleQueue()
        self._portal: BlockingPortal | None = None
        self._services: Services | None = None

    def call(self, workflow: Callable[..., Awaitable[_Answer]], *arguments: object) -> _Answer:
        """Run a workflow with the arguments of the call and a new context, and return its result.

        Raises:
            PlannerForgeError: The workflow raised it.
        """
        with self._lock:
            portal, services = self._open_services()
            context = WorkflowContext(services)
            waiting = portal.start_task_soon(partial(workflow, *arguments, context))
            waiting.add_done_callback(lambda _: self._errands.put(None))
            try:
                while not waiting.done():
                    errand = self._errands.get()
                    if errand is not None:
                        errand.carry_out()
            except BaseException:
                waiting.cancel()
                for kind, key in list(context.made_here):
                    if kind == "job":
                        with suppress(PlannerForgeError):
                            portal.call(services.jobs.cancel, key)
                raise
            return waiting.result()

    @property
    def services(self) -> Services:
        """The services, which open on first use."""
        with self._lock:
            return self._open_services()[1]

    def close(self) -> None:
        """Stop workers and jobs; stored artifacts stay."""
        with self._lock:
            self._is_closed = True
            self._portal = self._services = None
            self._stack.close()

    def _open_services(self) -> tuple[BlockingPortal, Services]:
        if self._is_closed:
            raise NotPossible("this workspace is closed", next_step="open it again with plannerforge.Workspace(folder)")
        if self._portal is None or self._services is None:
            threads = CallThreads()
            self._stack.callback(threads.close)
            self._portal = self._stack.enter_context(_portal())
            opened = self._portal.wrap_async_context_manager(open_services(self._options, threads))
            services, _ = self._stack.enter_context(opened)
            self._services = replace(services, workers=_CallersExecutor(services.workers, self._errands))
        return self._portal, self._services
