"""find_scenarios ``like``: an entry of the catalogue, one of several problems, and what is listed no more."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.builders import Problem, town_road
from support.server import Connect

from plannerforge.server.settings import Settings

pytestmark = pytest.mark.anyio
EXAMPLE, OTHER = "ZAM_Builder-1_1_T-1", "ZAM_Builder-2_1_T-1"


async def call(client: Client, tool: str, **arguments: Any) -> dict[str, Any]:
    result = await client.call_tool(tool, arguments)
    assert not result.is_error, result.content
    return result.structured_content or {}


def shown(found: dict[str, Any]) -> list[str]:
    return [match["scenario_id"] for match in found["matches"]]


@pytest.fixture
def bare(settings: Settings) -> Settings:
    """No starter catalogue."""
    return settings.model_copy(update={"starter": False})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scenario with two planning problems, and one beside it."""
    folder = tmp_path / "files"
    folder.mkdir()
    problems = (Problem(), Problem(problem_id=200, start=(40.0, 3.5, 0.0, 25.0)))
    replace(town_road(), problems=problems).write(folder / "two.xml")
    replace(town_road(), benchmark_id=OTHER).write(folder / "other.xml")
    return folder


async def test_the_example_is_not_among_its_similar_scenarios(connect: Connect, bare: Settings, folder: Path) -> None:
    async with connect(bare) as client:
        await call(client, "import_files", path=str(folder))
        whole = await call(client, "find_scenarios", like=EXAMPLE, method="bm25")
        assert sorted(shown(whole)) == [f"{EXAMPLE}#200", OTHER]
        assert all(match["score"] > 0 for match in whole["matches"])
        problem = await call(client, "find_scenarios", like=f"{EXAMPLE}#200", method="bm25")
        assert sorted(shown(problem)) == [EXAMPLE, OTHER]
        first = await call(client, "find_scenarios", like=f"{EXAMPLE}#{Problem().problem_id}", method="bm25")
        assert first["search_id"] == whole["search_id"]


async def test_a_version_that_was_superseded_is_an_example_still(
    connect: Connect, bare: Settings, folder: Path
) -> None:
    async with connect(bare) as client:
        await call(client, "import_files", path=str(folder / "other.xml"))
        replace(town_road(), benchmark_id=OTHER).with_vehicles().write(folder / "other.xml")
        changed = await call(client, "import_files", path=str(folder / "other.xml"))
        found = await call(client, "find_scenarios", like=OTHER, method="bm25")
        assert shown(found) == [changed["items"][0]["artifact_id"]]
