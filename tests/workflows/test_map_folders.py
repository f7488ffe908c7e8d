"""Maps in the user's map folders: read once, and one that is broken is left out and told of."""

import gzip
import os
import sys
from pathlib import Path

import pytest
from support.server import Connect

from plannerforge.engine.maps.drawn_library import LIBRARY
from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.generation import MAP_FACTS_VERSION, MapFacts
from plannerforge.server.settings import Settings
from plannerforge.workflows import maps as importing_kinds

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]
WISH = {"place": "town", "duration_s": 5, "scenario_type": "intersection", "goal": "steps:20"}
NOWHERE = {"place": "Atlantis"}
"""A request that is refused once all maps are read."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A packed map, and one that was cut in the middle."""
    made = tmp_path / "maps"
    made.mkdir()
    town = (LIBRARY / "fahrhausen.osm").read_bytes()
    (made / "town.osm.gz").write_bytes(gzip.compress(town))
    (made / "half.osm").write_bytes(town[:9000])
    return made


@pytest.fixture
def settings(settings: Settings, folder: Path) -> Settings:
    return settings.model_copy(update={"map_folders": (folder, folder.parent / "nowhere")})


async def test_a_broken_map_does_not_stop_the_others_and_is_reported(connect: Connect) -> None:
    async with connect() as client:
        answer = await client.call_tool("generate_scenarios", WISH)
        assert not answer.is_error, answer.content
        assert answer.structured_content is not None
        notes = answer.structured_content["notes"]
        assert any(note.startswith("the map half.osm was left out: half.osm is not well-formed XML") for note in notes)
        assert any("nowhere cannot be read" in note for note in notes)
        facets = str((await client.call_tool("describe_catalog", {"facet": "maps"})).content)
        assert "half.osm was left out" in facets


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has file names that are not UTF-8")
async def test_a_map_with_a_name_that_is_not_utf8_is_left_out_and_reported(connect: Connect, folder: Path) -> None:
    (folder / os.fsdecode(b"lost\xff.osm")).write_bytes((LIBRARY / "fahrhausen.osm").read_bytes())
    async with connect() as client:
        assert (await client.call_tool("generate_scenarios", NOWHERE)).is_error
        facets = str((await client.call_tool("describe_catalog", {"facet": "maps"})).content)
        assert "not UTF-8" in facets


async def test_a_packed_map_is_unpacked_once(connect: Connect, monkeypatch: pytest.MonkeyPatch) -> None:
    unpacked: list[str] = []
    original = importing_kinds.unpacked

    def counting(path: Path, folder: Path) -> Path:
        unpacked.append(path.name)
        return original(path, folder)

    monkeypatch.setattr(importing_kinds, "unpacked", counting)
    async with connect() as client:
        await client.call_tool("generate_scenarios", NOWHERE)
        await client.call_tool("generate_scenarios", NOWHERE | {"seed": 1})
    assert sorted(unpacked) == ["half.osm", "town.osm.gz"]


async def test_a_map_that_was_mended_is_read_again(connect: Connect, folder: Path) -> None:
    async with connect() as client:
        before = str((await client.call_tool("describe_catalog", {"facet": "maps"})).content)
        assert "2 map files not read yet; generate_scenarios reads new files" in before
        await client.call_tool("generate_scenarios", NOWHERE)
        (folder / "half.osm").write_bytes((LIBRARY / "kreiselheim.osm").read_bytes())
        answer = await client.call_tool("generate_scenarios", {"place": "half", "duration_s": 5, "goal": "steps:20"})
        assert not answer.is_error, answer.content


async def test_a_box_larger_than_the_maps_is_used_within_them(connect: Connect) -> None:
    async with connect() as client:
        country = {"bbox": [50.0, 0.0, 60.0, 10.0], "duration_s": 5, "goal": "steps:20"}
        answer = await client.call_tool("generate_scenarios", country)
        assert answer.structured_content is not None
        assert any("no map covers the whole bbox" in note for note in answer.structured_content["notes"])


async def test_map_facts_of_an_older_program_are_read_again(connect: Connect, settings: Settings) -> None:
    async with connect() as client:
        await client.call_tool("generate_scenarios", NOWHERE)
    workspace = Workspace(settings.workspace)
    kept = workspace.newest(kind="map")[0]
    old = kept.read(MapFacts).model_copy(update={"facts_version": 1, "areas": (), "sites": {}, "place": "Oldtown"})
    workspace.amend("map", kept.artifact_id, old)
    async with connect() as client:
        await client.call_tool("generate_scenarios", NOWHERE)
    read = workspace.get(kept.artifact_id, "map").read(MapFacts)
    assert read.facts_version == MAP_FACTS_VERSION
    assert read.sites["urban"] > 0
    assert (read.place, [area.name for area in read.areas]) == ("Oldtown", ["Fahrhausen"])
    workspace.close()


@pytest.mark.parametrize("version", [1, MAP_FACTS_VERSION])
async def test_a_stored_map_without_its_file_is_left_out_and_reported(
    connect: Connect, settings: Settings, version: int
) -> None:
    async with connect() as client:
        await client.call_tool("generate_scenarios", NOWHERE)
    workspace = Workspace(settings.workspace)
    (kept,) = workspace.newest(kind="map", limit=5)
    workspace.amend("map", kept.artifact_id, kept.read(MapFacts).model_copy(update={"facts_version": version}))
    workspace.file("map", kept.artifact_id, "map.osm").unlink()
    async with connect() as client:
        listed = await client.call_tool("describe_catalog", {"facet": "maps"})
        assert "has no file map.osm" in str(listed.content), listed.content
        made = await client.call_tool("generate_scenarios", WISH | {"place": "Fahrhausen"})
        assert not made.is_error, made.content
    workspace.close()
