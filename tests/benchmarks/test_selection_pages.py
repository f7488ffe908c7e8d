"""The bench's way through the tool: all pages, and what counts as exact and as rightly empty."""

from pathlib import Path

import pytest
from mcp import Client
from support.catalog import facts

from benchmarks.selection.pages import PAGE, answer_all, search_ms
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.evals.ground_truth.selection import Request
from plannerforge.schemas.scenarios import ScenarioRecord
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

pytestmark = pytest.mark.anyio
IDS = [f"DEU_Bonn-{number}_1_T-1" for number in range(1, PAGE + 3)]
COUNTRY = {"country": "DEU", "city": None}
ALL = Request("all", "", "ok", {"location": COUNTRY, "matching_ids": IDS})
FEWER = Request("fewer", "", "ok", {"location": COUNTRY, "matching_ids": [*IDS[1:], "DEU_Ulm-1_1_T-1"]})
NO_TAG = {"location": COUNTRY, "tags": ["rural"], "matching_ids": []}
EMPTY = Request("empty", "", "empty", {**NO_TAG, "emptied_by": {"stage": "tags"}})
WRONG_STAGE = Request("stage", "", "empty", {**NO_TAG, "emptied_by": {"stage": "obstacles"}})
NOT_EMPTY = Request("found", "", "empty", {"location": COUNTRY, "matching_ids": [], "emptied_by": {"stage": "tags"}})
REFUSED = Request("refused", "", "refuse", {"refused": [{"slot": "tags", "value": "tunnel"}]})


@pytest.fixture
def filled(settings: Settings) -> Settings:
    """A workspace with more scenarios than a page holds."""
    workspace = Workspace(settings.workspace)
    for key in IDS:
        record = ScenarioRecord(facts=facts(key), origin="imported", content=key)
        workspace.put("scenario", key, recipe=Recipe(tool="import_files"), record=record)
    workspace.close()
    return settings.model_copy(update={"starter": False})


async def test_all_pages_are_compared_and_differences_are_reported(filled: Settings, tmp_path: Path) -> None:
    async with Client(create_server(filled, start_folder=tmp_path)) as client:
        every, fewer, empty, stage, found = await answer_all(
            client, [ALL, FEWER, EMPTY, WRONG_STAGE, NOT_EMPTY, REFUSED]
        )
        assert len(await search_ms(client, [ALL, EMPTY, REFUSED])) == 2
    assert set(every.facts) == set(IDS)
    assert [answer.is_exact for answer in (every, fewer, empty)] == [True, False, True]
    assert fewer.difference() == ("fewer: only found: DEU_Bonn-1_1_T-1 (Bonn, DEU); only expected: DEU_Ulm-1_1_T-1")
    assert [answer.is_rightly_empty for answer in (empty, stage, found)] == [True, False, False]
