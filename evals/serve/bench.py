"""What the parts of ``make bench-serve`` are given, and the server by HTTP that they speak to."""

import os
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx2
import psutil
from mcp import Client
from mcp.client.streamable_http import streamable_http_client

_TIMEOUT_S = 120.0
_STOP_S = 60.0
"""How long a client waits for an answer, and the server has to end; chosen."""
QUIET = {"PLANNERFORGE_MAPS_ONLINE": "offline"}


@dataclass(frozen=True)
class ServeBench:
    """Where a part may write, and how much it measures.

    Args:
        scratch: an empty folder, gone afterwards.
        minutes: how long the load lasts.
        clients: how many load the server at once.
        node: program of Node; empty where one is to be fetched.
        hosts: the clients of others that are tried; all of them where none is named.
        environments: where their environments are kept; none for the usual folder.
        page: the page that their table is written into.
    """

    scratch: Path
    minutes: float = 10.0
    clients: int = 8
    node: str = ""
    hosts: tuple[str, ...] = ()
    environments: Path | None = None
    page: Path | None = None

    def folder(self, name: str) -> Path:
        """A new folder in the scratch."""
        folder = self.scratch / name
        folder.mkdir()
        return folder


@dataclass(frozen=True)
class HttpProcess:
    """A server process that listens, and where."""

    process: psutil.Process
    url: str


@contextmanager
def http_process(
    folder: Path,
    arguments: Sequence[str] = ("-m", "plannerforge.server", "serve", "--http"),
    settings: Mapping[str, str] | None = None,
) -> Iterator[HttpProcess]:
    """A server of its own in a folder, on a free port; ended by a signal, as an operator ends it.

    Raises:
        RuntimeError: it did not begin to listen, or did not end well.
    """
    environment = {**os.environ, **QUIET, "PLANNERFORGE_WORKSPACE": str(folder / "workspace"), **(settings or {})}
    log = folder / "server.log"
    with log.open("w") as stderr:
        started = subprocess.Popen(
            [sys.executable, *arguments, "--port", "0"], cwd=folder, env=environment, stderr=stderr, text=True
        )
        try:
            yield HttpProcess(psutil.Process(started.pid), _address(started, log))
            started.terminate()
            if started.wait(timeout=_STOP_S) != 0:
                raise RuntimeError(f"the server ended with {started.returncode}: {log.read_text()[-2000:]}")
        finally:
            started.kill()
            started.wait()


def _address(started: "subprocess.Popen[str]", log: Path) -> str:
    while started.poll() is None:
        for line in log.read_text().splitlines():
            if line.startswith("PlannerForge: MCP at "):
                return line.rpartition(" ")[2]
        try:
            started.wait(timeout=0.05)
        except subprocess.TimeoutExpired:
            continue
    raise RuntimeError(f"the server does not listen: {log.read_text()[-2000:]}")


@asynccontextmanager
async def http_client(url: str, token: str = "", mode: str = "auto") -> AsyncIterator[Client]:
    """A client of a server by HTTP."""
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    async with (
        httpx2.AsyncClient(headers=headers, timeout=httpx2.Timeout(_TIMEOUT_S)) as http,
        Client(streamable_http_client(url, http_client=http), mode=mode) as client,
    ):
        yield client
