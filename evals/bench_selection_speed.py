"""How long searches take: among many entries, and from the start of a server."""

import sqlite3
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass

import anyio
from mcp import Client, StdioServerParameters

from plannerforge.engine.catalog.search import Search
from plannerforge.evals.selection_corpus import Request, arguments_of

WARM_TEXTS = 15


@dataclass(frozen=True)
class Starts:
    """Seconds from the start of a server process to an answer, and milliseconds of a search by text after that."""

    first_search_s: float
    first_text_search_s: float
    warm_text_search_ms: float


def search_ms(connection: sqlite3.Connection, requests: Sequence[Request]) -> list[float]:
    """Milliseconds of every valid request by its slots, from the arguments to the answer with its evidence."""
    durations = []
    for request in requests:
        if request.expect not in ("ok", "empty"):
            continue
        arguments = arguments_of(request.truth).model_copy(update={"limit": 5})
        started = time.perf_counter()
        search = Search(connection, arguments)
        search.answer("search", search.find(None), None)
        durations.append((time.perf_counter() - started) * 1000)
    return durations


async def measure_starts(server: StdioServerParameters) -> Starts:
    """Start two servers: the first is searched by slots at once, the second by text at once and then again."""
    started = time.perf_counter()
    async with Client(server) as client:
        await client.call_tool("find_scenarios", {"tags": ["urban"]})
        first_s = time.perf_counter() - started
    started = time.perf_counter()
    async with Client(server) as client:
        await client.call_tool("find_scenarios", {"text": "a busy crossing"})
        text_s = time.perf_counter() - started
        warm = []
        for number in range(WARM_TEXTS):
            await anyio.sleep(0.05)
            again = time.perf_counter()
            await client.call_tool("find_scenarios", {"text": f"a left turn with {number} trucks"})
            warm.append((time.perf_counter() - again) * 1000)
    return Starts(first_s, text_s, statistics.median(warm))
