"""``make bench-server``: the server's overhead over an ``MCPServer`` without tools in the same run.

Keys: ``start_ratio``: process start to first answer, median of the paired ratios. ``call_memory_ms``,
``call_stdio_ms``: medians of a call that reads the workspace. ``kill_error_s``: worker killed → error at the client.
``cancel_gone_s``: call cancelled → worker gone. ``close_gone_s``: client closed → server and workers gone; the worst.
"""

import os
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import anyio
import psutil
from mcp import Client, StdioServerParameters
from rich.progress import track

from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

from ..faults.processes import workers_of_this_process
from ..harness import call_ms, print_figures, spread

_STARTS, _CALLS, _FAULT_REPEATS = 9, 300, 5
"""Repetitions (chosen): the figures are medians, or the worst for faults."""
_BARE = "from mcp.server import MCPServer; MCPServer('bare').run()"
_LONG_WORK: dict[str, Any] = {"density": "high", "duration_s": 120}
"""A generation long enough to be killed or cancelled."""


async def _measure(workspace: Path) -> None:
    """Measure and print."""
    bare = StdioServerParameters(command=sys.executable, args=["-c", _BARE])
    serve = ["-m", "plannerforge", "serve", "--workspace", str(workspace)]
    ours = StdioServerParameters(command=sys.executable, args=serve)
    bare_s, ours_s = [], []
    for _ in track(range(_STARTS), description="starting servers in turn"):
        bare_s.append(await _first_answer_s(bare))
        ours_s.append(await _first_answer_s(ours))
    ratios = [full / least for full, least in zip(ours_s, bare_s, strict=True)]
    calls_ms = []
    for server in (create_server(Settings(workspace=workspace, warm_up=False, maps_online="offline")), ours):
        async with Client(server) as client:
            calls_ms.append([await call_ms(client, "list_artifacts") for _ in range(_CALLS)])
    quiet = {"PLANNERFORGE_WARM_UP": "false"}  # only the worker that the work itself needs
    faults_s = [await _faults_s(ours.model_copy(update={"env": quiet}), seed) for seed in range(_FAULT_REPEATS)]
    kill_s, cancel_s, close_s = zip(*faults_s, strict=True)
    print_figures(
        "Server",
        {
            "start_ratio": round(statistics.median(ratios), 3),
            "call_memory_ms": round(statistics.median(calls_ms[0]), 3),
            "call_stdio_ms": round(statistics.median(calls_ms[1]), 3),
            "kill_error_s": round(max(kill_s), 3),
            "cancel_gone_s": round(max(cancel_s), 3),
            "close_gone_s": round(max(close_s), 3),
        },
        [
            ("start to first answer, MCPServer without tools", spread(bare_s, "s")),
            ("start to first answer, plannerforge serve", spread(ours_s, "s")),
            ("ratio", spread(ratios, "×")),
            ("call in memory", spread(calls_ms[0], "ms")),
            ("call over stdio", spread(calls_ms[1], "ms")),
            ("worker killed to error result", spread(kill_s, "s")),
            ("call cancelled to worker gone", spread(cancel_s, "s")),
            ("client closed to server and workers gone", spread(close_s, "s")),
        ],
    )


async def _first_answer_s(server: StdioServerParameters) -> float:
    """Return seconds from the start of a server process to the answer to its first request."""
    started = time.perf_counter()
    async with Client(server) as client:
        await client.list_tools()
        return time.perf_counter() - started


async def _faults_s(server: StdioServerParameters, seed: int) -> tuple[float, float, float]:
    """Return seconds from a kill to the error, from a cancellation to the worker's end, and from closing to all ends.

    Each fault is provoked on a real server over stdio.
    """
    async with Client(server) as client:
        kill_s = await _after_a_kill(client, seed)
        cancel_s = await _after_a_cancel(client, seed)
        await client.call_tool("generate_scenarios", {"duration_s": 5, "seed": seed})
        server_processes = psutil.Process().children(recursive=True)
        left = time.perf_counter()
    while any(process.is_running() and process.status() != psutil.STATUS_ZOMBIE for process in server_processes):
        await anyio.sleep(0.02)
    return kill_s, cancel_s, time.perf_counter() - left


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
