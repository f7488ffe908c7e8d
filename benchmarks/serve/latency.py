"""The server's speed over each transport, in one run on one machine.

Keys:

- ``memory_ms``, ``stdio_ms``, ``http_ms``: medians of a call that reads the workspace (``list_artifacts``), in memory,
  over standard input and over HTTP with a token; ``http_sessions_ms``: over HTTP in a revision with sessions.
- ``bare_http_ms``: the same SDK's server over HTTP with one empty tool.
- ``find_scenarios_ms``, ``describe_catalog_ms``, ``describe_scenario_ms``: medians of these calls in memory; the last
  one uses a worker.
- ``start_ratio``: process start to first answer, median of the paired ratios against an ``MCPServer`` without tools.

Every workspace holds the starter scenarios. Transports and calls alternate in blocks, so that other load on the machine
affects all equally.
"""

import statistics
import sys
import time
from collections.abc import Awaitable, Callable, Mapping
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from functools import partial
from pathlib import Path

import anyio
from mcp import Client, StdioServerParameters

from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

from ..faults.http_process import QUIET, http_client, http_process
from ..harness import Figures, ask, call_ms
from .bench import ServeBench

_STARTS, _BLOCKS, _CALLS, _WARM_UP = 9, 10, 30, 20
"""Numbers of starts, blocks of each kind, calls per block, and earlier calls (chosen: the figures are medians)."""
_TOKEN = "latency-" + "t" * 32
_BARE = "from mcp.server import MCPServer; MCPServer('bare').run()"
_BARE_HTTP = """
import sys, socket, anyio, uvicorn
from mcp.server import MCPServer
server = MCPServer('bare')
@server.tool()
async def list_artifacts() -> str:
    return 'nothing'
listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP); listener.bind(('127.0.0.1', 0))
sys.stderr.write(f'PlannerForge: MCP at http://127.0.0.1:{listener.getsockname()[1]}/mcp\\n'); sys.stderr.flush()
config = uvicorn.Config(server.streamable_http_app(), log_config=None, access_log=False, timeout_graceful_shutdown=1)
served = uvicorn.Server(config)
served.handle_exit = lambda *_: setattr(served, 'should_exit', True)
anyio.run(lambda: served.serve(sockets=[listener]))
"""


def measure(bench: ServeBench) -> Figures:
    """Start servers, call them, take medians."""
    return anyio.run(_measure, bench.folder("latency"))


async def _measure(folder: Path) -> Figures:
    ratios = await _start_ratios(folder)
    quiet = {"PLANNERFORGE_WARM_UP": "false"}  # no worker starts meanwhile, in any of them
    own = {"PLANNERFORGE_HTTP_TOKENS": f"latency {_TOKEN}", "PLANNERFORGE_HTTP_RATE": "100000", **quiet}
    for name in ("http", "bare", "memory", "stdio"):
        (folder / name).mkdir()
    with http_process(folder / "http", settings=own) as ours, http_process(folder / "bare", ("-c", _BARE_HTTP)) as bare:
        async with AsyncExitStack() as stack:
            settings = Settings(workspace=folder / "memory", warm_up=False, maps_online="offline")
            clients: dict[str, AbstractAsyncContextManager[Client]] = {
                "memory_ms": Client(create_server(settings)),
                "stdio_ms": Client(_stdio(folder / "stdio", quiet)),
                "http_ms": http_client(ours.url, _TOKEN),
                "http_sessions_ms": http_client(ours.url, _TOKEN, "legacy"),
                "bare_http_ms": http_client(bare.url),
            }
            opened = {name: await stack.enter_async_context(client) for name, client in clients.items()}
            for name, client in opened.items():
                if name != "bare_http_ms":
                    await call_ms(client, "describe_catalog")  # the first of its kind brings the starter scenarios
            memory = opened["memory_ms"]
            found = await ask(memory, "find_scenarios")
            scenario_id = found["matches"][0]["scenario_id"]
            times = await _times_ms(
                {
                    **{name: partial(call_ms, client, "list_artifacts") for name, client in opened.items()},
                    "find_scenarios_ms": partial(call_ms, memory, "find_scenarios"),
                    "describe_catalog_ms": partial(call_ms, memory, "describe_catalog"),
                    "describe_scenario_ms": partial(call_ms, memory, "describe_scenario", scenario_id=scenario_id),
                }
            )
    medians = {name: round(statistics.median(values), 3) for name, values in times.items()}
    return {**medians, "start_ratio": round(statistics.median(ratios), 3)}


async def _times_ms(calls: Mapping[str, Callable[[], Awaitable[float]]]) -> dict[str, list[float]]:
    """Return the times of calls by their keys; they take turns block by block."""
    times = {name: list[float]() for name in calls}
    for call in calls.values():
        for _ in range(_WARM_UP):
            await call()
    for _ in range(_BLOCKS):
        for name, call in calls.items():
            times[name] += [await call() for _ in range(_CALLS)]
    return times


def _stdio(workspace: Path, settings: Mapping[str, str] | None = None) -> StdioServerParameters:
    arguments = ["-m", "plannerforge", "serve", "--workspace", str(workspace)]
    return StdioServerParameters(command=sys.executable, args=arguments, env={**QUIET, **(settings or {})})


async def _start_ratios(folder: Path) -> list[float]:
    bare, ours = StdioServerParameters(command=sys.executable, args=["-c", _BARE]), _stdio(folder / "started")
    ratios = []
    for _ in range(_STARTS):
        least_s = await _first_answer_s(bare)
        ratios.append(await _first_answer_s(ours) / least_s)
    return ratios


async def _first_answer_s(server: StdioServerParameters) -> float:
    """Return seconds from the start of a server process to the answer to its first request."""
    started = time.perf_counter()
    async with Client(server) as client:
        await client.list_tools()
        return time.perf_counter() - started
