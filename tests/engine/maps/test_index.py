from dataclasses import replace

import pytest

from plannerforge.engine.maps.index import MapEntry, built_in_maps, find_maps, same_street
from plannerforge.engine.maps.road_classes import resolve_road_classes
from plannerforge.schemas.errors import UnknownName


def places(**wish: object) -> list[str]:
    return [match.entry.facts.place for match in find_maps(built_in_maps(), **wish)]  # type: ignore[arg-type]


def test_a_map_is_found_by_its_everyday_names() -> None:
    assert places(place="kreiselheim") == ["Kreiselheim"]
    assert places(place="map_neuland") == ["Neuland"]
    assert places(place="A901") == ["Neuland"]
    assert places(place="Suedstrasse") == ["Kreiselheim"]
    assert places(place="Hauptstraße / Bahnhofstr.") == ["Musterstadt"]
    assert places(place="Torfweg, Landmoor") == ["Landmoor"]
    assert places(bbox=(54.59, 5.19, 54.601, 5.21)) == ["Musterstadt"]
    assert places(country="ZAM") == [entry.facts.place for entry in built_in_maps() if entry.facts.country == "ZAM"]


def test_maps_with_the_requested_site_come_first() -> None:
    assert places(scenario_type="roundabout")[0] == "Kreiselheim"


def test_streets_match_those_of_the_map() -> None:
    match = find_maps(built_in_maps(), place="uferstrasse")[0]
    assert match.streets == (("Uferstraße",),)


@pytest.mark.parametrize(
    "wish",
    [{"place": "Kraiselheim"}, {"place": "Torfweg, Musterstadt"}, {"country": "DEU"}, {"bbox": (0.0, 0.0, 1.0, 1.0)}],
)
def test_a_place_without_a_map_is_refused_with_available_ones(wish: dict[str, object]) -> None:
    with pytest.raises(UnknownName) as caught:
        places(**wish)
    assert caught.value.valid


@pytest.mark.parametrize("district", ["Musterstadt-Nordviertel", "Musterstadt\u2013Nordviertel"])
def test_a_district_may_be_joined_to_its_town_by_a_hyphen(district: str) -> None:
    entry = next(entry for entry in built_in_maps() if entry.facts.place == "Musterstadt")
    facts = entry.facts.model_copy(update={"places": (*entry.facts.places, "Nordviertel")})
    maps = [replace(entry, facts=facts)]
    assert find_maps(maps, place=f"Hauptstraße, {district}")[0].streets == (("Hauptstraße",),)
    with pytest.raises(UnknownName):
        find_maps(maps, place=district.replace("Nord", "Süd"))


def nameless(**facts: object) -> MapEntry:
    """A map of Musterstadt that does not know its place."""
    entry = next(entry for entry in built_in_maps() if entry.facts.place == "Musterstadt")
    changes = {
        "map_id": "map_old_mill",
        "file_name": "old_mill.osm",
        "place": "old_mill",
        "places": (),
        "areas": (),
        **facts,
    }
    return replace(entry, facts=entry.facts.model_copy(update=changes))


def test_a_town_that_a_map_does_not_name_is_not_guessed() -> None:
    with pytest.raises(UnknownName, match="does not state its place") as caught:
        find_maps([nameless()], place="Hauptstraße, London")
    assert caught.value.valid == ("map_old_mill",)
    assert find_maps([nameless()], place="Hauptstraße")[0].unnamed == ()
    assert find_maps([nameless()], place="Hauptstraße, Anytown", country="ZAM")[0].unnamed == ("Anytown",)


@pytest.mark.parametrize(("place", "shown"), [("old_mill", True), ("old_mill.osm", True), ("mill", False)])
def test_a_file_is_named_whole(place: str, shown: bool) -> None:
    if shown:
        assert find_maps([nameless()], place=place)
    else:
        with pytest.raises(UnknownName):
            find_maps([nameless()], place=place)


def test_near_a_border_only_its_countries_are_accepted() -> None:
    border = nameless(country=None, countries_near=("CHE", "DEU", "FRA"))
    for country in ("CHE", "Germany", None):
        assert find_maps([border], country=country)
    with pytest.raises(UnknownName, match="no map covers the country 'JPN'") as caught:
        find_maps([border], country="JPN")
    assert caught.value.valid == ("CHE", "DEU", "FRA")
    assert find_maps([nameless(country=None, countries_near=())], country="JPN")


@pytest.mark.parametrize("wish", [{"bbox": (54.0, 6.0, 54.9, 9.0)}, {"country": "FRA"}], ids=["box", "country"])
def test_a_place_in_conflict_with_box_or_country_is_reported_as_elsewhere(wish: dict[str, object]) -> None:
    elsewhere = nameless(country="FRA", south=54.5, north=54.6, west=7.0, east=7.1)
    with pytest.raises(UnknownName, match="it is elsewhere") as caught:
        find_maps([*built_in_maps(), elsewhere], place="Musterstadt", **wish)  # type: ignore[arg-type]
    assert "“Musterstadt” [54." in caught.value.valid[0]


def test_the_closest_place_is_named_first() -> None:
    with pytest.raises(UnknownName) as caught:
        places(place="Musterstat")
    assert caught.value.valid[0] == "“Musterstadt”"


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


def test_long_names_are_compared_by_their_beginnings() -> None:
    entry = built_in_maps()[0]
    long_street = replace(entry, facts=entry.facts.model_copy(update={"streets": ("Mill Road " + "x" * 200_000,)}))
    with pytest.raises(UnknownName) as refusal:
        find_maps([long_street], place="Hill Road " + "y" * 30_000)
    assert len(refusal.value.text) < 3000


def test_a_refused_place_is_answered_with_the_names_that_share_a_word() -> None:
    entry = built_in_maps()[0]
    streets = (*(f"Aaa Street {number}" for number in range(3000)), "Zzz Mill")
    crowded = replace(entry, facts=entry.facts.model_copy(update={"streets": streets}))
    with pytest.raises(UnknownName) as refusal:
        find_maps([crowded], place="Zzzz Mill")
    assert refusal.value.valid[0] == "“Zzz Mill”"


def town_with(*streets: str) -> MapEntry:
    return nameless(place="Mandaue", places=("Mandaue",), streets=streets, refs=(), road_names=())


@pytest.mark.parametrize(
    ("place", "streets"),
    [
        ("Colina St / M.C. Briones St", (("Colina Street",), ("M.C. Briones",))),
        ("Colina Drive & M.C. Briones Avenue", (("Colina Street",), ("M.C. Briones",))),
        ("Ouano Road / Colina Street", (("Ouano Avenue",), ("Colina Street",))),
    ],
)
def test_a_road_of_a_crossing_may_have_another_kind_or_no_kind(
    place: str, streets: tuple[tuple[str, ...], ...]
) -> None:
    match = find_maps([town_with("Colina Street", "M.C. Briones", "Ouano Avenue")], place=place)[0]
    assert match.streets == streets
    assert match.understood


@pytest.mark.parametrize("place", ["5th Avenue / Colina Street", "Colina Drive / Ouano Road", "Colina Drive"])
def test_roads_of_other_kinds_need_one_with_this_kind_and_numbers_are_not_names(place: str) -> None:
    with pytest.raises(UnknownName):
        find_maps([town_with("Colina Street", "5th Street", "Ouano Avenue")], place=place)


def crossed(place: str, *streets: str, **facts: object) -> tuple[tuple[str, ...], ...]:
    entry = nameless(
        **{"place": "Town", "places": ("Town",), "streets": streets, "refs": (), "road_names": (), **facts}
    )
    return find_maps([entry], place=f"{place}, Town")[0].streets


@pytest.mark.parametrize(
    ("place", "streets"),
    [
        ("угол Северной и Новороссийской", ("Северная улица", "Новороссийская улица")),
        ("перекрёсток улицы Северной и проспекта Мира", ("Северная улица", "проспект Мира")),
        ("róg Marszałkowskiej i Długiej", ("Marszałkowska", "Długa")),
        ("Vinohradské / Rybné", ("Vinohradská", "Rybná")),
        ("Mannerheimintien ja Aleksanterinkadun kulma", ("Mannerheimintie", "Aleksanterinkatu")),
        ("az Andrássy úton és a Rózsa utcán", ("Andrássy út", "Rózsa utca")),
        ("Brīvības ielas un Lāčplēša ielas stūris", ("Brīvības iela", "Lāčplēša iela")),
        ("Atatürk Caddesi'nin ve Gül Sokağı'nın kavşağı", ("Atatürk Caddesi", "Gül Sokağı")),
    ],
)
def test_the_roads_of_a_crossing_may_be_in_another_grammatical_form(place: str, streets: tuple[str, str]) -> None:
    assert crossed(place, *streets, "Other Road") == tuple((name,) for name in streets)


HEBREW = ("הרצל", "דוד המלך", "העצמאות", "וייצמן")
ARABIC = ("شارع النصر", "الملك فيصل", "شارع الوحدة")


@pytest.mark.parametrize(
    ("place", "streets"),
    [
        ("פינת הרצל ודוד המלך", ("הרצל", "דוד המלך")),
        ("הרצל ו-וייצמן", ("הרצל", "וייצמן")),
        ("בין העצמאות ל\u05beהרצל", ("העצמאות", "הרצל")),
        ("רחוב הרצל ורחוב העצמאות", ("הרצל", "העצמאות")),
        ("تقاطع شارع النصر والملك فيصل", ("شارع النصر", "الملك فيصل")),
        ("شارع النصر وشارع الوحدة", ("شارع النصر", "شارع الوحدة")),
    ],
)
def test_a_word_between_two_roads_may_be_written_together_with_the_second_one(
    place: str, streets: tuple[str, str]
) -> None:
    assert crossed(place, *HEBREW, *ARABIC) == tuple((name,) for name in streets)


@pytest.mark.parametrize("place", ["세종대로와 을지로 교차로", "을지로와 세종대로 사거리", "세종대로와 을지로"])
def test_a_word_between_two_roads_may_be_written_together_with_the_first_one(place: str) -> None:
    assert {*crossed(place, "세종대로", "을지로", "종로")} == {("세종대로",), ("을지로",)}


@pytest.mark.parametrize("place", ["Kościuszki róg Mickiewicza", "ul. Kościuszki przy Mickiewicza"])
def test_people_shorten_the_roads_of_a_crossing_in_a_phrase(place: str) -> None:
    streets = ("Generała Tadeusza Kościuszki", "Adama Mickiewicza", "Długa")
    assert crossed(place, *streets) == tuple((name,) for name in streets[:2])


@pytest.mark.parametrize("place", ["ברחוב הרצל", "בהרצל", "רחוב הרצל"])
def test_a_road_may_have_a_preposition_or_a_kind_of_road_in_front(place: str) -> None:
    assert crossed(place, *HEBREW) == (("הרצל",),)


def test_letters_of_a_name_are_not_read_as_a_word_before_it() -> None:
    assert crossed("וייצמן", *HEBREW) == (("וייצמן",),)
    for place in ("פינת הרצל ובן גוריון", "שהרצליה", "شارع النصر وشارع البحر"):
        with pytest.raises(UnknownName):
            crossed(place, *HEBREW, *ARABIC)


@pytest.mark.parametrize(
    ("place", "longer"),
    [
        ("Bolívar / Sucre", (("Simón Bolívar", "Paseo Simón Bolívar"), ("Antonio José de Sucre",))),
        ("Calle Sucre / Mill Road", (("Antonio José de Sucre",), ("Old Mill Road",))),
        ("Calle 5 / Bolívar", (("Calle 5 Norte",), ("Simón Bolívar", "Paseo Simón Bolívar"))),
        ("Bolívar", ()),
        ("Mill Road / Old Mill Road", ()),
    ],
)
def test_streets_with_longer_names_are_kept_for_streets_that_do_not_meet(
    place: str, longer: tuple[tuple[str, ...], ...]
) -> None:
    short = ("Bolívar", "Sucre", "Mill Road", "Calle 5")
    long = (
        "Simón Bolívar",
        "Paseo Simón Bolívar",
        "Antonio José de Sucre",
        "Old Mill Road",
        "Calle 5 A",
        "Calle 5 Norte",
    )
    town = nameless(place="Town", places=("Town",), streets=(*short, *long), refs=(), road_names=())
    assert find_maps([town], place=f"{place}, Town")[0].longer == longer


def test_another_form_of_a_name_alone_or_of_no_name_on_the_map_is_refused() -> None:
    for place in ("Северной", "угол Южной и Новороссийской", "Old Pine Street / Rose Street"):
        with pytest.raises(UnknownName):
            crossed(place, "Северная улица", "Новороссийская улица", "Park Street", "Rose Street")


@pytest.mark.parametrize(
    "place",
    ["Main Street / Mill Road intersection", "Junction Main Street/Mill Road", "Main Street and Mill Road corner"],
)
def test_words_for_a_crossing_may_be_before_or_behind_its_roads(place: str) -> None:
    assert crossed(place, "Main Street", "Mill Road") == (("Main Street",), ("Mill Road",))


def test_a_street_called_by_a_letter_is_not_dropped_from_a_crossing() -> None:
    streets = ("Rua D", "Rua E", "Rua L", "Rua")
    assert crossed("Rua D / Rua E", *streets) == (("Rua D",), ("Rua E",))
    assert crossed("Rua L", *streets) == (("Rua L",),)


@pytest.mark.parametrize("between", [" / ", " e ", "/"])
def test_a_word_for_a_crossing_inside_a_name_does_not_split_the_name(between: str) -> None:
    streets = ("Avenida João Corrêa", "Rua 20", "Rua Cinco de Julho", "Rua Vinte e Cinco de Julho")
    found = crossed(f"Av. João Corrêa{between}Rua Vinte e Cinco de Julho", *streets)
    assert found == (("Avenida João Corrêa",), ("Rua Vinte e Cinco de Julho",))


def test_a_road_s_other_name_counts_if_another_road_has_exactly_this_name() -> None:
    streets = ("Rua 1º de Maio", "Rua Primeiro de Maio", "Rua Azul", "6. Cadde", "6. Sokak")
    streets = (streets[3], *streets[:3], streets[4])  # the map's order does not decide
    of_labour = crossed("Rua Primeiro de Maio", *streets)
    assert set(of_labour[0]) == {"Rua 1º de Maio", "Rua Primeiro de Maio"}
    assert crossed("6. Cadde", *streets) == (("6. Cadde",),)
    both = crossed("Rua Azul", *streets, road_names=(("6. Cadde", "Rua Azul"),))
    assert both[0] == ("Rua Azul", "6. Cadde")


def test_a_district_that_the_map_does_not_locate_is_the_road_of_its_name() -> None:
    districts = {"places": ("Granada", "Camino de Ronda")}
    entry = nameless(place="Granada", streets=("Camino de Ronda",), refs=(), road_names=(), **districts)
    assert find_maps([entry], place="Camino de Ronda, Granada")[0].streets == (("Camino de Ronda",),)
    assert find_maps([entry], place="Granada")[0].streets == ()


def in_california(place: str, *streets: str) -> MapEntry:
    """A map of a Californian town with these streets."""
    entry = next(entry for entry in built_in_maps() if entry.facts.place == "Musterstadt")
    at = {"San Rafael": (37.97, -122.53), "Mountain View": (37.38, -122.09)}[place]
    changes = {
        "map_id": f"map_{place[:3].lower()}",
        "place": place,
        "places": (place,),
        "country": "USA",
        "streets": streets,
        "refs": (),
        "road_names": (),
        "areas": (),
        "south": at[0],
        "north": at[0] + 0.02,
        "west": at[1],
        "east": at[1] + 0.02,
    }
    return replace(entry, facts=entry.facts.model_copy(update=changes))


SAN_RAFAEL = in_california("San Rafael", "Mountain View Avenue", "Lincoln Avenue", "Madison Avenue", "Mission Avenue")
MOUNTAIN_VIEW = in_california(
    "Mountain View", "West El Camino Real", "South Shoreline Boulevard", "Mountain View Avenue"
)


@pytest.mark.parametrize(
    "place",
    [
        "El Camino & Shoreline, Mountain View CA",
        "El Camino & Shoreline, Mountain View, CA",
        "El Camino & Shoreline, Mountain View",
        "Lincoln Ave, Mountain View CA",
        "Lincoln Ave, Mountain View, California",
        "Lincoln Ave, Mountain View",
        "Mountain View, Lincoln Ave",
    ],
)
def test_a_city_without_a_map_is_not_read_as_a_street_elsewhere(place: str) -> None:
    with pytest.raises(UnknownName):
        find_maps([SAN_RAFAEL], place=place)


@pytest.mark.parametrize("town", ["Mountain View CA", "Mountain View, CA", "Mountain View"])
def test_a_city_with_its_state_is_the_city_and_not_its_street_of_the_same_name(town: str) -> None:
    (match,) = find_maps([SAN_RAFAEL, MOUNTAIN_VIEW], place=f"El Camino & Shoreline, {town}")
    assert match.entry is MOUNTAIN_VIEW
    assert match.streets == (("West El Camino Real",), ("South Shoreline Boulevard",))


@pytest.mark.parametrize(
    "place",
    [
        "Lincoln Ave, Mountain View Ave",
        "Lincoln Ave / Mountain View",
        "Lincoln Ave, Mountain View, San Rafael",
        "Lincoln Ave & Mountain View, San Rafael CA",
    ],
)
def test_a_street_with_the_name_of_a_city_is_found_if_the_text_shows_that_it_is_a_street(place: str) -> None:
    (match,) = find_maps([SAN_RAFAEL], place=place)
    assert match.streets == (("Lincoln Avenue",), ("Mountain View Avenue",))


@pytest.mark.parametrize("crossing", ["Lincoln Ave & Foo Street", "Foo St at Bar St"])
def test_a_crossing_needs_all_of_its_roads_even_next_to_another_street(crossing: str) -> None:
    with pytest.raises(UnknownName):
        find_maps([SAN_RAFAEL], place=f"{crossing}, Mission Avenue, San Rafael")
    (match,) = find_maps([SAN_RAFAEL], place="Foo & Sons, Mission Avenue, San Rafael")
    assert match.unnamed == ("Foo & Sons",)
