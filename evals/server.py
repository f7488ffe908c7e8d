"""``make bench-server``: what the server adds to the protocol, against an ``MCPServer`` without tools in the same run.

Keys: ``start_ratio`` (process start to first answer, median of the paired ratios), ``call_memory_ms``,
``call_stdio_ms`` (medians of a call that reads the workspace), ``kill_error_s`` (worker killed → error at the client),
``cancel_gone_s`` (call cancelled → worker gone), ``close_gone_s`` (client closed → server and workers gone; the worst).
"""

import os
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio
import psutil
from mcp import Client, StdioServerParameters
from rich.progress import track

from ..server.assembly import create_server
from ..server.settings import Settings
from .harness import print_figures, spread

_STARTS, _CALLS, _FAULT_REPEATS = 9, 300, 5
"""Repetitions (chosen): the figures are medians, of the faults the worst."""
_BARE = "from mcp.server import MCPServer; MCPServer('bare').run()"
_LONG_WORK: dict[str, Any] = {"density": "high", "duration_s": 120}
"""A generation that takes long enough to be killed or cancelled."""


async def _measure(workspace: Path) -> None:
    """Measure and print."""
    ours = ["-m", "plannerforge.server", "serve", "--workspace", str(workspace)]
    bare, full = [], []
    for _ in track(range(_STARTS), description="starting servers in turn"):
        bare.append(await _first_answer_s(["-c", _BARE]))
        full.append(await _first_answer_s(ours))
    async with Client(create_server(Settings(workspace=workspace, warm_up=False))) as client:
        memory = await _call_ms(client)
    async with Client(StdioServerParameters(command=sys.executable, args=ours)) as client:
        stdio = await _call_ms(client)
    faults = await _measure_faults(ours)
    ratios = [ours_s / bare_s for ours_s, bare_s in zip(full, bare, strict=True)]
    print_figures(
        "Server",
        [
            ("start to first answer, MCPServer without tools", spread(bare, "s")),
            ("start to first answer, plannerforge serve", spread(full, "s")),
            ("ratio", spread(ratios, "×")),
            ("call in memory", spread(memory, "ms")),
            ("call over stdio", spread(stdio, "ms")),
            ("worker killed to error result", spread(faults.kill_error_s, "s")),
            ("call cancelled to worker gone", spread(faults.cancel_gone_s, "s")),
            ("client closed to server and workers gone", spread(faults.close_gone_s, "s")),
        ],
        {
            "start_ratio": round(statistics.median(ratios), 3),
            "call_memory_ms": round(statistics.median(memory), 3),
            "call_stdio_ms": round(statistics.median(stdio), 3),
            "kill_error_s": round(max(faults.kill_error_s), 3),
            "cancel_gone_s": round(max(faults.cancel_gone_s), 3),
            "close_gone_s": round(max(faults.close_gone_s), 3),
        },
    )


async def _first_answer_s(arguments: list[str]) -> float:
    """Seconds from the start of a server process to the answer to its first request."""
    started = time.perf_counter()
    async with Client(StdioServerParameters(command=sys.executable, args=arguments)) as client:
        await client.list_tools()
        return time.perf_counter() - started


async def _call_ms(client: Client) -> list[float]:
    """Milliseconds of calls that read the workspace."""
    durations = []
    for _ in range(_CALLS):
        started = time.perf_counter()
        await client.call_tool("list_artifacts", {})
        durations.append((time.perf_counter() - started) * 1000)
    return durations


@dataclass(frozen=True)
class _FaultTimes:
    """Seconds, one entry a repetition."""

    kill_error_s: list[float]
    cancel_gone_s: list[float]
    close_gone_s: list[float]


def workers_of_this_process() -> list[psutil.Process]:
    """All worker processes below this one."""
    workers = []
    for child in psutil.Process().children(recursive=True):
        try:
            if "plannerforge.engine.execution.worker" in " ".join(child.cmdline()):
                workers.append(child)
        except psutil.NoSuchProcess:
            continue
    return workers


async def _measure_faults(server_arguments: list[str]) -> _FaultTimes:
    """Provoke each fault several times on real servers over stdio."""
    times = _FaultTimes([], [], [])
    for repetition in range(_FAULT_REPEATS):
        quiet = {"PLANNERFORGE_WARM_UP": "false"}  # only the worker that the work itself needs
        server = StdioServerParameters(command=sys.executable, args=server_arguments, env=quiet)
        async with Client(server) as client:
            times.kill_error_s.append(await _after_a_kill(client, repetition))
            times.cancel_gone_s.append(await _after_a_cancel(client, repetition))
            await client.call_tool("generate_scenarios", {"duration_s": 5, "seed": repetition})
            server_processes = psutil.Process().children(recursive=True)
            left = time.perf_counter()
        while any(process.is_running() and process.status() != psutil.STATUS_ZOMBIE for process in server_processes):
            await anyio.sleep(0.02)
        times.close_gone_s.append(time.perf_counter() - left)
    return times


async def _after_a_kill(client: Client, seed: int) -> float:
    killed: list[float] = []

    def kill() -> None:
        for process in workers_of_this_process():
            os.kill(process.pid, signal.SIGKILL)
        killed.append(time.perf_counter())

    result = await client.call_tool("generate_scenarios", {**_LONG_WORK, "seed": seed}, progress_callback=_once(kill))
    if not (result.is_error and killed):
        raise RuntimeError("the work ended before its worker could be killed")
    return time.perf_counter() - killed[0]


async def _after_a_cancel(client: Client, seed: int) -> float:
    with anyio.CancelScope() as scope:
        await client.call_tool(
            "generate_scenarios", {**_LONG_WORK, "seed": seed}, progress_callback=_once(scope.cancel)
        )
    cancelled = time.perf_counter()
    while workers_of_this_process():
        await anyio.sleep(0.02)
    return time.perf_counter() - cancelled


def _once(action: Callable[[], None]) -> Any:
    done = False

    async def on_progress(progress: float, total: float | None, message: str | None) -> None:
        nonlocal done
        del progress, total, message
        if not done:
            done = True
            action()

    return on_progress


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        anyio.run(_measure, Path(folder))
