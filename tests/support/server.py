"""Servers for tests: a client session in memory, and a process that can be killed at any time."""

import json
import os
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Sequence
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any, Protocol

import psutil
import pytest
from mcp import Client

from plannerforge.engine.execution import Limits, WorkerPool
from plannerforge.server.settings import Settings

ERAS = ("auto", "legacy")
ERA_NAMES = ("2026-07-28", "initialize")
"""Both protocol eras: the stateless revision and those that begin with ``initialize``."""
both_eras = pytest.mark.parametrize("era", ERAS, ids=ERA_NAMES)
"""For tests of what the protocol has a part in. What a tool does with its arguments is the same in both eras."""
GUARD_S = 120.0
"""A server that does not answer for so long hangs: it is killed, and the test fails instead of hanging as well."""


class StdioServer:
    """``plannerforge serve`` on a workspace; it may read and write its working folder."""

    def __init__(self, folder: Path, arguments: Sequence[str] = ()) -> None:
        environment = {
            **os.environ,
            "PLANNERFORGE_WORKSPACE": str(folder / "workspace"),
            "PLANNERFORGE_STARTER": "false",
            "PLANNERFORGE_WARM_UP": "false",
        }
        self.process = subprocess.Popen(
            [sys.executable, "-m", "plannerforge", "serve", *arguments],
            cwd=folder,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self._requests = 0
        client = {"name": "test", "version": "1"}
        self._request("initialize", {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": client})
        self._send({"jsonrpc": "2.0", "method": "notifications/initialized"})

    def call(self, tool: str, **arguments: Any) -> Any:
        """Return the structured answer of a tool, or the text of its error."""
        result = self._request("tools/call", {"name": tool, "arguments": arguments})["result"]
        return result["content"][0]["text"] if result.get("isError") else result["structuredContent"]

    def kill(self) -> None:
        """Kill the process."""
        self.process.kill()
        self.process.communicate()

    def _request(self, method: str, parameters: dict[str, Any]) -> Any:
        self._requests += 1
        self._send({"jsonrpc": "2.0", "id": self._requests, "method": method, "params": parameters})
        assert self.process.stdout is not None
        guard = threading.Timer(GUARD_S, self.process.kill)
        guard.start()
        try:
            for line in self.process.stdout:
                answer = json.loads(line)
                if answer.get("id") == self._requests:
                    return answer
        finally:
            guard.cancel()
        raise AssertionError(f"the server ended, or was killed because it did not answer {method} for {GUARD_S:g} s")

    def _send(self, message: dict[str, Any]) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(message) + "\n")
        self.process.stdin.flush()


class Connect(Protocol):
    """Opens a client session with a server; options are those of the client."""

    def __call__(self, settings: Settings | None = None, **options: Any) -> AbstractAsyncContextManager[Client]: ...


def worker_processes() -> set[psutil.Process]:
    """Return workers of this test process."""
    return {child for child in psutil.Process().children(recursive=True) if _is_worker(child)}


def _is_worker(process: psutil.Process) -> bool:
    try:
        return "plannerforge.engine.execution.worker" in " ".join(process.cmdline())
    except (psutil.NoSuchProcess, psutil.ZombieProcess):  # it ended since it was listed
        return False


class KeptWorkers:
    """Pools that outlive their servers, so that a worker imports its libraries only once."""

    def __init__(self, stack: AsyncExitStack, log: Path) -> None:
        self._stack, self._log, self._open = stack, log, WorkerPool.open
        self._pools: dict[tuple[int, int, float], WorkerPool] = {}

    @classmethod
    @asynccontextmanager
    async def until_left(cls, log: Path) -> AsyncIterator["KeptWorkers"]:
        """Provide pools that end with the block."""
        async with AsyncExitStack() as stack:
            yield cls(stack, log)

    @asynccontextmanager
    async def lent(self, limits: Limits, log: Path) -> AsyncIterator[WorkerPool]:
        """Replace ``WorkerPool.open`` with the pool of these limits, which stays open afterwards."""
        key = (limits.worker_count, limits.worker_memory_bytes, limits.operation_timeout_s)
        if key not in self._pools:
            self._pools[key] = await self._stack.enter_async_context(self._open(limits, self._log))
        yield self._pools[key]
