from pathlib import Path

import osmium
import pytest

from plannerforge.engine.commonroad.reader import XmlLimits
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.maps import osm as binary_osm
from plannerforge.engine.maps.drawn_library import LIBRARY
from plannerforge.engine.maps.osm import read_osm, write_as_xml
from plannerforge.engine.maps.site_search.finder import SiteFinder
from plannerforge.engine.maps.unpacking import is_binary, is_map, stored_name
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.generation import ConvertMapRequest

TOWN = LIBRARY / "fahrhausen.osm"


@pytest.fixture
def binary(tmp_path: Path) -> Path:
    """The town in OpenStreetMap's binary format, with a fence that no scenario needs."""
    path = tmp_path / "Town.osm.pbf"
    with osmium.SimpleWriter(str(path)) as writer:
        for element in osmium.FileProcessor(str(TOWN)):
            writer.add(element)
        writer.add_way(osmium.osm.mutable.Way(id=9_000_001, nodes=[1, 2, 3, 1], tags={"barrier": "fence"}))
    return path


def written(path: Path, folder: Path) -> Path:
    folder.mkdir()
    return Path(write_as_xml(ConvertMapRequest(path=str(path), folder=str(folder)), silent).path)


def test_a_binary_extract_has_the_same_roads_and_sites(binary: Path, tmp_path: Path) -> None:
    plain = written(binary, tmp_path / "out")
    made, original = read_osm(plain), read_osm(TOWN)
    assert plain.name == "Town.osm"
    assert {way.way_id: way for way in made.roads()} == {way.way_id: way for way in original.roads()}
    assert SiteFinder(made).kinds() == SiteFinder(original).kinds()
    assert 9_000_001 not in {way.way_id for way in made.ways}


def test_writing_it_again_gives_the_same_bytes(binary: Path, tmp_path: Path) -> None:
    assert written(binary, tmp_path / "one").read_bytes() == written(binary, tmp_path / "two").read_bytes()


def test_a_binary_extract_that_is_cut_off_or_something_else_is_refused(binary: Path, tmp_path: Path) -> None:
    content = binary.read_bytes()
    for index, bad in enumerate((content[: len(content) // 2], b"no map at all" * 50, b"")):
        path = tmp_path / f"bad{index}.osm.pbf"
        path.write_bytes(bad)
        with pytest.raises(UnsafeInput, match=f"bad{index}.osm.pbf"):
            written(path, tmp_path / f"out{index}")


@pytest.mark.parametrize("limits", [XmlLimits(10**9, 8, elements=2), XmlLimits(1000, 8, elements=10**6)])
def test_an_extract_that_is_too_large_is_reported_and_not_written(
    limits: XmlLimits, binary: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(binary_osm, "LIMITS", limits)
    request = ConvertMapRequest(path=str(binary), folder=str(tmp_path / "out"))
    (tmp_path / "out").mkdir()
    assert write_as_xml(request, silent).too_large
    assert list((tmp_path / "out").iterdir()) == []


def test_binary_extracts_are_known_by_their_names() -> None:
    path = Path("a.OSM.PBF")
    assert is_map(path)
    assert is_binary(path)
    assert stored_name(path) == "map.osm"
