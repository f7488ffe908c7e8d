"""A call with several faults is refused with all of them, each with what is valid, and nothing is changed."""

from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.builders import town_road

from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

pytestmark = pytest.mark.anyio
CASES: tuple[tuple[str, dict[str, Any], tuple[str, ...]], ...] = (
    (
        "modify_scenario",
        {
            "edits": [
                {"op": "set_speed", "vehicles": ["77"], "speed": "5m/s"},
                {"op": "set_behaviour", "vehicles": ["31"], "preset": "agressive"},
                {"op": "reroute", "vehicles": ["32"], "to": ["999"]},
                {"op": "remove_vehicle", "vehicles": ["33"]},
            ]
        },
        ("3 errors", "edit 0 (set_speed): there is no vehicle 77", "edit 1 (set_behaviour)", "aggressive", "edit 2"),
    ),
    (
        "run_planner",
        {"scenarios": ["ZAM_Bilder-1_1_T-1", "preset:many"], "configs": ["frenetix:Fast", "cfg_0"]},
        ("ZAM_Builder-1_1_T-1", "preset:10", "frenetix has no preset 'Fast'", "there is no configuration 'cfg_0'"),
    ),
    (
        "configure_planner",
        {"preset": "fast", "weights": ["jerk=purple", "lateral_jrk=1"], "settings": ["vehicle=9"]},
        ("4 errors", "no preset 'fast'", "jerk cannot be 'purple'", "lateral_jerk", "vehicle from 1 to 4"),
    ),
    (
        "find_scenarios",
        {"tags": ["urbn"], "obstacles": ["trck"], "road_net": ["lanes=x"], "ego_speed": "50"},
        ("4 errors", "urban", "truck", "lanes=x", "without a unit"),
    ),
    (
        "optimize_planner",
        {"scenarios": ["latest"], "base": "idm", "objective": ["safety"], "constraints": ["success>2"]},
        ("3 errors", "'safety'", "'success>2'", "preset:100"),
    ),
    ("analyze_results", {"results": ["run_0", "batch_0"]}, ("2 errors", "run_0", "batch_0")),
    ("export_artifacts", {"ids": ["run_0", "cfg_0"], "folder": "."}, ("2 errors", "run_0", "cfg_0")),
)


@pytest.mark.parametrize(("tool", "arguments", "told"), CASES, ids=[tool for tool, _, _ in CASES])
async def test_every_fault_is_reported(
    tool: str, arguments: dict[str, Any], told: tuple[str, ...], settings: Settings, warm_workers: None, tmp_path: Path
) -> None:
    town_road().write(tmp_path / "town.xml")
    own = settings.model_copy(update={"starter": False})
    async with Client(create_server(own, start_folder=tmp_path)) as client:
        await client.call_tool("import_files", {"path": "town.xml"})
        before = (await client.call_tool("list_artifacts", {})).structured_content
        result = await client.call_tool(tool, arguments)
        assert (await client.call_tool("list_artifacts", {})).structured_content == before
    text = str(result.content[0].text)  # type: ignore[union-attr]
    assert result.is_error
    assert [words for words in told if words not in text] == []


async def test_an_edit_of_a_vehicle_from_a_refused_edit_is_not_a_fault_of_its_own(
    settings: Settings, warm_workers: None, tmp_path: Path
) -> None:
    town_road().write(tmp_path / "town.xml")
    own = settings.model_copy(update={"starter": False})
    edits = [
        {"op": "add_vehicle", "vehicle_class": "spaceship", "at": "ego", "offset_m": 30},
        {"op": "set_speed", "vehicles": ["new:0"], "speed": "5m/s"},
    ]
    async with Client(create_server(own, start_folder=tmp_path)) as client:
        await client.call_tool("import_files", {"path": "town.xml"})
        result = await client.call_tool("modify_scenario", {"edits": edits})
    text = str(result.content[0].text)  # type: ignore[union-attr]
    assert "edit 0 (add_vehicle)" in text
    assert "edit 1" not in text
