"""``plannerforge serve`` as a real process: a clean protocol on standard output, and nothing left when it ends."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import anyio
import psutil
import pytest
from mcp import Client
from mcp.client.stdio import StdioServerParameters
from support.server import ERAS

PATIENCE_S = 60.0
COMMAND = ("-m", "plannerforge", "serve", "--workers", "1")


def wait_until_gone(processes: list[psutil.Process]) -> None:
    _, alive = psutil.wait_procs(processes, timeout=PATIENCE_S)
    assert [process for process in alive if process.status() != psutil.STATUS_ZOMBIE] == []


class Server:
    """A server process that is spoken to line by line."""

    def __init__(self, folder: Path) -> None:
        environment = {**os.environ, "PLANNERFORGE_WORKSPACE": str(folder / "workspace")}
        self.process = subprocess.Popen(
            [sys.executable, *COMMAND],
            cwd=folder,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.lines: list[str] = []

    def request(self, number: int, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        self.send({"jsonrpc": "2.0", "id": number, "method": method, "params": parameters})
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line)
            answer: dict[str, Any] = json.loads(line)
            if answer.get("id") == number:
                return answer
        raise AssertionError(f"the server ended: {self.process.communicate()}")

    def send(self, message: dict[str, Any]) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(message) + "\n")
        self.process.stdin.flush()

    def initialize(self) -> None:
        client = {"name": "test", "version": "1"}
        parameters = {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": client}
        assert "result" in self.request(0, "initialize", parameters)
        self.send({"jsonrpc": "2.0", "method": "notifications/initialized"})

    def warm_workers(self) -> list[psutil.Process]:
        """The worker processes, which start by themselves a moment after the first connection."""
        own = psutil.Process(self.process.pid)
        with anyio.from_thread.start_blocking_portal() as portal:
            portal.call(_until, lambda: bool(own.children(recursive=True)))
        return own.children(recursive=True)


async def _until(happened: Any) -> None:
    with anyio.fail_after(PATIENCE_S):
        while not happened():
            await anyio.sleep(0.05)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    started = Server(tmp_path)
    yield started
    started.process.kill()
    started.process.communicate()


@pytest.fixture
def stdio_client(tmp_path: Path, era: str) -> Any:
    @asynccontextmanager
    async def session(*flags: str) -> AsyncIterator[Client]:
        parameters = StdioServerParameters(
            command=sys.executable, args=[*COMMAND, "--workspace", str(tmp_path / "workspace"), *flags], cwd=tmp_path
        )
        async with Client(parameters, mode=era) as client:  # type: ignore[arg-type]
            yield client

    return session


@pytest.mark.anyio
async def test_client_lists_and_calls_in_both_eras(stdio_client: Any) -> None:
    async with stdio_client() as client:
        tools = (await client.list_tools()).tools
        listed = await client.call_tool("list_artifacts", {})
        refused = await client.call_tool("list_artifacts", {"kindd": "run"})
    assert {"find_scenarios", "run_planner", "list_artifacts"} <= {tool.name for tool in tools}
    assert listed.structured_content == {"artifacts": [], "more": False}
    assert refused.is_error


@pytest.mark.anyio
@pytest.mark.parametrize("era", ERAS[:1])
async def test_flags_choose_the_tools(stdio_client: Any) -> None:
    async with stdio_client("--read-only", "--tools", "essential") as client:
        tools = (await client.list_tools()).tools
    assert tools
    assert all(tool.annotations.read_only_hint for tool in tools)
    assert "list_artifacts" not in {tool.name for tool in tools}


def journal_of(folder: Path) -> dict[str, Any]:
    """The entry of the only call."""
    (line,) = (folder / "workspace" / "journal" / "calls.jsonl").read_text().splitlines()
    entry: dict[str, Any] = json.loads(line)
    return entry


def test_closed_input_ends_the_server_and_its_workers_after_clean_output(server: Server, tmp_path: Path) -> None:
    server.initialize()
    server.request(1, "tools/call", {"name": "list_artifacts", "arguments": {}})
    server.request(2, "tools/call", {"name": "no_such_tool", "arguments": {}})
    server.request(3, "no/such/method", {})
    workers = server.warm_workers()
    rest, _ = server.process.communicate(timeout=PATIENCE_S)
    assert server.process.returncode == 0
    wait_until_gone(workers)
    for line in [*server.lines, *rest.splitlines()]:
        assert json.loads(line)["jsonrpc"] == "2.0"
    entry = journal_of(tmp_path)
    assert (entry["client"], entry["tool"], entry["error"]) == ("test 1", "list_artifacts", "")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
def test_signal_ends_the_server_and_its_workers(server: Server, number: signal.Signals, tmp_path: Path) -> None:
    """Also right after a call: hosts that leave (SIGTERM) give a server 2 s to write its journal, in which a busy
    machine does not read the tables of the token count.
    """
    server.initialize()
    workers = server.warm_workers()
    server.request(1, "tools/call", {"name": "list_artifacts", "arguments": {}})
    server.process.send_signal(number)
    assert server.process.wait(timeout=PATIENCE_S) == -number
    wait_until_gone(workers)
    if number == signal.SIGTERM:
        assert journal_of(tmp_path)["tool"] == "list_artifacts"
