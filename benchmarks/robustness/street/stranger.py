"""A stranger on loopback without a token, while four honest clients with a token work.

The honest clients do the same work twice, first alone and then with the stranger (:mod:`.knocks`, in its own process):
they search, read, edit and run, with a human pause after each call.

Keys:

- ``honest_answered``: share of their calls answered correctly next to the stranger; ``honest_calls``.
- ``honest_p95_ratio``: 95th percentile of their waiting times with the stranger over that without.
- ``memory_over_bound_mb``: memory of the server's process beyond ``server_memory_mb``.
- ``descriptors_left``: descriptors that it still holds after the stranger left, beyond the initial ones.
- ``log_lines_per_s``: while the stranger was there.
- ``stranger_requests``; ``stranger_let_in``: the stranger's MCP requests that succeeded.
"""

import json
import random
import subprocess
import sys
import time
from collections import Counter
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio
from mcp import Client, MCPError

from ...faults.http_process import HttpProcess, http_client, http_process
from ...harness import Figures, percentile_95, share
from ..judges import peak_memory_mb
from .bench import StreetBench

_CLIENTS = 4
_MEMORY_MB = 512
"""The server's limit (chosen): the smallest is 256."""
_QUIET_SHARE = 0.5
"""Time of the clients alone as a share of that with the stranger (chosen)."""
_PAUSE_S = (0.05, 0.4)
"""Range of the pause between two calls of an honest client (chosen), so that it does not fill a core."""
_GONE_WITHIN_S = 90.0
"""Time within which a server must release a stranger's connections; an idle one stays open for 75 s (docs/http.md)."""
_MOST_LISTED = 10


@dataclass
class _Waits:
    """The calls of honest clients: the duration of each, and whether its answer was right."""

    seconds: list[float] = field(default_factory=list)
    were_right: list[bool] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


class _Honest:
    """A client that works at the pace of a person, the same calls for the same seed."""

    def __init__(self, client: Client, seed: str) -> None:
        self._client, self._seed = client, seed

    async def work(self, seconds: float, waits: _Waits) -> None:
        """Call tools until the time is over."""
        chance = random.Random(self._seed)  # noqa: S311 - the mix of a benchmark
        found = await self._client.call_tool("find_scenarios", {"obstacles": ["car>=2"], "limit": 20})
        ids = [match["scenario_id"].partition("#")[0] for match in (found.structured_content or {})["matches"]]
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            tool, arguments = self._drawn(chance, ids)
            await self._call(tool, arguments, waits)
            await anyio.sleep(chance.uniform(*_PAUSE_S))

    def _drawn(self, chance: random.Random, ids: list[str]) -> tuple[str, dict[str, Any]]:
        one = chance.choice(ids)
        calls: list[tuple[str, dict[str, Any]]] = [
            ("list_artifacts", {}),
            ("describe_catalog", {}),
            ("list_planners", {}),
            ("find_scenarios", {"obstacles": ["car>=2"], "limit": 5}),
            ("describe_scenario", {"scenario_id": one}),
            ("run_planner", {"scenarios": [one], "configs": ["idm"], "wait_s": 50}),
        ]
        return chance.choices(calls, weights=[3, 3, 2, 4, 4, 1])[0]

    async def _call(self, tool: str, arguments: dict[str, Any], waits: _Waits) -> None:
        began, told = time.monotonic(), ""
        try:
            result = await self._client.call_tool(tool, arguments)
            told = str(result.content[:1]) if result.is_error or not result.structured_content else ""
        except MCPError as error:
            told = str(error)
        waits.seconds.append(time.monotonic() - began)
        waits.were_right.append(not told)
        if told:
            waits.faults.append(f"{tool}: {told[:200]}")


@dataclass
class _Seen:
    alone: _Waits = field(default_factory=_Waits)
    beside: _Waits = field(default_factory=_Waits)
    descriptors_left: int = 0
    lines: int = 0
    knocks: dict[str, dict[str, int]] = field(default_factory=dict)
    memory_mb: float = 0.0


def measure(bench: StreetBench) -> Figures:
    """Let honest clients work alone and with the stranger."""
    folder, seen = bench.folder("stranger"), _Seen()
    tokens = [f"{number:02d}-" + "h" * 32 for number in range(_CLIENTS)]
    settings = {
        "PLANNERFORGE_HTTP_TOKENS": ",".join(f"honest-{token[:2]} {token}" for token in tokens),
        "PLANNERFORGE_SERVER_MEMORY_MB": str(_MEMORY_MB),
    }
    with http_process(folder, settings=settings) as server:
        anyio.run(_attended, bench, server, folder / "server.log", tokens, seen)
    for fault in (*seen.alone.faults, *seen.beside.faults)[:_MOST_LISTED]:
        sys.stderr.write(f"{fault}\n")
    for name, counted in sorted(seen.knocks.items()):
        sys.stderr.write(f"{name}: {counted}\n")
    to_mcp = [Counter(counted) for name, counted in seen.knocks.items() if name != "ready"]
    return {
        "honest_answered": share(seen.beside.were_right),
        "honest_p95_ratio": round(percentile_95(seen.beside.seconds) / percentile_95(seen.alone.seconds), 3),
        "honest_p95_alone_ms": round(1000 * percentile_95(seen.alone.seconds), 1),
        "honest_calls": len(seen.beside.seconds),
        "memory_over_bound_mb": round(max(0.0, seen.memory_mb - _MEMORY_MB), 1),
        "memory_mb": round(seen.memory_mb, 1),
        "descriptors_left": seen.descriptors_left,
        "log_lines_per_s": round(seen.lines / (60 * bench.minutes), 3),
        "stranger_requests": sum(sum(counted.values()) for counted in seen.knocks.values()),
        "stranger_let_in": sum(counted["200"] + counted["202"] for counted in to_mcp),
    }


async def _attended(bench: StreetBench, server: HttpProcess, log: Path, tokens: list[str], seen: _Seen) -> None:
    async with AsyncExitStack() as stack:
        clients = [
            _Honest(
                await stack.enter_async_context(http_client(server.url, token, "legacy" if number % 2 else "auto")),
                f"{bench.seed} {number}",
            )
            for number, token in enumerate(tokens)
        ]
        await _together(clients, 10.0, _Waits())  # workers and caches are warm then
        await _together(clients, 60 * bench.minutes * _QUIET_SHARE, seen.alone)
        before, lines = server.process.num_fds(), _lines(log)
        with _Stranger(bench, server) as stranger:
            await _together(clients, 60 * bench.minutes, seen.beside)
            seen.lines = _lines(log) - lines
            seen.knocks = await anyio.to_thread.run_sync(stranger.said)
        seen.memory_mb = peak_memory_mb(server.process.pid)
        with anyio.move_on_after(_GONE_WITHIN_S):
            while server.process.num_fds() > before:
                await anyio.sleep(0.5)
        seen.descriptors_left = max(0, server.process.num_fds() - before)


async def _together(clients: list[_Honest], seconds: float, waits: _Waits) -> None:
    async with anyio.create_task_group() as tasks:
        for client in clients:
            tasks.start_soon(client.work, seconds, waits)


class _Stranger:
    """The stranger's process, which is ended if the block is left early."""

    def __init__(self, bench: StreetBench, server: HttpProcess) -> None:
        address = server.url.removeprefix("http://").partition("/")[0]
        host, _, port = address.rpartition(":")
        command = [sys.executable, "-m", f"{__package__}.knocks", host, port, str(60 * bench.minutes), str(bench.seed)]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    def __enter__(self) -> "_Stranger":
        return self

    def __exit__(self, *problem: object) -> None:
        self._process.kill()
        self._process.wait()

    def said(self) -> dict[str, dict[str, int]]:
        """Return the stranger's responses once it has ended.

        Raises:
            RuntimeError: it failed.
        """
        told, _ = self._process.communicate(timeout=60)
        if self._process.returncode:
            raise RuntimeError(f"the stranger ended with {self._process.returncode}")
        said: dict[str, dict[str, int]] = json.loads(told)
        return said


def _lines(log: Path) -> int:
    return log.read_bytes().count(b"\n")
