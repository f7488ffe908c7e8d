"""Extracts of countries as maps: taken in by a job, found by their towns, cut out for the request that means them."""

import os
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from mcp.types import TextContent
from support.extracts import IDS_APART, SECOND_TOWN, elements, written
from support.server import Connect

from plannerforge.engine.maps import unpacking
from plannerforge.engine.workspace import content_digest
from plannerforge.server.settings import Settings
from plannerforge.workflows import extracts

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]
WISH = {"place": SECOND_TOWN, "duration_s": 5, "scenario_type": "intersection", "goal": "steps:20"}


@pytest.fixture(autouse=True)
def _any_binary_extract_is_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unpacking, "LARGE_BINARY_BYTES", 100)


@pytest.fixture
def country(tmp_path: Path) -> Path:
    return written(tmp_path / "Country.osm.pbf", elements())


async def structured(client: Client, tool: str, **arguments: Any) -> dict[str, Any]:
    answer = await client.call_tool(tool, arguments)
    assert not answer.is_error, answer.content
    assert answer.structured_content is not None
    return answer.structured_content


async def added(client: Client, path: Path) -> str:
    """The id of the extract, once it is a map."""
    answer = await structured(client, "import_files", path=path.name, country="ZAM")
    (item,) = answer["items"]
    assert "2 places, kept by 8 tiles" in item["summary"]
    return str(item["artifact_id"])


async def test_a_town_of_a_country_is_cut_out_reported_and_the_same_after_other_requests(
    connect: Connect, country: Path
) -> None:
    async with connect() as client:
        map_id = await added(client, country)
        answer = await structured(client, "generate_scenarios", **WISH)
        (scenario,) = answer["scenarios"]
        assert scenario["place"] == SECOND_TOWN
        assert f"“town {SECOND_TOWN}” was cut out of Country.osm.pbf ({map_id})" in answer["notes"]
        listed = str((await client.call_tool("describe_catalog", {"facet": "maps"})).content)
        assert map_id in listed
        assert scenario["map_id"] not in listed
        await structured(client, "generate_scenarios", **{**WISH, "place": f"Uferstraße, {SECOND_TOWN}"})
        (again,) = (await structured(client, "generate_scenarios", **WISH))["scenarios"]
        assert (again["scenario_id"], again["reused"]) == (scenario["scenario_id"], True)
        named = await structured(client, "generate_scenarios", **{**WISH, "place": scenario["map_id"]})
        assert named["scenarios"][0]["map_id"] == scenario["map_id"]


async def test_a_map_of_the_town_itself_wins_over_the_country(connect: Connect, country: Path) -> None:
    async with connect() as client:
        map_id = await added(client, country)
        answer = await structured(client, "generate_scenarios", **{**WISH, "place": "Fahrhausen"})
        assert not any(map_id in note for note in answer["notes"])
        answer = await structured(client, "generate_scenarios", **{**WISH, "place": f"Fahrhausen, {map_id}"})
        assert any(map_id in note for note in answer["notes"])


async def test_a_box_outside_all_other_maps_is_cut_out(connect: Connect, country: Path) -> None:
    async with connect() as client:
        await added(client, country)
        box = [54.59, 5.64, 54.61, 5.66]
        answer = await structured(client, "generate_scenarios", bbox=box, duration_s=5, goal="steps:20")
        assert any("was cut out of Country.osm.pbf" in note for note in answer["notes"])


async def test_a_place_that_no_map_shows_is_refused_as_before(connect: Connect, country: Path) -> None:
    async with connect() as client:
        await added(client, country)
        answer = await client.call_tool("generate_scenarios", {"place": "Atlantis"})
        assert answer.is_error
        said = "".join(part.text for part in answer.content if isinstance(part, TextContent))
        assert "no map contains 'Atlantis'" in said


async def test_a_broken_extract_is_refused_and_leaves_no_files(
    connect: Connect, country: Path, settings: Settings
) -> None:
    country.write_bytes(country.read_bytes()[:1000])
    async with connect() as client:
        answer = await structured(client, "import_files", path=country.name)
        assert answer["refused"] == 1
        assert "Country.osm.pbf cannot be read" in answer["refusals"][0]["reason"]
    assert list((settings.workspace / "extracts").iterdir()) == []


def index_of(settings: Settings, map_id: str) -> Path:
    return settings.workspace / "extracts" / map_id / "extract.sqlite"


async def test_an_extract_with_a_missing_index_is_reported_and_added_again(
    connect: Connect, country: Path, settings: Settings
) -> None:
    async with connect() as client:
        map_id = await added(client, country)
        index_of(settings, map_id).unlink()
        for place in (SECOND_TOWN, f"{SECOND_TOWN}, {map_id}"):
            answer = await client.call_tool("generate_scenarios", {**WISH, "place": place})
            assert answer.is_error
            assert "extract.sqlite" in str(answer.content)
            assert "add the extract again" in str(answer.content)
        assert await added(client, country) == map_id
        assert (await structured(client, "generate_scenarios", **WISH))["scenarios"][0]["place"] == SECOND_TOWN


async def test_a_damaged_extract_spoils_no_request_that_another_shows(
    connect: Connect, country: Path, settings: Settings
) -> None:
    async with connect() as client:
        await added(client, country)
        again = country.with_name("Again.osm.pbf")
        again.write_bytes(country.read_bytes())
        answer = await structured(client, "import_files", path=again.name, country="ZAM", name="Again")
        index_of(settings, answer["items"][0]["artifact_id"]).write_bytes(b"no index")
        answer = await structured(client, "generate_scenarios", **WISH)
        assert any("an extract was left out: the index extract.sqlite" in note for note in answer["notes"])


async def test_an_extract_that_changed_is_another_map_with_its_own_index(
    connect: Connect, country: Path, settings: Settings
) -> None:
    async with connect() as client:
        before = await added(client, country)
        moved = [element for element in elements() if element.id < IDS_APART]
        written(country, moved)
        answer = await structured(client, "import_files", path=country.name, country="ZAM")
        after = answer["items"][0]["artifact_id"]
        assert after != before
        assert "1 place, kept by 4 tiles" in answer["items"][0]["summary"]
        assert index_of(settings, before).exists()
        assert index_of(settings, after).exists()


async def test_an_extract_that_is_written_while_it_is_read_is_refused(
    connect: Connect, country: Path, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    def digest_before_more_comes(path: Path) -> str:
        digest = content_digest(path)
        os.utime(path, ns=(0, 0))
        return digest

    monkeypatch.setattr(extracts, "content_digest", digest_before_more_comes)
    async with connect() as client:
        answer = await structured(client, "import_files", path=country.name)
        assert "changed while it was read" in answer["refusals"][0]["reason"]
    assert list((settings.workspace / "extracts").iterdir()) == []


class TestMapFolder:
    @pytest.fixture
    def settings(self, settings: Settings, country: Path) -> Settings:
        return settings.model_copy(update={"map_folders": (country.parent,)})

    async def test_a_country_in_a_map_folder_is_read_by_a_job(self, connect: Connect) -> None:
        async with connect() as client:
            before = await structured(client, "generate_scenarios", duration_s=5, goal="steps:20")
            (note,) = [
                note for note in before["notes"] if "Country.osm.pbf is still being split into tiles: job_" in note
            ]
            job_id = note.partition(": ")[2].partition(",")[0]
            job = await structured(client, "get_job", job_id=job_id, wait_s=40)
            assert job["state"] == "done"
            answer = await structured(client, "generate_scenarios", **WISH)
            assert answer["scenarios"][0]["place"] == SECOND_TOWN
