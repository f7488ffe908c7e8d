"""The country that benchmarks are made in: the same each time, and one that the product takes."""

from pathlib import Path

import osmium
import pytest
from support.extracts import indexed

from benchmarks.maps.country import town_of, write_country
from plannerforge.engine.maps.drawn_library import LIBRARY


def written(path: Path) -> int:
    """A country of two cells out of built-in maps: streets of a town, and ramps of a motorway."""
    return write_country(LIBRARY, path, columns=2, rows=1, sources=("musterstadt.osm", "neuland.osm"))


@pytest.fixture(scope="module")
def country(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("country") / "Land.osm.pbf"
    written(path)
    return path


def test_the_same_country_is_written_again(country: Path, tmp_path: Path) -> None:
    again = tmp_path / "Land.osm.pbf"
    count = written(again)
    assert again.read_bytes() == country.read_bytes()
    assert count == sum(1 for _ in osmium.FileProcessor(str(again), osmium.osm.NODE))


def test_each_place_has_its_own_name(country: Path) -> None:
    places = [each.tags["name"] for each in osmium.FileProcessor(str(country)) if "place" in each.tags]
    assert len(set(places)) == len(places) > 1
    assert len({town_of(cell) for cell in range(144)}) == 144


def test_copied_cells_are_read_into_tiles_and_have_their_towns(country: Path, tmp_path: Path) -> None:
    facts = indexed(country, tmp_path / "index").facts
    assert {town_of(0), town_of(1)} <= set(facts.places)
    assert facts.sites["intersection"]
    assert facts.sites["ramp"]
