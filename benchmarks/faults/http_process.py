"""Starts and stops an HTTP server for benches, and connects a client."""

import os
import sys
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx2
import psutil
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from mcp.types import CONNECTION_CLOSED, ErrorData, JSONRPCError

_TIMEOUT_S = 120.0
_STOP_S = 60.0
"""Time limits for an answer, and for the end of the server (chosen)."""
QUIET = {"PLANNERFORGE_MAPS_ONLINE": "offline"}


@dataclass(frozen=True)
class HttpProcess:
    """A listening server process and its address."""

    process: psutil.Process
    url: str


@contextmanager
def http_process(
    folder: Path,
    arguments: Sequence[str] = ("-m", "plannerforge", "serve", "--http"),
    settings: Mapping[str, str] | None = None,
) -> Iterator[HttpProcess]:
    """Run a server in a folder on a free port, and end it by a signal, as an operator does.

    Raises:
        RuntimeError: it did not start to listen, or did not end well.
    """
    environment = {**os.environ, **QUIET, "PLANNERFORGE_WORKSPACE": str(folder / "workspace"), **(settings or {})}
    log = folder / "server.log"
    with listening(arguments, folder, environment, log) as server:
        yield server
        server.process.terminate()
        status = server.process.wait(timeout=_STOP_S)
        if status != 0:
            raise RuntimeError(f"the server ended with {status}: {log.read_text()[-2000:]}")


@contextmanager
def listening(
    arguments: Sequence[str], folder: Path, environment: Mapping[str, str], log: Path
) -> Iterator[HttpProcess]:
    """Run a server on a free port until the block ends, and kill it then if it still runs.

    Raises:
        RuntimeError: it did not start to listen.
    """
    with log.open("w") as stderr:
        started = psutil.Popen(
            [sys.executable, *arguments, "--port", "0"], cwd=folder, env=environment, stderr=stderr, text=True
        )
        try:
            yield HttpProcess(started, _address(started, log))
        finally:
            if started.is_running():
                started.kill()
            started.wait()


def _address(started: psutil.Popen, log: Path) -> str:
    while started.poll() is None:
        for line in log.read_text().splitlines():
            if line.startswith("PlannerForge: MCP at "):
                return line.rpartition(" ")[2]
        try:
            started.wait(timeout=0.05)
        except psutil.TimeoutExpired:
            continue
    raise RuntimeError(f"the server did not start to listen: {log.read_text()[-2000:]}")


class _Outliving(httpx2.AsyncHTTPTransport):
    """Requests that reach no server, or one that dies, are answered with 502: the SDK's client would end at once.

    The body gives them the code that the SDK gives to streams which break off: the connection was closed.
    """

    async def handle_async_request(self, request: httpx2.Request) -> httpx2.Response:
        try:
            return await super().handle_async_request(request)
        except httpx2.TransportError as error:
            told = ErrorData(code=CONNECTION_CLOSED, message=f"{type(error).__name__}: {error}")
            answer = JSONRPCError(jsonrpc="2.0", id=None, error=told)
            return httpx2.Response(502, json=answer.model_dump(mode="json"), request=request)


@asynccontextmanager
async def http_client(url: str, token: str = "", mode: str = "auto") -> AsyncIterator[Client]:
    """Open a client of an HTTP server that outlives the server: its later calls are errors."""
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    async with (
        httpx2.AsyncClient(headers=headers, timeout=httpx2.Timeout(_TIMEOUT_S), transport=_Outliving()) as http,
        Client(streamable_http_client(url, http_client=http), mode=mode) as client,
    ):
        yield client
