import json
from pathlib import Path

import pytest

from plannerforge.engine.maps import MapEntry, find_maps
from plannerforge.engine.maps.facts import countries_near, country_at, facts_of
from plannerforge.engine.maps.osm import OsmMap, OsmNode, OsmWay
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.generation import ReadMapRequest


def around(latitude: float, longitude: float) -> tuple[float, float, float, float]:
    return latitude - 0.005, longitude - 0.005, latitude + 0.005, longitude + 0.005


def country_of(bounds: tuple[float, float, float, float]) -> str | None:
    """The country that the facts of a map state."""
    near = countries_near(bounds)
    return near[0] if len(near) == 1 else None


@pytest.mark.parametrize(
    ("latitude", "longitude", "country"),
    [
        (48.14, 11.57, "DEU"),
        (48.86, 2.35, "FRA"),
        (-31.95, 115.86, "AUS"),
        (-17.79, 177.95, "FJI"),
        (1.30, 103.83, "SGP"),
        (53.80, -1.55, "GBR"),
    ],
)
def test_a_place_inside_a_country_belongs_to_it(latitude: float, longitude: float, country: str) -> None:
    assert country_of(around(latitude, longitude)) == country


@pytest.mark.parametrize(
    ("latitude", "longitude"),
    [(54.6, 5.2), (47.56, 7.59), (43.94, 12.45), (47.14, 9.52), (42.66, 21.16), (-80.0, 20.0)],
    ids=["sea", "Basel", "San Marino", "Vaduz", "Kosovo", "Antarctica"],
)
def test_at_sea_near_a_border_and_in_disputed_areas_no_country_is_assumed(latitude: float, longitude: float) -> None:
    assert country_of(around(latitude, longitude)) in (None, "ATA")


def test_near_a_border_its_countries_are_named() -> None:
    assert countries_near(around(47.56, 7.59)) == ("CHE", "DEU", "FRA")
    assert countries_near(around(54.6, 5.2)) == ()


def country_read(bounds: tuple[float, float, float, float], **tags: str) -> str | None:
    """The country of a map with this box, and with an object of these tags in a corner."""
    nodes = {1: OsmNode(1, *bounds[:2], tags), 2: OsmNode(2, *bounds[2:], {})}
    road = OsmWay(3, (1, 2), {"highway": "residential"})
    return facts_of(OsmMap(nodes, (road,), (), None), ReadMapRequest(path="a.osm", map_id="map_a")).country


@pytest.mark.parametrize(
    ("latitude", "longitude", "city", "country"),
    [
        (7.889, -72.4995, "CUCUTA", "COL"),
        (-25.5745, -54.5775, "Foz do Iguaçu", "BRA"),
        (49.59, 5.81, "Messancy", "BEL"),
        (47.557, 7.59, "Basel", "CHE"),
    ],
)
def test_near_a_border_the_settlements_there_decide(latitude: float, longitude: float, city: str, country: str) -> None:
    assert country_read(around(latitude, longitude), **{"addr:city": city}) == country


def test_between_towns_of_two_countries_and_over_both_nothing_is_guessed() -> None:
    assert country_read(around(31.501, 34.561)) is None
    assert country_read((45.0, 5.0, 50.0, 12.0)) is None
    assert country_read((47.5, 7.5, 47.65, 7.75)) is None


def test_a_box_over_two_countries_belongs_to_neither() -> None:
    assert country_of((45.0, 5.0, 50.0, 12.0)) is None


def test_no_real_extract_gets_a_wrong_country(shared_data: Path) -> None:
    places = json.loads((shared_data / "data" / "osm" / "places.json").read_text(encoding="utf-8"))
    found = {name: (country_of(tuple(entry["bbox"])), entry["country"]) for name, entry in places.items()}
    unknown = [name for name, (country, _) in found.items() if country is None]
    assert len(unknown) < len(places) / 10, "only the smallest countries are not in the outlines"
    assert [name for name, (country, true) in found.items() if country not in (None, true)] == []


def test_a_map_on_both_sides_of_a_border_shows_both_countries() -> None:
    constance = (47.640, 9.160, 47.680, 9.190)
    nodes = {
        1: OsmNode(1, *constance[:2], {"addr:country": "DE", "place": "city", "name": "Konstanz"}),
        2: OsmNode(2, *constance[2:], {}),
    }
    road = OsmWay(3, (1, 2), {"highway": "residential", "name": "Hauptstrasse"})
    facts = facts_of(OsmMap(nodes, (road,), (), None), ReadMapRequest(path="a.osm", map_id="map_a"))
    assert (facts.country, facts.countries_near) == ("DEU", ("CHE",))
    for country in ("Deutschland", "Switzerland"):
        assert find_maps([MapEntry(facts, Path("a.osm"))], place=f"Hauptstrasse, Konstanz, {country}")
    with pytest.raises(UnknownName):
        find_maps([MapEntry(facts, Path("a.osm"))], place="Hauptstrasse, Konstanz, France")


def test_a_map_without_names_is_called_by_the_settlement_around_it() -> None:
    box = around(-7.28, 112.74)
    nodes = {1: OsmNode(1, *box[:2], {}), 2: OsmNode(2, *box[2:], {})}
    road = OsmWay(3, (1, 2), {"highway": "residential", "name": "Jalan Darmo"})
    facts = facts_of(OsmMap(nodes, (road,), (), None), ReadMapRequest(path="a.osm", map_id="map_a"))
    assert facts.place == "Surabaya"
    assert find_maps([MapEntry(facts, Path("a.osm"))], place="Jalan Darmo, Surabaya")


def strip(west: float, east: float, latitude: float) -> OsmMap:
    """A map with one road from west to east."""
    nodes = {1: OsmNode(1, latitude, west, {}), 2: OsmNode(2, latitude, east, {})}
    return OsmMap(nodes, (OsmWay(1, (1, 2), {"highway": "primary"}),), (), None)


@pytest.mark.parametrize(
    ("longitude", "main", "country"),
    [
        (7.65, "DEU", "FRA"),  # west of Strasbourg
        (7.95, "FRA", "DEU"),  # Offenburg
        (7.75, "DEU", "FRA"),  # in Strasbourg, near the border
        (7.65, "FRA", "FRA"),
        (7.95, "ZAM", "ZAM"),  # an invented country
        (7.95, "ITA", "ITA"),  # stated by the caller
        (7.95, None, "DEU"),
    ],
)
def test_the_country_at_a_position_may_be_another_than_that_of_the_map(
    longitude: float, main: str | None, country: str
) -> None:
    assert country_at(strip(7.6, 8.0, 48.57), (48.57, longitude), main) == country
