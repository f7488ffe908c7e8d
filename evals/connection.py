"""The server under evaluation: a child process with its own workspace and the data of a corpus."""

import os
import shutil
import sys
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mcp import StdioServerParameters

from ..agent.connection import ToolAnswer, ToolConnection, ToolSet
from ..agent.errors import ToolServerGone
from ..schemas.errors import ResourceFailure
from .attempts import MadeCall

_WAIT_S = 50
"""Time for which the server is asked to wait for a job: the most that it accepts."""
_PREPARED = "prepared"
_IMMUTABLE = {"scenario.xml", "scenario.net.xml"}


@dataclass(frozen=True)
class ServerSetup:
    """The data of a server under evaluation.

    ``base`` is a workspace to copy at the start; ``scenarios`` and ``maps`` are folders of the corpora's files. Without
    them, the server has the starter catalogue and the built-in maps. ``journal``: whether the workspace records calls.
    """

    workspace: Path
    base: Path | None = None
    scenarios: Path | None = None
    maps: Path | None = None
    tools: ToolSet = "all"
    journal: bool = False

    def command(self) -> StdioServerParameters:
        """Return the command that starts the server."""
        roots = [str(folder) for folder in (self.scenarios, self.maps) if folder]
        wanted = {
            "PLANNERFORGE_ROOTS": os.pathsep.join(roots),
            "PLANNERFORGE_MAP_FOLDERS": str(self.maps or ""),
            "PLANNERFORGE_STARTER": "false" if self.scenarios else "true",
            "PLANNERFORGE_WARM_UP": "false",
            "PLANNERFORGE_MAPS_ONLINE": "offline",  # requests for places without a map must be refused
            "PLANNERFORGE_WORKERS": "1",
            "PLANNERFORGE_JOURNAL": "true" if self.journal else "false",
        }
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PLANNERFORGE_")}
        environment |= {name: value for name, value in wanted.items() if value}
        serve = ["-m", "plannerforge", "serve", "--workspace", str(self.workspace), "--tools", self.tools]
        return StdioServerParameters(command=sys.executable, args=serve, env=environment)


class ServerSession:
    """A ``ToolSession`` over MCP. ``workspace`` is the folder of its artifacts."""

    def __init__(self, connection: ToolConnection, workspace: Path) -> None:
        self.connection, self.workspace = connection, workspace

    async def call(self, tool: str, arguments: Mapping[str, Any], turn: int = 0) -> MadeCall:
        """Make a call and wait for its answer; see ``ToolSession``. If the server is gone, the answer is an error."""
        began = time.perf_counter()
        try:
            await self.connection.ready()
            answer = await self.connection.call(tool, arguments, _ignore_progress)
            while answer.structured.get("state") == "running" and "job_id" in answer.structured and tool != "get_job":
                polled = {"job_id": answer.structured["job_id"], "wait_s": _WAIT_S}
                answer = await self.connection.call("get_job", polled, _ignore_progress)
        except ToolServerGone as error:
            answer = ToolAnswer(error.text, {}, is_error=True)
        spent_s = time.perf_counter() - began
        return MadeCall(tool, arguments, answer.text, answer.structured, answer.is_error, spent_s, turn)


def _ignore_progress(share: float | None, message: str) -> None:
    del share, message


@asynccontextmanager
async def open_session(setup: ServerSetup) -> AsyncIterator[ServerSession]:
    """Open a session with a server that starts for it and ends with it.

    Raises:
        ToolServerGone: the server cannot be started.
    """
    setup.workspace.mkdir(parents=True, exist_ok=True)
    async with ToolConnection.open(setup.command()) as connection:
        yield ServerSession(connection, setup.workspace)


async def prepare(setup: ServerSetup) -> None:
    """Fill the workspace with the corpora's scenarios, once.

    Raises:
        ResourceFailure: the server refused to import the scenarios.
        ToolServerGone: the server cannot be started.
    """
    mark = setup.workspace / _PREPARED
    if mark.exists():
        return
    shutil.rmtree(setup.workspace, ignore_errors=True)
    if setup.base:
        _copy(setup.base, setup.workspace)
    async with open_session(setup) as session:
        if setup.scenarios:
            answer = await session.call("import_files", {"path": str(setup.scenarios.resolve())})
        else:
            answer = await session.call("describe_catalog", {})
        if answer.is_error:
            raise ResourceFailure(
                f"the scenarios in {setup.scenarios} cannot be imported: {answer.text}",
                next_step="use a folder of CommonRoad files with --scenarios",
            )
    mark.touch()


def _copy(workspace: Path, target: Path) -> None:
    try:
        unmarked = shutil.ignore_patterns(_PREPARED, "logs", "scratch", "*.lock", "*.sock")
        shutil.copytree(workspace, target, ignore=unmarked, copy_function=_linked)
    except (OSError, shutil.Error) as error:
        raise ResourceFailure(
            f"the workspace {workspace} cannot be copied: {error}", next_step="use a workspace with --workspace"
        ) from error


def _linked(source: str, target: str) -> None:
    """Link files of artifacts, which never change, if the disk allows it; copy all other files."""
    if Path(source).name in _IMMUTABLE:
        try:
            os.link(source, target)
        except OSError:
            shutil.copy2(source, target)
    else:
        shutil.copy2(source, target)


def copied(setup: ServerSetup, workspace: Path) -> ServerSetup:
    """Return the setup with a new copy of its prepared workspace, which replaces an old copy."""
    shutil.rmtree(workspace, ignore_errors=True)
    _copy(setup.workspace, workspace)
    return replace(setup, workspace=workspace)
