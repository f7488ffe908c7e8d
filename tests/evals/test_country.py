"""The country that benchmarks are made in: the same each time, and one that the product takes."""

from pathlib import Path

import osmium
import pytest
from support.extracts import indexed

from plannerforge.evals.maps.country import town_of, write_country


@pytest.fixture(scope="module")
def country(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("country") / "Land.osm.pbf"
    write_country(shared_data / "data" / "osm", path, columns=1, rows=1)
    return path


def test_the_same_country_is_written_again(country: Path, shared_data: Path, tmp_path: Path) -> None:
    again = tmp_path / "Land.osm.pbf"
    count = write_country(shared_data / "data" / "osm", again, columns=1, rows=1)
    assert again.read_bytes() == country.read_bytes()
    assert count == sum(1 for _ in osmium.FileProcessor(str(again), osmium.osm.NODE))


def test_each_place_has_a_name_of_its_own(country: Path) -> None:
    places = [each.tags["name"] for each in osmium.FileProcessor(str(country)) if "place" in each.tags]
    assert len(set(places)) == len(places) > 1
    assert len({town_of(cell) for cell in range(144)}) == 144


def test_a_copied_cell_is_read_into_tiles_and_has_its_town(country: Path, tmp_path: Path) -> None:
    facts = indexed(country, tmp_path / "index").facts
    assert town_of(0) in facts.places
    assert facts.sites["intersection"]
    assert facts.sites["ramp"]
