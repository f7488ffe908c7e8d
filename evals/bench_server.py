"""``make bench-server``: what the server adds to the protocol, against an ``MCPServer`` without tools in the same run.

Keys: ``start_ratio`` (process start to first answer, median of the paired ratios), ``call_memory_ms``,
``call_stdio_ms`` (medians of a call that reads the workspace), ``kill_error_s`` (worker killed → error at the client),
``cancel_gone_s`` (call cancelled → worker gone), ``close_gone_s`` (client closed → server and workers gone; the worst).
"""

import statistics
import sys
import tempfile
import time
from pathlib import Path

import anyio
from mcp import Client, StdioServerParameters
from rich.progress import track

from plannerforge.evals.bench_faults import measure_faults
from plannerforge.evals.bench_output import print_figures, spread
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

STARTS = 9
CALLS = 300
BARE = "from mcp.server import MCPServer; MCPServer('bare').run()"


async def first_answer_s(arguments: list[str]) -> float:
    """Seconds from the start of a server process to the answer to its first request."""
    started = time.perf_counter()
    async with Client(StdioServerParameters(command=sys.executable, args=arguments)) as client:
        await client.list_tools()
        return time.perf_counter() - started


async def call_ms(client: Client) -> list[float]:
    """Milliseconds of calls that read the workspace."""
    durations = []
    for _ in range(CALLS):
        started = time.perf_counter()
        await client.call_tool("list_artifacts", {})
        durations.append((time.perf_counter() - started) * 1000)
    return durations


async def measure(workspace: Path) -> None:
    """Measure and print."""
    ours = ["-m", "plannerforge.server", "serve", "--workspace", str(workspace)]
    bare, full = [], []
    for _ in track(range(STARTS), description="starting servers in turn"):
        bare.append(await first_answer_s(["-c", BARE]))
        full.append(await first_answer_s(ours))
    async with Client(create_server(Settings(workspace=workspace, warm_up=False))) as client:
        memory = await call_ms(client)
    async with Client(StdioServerParameters(command=sys.executable, args=ours)) as client:
        stdio = await call_ms(client)
    faults = await measure_faults(ours)
    ratios = [one / other for one, other in zip(full, bare, strict=True)]
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


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        anyio.run(measure, Path(folder))
