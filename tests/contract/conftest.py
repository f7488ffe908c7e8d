"""A workspace in which every tool has something to work on, made by the tools themselves."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client

from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings


@dataclass(frozen=True)
class Prepared:
    """Settings of a filled workspace, and the ids that are in it."""

    settings: Settings
    folder: Path
    scenario_id: str
    config_id: str
    batch_id: str
    run_ids: tuple[str, ...]
    search_id: str


@pytest.fixture(scope="session")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    folder = tmp_path_factory.mktemp("prepared")
    settings = Settings(workspace=folder / "workspace", roots=(folder,), workers=1, warm_up=False)
    return anyio.run(_prepare, settings, folder)


async def _prepare(settings: Settings, folder: Path) -> Prepared:
    async with Client(create_server(settings, start_folder=folder)) as client:

        async def made(tool: str, arguments: dict[str, Any]) -> dict[str, Any]:
            result = await client.call_tool(tool, arguments)
            assert not result.is_error, result.content[0].text  # type: ignore[union-attr]
            assert result.structured_content is not None
            return result.structured_content

        search = await made("find_scenarios", {"obstacles": ["car>=1"], "limit": 1})
        scenario_id = search["matches"][0]["scenario_id"]
        config = await made("configure_planner", {"preset": "Safety-Conservative", "weights": ["jerk=0.3"]})
        grid = {"scenarios": [scenario_id], "configs": ["frenetix:Default", config["config_id"]], "wait_s": 50}
        runs = await made("run_planner", grid)
        return Prepared(
            settings=settings,
            folder=folder,
            scenario_id=scenario_id,
            config_id=config["config_id"],
            batch_id=runs["batch_id"],
            run_ids=tuple(run["run_id"] for run in runs["runs"]),
            search_id=search["search_id"],
        )
