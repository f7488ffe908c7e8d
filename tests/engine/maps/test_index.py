import pytest

from plannerforge.engine.maps.index import built_in_maps, find_maps, same_street
from plannerforge.engine.maps.road_classes import resolve_road_classes
from plannerforge.schemas.errors import UnknownName


def places(**wish: object) -> list[str]:
    return [match.entry.facts.place for match in find_maps(built_in_maps(), **wish)]  # type: ignore[arg-type]


def test_a_map_is_found_by_what_people_call_it() -> None:
    assert places(place="kreiselheim") == ["Kreiselheim"]
    assert places(place="map_neuland") == ["Neuland"]
    assert places(place="A901") == ["Neuland"]
    assert places(place="Suedstrasse") == ["Kreiselheim"]
    assert places(place="Hauptstraße / Bahnhofstr.") == ["Musterstadt"]
    assert places(place="Torfweg, Landmoor") == ["Landmoor"]
    assert places(bbox=(54.59, 5.19, 54.601, 5.21)) == ["Musterstadt"]
    assert len(places(country="ZAM")) == 6


def test_maps_that_hold_the_wished_site_come_first() -> None:
    assert places(scenario_type="roundabout")[0] == "Kreiselheim"


def test_streets_are_those_of_the_map() -> None:
    match = find_maps(built_in_maps(), place="uferstrasse")[0]
    assert match.streets == (("Uferstraße",),)


@pytest.mark.parametrize(
    "wish",
    [
        {"place": "Kraiselheim"},
        {"place": "Torfweg, Musterstadt"},
        {"country": "DEU"},
        {"bbox": (0.0, 0.0, 1.0, 1.0)},
    ],
)
def test_what_no_map_shows_is_refused_with_what_there_is(wish: dict[str, object]) -> None:
    with pytest.raises(UnknownName) as caught:
        places(**wish)
    assert caught.value.valid


def test_the_closest_place_is_named_first() -> None:
    with pytest.raises(UnknownName) as caught:
        places(place="Musterstat")
    assert caught.value.valid[0] == "Musterstadt"


def test_street_spellings() -> None:
    assert same_street("Seattle Blvd", "Seattle Boulevard")
    assert same_street("Moosacher Str.", "Moosacher Straße")
    assert not same_street("Moosacher Straße", "Lerchenauer Straße")


def test_road_classes_are_groups_or_values() -> None:
    assert resolve_road_classes(["link"])[0] == "motorway_link"
    assert resolve_road_classes(["primary", "primary"]) == ("primary",)
    with pytest.raises(UnknownName, match="motorwy") as caught:
        resolve_road_classes(["motorwy"])
    assert "motorway" in caught.value.valid
