"""Servers for tests: a client session in memory, and a process that can be killed at any time."""

import asyncio
import json
import os
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import anyio
import psutil
import pytest
from anyio.from_thread import BlockingPortal, start_blocking_portal
from mcp import Client

from plannerforge.engine.execution import Limits, WorkerPool
from plannerforge.engine.execution.executor import Lane, OnProgress, Operation, Request, Response, no_progress
from plannerforge.server.settings import Settings

ERAS = ("auto", "legacy")
ERA_NAMES = ("2026-07-28", "initialize")
"""Both protocol eras: the stateless revision and those that begin with ``initialize``."""
both_eras = pytest.mark.parametrize("era", ERAS, ids=ERA_NAMES)
"""For tests of what the protocol has a part in. What a tool does with its arguments is the same in both eras."""
MOST_WORKERS = 4
"""The kept workers of one kind that run at once, shared by all servers of a test."""
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
    """Workers in an event loop of their own that outlive their servers, whatever loop a server runs in: a worker
    imports its libraries only once.
    """

    def __init__(self, portal: BlockingPortal, log: Path) -> None:
        self._portal, self._log = portal, log
        self._pools: dict[tuple[int, float], WorkerPool] = {}

    @classmethod
    @contextmanager
    def until_left(cls, log: Path) -> Iterator["KeptWorkers"]:
        """Provide workers that end with the block."""
        with start_blocking_portal("asyncio") as portal:
            kept = cls(portal, log)
            yield kept
            for one in kept._pools.values():
                portal.call(one.close)

    @asynccontextmanager
    async def lent(self, limits: Limits, log: Path) -> AsyncIterator["LentWorkers"]:
        """Replace ``WorkerPool.open``: lend workers with these limits, which stay afterwards."""
        key = (limits.worker_memory_bytes, limits.operation_timeout_s)
        if key not in self._pools:
            self._pools[key] = self._portal.call(WorkerPool, replace(limits, worker_count=MOST_WORKERS), self._log)
        yield LentWorkers(self._portal, self._pools[key], limits.worker_count)


class LentWorkers:
    """Some of the kept workers, for one server in another event loop."""

    notice = ""

    def __init__(self, portal: BlockingPortal, pool: WorkerPool, capacity: int) -> None:
        self._portal, self._pool, self.capacity = portal, pool, capacity
        self._slots = {"compute": anyio.Semaphore(capacity), "retrieval": anyio.Semaphore(1)}

    @property
    def worker_pids(self) -> tuple[int, ...]:
        """The process ids of all kept workers with the same limits."""
        return self._pool.worker_pids

    async def run(
        self, operation: Operation[Request, Response], request: Request, *, on_progress: OnProgress = no_progress
    ) -> Response:
        """Run the operation in a kept worker; a cancelled caller returns once the worker has ended."""
        loop = asyncio.get_running_loop()
        reports: asyncio.Queue[tuple[float, str] | None] = asyncio.Queue()
        ended = threading.Event()

        async def there() -> Response:
            async def report(share: float, message: str) -> None:
                loop.call_soon_threadsafe(reports.put_nowait, (share, message))

            try:
                return await self._pool.run(operation, request, on_progress=report)
            finally:
                ended.set()
                loop.call_soon_threadsafe(reports.put_nowait, None)

        async with self._slots[operation.lane]:
            answer = self._portal.start_task_soon(there)
            try:
                while (told := await reports.get()) is not None:
                    await on_progress(*told)
            finally:
                if not ended.is_set():
                    answer.cancel()
                    with anyio.CancelScope(shield=True):
                        await anyio.to_thread.run_sync(ended.wait)
            return await asyncio.wrap_future(answer)

    async def warm_up(self, lane: Lane = "compute") -> None:
        """Do nothing: most workers are warm."""
