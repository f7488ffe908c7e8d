"""Words and the places that they mean: towns, roads, crossings, one of several, none."""

from pathlib import Path

import pytest
from support.online import HERE, drawn_town, services_of, town_places, town_servers

from benchmarks.maps.loopback import MapServers, Place, settlement
from plannerforge.engine.execution import silent
from plannerforge.engine.maps import locate_place
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.maps import LocatedPlace, LocateRequest, NamedPlace


def located(servers: MapServers, cache: Path, words: str, country: str | None = None) -> LocatedPlace:
    request = LocateRequest(services=services_of(servers, cache), place=words, country=country)
    return locate_place(request, silent)


def found(servers: MapServers, cache: Path, words: str, country: str | None = None) -> NamedPlace:
    place = located(servers, cache, words, country).place
    assert place is not None
    return place


def town(name: str, at: tuple[float, float], importance: float, state: str, country: str = "USA") -> Place:
    box = (at[0] - 0.1, at[1] - 0.1, at[0] + 0.1, at[1] + 0.1)
    return settlement([name], country, box, importance=importance, state=state)


def test_a_town_a_road_and_a_crossing_are_found(tmp_path: Path) -> None:
    with town_servers("Rechteck", "quadratstadt.osm").running() as servers:
        place = found(servers, tmp_path, "Rechteck")
        assert (place.kind, place.country, place.is_settlement) == ("city", "DEU", True)
        road = found(servers, tmp_path, "Marktstraße, Rechteck")
        assert (road.kind, road.name) == ("road", "Marktstraße")
        assert road.lines
        crossing = found(servers, tmp_path, "Marktstraße / Erste Straße, Rechteck")
        assert crossing.kind == "crossing"
        assert crossing.roads == (("Marktstraße",), ("Erste Straße",))
        south, west, north, east = road.box
        assert south - 1e-3 <= crossing.latitude <= north + 1e-3
        assert west - 1e-3 <= crossing.longitude <= east + 1e-3


def test_a_road_that_nominatim_does_not_know_is_left_to_the_map_of_its_town(tmp_path: Path) -> None:
    with town_servers("Rechteck", "quadratstadt.osm").running() as servers:
        place = found(servers, tmp_path, "Marktstrasse Nord, Rechteck")
        assert (place.name, place.roads) == ("Rechteck", (("Marktstrasse Nord",),))


def test_of_two_towns_the_far_better_known_one_is_chosen(tmp_path: Path) -> None:
    towns = [town("Paris", (48.86, 2.35), 0.9, "Île-de-France", "FRA"), town("Paris", (33.66, -95.56), 0.5, "Texas")]
    with MapServers((), towns).running() as servers:
        assert found(servers, tmp_path, "Paris").country == "FRA"
        assert found(servers, tmp_path, "Paris", "USA").label == "Paris, Texas, United States of America"


def test_towns_that_are_as_well_known_are_candidates(tmp_path: Path) -> None:
    towns = [town("Springfield", (39.8, -89.6), 0.60, "Illinois"), town("Springfield", (37.2, -93.3), 0.58, "Missouri")]
    with MapServers((), towns).running() as servers:
        several = located(servers, tmp_path, "Springfield")
        assert several.place is None
        assert [place.label for place in several.candidates] == [
            "Springfield, Illinois, United States of America",
            "Springfield, Missouri, United States of America",
        ]
        chosen = found(servers, tmp_path, several.candidates[1].label)
        assert (chosen.latitude, chosen.longitude) == (37.2, -93.3)


def test_one_town_that_is_listed_twice_is_one(tmp_path: Path) -> None:
    towns = [town("Ringstadt", HERE, 0.5, "Bavaria", "DEU"), town("Ringstadt", (48.01, 11.01), 0.5, "Bavaria", "DEU")]
    with MapServers((), towns).running() as servers:
        assert found(servers, tmp_path, "Ringstadt").label == "Ringstadt, Bavaria, Germany"


def test_a_territory_with_its_own_code_is_found_by_it(tmp_path: Path) -> None:
    with MapServers((), [settlement(["Frederiksted"], "VIR", (17.6, -64.9, 17.8, -64.8))]).running() as servers:
        assert found(servers, tmp_path, "Frederiksted", "VIR").country == "VIR"


def test_an_unknown_place_is_refused(tmp_path: Path) -> None:
    with town_servers().running() as servers:
        with pytest.raises(UnknownName, match=r"'Gotham City', and 127\.0\.0\.1:\d+ knows no such place") as caught:
            located(servers, tmp_path, "Gotham City")
        assert caught.value.reason == "not_shown"
        with pytest.raises(UnknownName, match="knows no such place in FRA"):
            located(servers, tmp_path, "Ringstadt", "FRA")


def test_a_bare_name_does_not_select_a_bar(tmp_path: Path) -> None:
    bar = Place({"name": "Atlantis"}, "amenity", "bar", *HERE, (48.0, 11.0, 48.0, 11.0), "DEU", {"city": "Ringstadt"})
    extract = drawn_town("kreiselheim.osm")
    with MapServers([extract], [bar, *town_places("Ringstadt", extract)]).running() as servers:
        with pytest.raises(UnknownName, match="only a bar of that name"):
            located(servers, tmp_path, "Atlantis")
        assert found(servers, tmp_path, "Atlantis, Ringstadt").kind == "bar"


def test_a_finding_without_its_own_name_is_still_a_place(tmp_path: Path) -> None:
    box = (48.0, 11.0, 48.2, 11.2)
    nameless = Place({"operator": "Nirgendwo"}, "boundary", "city", 48.1, 11.1, box, "DEU", importance=0.6)
    with MapServers((), [nameless]).running() as servers:
        assert found(servers, tmp_path, "Nirgendwo").names == ()
