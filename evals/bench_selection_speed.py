"""How long searches take: among many entries, and from the start of a server."""

import os
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import anyio
from mcp import Client, StdioServerParameters

from plannerforge.evals.selection_corpus import Request
from plannerforge.evals.selection_pages import search_ms
from plannerforge.evals.synthetic_catalog import make_catalog
from plannerforge.schemas.scenarios import ScenarioFacts
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

WARM_TEXTS = 15


@dataclass(frozen=True)
class Starts:
    """Seconds from the start of a server process to an answer, and milliseconds of a search by text after that."""

    first_search_s: float
    first_search_new_s: float
    first_text_search_s: float
    warm_text_search_ms: float


async def measure_searches(
    folder: Path, real: Sequence[ScenarioFacts], size: int, requests: Sequence[Request]
) -> list[float]:
    """Milliseconds of find_scenarios for every request, in a new workspace with so many entries made of real facts."""
    folder.mkdir()
    make_catalog(folder / "workspace.sqlite", real, size).close()
    settings = Settings(workspace=folder, starter=False, warm_up=False)
    async with Client(create_server(settings, start_folder=folder)) as client:
        return await search_ms(client, requests)


async def measure_starts(python: str, workspace: Path, new_workspace: Path) -> Starts:
    """Start three servers: two are searched by slots at once, the third by text at once and then again.

    The second one begins with an empty workspace, which it fills with the starter catalogue before it answers.
    """

    def server(folder: Path, *, starter: bool) -> StdioServerParameters:
        arguments = ["-m", "plannerforge.server", "serve", "--workspace", str(folder)]
        environment = {**os.environ, "PLANNERFORGE_STARTER": str(starter).lower()}
        return StdioServerParameters(command=python, args=arguments, env=environment)

    first_s = await _first_search_s(server(workspace, starter=False))
    new_s = await _first_search_s(server(new_workspace, starter=True))
    started = time.perf_counter()
    async with Client(server(workspace, starter=False)) as client:
        await client.call_tool("find_scenarios", {"text": "a busy crossing"})
        text_s = time.perf_counter() - started
        warm = []
        for number in range(WARM_TEXTS):
            await anyio.sleep(0.05)
            again = time.perf_counter()
            await client.call_tool("find_scenarios", {"text": f"a left turn with {number} trucks"})
            warm.append((time.perf_counter() - again) * 1000)
    return Starts(first_s, new_s, text_s, statistics.median(warm))


async def _first_search_s(server: StdioServerParameters) -> float:
    started = time.perf_counter()
    async with Client(server) as client:
        await client.call_tool("find_scenarios", {"tags": ["urban"]})
        return time.perf_counter() - started
