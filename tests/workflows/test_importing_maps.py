import gzip
import os
import sys
from pathlib import Path

import pytest
from support.builders import town_road
from support.server import Connect

from plannerforge.engine.maps.drawn_library import LIBRARY

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("starter_ready")]


async def test_packed_maps_of_a_folder_go_in_and_a_broken_one_is_named(connect: Connect, tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    (folder / "town.osm.gz").write_bytes(gzip.compress((LIBRARY / "fahrhausen.osm").read_bytes()))
    (folder / "broken.osm.gz").write_bytes(b"no archive")
    async with connect() as client:
        answer = await client.call_tool("import_files", {"path": str(folder)})
        text = str(answer.content)
        assert not answer.is_error, text
        assert "“Fahrhausen” (ZAM)" in text
        assert "broken.osm.gz" in text
        assert "cannot be unpacked" in text


async def test_the_country_of_a_map_may_be_stated(connect: Connect, tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_bytes((LIBRARY / "fahrhausen.osm").read_bytes())
    async with connect() as client:
        answer = await client.call_tool("import_files", {"path": "town.osm", "country": "Germany"})
        assert "(DEU)" in str(answer.content)
        unknown = await client.call_tool("import_files", {"path": "town.osm", "country": "Atlantis"})
        assert "there is no country 'Atlantis'" in unknown.content[0].text


async def test_a_country_without_a_map_is_refused(connect: Connect, tmp_path: Path) -> None:
    (tmp_path / "some.yaml").write_text("cost_weights: {}")
    async with connect() as client:
        answer = await client.call_tool("import_files", {"path": "some.yaml", "country": "DEU"})
        assert answer.is_error
        assert "country is only for maps" in str(answer.content)


async def test_a_map_is_identified_by_its_content_under_any_name(connect: Connect, tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    town = (LIBRARY / "fahrhausen.osm").read_bytes()
    for name in ("web.osm.xml", "other.xml", "packed.osm.xml.gz"):
        (folder / name).write_bytes(gzip.compress(town) if name.endswith(".gz") else town)
    async with connect() as client:
        for kind in ("auto", "map"):
            answer = await client.call_tool("import_files", {"path": str(folder / "web.osm.xml"), "kind": kind})
            assert (answer.structured_content or {})["refused"] == 0
        answer = await client.call_tool("import_files", {"path": str(folder)})
        assert (answer.structured_content or {})["refused"] == 0
        assert {item["kind"] for item in (answer.structured_content or {})["items"]} == {"map"}


async def test_a_compressed_scenario_is_imported_and_other_compressed_xml_is_skipped(
    connect: Connect, tmp_path: Path
) -> None:
    folder = tmp_path / "scenarios"
    folder.mkdir()
    (folder / "road.xml.gz").write_bytes(gzip.compress(town_road().xml().encode()))
    (folder / "osm.poly.xml.gz").write_bytes(gzip.compress(b"<additional/>"))
    async with connect() as client:
        answer = await client.call_tool("import_files", {"path": str(folder)})
        found = answer.structured_content or {}
        assert [item["kind"] for item in found["items"]] == ["scenario"]
        assert found["refused"] == 0
        assert ".gz (1)" in found["note"]
        (folder / "road.xml").write_text(town_road().xml(), encoding="utf-8")
        again = await client.call_tool("import_files", {"path": str(folder / "road.xml")})
        assert (again.structured_content or {})["reused"] == 1


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has file names that are not UTF-8")
async def test_another_user_s_file_is_skipped_and_reported_and_refused_alone(
    connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    for name in ("town.osm", "theirs.osm"):
        (folder / name).write_bytes((LIBRARY / "fahrhausen.osm").read_bytes())
    (folder / "theirs.osm").chmod(0)
    if os.access(folder / "theirs.osm", os.R_OK):  # root may read every file
        monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "theirs.osm")
    async with connect() as client:
        alone = await client.call_tool("import_files", {"path": str(folder / "theirs.osm")})
        assert "[invalid_request]" in str(alone.content)
        assert "is not readable" in str(alone.content)
        answer = await client.call_tool("import_files", {"path": str(folder)})
        assert "Fahrhausen" in str(answer.content)
        assert "not readable (1)" in (answer.structured_content or {})["note"]


async def test_files_with_names_that_are_not_utf8_are_skipped_and_reported(connect: Connect, tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    town = (LIBRARY / "fahrhausen.osm").read_bytes()
    (folder / os.fsdecode(b"town\xff.osm")).write_bytes(town)
    async with connect() as client:
        nothing = await client.call_tool("import_files", {"path": str(folder)})
        assert "[invalid_request]" in str(nothing.content)
        assert "not UTF-8 (1)" in str(nothing.content)
        (folder / "town.osm").write_bytes(town)
        answer = await client.call_tool("import_files", {"path": str(folder)})
        assert "Fahrhausen" in str(answer.content)
        assert "not UTF-8 (1)" in (answer.structured_content or {})["note"]
