"""The extension ``io.modelcontextprotocol/tasks`` (SEP-2663): long calls with an answer that the client fetches later.

A call to a tool that creates something starts as usual. If it has not answered after a moment, a client that knows the
extension gets the id of a task. The call continues apart from the request, waits for its job to end, and its answer is
stored in the workspace. A task outlives its session and its server: see ``engine/execution/tasks.py``.
"""

import logging
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Protocol

import anyio
import anyio.abc
from mcp import MCPError
from mcp.server.context import CallNext, HandlerResult, ServerRequestContext
from mcp.server.extension import Extension, MethodBinding
from mcp.server.mcpserver.context import Context
from mcp.server.mcpserver.server import require_client_extension
from mcp.types import (
    HEADER_MISMATCH,
    INTERNAL_ERROR,
    INVALID_PARAMS,
    CallToolRequestParams,
    CallToolResult,
    ElicitResult,
    RequestParams,
)
from pydantic import Field, ValidationError
from starlette.requests import Request

from ..engine.execution import CallThreads, Job, Task, TaskStore
from ..schemas.errors import PlannerForgeError, ResourceFailure, UnknownName, error_to_report
from ..tools.call import ToolCall
from ..tools.registry import ToolSpec
from ..workflows.context import Question, Services
from .asking import STATELESS_SINCE, Asker, PacedProgress, chosen, question_request, question_result
from .clients import ClientIdentity, client_of, principal_of
from .tool_calls import InputNeeded

logger = logging.getLogger(__name__)
EXTENSION = "io.modelcontextprotocol/tasks"
GRACE_S = 2.0
"""Time after which a call becomes a task; chosen: most calls answer at once."""
_POLL_S = 1.0
"""Polling interval for clients, and for a task that checks for cancellation or answers; chosen."""
_MOST_AT_ONCE, _MOST_WAITING = 16, 100
"""Tasks that run at once in one server, including waiting ones; further calls do not become tasks. Chosen."""
_NOTE_INTERVAL_S = 0.5
_VERSIONS = frozenset({STATELESS_SINCE})


class TaskParameters(RequestParams):
    """The requested task."""

    task_id: str = Field(max_length=200)


class TaskAnswers(TaskParameters):
    """Answers to the open questions of a task, by their keys."""

    input_responses: dict[str, dict[str, Any]] = Field(default_factory=dict)


class Caller(Protocol):
    """The server, which runs calls."""

    def spec_for(self, client: ClientIdentity, name: str) -> ToolSpec | None:
        """Return the tool of this name, if the client may use it."""

    def services_for(self, client: ClientIdentity, services: Services) -> Services:
        """Return the services for this client."""

    async def carry_out(
        self,
        spec: ToolSpec,
        arguments: Mapping[str, Any],
        call: ToolCall,
        client: ClientIdentity,
        turn: anyio.Semaphore | None = None,
    ) -> CallToolResult:
        """Run a tool call."""


@dataclass
class _Work:
    """A call that runs separately: the means to stop it, and its result."""

    spec: ToolSpec
    arguments: Mapping[str, Any]
    client: ClientIdentity
    services: Services
    task: Task | None = None
    job_id: str = ""
    scope: anyio.CancelScope = field(default_factory=anyio.CancelScope)
    ended: anyio.Event = field(default_factory=anyio.Event)
    result: CallToolResult | None = None
    needed: InputNeeded | None = None
    error: MCPError | None = None

    @property
    def store(self) -> TaskStore:
        """The store of tasks."""
        return TaskStore(self.services.workspace.database)


class Tasks(Extension):
    """Starts, shows, answers and cancels tasks.

    Args:
        caller: runs the calls.
        threads: where the workspace's database is used.
    """

    identifier = EXTENSION

    def __init__(self, caller: Caller, threads: CallThreads) -> None:
        self._caller, self._threads, self._grace_s = caller, threads, GRACE_S
        self._turns = anyio.Semaphore(_MOST_AT_ONCE)
        self._works: dict[str, _Work] = {}
        self._background: anyio.abc.TaskGroup | None = None

    def run_in(self, background: anyio.abc.TaskGroup | None) -> None:
        """Run tasks in this group; None means that no more tasks can start."""
        self._background = background

    def methods(self) -> Sequence[MethodBinding]:
        """Return the three requests of the extension."""
        return [
            MethodBinding("tasks/get", TaskParameters, self._get, _VERSIONS),
            MethodBinding("tasks/update", TaskAnswers, self._update, _VERSIONS),
            MethodBinding("tasks/cancel", TaskParameters, self._cancel, _VERSIONS),
        ]

    async def intercept_tool_call(
        self, params: CallToolRequestParams, ctx: ServerRequestContext[Any], call_next: CallNext
    ) -> HandlerResult:
        """Run a call, and turn it into a task if it takes long and the client knows tasks."""
        client = client_of(ctx)
        spec = self._caller.spec_for(client, params.name)
        may_wait = spec is not None and not spec.read_only and len(self._works) < _MOST_AT_ONCE + _MOST_WAITING
        if spec is None or not may_wait or not _client_knows_tasks(ctx):
            return await call_next(ctx)
        services = self._caller.services_for(client, ctx.lifespan_context)
        work = _Work(spec, params.arguments or {}, client, services)
        context: Context[Services, Any] = Context(request_context=ctx, input_params=params)
        self._start(work, _Link(work, PacedProgress(context), Asker(context)))
        try:
            with anyio.move_on_after(self._grace_s):
                await work.ended.wait()
            if not work.ended.is_set():
                owner = _owner(ctx)
                work.task = await self._threads.run(_begin, work, owner)
                self._works[work.task.task_id] = work
        except anyio.get_cancelled_exc_class():
            work.scope.cancel()
            raise
        if work.needed is not None:
            return question_result(work.needed)
        if work.task is None:
            if work.error is not None:
                raise work.error
            return work.result
        if work.ended.is_set():
            await self._threads.run(_record, work)
        return {"resultType": "task", **_wire(work.task, detailed=False)}

    def _start(self, work: _Work, link: "_Link") -> None:
        if self._background is None:
            raise MCPError(INTERNAL_ERROR, "the server is stopping")
        self._background.start_soon(self._carry_out, work, link)

    async def _carry_out(self, work: _Work, link: "_Link") -> None:
        """Run the call and record its end, or leave it to the next server if this server stops."""
        try:
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(self._watch, work)
                with work.scope:
                    try:
                        work.result = await self._caller.carry_out(
                            work.spec, work.arguments, link.call(), work.client, self._turns
                        )
                    except InputNeeded as needed:
                        work.needed = needed
                    except Exception as raised:  # noqa: BLE001 - the boundary of a task: it becomes the task's error
                        reason = error_to_report(raised, work.spec.name).text
                        work.error = raised if isinstance(raised, MCPError) else MCPError(INTERNAL_ERROR, reason)
                tasks.cancel_scope.cancel()
        finally:
            work.ended.set()
            if work.task is not None:
                self._works.pop(work.task.task_id, None)
                with anyio.CancelScope(shield=True):
                    await self._recorded(work)

    async def _recorded(self, work: _Work) -> None:
        try:
            await self._threads.run(_record, work)
        except ResourceFailure as error:  # the next server that gets a request for the task runs it again
            logger.error("the end of a task could not be recorded: %s", error.text)  # noqa: TRY400

    async def _watch(self, work: _Work) -> None:
        """Stop the work after any server has cancelled its task."""
        while True:
            await anyio.sleep(_POLL_S)
            with suppress(ResourceFailure):  # the next check tries again
                if work.task is not None and await self._threads.run(_is_cancelled, work):
                    work.scope.cancel()

    async def _get(self, ctx: ServerRequestContext[Any], params: TaskParameters) -> HandlerResult:
        task = await self._found(ctx, params)
        if not task.ended and not task.is_carried_out:
            task = await self._take_over_task(ctx, task)
        return _wire(task, detailed=True)

    async def _take_over_task(self, ctx: ServerRequestContext[Any], task: Task) -> Task:
        """Continue a task of a server that ended; its finished parts are reused."""
        client = client_of(ctx)
        spec = self._caller.spec_for(client, task.tool)
        if spec is None or task.task_id in self._works:
            return task
        work = _Work(spec, task.arguments, client, self._caller.services_for(client, ctx.lifespan_context), task)
        if await self._threads.run(_take_over, work):
            self._works[task.task_id] = work
            context: Context[Services, Any] = Context(request_context=ctx)
            self._start(work, _Link(work, PacedProgress(context), Asker(context)))
        return task

    async def _update(self, ctx: ServerRequestContext[Any], params: TaskAnswers) -> HandlerResult:
        await self._found(ctx, params)

        async def write() -> None:
            TaskStore(ctx.lifespan_context.workspace.database).answer(params.task_id, params.input_responses)

        await self._threads.run(write)
        return {}

    async def _cancel(self, ctx: ServerRequestContext[Any], params: TaskParameters) -> HandlerResult:
        task = await self._found(ctx, params)

        async def write() -> None:
            store = TaskStore(ctx.lifespan_context.workspace.database)
            store.end(task.task_id, "cancelled", {}, "cancelled; what was finished is kept")

        if not task.ended:
            await self._threads.run(write)
            work = self._works.get(task.task_id)
            if work is not None:
                work.scope.cancel()
                await self._cancel_job(work)
        return {}

    async def _cancel_job(self, work: _Work) -> None:
        """Stop the job that a task started; a job that others started earlier continues."""
        jobs = work.services.jobs

        async def stop() -> None:
            if work.job_id and work.task is not None:
                job = jobs.store.get(work.job_id)
                is_own = job.owner == work.services.owner
                if is_own and not job.ended and job.started_at >= work.task.created_at - self._grace_s - 1.0:
                    await jobs.cancel(work.job_id)

        await self._threads.run(stop)

    async def _found(self, ctx: ServerRequestContext[Any], params: TaskParameters) -> Task:
        """Return the requested task.

        Raises:
            MCPError: the client does not know the extension, its headers contradict it, or there is no such task.
        """
        require_client_extension(ctx, EXTENSION)
        if isinstance(ctx.request, Request) and ctx.request.headers.get("mcp-name") not in (None, params.task_id):
            raise MCPError(HEADER_MISMATCH, "the header Mcp-Name is not the id of the task")
        owner = _owner(ctx)

        async def read() -> Task:
            return TaskStore(ctx.lifespan_context.workspace.database).get(params.task_id, owner)

        try:
            return await self._threads.run(read)
        except PlannerForgeError as error:
            raise MCPError(INVALID_PARAMS, error.text) from error


class _Link:
    """The connection of a call to its client: first its request, later the task's record."""

    def __init__(self, work: _Work, progress: PacedProgress, asker: Asker) -> None:
        self._work, self._progress, self._asker = work, progress, asker
        self._noted_at = -math.inf

    def call(self) -> ToolCall:
        """Return the call as a tool sees it."""
        return _TaskCall(self._work, self._send, self._ask)

    async def _send(self, share: float, message: str) -> None:
        task = self._work.task
        if task is None:
            await self._progress.send(share, message)
        elif time.monotonic() - self._noted_at >= _NOTE_INTERVAL_S:
            self._noted_at = time.monotonic()
            self._work.store.note(task.task_id, f"{share:.0%} {message}".strip())

    async def _ask(self, question: Question) -> str | None:
        """Return the answer to a question, for which a task waits; None if the client cannot ask."""
        task, store = self._work.task, self._work.store
        if task is None:
            return await self._asker.ask(question)
        if not self._asker.can_ask():
            return None
        key = self._asker.key(question)
        if key not in task.answers:
            store.ask(task.task_id, key, question_request(question))
            while key not in (task := store.get(task.task_id, task.owner)).answers and not task.ended:
                await anyio.sleep(_POLL_S / 2)
        try:
            given = ElicitResult.model_validate(task.answers.get(key, {}))
        except ValidationError:
            return None
        return chosen(given.content, question) if given.action == "accept" else None


class _TaskCall(ToolCall):
    """A call that waits for its job to end, because no client waits for the call."""

    def __init__(self, work: _Work, send: Any, ask: Any) -> None:
        super().__init__(work.services, send, ask)
        self._work = work

    async def wait_for(self, job_id: str, wait_s: float) -> Job:
        """Return the job after it has ended."""
        del wait_s
        self._work.job_id = job_id
        if self._work.task is not None:
            self._work.store.note_job(self._work.task.task_id, job_id)
        return await super().wait_for(job_id, math.inf)


async def _begin(work: _Work, owner: str) -> Task:
    task = work.store.begin(owner, work.spec.name, work.arguments)
    if work.job_id:
        work.store.note_job(task.task_id, work.job_id)
    return task


async def _take_over(work: _Work) -> bool:
    return work.task is not None and work.store.take_over(work.task)


async def _is_cancelled(work: _Work) -> bool:
    """Return whether a task was cancelled, or its lifetime is over."""
    if work.task is None:
        return False
    try:
        return work.store.get(work.task.task_id, work.task.owner).state == "cancelled"
    except UnknownName:
        return True
    except PlannerForgeError as error:
        logger.warning("a task could not be looked at: %s", error.text)
        return False


async def _record(work: _Work) -> None:
    """Record how a task ended; if that fails, the task seems to run until its lifetime is over."""
    try:
        _write_end(work)
    except PlannerForgeError as error:
        logger.error("the end of a task could not be recorded: %s", error.text)  # noqa: TRY400


def _write_end(work: _Work) -> None:
    """Record the result of a call; if its server stops, leave the task to the next server."""
    if work.task is None:
        return
    task_id, store = work.task.task_id, work.store
    if work.result is not None:
        result = work.result.model_dump(by_alias=True, mode="json", exclude_none=True)
        store.end(task_id, "completed", {"resultType": "complete", **result})
    elif work.error is not None:
        error = work.error.error.model_dump(by_alias=True, mode="json", exclude_none=True)
        store.end(task_id, "failed", error, work.error.error.message)
    elif work.needed is not None:
        store.end(task_id, "cancelled", {}, "the call ended with a question")
    else:
        store.release(task_id)  # does nothing to a cancelled one, which has ended


def _client_knows_tasks(ctx: ServerRequestContext[Any]) -> bool:
    """Return whether the client of a request knows tasks."""
    capabilities = ctx.session.client_capabilities
    declared = capabilities.extensions if capabilities is not None else None
    return ctx.protocol_version in _VERSIONS and declared is not None and EXTENSION in declared


def _owner(ctx: ServerRequestContext[Any]) -> str:
    """Return the owner of the token that started a task; empty over standard input or if there are no tokens."""
    return principal_of(ctx.request.scope) if isinstance(ctx.request, Request) else ""


def _wire(task: Task, *, detailed: bool) -> dict[str, Any]:
    """Return a task in the extension's format."""
    asks = bool(task.questions) and not task.ended
    shown: dict[str, Any] = {
        "taskId": task.task_id,
        "status": "input_required" if asks else task.state,
        "createdAt": _moment(task.created_at),
        "lastUpdatedAt": _moment(task.updated_at),
        "ttlMs": round(task.lifetime_s * 1000),
        "pollIntervalMs": round(_POLL_S * 1000),
    }
    if task.message:
        shown["statusMessage"] = task.message
    if detailed and asks:
        shown["inputRequests"] = task.questions
    if detailed and task.state == "completed":
        shown["result"] = task.result
    if detailed and task.state == "failed":
        shown["error"] = task.result
    return shown


def _moment(time_s: float) -> str:
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
