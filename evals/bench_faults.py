"""How fast the server gets over a killed worker, a cancelled call and a client that goes away.

Called by ``make bench-server``; keys ``kill_error_s``, ``cancel_gone_s``, ``close_gone_s`` (worst of several).
"""

import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import anyio
import psutil
from mcp import Client, StdioServerParameters

REPEATS = 5
LONG_WORK: dict[str, Any] = {"density": "high", "duration_s": 120}


@dataclass(frozen=True)
class FaultTimes:
    """Seconds, one entry a repetition."""

    kill_error_s: list[float]
    cancel_gone_s: list[float]
    close_gone_s: list[float]


def workers_of_this_process() -> list[psutil.Process]:
    """All worker processes below this one."""
    found = []
    for child in psutil.Process().children(recursive=True):
        try:
            if "plannerforge.engine.execution.worker" in " ".join(child.cmdline()):
                found.append(child)
        except psutil.NoSuchProcess:
            continue
    return found


async def measure_faults(server_arguments: list[str]) -> FaultTimes:
    """Provoke each fault several times on real servers over stdio."""
    times = FaultTimes([], [], [])
    for repetition in range(REPEATS):
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
    struck: list[float] = []

    def kill() -> None:
        for process in workers_of_this_process():
            os.kill(process.pid, signal.SIGKILL)
        struck.append(time.perf_counter())

    result = await client.call_tool("generate_scenarios", {**LONG_WORK, "seed": seed}, progress_callback=_once(kill))
    if not (result.is_error and struck):
        raise RuntimeError("the work ended before its worker could be killed")
    return time.perf_counter() - struck[0]


async def _after_a_cancel(client: Client, seed: int) -> float:
    with anyio.CancelScope() as scope:
        await client.call_tool("generate_scenarios", {**LONG_WORK, "seed": seed}, progress_callback=_once(scope.cancel))
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
