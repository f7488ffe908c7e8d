"""Pictures as the first thing that is asked of a workspace."""

from pathlib import Path

import pytest
from support.server import Connect

from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]


async def test_a_scenario_of_the_catalogue_is_drawn_before_anything_opened_it(
    connect: Connect, settings: Settings, tmp_path: Path
) -> None:
    async with connect(settings.model_copy(update={"workspace": tmp_path / "unopened"})) as client:
        drawn = await client.call_tool("render", {"ids": ["ZAM_Landmoor-32_1_T-1"]})
    assert not drawn.is_error, drawn.content


@pytest.mark.parametrize("given", [{"time_s": 1.0}, {"focus": 12}])
async def test_a_chart_refuses_a_moment_and_a_road_user_by_name(connect: Connect, given: dict[str, float]) -> None:
    async with connect() as client:
        refused = await client.call_tool("render", {"ids": ["ZAM_Landmoor-32_1_T-1"], "kind": "outcomes", **given})
    assert refused.is_error
    assert next(iter(given)) in refused.content[0].text  # type: ignore[union-attr]
    assert refused.meta is not None
    assert next(iter(given)) not in refused.meta["plannerforge/next_call"]["arguments"]
