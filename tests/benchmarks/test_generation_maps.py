"""The maps that the generator is measured on."""

import json
import shutil
from pathlib import Path

from benchmarks.generation.cases import convert_whole
from plannerforge.evals.scoring.map_evidence import read_maps

BINARY = "o2s_frederiksted.osm.pbf"


def test_a_binary_map_is_read_and_converted_like_the_others(shared_data: Path, tmp_path: Path) -> None:
    folder, scratch = tmp_path / "maps", tmp_path / "scratch"
    for made in (folder, scratch):
        made.mkdir()
    listed = json.loads((shared_data / "data" / "osm" / "places.json").read_text(encoding="utf-8"))
    (folder / "places.json").write_text(json.dumps({BINARY: listed[BINARY]}), encoding="utf-8")
    shutil.copy(shared_data / "data" / "osm" / BINARY, folder / BINARY)
    maps = read_maps(folder, scratch)
    assert maps.names == {BINARY}
    assert maps.files[BINARY].suffix == ".osm"
    assert maps.name_of(maps.entries[0].facts.map_id) == BINARY
    assert maps.drives_left(BINARY)
    assert convert_whole(BINARY, maps) == ""


def test_an_unreadable_or_unlisted_map_is_counted_and_reported(tmp_path: Path) -> None:
    (tmp_path / "places.json").write_text("{}", encoding="utf-8")
    (tmp_path / "broken.osm.pbf").write_bytes(b"no map")
    (tmp_path / "unlisted.osm").write_text("<osm/>", encoding="utf-8")
    maps = read_maps(tmp_path, tmp_path)
    assert "cannot be unpacked" in convert_whole("broken.osm.pbf", maps)
    assert {*maps.files, *maps.unread} == {"broken.osm.pbf", "unlisted.osm"}
    assert maps.names == frozenset()
