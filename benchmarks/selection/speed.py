"""Measures the duration of searches among many entries, and from the start of a server.

A large catalogue combines real facts: a seed mixes their places, counts, tags and speeds.
"""

import os
import random
import sqlite3
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import anyio
from mcp import Client, StdioServerParameters

from plannerforge.engine.catalog.tables import add_facts, prepare
from plannerforge.evals.ground_truth.selection import Request
from plannerforge.schemas.scenarios import ParticipantFacts, ScenarioFacts
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

from ..harness import call_ms
from .pages import search_ms

_WARM_TEXTS = 15
"""Number of timed text searches; their median counts (chosen)."""


@dataclass(frozen=True)
class _Starts:
    """Seconds from the start of a server process to an answer, and milliseconds of a search by text after that."""

    first_search_s: float
    first_search_new_s: float
    first_text_search_s: float
    warm_text_search_ms: float


async def measure_searches(
    folder: Path, real: Sequence[ScenarioFacts], size: int, requests: Sequence[Request]
) -> list[float]:
    """Return milliseconds of find_scenarios for every request, in a new workspace with ``size`` entries of real
    facts.
    """
    folder.mkdir()
    make_catalog(folder / "workspace.sqlite", real, size).close()
    settings = Settings(workspace=folder, starter=False, warm_up=False, maps_online="offline")
    async with Client(create_server(settings, start_folder=folder)) as client:
        return await search_ms(client, requests)


async def measure_starts(python: str, workspace: Path, new_workspace: Path) -> _Starts:
    """Start three servers: two are searched by slots at once, the third by text at once and then again.

    The second one begins with an empty workspace, which it fills with the starter catalogue before it answers.
    """

    def server(folder: Path, *, starter: bool) -> StdioServerParameters:
        arguments = ["-m", "plannerforge", "serve", "--workspace", str(folder)]
        environment = {
            **os.environ,
            "PLANNERFORGE_STARTER": str(starter).lower(),
            "PLANNERFORGE_MAPS_ONLINE": "offline",
        }
        return StdioServerParameters(command=python, args=arguments, env=environment)

    first_s = await _first_search_s(server(workspace, starter=False))
    new_s = await _first_search_s(server(new_workspace, starter=True))
    started = time.perf_counter()
    async with Client(server(workspace, starter=False)) as client:
        await client.call_tool("find_scenarios", {"text": "a busy crossing"})
        text_s = time.perf_counter() - started
        warm = []
        for number in range(_WARM_TEXTS):
            await anyio.sleep(0.05)
            warm.append(await call_ms(client, "find_scenarios", text=f"a left turn with {number} trucks"))
    return _Starts(first_s, new_s, text_s, statistics.median(warm))


async def _first_search_s(server: StdioServerParameters) -> float:
    started = time.perf_counter()
    async with Client(server) as client:
        await client.call_tool("find_scenarios", {"tags": ["urban"]})
        return time.perf_counter() - started


def make_catalog(path: Path, real: Sequence[ScenarioFacts], count: int) -> sqlite3.Connection:
    """Return a database with ``count`` entries; every layer of an entry comes from another real scenario."""
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("PRAGMA journal_mode = WAL")
    prepare(connection)
    chance = random.Random(count)  # noqa: S311 - a reproducible choice, no secret
    connection.execute("BEGIN")
    for number in range(1, count + 1):
        add_facts(connection, number, _mixed(real, chance, number))
    connection.execute("COMMIT")
    return connection


def _mixed(real: Sequence[ScenarioFacts], chance: random.Random, number: int) -> ScenarioFacts:
    place, tags, roads, ego = (chance.choice(real) for _ in range(4))
    counts = {
        kind: max(1, count + chance.randint(-2, 4)) for kind, count in chance.choice(real).participants.counts.items()
    }
    egos = tuple(
        state.model_copy(update={"speed_mps": max(0.0, state.speed_mps + chance.gauss(0.0, 2.0))}) for state in ego.egos
    )
    return roads.model_copy(
        update={
            "scenario_id": f"{place.location.country}_{place.location.place}-{number}_1_T-1",
            "location": place.location,
            "tags": tags.tags,
            "participants": ParticipantFacts(dynamic=counts),
            "egos": egos,
        }
    )
