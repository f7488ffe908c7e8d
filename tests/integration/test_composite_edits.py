"""One call with several edits makes the same scenario as several calls with one edit each."""

from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from support.builders import town_road
from support.server import Connect

from plannerforge.server.settings import Settings

pytestmark = pytest.mark.anyio

REROUTE = {"op": "reroute", "vehicles": ["35"], "to": ["13"]}
BEHAVIOUR = {"op": "set_behaviour", "vehicles": ["lead"], "preset": "cautious"}
ADD = {"op": "add_vehicle", "vehicle_class": "truck", "at": "3", "position": "middle"}
GOAL = {"op": "set_goal", "to": ["11"], "position": "middle"}
WALKER = {"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "2", "position": "150m", "time_s": 4}
SLOW_NEW = {"op": "set_speed", "vehicles": ["new:0"], "speed": "3m/s"}
SHIFT = {"op": "shift_time", "vehicles": ["34"], "time_s": -1}
SWAP = {"op": "set_ego", "vehicles": ["31"], "former_ego": "traffic"}
AHEAD = {"op": "add_vehicle", "vehicle_class": "truck", "at": "ego", "offset_m": 14}
BRAKE = {"op": "set_speed", "vehicles": ["lead"], "speed": "2m/s", "time_s": 1}
CLEAR = {"op": "remove_vehicle", "vehicles": ["nearest:1", "class:motorcycle"]}
EVERYBODY = {"op": "set_behaviour", "vehicles": ["all"], "preset": "balanced"}
LANE = {"op": "change_lane", "vehicles": ["32"], "lane": "left", "time_s": 2}


@pytest.fixture
def base(tmp_path: Path) -> Path:
    return town_road().cut(61).write(tmp_path / "base.xml")


async def modified(
    connect: Connect, settings: Settings, base: Path, calls: list[list[dict[str, Any]]]
) -> tuple[str, bytes, bytes]:
    """The id and the files after these calls, in a workspace of its own."""
    folder = base.parent / f"workspace{len(calls)}"
    own = settings.model_copy(update={"starter": False, "workspace": folder})
    async with connect(own) as client:
        latest = "ZAM_Builder-1_1_T-1"
        await client.call_tool("import_files", {"path": str(base)})
        for edits in calls:
            latest = await _edit(client, latest, edits)
    stored = next(path.parent for path in folder.rglob("scenario.xml") if latest in str(path))
    return latest, (stored / "scenario.xml").read_bytes(), (stored / "scenario.net.xml").read_bytes()


async def _edit(client: Client, scenario_id: str, edits: list[dict[str, Any]]) -> str:
    result = await client.call_tool("modify_scenario", {"scenario_id": scenario_id, "edits": edits})
    assert not result.is_error, result.content
    return str((result.structured_content or {})["scenario_id"])


@pytest.mark.parametrize(
    "edits",
    [[REROUTE, BEHAVIOUR, ADD, GOAL], [SHIFT, SWAP, LANE, WALKER], [AHEAD, BRAKE, CLEAR, EVERYBODY]],
    ids=["T+B+P+G", "shift+ego+lane+walker", "words after edits"],
)
async def test_one_call_equals_one_call_for_each_edit(
    connect: Connect, settings: Settings, base: Path, edits: list[dict[str, Any]]
) -> None:
    together = await modified(connect, settings, base, [edits])
    one_by_one = await modified(connect, settings, base, [[edit] for edit in edits])
    assert together == one_by_one


async def test_a_call_reports_as_new_only_what_it_adds(connect: Connect, settings: Settings, base: Path) -> None:
    split = await modified(connect, settings, base, [[WALKER], [ADD, SLOW_NEW]])
    ids = [{"op": "set_speed", "vehicles": ["new:1"], "speed": "3m/s"}]
    assert await modified(connect, settings, base, [[WALKER, ADD, *ids]]) == split
