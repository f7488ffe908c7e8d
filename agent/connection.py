"""The agent's connection to an MCP server: its tools in a form for models, and calls to them.

The connection runs in its own task, so an interrupted call does not affect it, and a server that ended is restarted.
"""

import base64
import json
import os
import shlex
import sys
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import anyio
from anyio.abc import TaskGroup, TaskStatus
from mcp import Client, MCPError, StdioServerParameters
from mcp.client import Transport
from mcp.client.stdio import stdio_client
from mcp.server import MCPServer
from mcp.types import CallToolResult, EmbeddedResource, ImageContent, ResourceLink, TextContent, Tool
from pydantic import ValidationError

from .errors import SettingsFault, ToolServerGone
from .models.interface import ToolDefinition
from .tool_schemas import flattened

ToolSet = Literal["all", "essential"]
Server = StdioServerParameters | MCPServer | str
"""A program to start, a server in this process, or the address of a server (streamable HTTP)."""
OnProgress = Callable[[float | None, str], None]
"""Receives the completed share, 0 to 1 (None if unknown), and the current activity."""
_CLOSED = -32000
"""The code of a closed connection, ``mcp_types.CONNECTION_CLOSED``."""
_MOST_PAGES = 50
"""Maximum number of pages in a list of tools (chosen: a server with endless pages must not block the agent)."""


@dataclass(frozen=True)
class Picture:
    """A picture of an answer; ``link`` is its address on the server, if given."""

    data: bytes
    mime_type: str


@dataclass(frozen=True)
class ToolAnswer:
    """The result of a call: text and a structure with the same content for the model; pictures and links for
    the user.
    """

    text: str
    structured: Mapping[str, Any]
    is_error: bool
    pictures: tuple[Picture, ...] = ()
    links: tuple[str, ...] = ()


class ToolSource(Protocol):
    """A source of tools: an MCP server, or a replacement for one."""

    @property
    def tools(self) -> tuple[ToolDefinition, ...]:
        """The tools in the model's format."""

    @property
    def instructions(self) -> str:
        """The server's instructions for its tools."""

    async def ready(self) -> bool:
        """Make sure that calls are possible; return True if the server had to be restarted.

        Raises:
            ToolServerGone: The server cannot be started.
        """

    async def call(self, tool: str, arguments: Mapping[str, Any], on_progress: OnProgress) -> ToolAnswer:
        """Make a call and wait for its answer; a refusal is also an answer.

        Raises:
            ToolServerGone: The server ended before it answered.
        """


def own_server(*, workspace: str = "", tools: ToolSet = "all") -> StdioServerParameters:
    """Return this package's server as a child process, with the settings in this process's environment."""
    arguments = ["-P", "-m", "plannerforge", "serve", "--tools", tools]
    arguments += ["--workspace", workspace] if workspace else []
    handed_on = ("PLANNERFORGE_", "PYTHON")
    environment = {name: value for name, value in os.environ.items() if name.startswith(handed_on)}
    return StdioServerParameters(command=sys.executable, args=arguments, env=environment)


def server_of_command(command: str) -> StdioServerParameters:
    """Return the server that a command line starts, with the environment of this process.

    Raises:
        SettingsFault: The command is empty, or has an unclosed quote.
    """
    try:
        program, *arguments = shlex.split(command)
    except ValueError as error:
        raise SettingsFault(f"the server's command {command!r} cannot be read: {error}") from error
    return StdioServerParameters(command=program, args=arguments, env=dict(os.environ))


class ToolConnection:
    """A connection to an MCP server (``open``), which restarts the server if it has ended."""

    def __init__(self, server: Server, tasks: TaskGroup, log: Path | None = None) -> None:
        self._server, self._tasks, self._log = server, tasks, log
        self._client: Client | None = None
        self._leave = anyio.Event()
        self._tools: tuple[ToolDefinition, ...] = ()
        self._instructions = ""

    @classmethod
    @asynccontextmanager
    async def open(cls, server: Server, log: Path | None = None) -> AsyncIterator["ToolConnection"]:
        """Connect to a server for the duration of the block.

        Args:
            log: A file for the standard error of a server program; by default it goes to our own.

        Raises:
            ToolServerGone: The server cannot be started, or nothing answers at its address.
        """
        async with anyio.create_task_group() as tasks:
            connection = cls(server, tasks, log)
            failure: Exception | None = None
            try:
                await connection.ready()
                yield connection
            except Exception as error:  # noqa: BLE001 - raised below, since a task group would wrap it
                failure = error
            finally:
                connection._leave.set()
        if failure is not None:
            raise failure

    @property
    def tools(self) -> tuple[ToolDefinition, ...]:
        """The server's tools, flattened for models."""
        return self._tools

    @property
    def instructions(self) -> str:
        """The server's own instructions for its tools."""
        return self._instructions

    async def ready(self) -> bool:
        """Start the server if it is not running, and return True if it had to be restarted; see ``ToolSource``."""
        if self._client is not None:
            return False
        self._leave = anyio.Event()
        problem = await self._tasks.start(self._keep, self._leave)
        if problem:
            step = f"check that its command or address is right{f', and the log {self._log}' if self._log else ''}"
            raise ToolServerGone(f"the MCP server cannot be reached: {problem}", next_step=step)
        return True

    async def call(self, tool: str, arguments: Mapping[str, Any], on_progress: OnProgress) -> ToolAnswer:
        """Make a call; see ``ToolSource``."""

        async def progressed(progress: float, total: float | None, message: str | None) -> None:
            on_progress(progress / total if total else None, message or "")

        if self._client is None:
            raise ToolServerGone(f"the MCP server ended before {tool} was called")
        try:
            return _answer(await self._client.call_tool(tool, dict(arguments), progress_callback=progressed))
        except MCPError as error:
            if error.error.code == _CLOSED:
                raise self._gone(tool) from error
            return ToolAnswer(error.error.message, {}, is_error=True)
        except (anyio.ClosedResourceError, anyio.BrokenResourceError, OSError) as error:
            raise self._gone(tool) from error
        except (ValidationError, RuntimeError, ValueError) as error:  # an answer that breaks the protocol
            return ToolAnswer(f"the server's answer cannot be read: {error}", {}, is_error=True)

    def _gone(self, tool: str) -> ToolServerGone:
        self._client = None
        self._leave.set()
        return ToolServerGone(f"the MCP server ended while it worked on {tool}")

    async def _keep(self, leave: anyio.Event, *, task_status: TaskStatus[str]) -> None:
        """Keep a connection open until ``leave`` is set; report an empty string, or the reason why there is no
        connection.
        """
        started = False
        stack = ExitStack()
        try:
            async with Client(self._transport(stack)) as client:
                self._tools = tuple([_definition(tool) async for tool in _all_tools(client)])
                self._instructions = client.instructions or ""
                self._client, started = client, True
                task_status.started("")
                await leave.wait()
        except Exception as error:  # noqa: BLE001 - the boundary of the connection: the exception becomes a turn's error
            if not started:
                task_status.started(_first_words(error))
        finally:
            stack.close()
            if started and self._leave is leave:
                self._client = None

    def _transport(self, stack: ExitStack) -> Server | Transport:
        """Return the server or, with a log, a transport that writes to it; the stack closes the file."""
        if self._log is None or not isinstance(self._server, StdioServerParameters):
            return self._server
        self._log.parent.mkdir(parents=True, exist_ok=True)
        return stdio_client(self._server, stack.enter_context(self._log.open("a", encoding="utf-8")))


async def _all_tools(client: Client) -> AsyncIterator[Tool]:
    cursor: str | None = None
    for _ in range(_MOST_PAGES):
        listed = await client.list_tools(cursor=cursor)
        for tool in listed.tools:
            yield tool
        cursor = listed.next_cursor
        if cursor is None:
            return


def _definition(tool: Tool) -> ToolDefinition:
    read_only = bool(tool.annotations and tool.annotations.read_only_hint)
    return ToolDefinition(tool.name, tool.description or "", flattened(tool.input_schema), read_only)


def _first_words(error: BaseException) -> str:
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return str(error) or type(error).__name__


def _answer(result: CallToolResult) -> ToolAnswer:
    texts = [block.text for block in result.content if isinstance(block, TextContent)]
    texts += [
        str(block.resource.text)
        for block in result.content
        if isinstance(block, EmbeddedResource) and hasattr(block.resource, "text")
    ]
    structured = result.structured_content or {}
    pictures = tuple(
        Picture(base64.b64decode(block.data), block.mime_type)
        for block in result.content
        if isinstance(block, ImageContent)
    )
    text = "\n".join(texts) or (json.dumps(structured, ensure_ascii=False) if structured else "")
    links = tuple(str(block.uri) for block in result.content if isinstance(block, ResourceLink))
    return ToolAnswer(text, structured, bool(result.is_error), pictures, links)


def shown_to_model(answer: ToolAnswer, most_characters: int) -> str:
    """Return the answer's text for the model, cut if it is too long, with a note on pictures shown to the user."""
    text = answer.text or "(an empty answer)"
    if len(text) > most_characters:
        kept = text[:most_characters]
        text = (
            f"{kept}\n[cut: {len(kept):,} of {len(text):,} characters are shown; request less at once, with a limit, a "
            "filter or less detail]"
        )
    if answer.pictures:
        count = len(answer.pictures)
        text += f"\n[{count} picture{'s' if count > 1 else ''} shown to the user]"
    return text
