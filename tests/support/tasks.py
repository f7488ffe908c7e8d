"""The client's half of the tasks extension, for a host that declares it."""

from typing import Any, Literal

import anyio
from mcp import Client, MCPError
from mcp.client.extension import ClaimContext, ClientExtension, ResultClaim
from mcp.types import CallToolResult, Request, RequestParams, Result

EXTENSION = "io.modelcontextprotocol/tasks"


class TaskParameters(RequestParams):
    """Names a task."""

    task_id: str
    input_responses: dict[str, Any] | None = None


class BegunTask(Result):
    """The answer to a call that became a task."""

    result_type: Literal["task"] = "task"
    task_id: str
    status: str
    created_at: str
    last_updated_at: str
    ttl_ms: int | None
    poll_interval_ms: int | None = None


class TaskInfo(Result):
    """The answer of ``tasks/get``."""

    task_id: str = ""
    status: str = ""
    status_message: str | None = None
    ttl_ms: int | None = None
    result: dict[str, Any] | None = None
    error: dict[str, Any] | None = None
    input_requests: dict[str, Any] | None = None


class _Ask(Request[TaskParameters, Literal["tasks/get", "tasks/update", "tasks/cancel"]]):
    method: Literal["tasks/get", "tasks/update", "tasks/cancel"]
    name_param = "taskId"


class KnowsTasks(ClientExtension):
    """Declares the extension, and keeps the tasks that calls became."""

    identifier = EXTENSION

    def __init__(self) -> None:
        self.begun: list[BegunTask] = []

    def claims(self) -> list[ResultClaim[Any]]:
        return [ResultClaim(result_type="task", model=BegunTask, resolve=self._keep)]

    async def _keep(self, begun: BegunTask, context: ClaimContext) -> CallToolResult:
        self.begun.append(begun)
        return CallToolResult(content=[], is_error=True)  # no client checks the structure of an error


async def ask(client: Client, method: Any, task_id: str, **more: Any) -> TaskInfo:
    """Send one of the three requests."""
    parameters = TaskParameters(task_id=task_id, **more)
    return await client.session.send_request(_Ask(method=method, params=parameters), TaskInfo)


async def once_it(client: Client, task_id: str, *statuses: str) -> TaskInfo:
    """Return the task as soon as it is in one of these states."""
    with anyio.fail_after(60):
        while True:
            info = await ask(client, "tasks/get", task_id)
            if info.status in statuses:
                return info
            await anyio.sleep(0.05)


__all__ = ["EXTENSION", "BegunTask", "KnowsTasks", "MCPError", "TaskInfo", "ask", "once_it"]
