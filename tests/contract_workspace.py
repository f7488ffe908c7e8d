"""A workspace in which every tool has something to work on, made by the tools themselves."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio
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


def prepare(folder: Path) -> Prepared:
    """Fill a workspace below a folder."""
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
        exported = {"ids": [scenario_id], "formats": ["xml"], "folder": str(folder)}
        await made("export_artifacts", exported)
        content = (folder / f"{scenario_id}.xml").read_text(encoding="utf-8")
        own_id = scenario_id.replace("_T-1", "_T-77")
        (folder / "own.xml").write_text(content.replace(scenario_id, own_id), encoding="utf-8")
        (folder / "hostile.xml").write_text('<!DOCTYPE a [<!ENTITY b "c">]><commonRoad/>', encoding="utf-8")
        return Prepared(
            settings=settings,
            folder=folder,
            scenario_id=scenario_id,
            config_id=config["config_id"],
            batch_id=runs["batch_id"],
            run_ids=tuple(run["run_id"] for run in runs["runs"]),
            search_id=search["search_id"],
        )


def filled(value: Any, prepared: Prepared) -> Any:
    """The arguments of a case with the ids of the prepared workspace."""
    if isinstance(value, dict):
        return {key: filled(part, prepared) for key, part in value.items()}
    if isinstance(value, list):
        return [filled(part, prepared) for part in value]
    if isinstance(value, str):
        for word, meaning in _meanings(prepared).items():
            value = value.replace(word, meaning)
    return value


def _meanings(prepared: Prepared) -> dict[str, str]:
    return {
        "<scenario>": prepared.scenario_id,
        "<config>": prepared.config_id,
        "<batch>": prepared.batch_id,
        "<run>": prepared.run_ids[0],
        "<search>": prepared.search_id,
        "<folder>": str(prepared.folder),
        "<file>": str(prepared.folder / "own.xml"),
        "<hostile>": str(prepared.folder / "hostile.xml"),
    }
