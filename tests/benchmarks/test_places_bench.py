"""The bench of place names: what its data promise, and that its judge tells right from wrong."""

from collections import Counter
from pathlib import Path

from benchmarks.answers.places import place_cases, wrong_there
from plannerforge.engine.execution import silent
from plannerforge.engine.maps import MapEntry, MapMatch, read_map
from plannerforge.engine.maps.drawn_library import LIBRARY
from plannerforge.schemas.generation import PlaceArea, ReadMapRequest


def test_there_are_many_spellings_in_many_languages_and_a_third_is_held_out() -> None:
    cases = place_cases()
    assert len(cases) >= 150
    assert len({case.language for case in cases}) >= 8
    assert 0.3 < Counter(case.aside for case in cases)[True] / len(cases) < 0.4
    assert len({case.words for case in cases}) == len(cases)


def test_another_road_or_a_part_in_place_of_the_whole_is_found_wrong() -> None:
    path = LIBRARY / "musterstadt.osm"
    entry = MapEntry(read_map(ReadMapRequest(path=str(path)), silent), Path(path))
    way = next(name for name, names in road_names(path).items() if "Hauptstraße" in names)
    area = PlaceArea(name="Mitte", kind="quarter", latitude=54.6, longitude=5.2, radius_m=100)
    assert wrong_there(way, MapMatch(entry, (("Hauptstraße",),))) == ""
    assert wrong_there(way, MapMatch(entry, (("Bahnhofstraße",),))) != ""
    assert wrong_there("map", MapMatch(entry)) == ""
    assert wrong_there("map", MapMatch(entry, area=area)) != ""


def road_names(path: Path) -> dict[str, str]:
    """The names of ways by ``way 1``, read from the text of the file."""
    ways = path.read_text(encoding="utf-8").split("<way ")[1:]
    return {f"way {way.partition('id=')[2].split(chr(34))[1]}": way for way in ways}
