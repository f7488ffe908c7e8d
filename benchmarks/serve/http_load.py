"""Several clients on one HTTP server for some minutes: mixed reading, searching, editing and running.

Half of the clients use the revision without sessions, half one with sessions. Each has a token and works on its own
artifacts. The bench checks each answer: a search finds something, a run is one run, and ``latest`` and ``current``
refer to this client's latest. A refusal that states a limit of the server (429) is counted separately.

Keys:

- ``http_errors``: calls that failed or got a wrong answer; ``http_limited``: refused by a stated limit; ``http_calls``.
- ``http_edits``, ``http_runs``: new scenarios and runs of the clients (omitted if 0, because that is another load).
- ``http_minutes``.
- ``memory_slope_mb_per_h``: of the server's process, least squares over the last two thirds (omitted with fewer than
  two samples); ``memory_start_mb``, ``memory_end_mb``: at the start and end of these.
- ``slowest_share``: calls of the slowest client over an equal share; ``slowest_call_s``.
"""

import random
import statistics
import sys
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import anyio
import psutil
from mcp import Client, MCPError

from plannerforge.engine.workspace import ArtifactKind

from ..faults.http_process import HttpProcess, http_client, http_process
from ..harness import Figures, as_measured
from .bench import ServeBench

_SAMPLE_S = 2.0
_WARM_UP_SHARE = 1 / 3
"""Share of the time without effect on the slope of memory (chosen), in which caches and worker pools fill."""
_MOST_LISTED = 10
_RANDOM_SEED = 21
_READ_BYTES = 700_000
"""Largest resource to read: the SDK's client accepts no event of more than 1 MiB (docs/http.md)."""


class ReportedArtifact(NamedTuple):
    """An artifact reported to a client."""

    kind: ArtifactKind
    artifact_id: str


@dataclass
class Tally:
    """The results of all clients' calls."""

    calls: Counter[str] = field(default_factory=Counter)
    limited: int = 0
    slowest_s: float = 0.0
    errors: list[str] = field(default_factory=list)
    memory: list[tuple[float, float]] = field(default_factory=list)
    """Seconds since the start, megabytes of the server's process."""
    told: set[ReportedArtifact] = field(default_factory=set)
    """Artifacts reported to clients, by kind and id."""


class LoadClient:
    """One client: its knowledge, and its actions in turn."""

    def __init__(self, name: str, client: Client, tally: Tally) -> None:
        self._name, self._client, self._tally = name, client, tally
        self._chance = random.Random(f"{_RANDOM_SEED} {name}")  # noqa: S311 - the mix of a benchmark
        self._scenario, self._vehicle, self._edited = "", "", ""

    async def work_until(self, end: float) -> None:
        """Call tools, one after the other, until the time is over."""
        kinds: list[Callable[[], Awaitable[None]]] = [
            *[self._read] * 6,
            *[self._search] * 4,
            *[self._edit] * 3,
            self._run,
            *[self._configure] * 2,
            *[self._resources] * 2,
        ]
        await self._search()
        while time.monotonic() < end:
            before = time.monotonic()
            await self._chance.choice(kinds)()
            self._tally.slowest_s = max(self._tally.slowest_s, time.monotonic() - before)

    async def _call(self, tool: str, **arguments: Any) -> Any:
        """Return the structured answer of a tool; record a failure and return None."""
        try:
            result = await self._client.call_tool(tool, arguments)
        except MCPError as error:
            self._fail(tool, str(error))
            return None
        self._tally.calls[self._name] += 1
        if result.is_error or result.structured_content is None:
            self._fail(tool, str(result.content[0]))
            return None
        return result.structured_content

    def _fail(self, tool: str, message: str) -> None:
        if "http_429" in message:
            self._tally.limited += 1
        else:
            self._tally.errors.append(f"{self._name} {tool}: {message[:300]}")

    def _expect(self, holds: bool, tool: str, message: str) -> None:
        if not holds:
            self._fail(tool, message)

    async def _read(self) -> None:
        tool = self._chance.choice(["list_artifacts", "describe_catalog", "list_planners"])
        await self._call(tool)

    async def _search(self) -> None:
        found = await self._call("find_scenarios", obstacles=["car>=2"], limit=20)
        matches = (found or {}).get("matches", [])
        self._expect(found is None or bool(matches), "find_scenarios", "nothing was found in the starter catalogue")
        if matches:
            chosen = self._chance.choice(matches)["scenario_id"].partition("#")[0]
            told = await self._call("describe_scenario", scenario_id=chosen, detail="vehicles")
            vehicles = told["description"]["vehicles"] if told is not None else []
            cars = [one for one in vehicles if (one["vehicle_class"] or one["kind"]) == "car"]
            if cars:
                self._scenario, self._vehicle = chosen, str(cars[0]["vehicle_id"])

    async def _edit(self) -> None:
        """Create a scenario; ``latest`` must then be that one, regardless of other clients."""
        if not self._vehicle:
            return
        speed = f"{self._chance.uniform(2.0, 12.0):.2f}m/s"
        edit = {"op": "set_speed", "vehicles": [self._vehicle], "speed": speed}
        made = await self._call("modify_scenario", scenario_id=self._scenario, edits=[edit])
        if made is None:
            return
        self._edited = made["scenario_id"]
        self._tally.told.add(ReportedArtifact("scenario", self._edited))
        told = await self._call("describe_scenario", scenario_id="latest")
        own = (told or {}).get("scenario_id")
        self._expect(told is None or own == self._edited, "latest", f"{own} is not {self._edited}")

    async def _configure(self) -> None:
        weight = f"jerk={self._chance.uniform(0.1, 2.0):.4f}"
        made = await self._call("configure_planner", base="frenetix:Default", weights=[weight])
        if made is None:
            return
        self._tally.told.add(ReportedArtifact("config", made["config_id"]))
        told = await self._call("list_planners")
        own = (told or {}).get("config_id")
        self._expect(told is None or own == made["config_id"], "current", f"{own} is not the own one")

    async def _run(self) -> None:
        """Drive this client's latest edit, so that the run is new and not a stored one."""
        if not self._edited:
            return
        ran = await self._call("run_planner", scenarios=[self._edited], configs=["idm"], wait_s=50)
        if ran is None:
            return
        self._tally.told |= {ReportedArtifact("run", run["run_id"]) for run in ran["runs"]}
        self._expect(ran["finished"] == 1, "run_planner", f"not one run: {ran}")

    async def _resources(self) -> None:
        try:
            listed = await self._client.list_resources()
            small = [one.uri for one in listed.resources if (one.size or 0) < _READ_BYTES]
            content = await self._client.read_resource(self._chance.choice(small))
        except MCPError as error:
            self._fail("resources", str(error))
            return
        self._tally.calls[self._name] += 2
        self._expect(bool(content.contents), "resources/read", "nothing was read")


def measure(bench: ServeBench) -> Figures:
    """Load a server, watch its memory, count."""
    tally = Tally()
    folder = bench.folder("load")
    tokens = tokens_of_clients(bench.clients)
    with http_process(folder, settings=token_settings(tokens)) as server:
        anyio.run(_load, server, tokens, bench.minutes * 60.0, tally)
    for error in tally.errors[:_MOST_LISTED]:
        sys.stderr.write(f"{error}\n")
    calls = sum(tally.calls.values())
    fewest = min(tally.calls[name] for name in tokens)
    made = Counter(told.kind for told in tally.told)
    return as_measured(
        {
            "http_errors": len(tally.errors),
            "http_limited": tally.limited,
            "http_calls": calls,
            "http_edits": made["scenario"] or None,
            "http_runs": made["run"] or None,
            "http_minutes": bench.minutes,
            "memory_slope_mb_per_h": slope_per_h(tally.memory),
            "memory_start_mb": round(settled(tally.memory)[0][1], 1),
            "memory_end_mb": round(tally.memory[-1][1], 1),
            "slowest_share": round(fewest * len(tokens) / calls, 3) if calls else None,
            "slowest_call_s": round(tally.slowest_s, 2),
        }
    )


def tokens_of_clients(count: int) -> dict[str, str]:
    """Return names and tokens of clients: a server identifies a client without a session by its token."""
    return {f"client-{number}": f"{number:02d}-" + "l" * 32 for number in range(count)}


def token_settings(tokens: Mapping[str, str]) -> dict[str, str]:
    """Return the variable that lets these clients in."""
    return {"PLANNERFORGE_HTTP_TOKENS": ",".join(f"{name} {token}" for name, token in tokens.items())}


async def _load(server: HttpProcess, tokens: dict[str, str], duration_s: float, tally: Tally) -> None:
    end = time.monotonic() + duration_s
    async with anyio.create_task_group() as watching:
        watching.start_soon(_watch_memory, server.process, tally)
        async with anyio.create_task_group() as tasks:
            for number, (name, token) in enumerate(tokens.items()):
                tasks.start_soon(_one_client, server.url, name, token, "legacy" if number % 2 else "auto", end, tally)
        watching.cancel_scope.cancel()


async def _one_client(url: str, name: str, token: str, mode: str, end: float, tally: Tally) -> None:
    async with http_client(url, token, mode) as client:
        await LoadClient(name, client, tally).work_until(end)


async def _watch_memory(process: psutil.Process, tally: Tally) -> None:
    started = time.monotonic()
    while True:
        tally.memory.append((time.monotonic() - started, process.memory_info().rss / 1024**2))
        await anyio.sleep(_SAMPLE_S)


def settled(memory: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the measurements after the warm-up."""
    begin_s = memory[-1][0] * _WARM_UP_SHARE
    return [sample for sample in memory if sample[0] >= begin_s]


def slope_per_h(memory: list[tuple[float, float]]) -> float | None:
    """Return growth of memory after the warm-up in MB an hour, by least squares; None with fewer than two looks."""
    looks = settled(memory)
    if len(looks) < 2:
        return None
    times_s, sizes_mb = zip(*looks, strict=True)
    return round(statistics.linear_regression(times_s, sizes_mb).slope * 3600.0, 2)
