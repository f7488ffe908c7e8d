"""Spellings of roads: abbreviations, scripts, word order, sections, crossings and parts of a map."""

from dataclasses import replace
from pathlib import Path

import pytest

from plannerforge.engine.maps.index import MapEntry, built_in_maps, find_maps, same_street
from plannerforge.engine.maps.naming.places import fold
from plannerforge.engine.maps.naming.regions import region_of, regions_at
from plannerforge.engine.maps.naming.spellings import route_number
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.generation import PlaceArea

SAME = [
    ("St John's Rd", "Saint John's Road"),
    ("Hauptstr", "Hauptstraße"),
    ("Hauptstr.", "Haupt Straße"),
    ("Zhongshan North Road", "中山北路"),
    ("Zhongshan Bei Lu", "中山北路"),
    ("ul. Tverskaya", "Тверская улица"),
    ("Tverskaya Street", "Тверская улица"),
    ("Str. Unirii", "Strada Unirii"),
    ("Bd du Larvotto", "Boulevard du Larvotto"),
    ("NE 45th St", "Northeast 45th Street"),
    ("Fifth Ave", "5th Avenue"),
    ("Interstate 5", "I 5"),
    ("I-5", "I 5"),
    ("Bundesstr. 96", "B 96"),
    ("Fan Noli Boulevard", "Bulevardi Fan Noli"),
    ("Elephant & Castle", "Elephant and Castle"),
    ("Kerkstr.", "Kerkstraat"),
    ("Kuzey Caddesi", "North Street"),
    ("3ra Avenida", "3° Avenida"),
    ("4ta Transversal", "4.ª Transversal"),
    ("2do Pasaje", "Segundo Pasaje"),
    ("1-я Тверская улица", "Первая Тверская улица"),
    ("2ème Rue", "2e Rue"),
    ("Boulevard François Ier", "Boulevard François 1er"),
]
OTHER = [
    ("Main St", "High St"),
    ("中山北一路", "中山北二路"),
    ("5th Avenue", "6th Avenue"),
    ("North 88th Street", "North 87th Street"),
    ("I 5", "I 90"),
    ("Rua", "C Street"),
    ("Via del C", "D Street"),
    ("Calle de L", "R Street"),
    ("12a Main Street", "12 Main Street"),
    ("3ra Avenida", "4ta Avenida"),
]


def a_map(*streets: str, country: str = "USA", **facts: object) -> MapEntry:
    """A map of Seattle with these streets."""
    entry = built_in_maps()[0]
    known = {"place": "Seattle", "places": ("Seattle",), "country": country, "streets": streets, "refs": ("I 5",)}
    here = {"map_id": "map_a", "file_name": "a.osm", "road_names": (), "areas": (), **known, **facts}
    return MapEntry(entry.facts.model_copy(update=here), Path("a.osm"))


def roads(entry: MapEntry, place: str) -> list[tuple[str, ...]]:
    return list(find_maps([entry], place=place)[0].streets)


@pytest.mark.parametrize(("one", "other"), SAME)
def test_spellings_of_one_road(one: str, other: str) -> None:
    assert same_street(one, other)


@pytest.mark.parametrize(("one", "other"), OTHER)
def test_other_roads_are_not_mistaken(one: str, other: str) -> None:
    assert not same_street(one, other)


@pytest.mark.parametrize(
    "words", ["Новороссийская / Северная", "Северная & Новороссийская", "Северная / Новороссийская"]
)
def test_a_direction_may_be_the_whole_name_of_a_street_of_a_crossing(words: str) -> None:
    entry = a_map("Новороссийская улица", "Северная улица", "Новая улица")
    assert {name for street in roads(entry, words) for name in street} == {"Новороссийская улица", "Северная улица"}


def test_a_street_called_by_a_state_is_not_any_street_of_its_kind() -> None:
    with pytest.raises(UnknownName):
        roads(a_map("Hovey Avenue", "Francis Avenue"), "Washington Avenue, Seattle")


def test_no_street_of_a_crossing_is_dropped() -> None:
    entry = a_map("Новороссийская улица", "Новая улица")
    with pytest.raises(UnknownName):
        roads(entry, "Новороссийская / Северная")


def test_an_exact_name_is_not_a_road_of_another_kind_and_stays_its_abbreviation() -> None:
    assert roads(a_map("6. Cadde", "6. Sokak"), "6. Cadde") == [("6. Cadde",)]
    assert roads(a_map("Main Street", "Main St"), "Main Street") == [("Main Street", "Main St")]


def test_a_road_means_its_numbered_sections_and_a_section_itself() -> None:
    entry = a_map("中山北一路", "中山北二路", "四平路")
    assert roads(entry, "中山北路") == [("中山北一路", "中山北二路")]
    assert roads(entry, "Zhongshan North Road") == [("中山北一路", "中山北二路")]
    assert roads(entry, "中山北二路") == [("中山北二路",)]
    assert roads(entry, "中山北一路与四平路路口") == [("中山北一路",), ("四平路",)]


@pytest.mark.parametrize(
    "words",
    ["Pine St & 5th Ave", "Pine St/5th Ave", "Pine at 5th", "corner of Pine St and Fifth Ave", "5th & Pine, Seattle"],
)
def test_a_crossing_is_understood_as_people_write_it(words: str) -> None:
    entry = a_map("Pine Street", "5th Avenue", "Pine Court")
    assert {name for street in roads(entry, words) for name in street} >= {"Pine Street", "5th Avenue"}


@pytest.mark.parametrize(
    "words",
    [
        "Długa i Krótka",
        "na rogu Długa i Krótka",
        "Długa és Krótka",
        "Długa un Krótka",
        "Długa Ecke Krótka",
        "Długa con Krótka",
        "Długa com Krótka",
        "Długa esquina con Krótka",
        "Długa esq. Krótka",
        "cruce de Długa y Krótka",
        "róg Długa z Krótka",
        "Długa ile Krótka",
        "hoek Długa met Krótka",
        "incrocio tra Długa e Krótka",
    ],
)
def test_words_for_a_crossing_are_known_in_any_language(words: str) -> None:
    assert roads(a_map("Długa", "Krótka"), words) == [("Długa",), ("Krótka",)]


@pytest.mark.parametrize("words", ["Długa Nowa Krótka", "stara Długa ile Krótka Nowa", "Długa ile Nowa"])
def test_a_phrase_that_contains_another_name_is_not_a_crossing_of_two_roads(words: str) -> None:
    with pytest.raises(UnknownName):
        roads(a_map("Długa", "Krótka"), words)


@pytest.mark.parametrize(
    "words", ["I-5 Seattle", "Seattle I-5", "I-5, Seattle", "Seattle, I-5", "Interstate 5 in Seattle"]
)
def test_road_and_city_are_accepted_in_any_order(words: str) -> None:
    match = find_maps([a_map()], place=words)[0]
    assert (match.streets, match.unnamed) == ((("I 5",),), ())


def test_other_names_of_a_road_select_it_and_the_answer_says_so() -> None:
    entry = a_map("Straße des 17. Juni", road_names=(("Straße des 17. Juni", "6月17日通り"),))
    match = find_maps([entry], place="6月17日通り")[0]
    assert match.streets == (("Straße des 17. Juni",),)
    assert match.understood == ("'6月17日通り' is read as “Straße des 17. Juni”",)


def test_a_part_of_a_map_selects_its_own_area_and_the_answer_says_so() -> None:
    quarter = PlaceArea(
        name="Old Town", kind="quarter", other_names=("Altstadt",), latitude=54.6, longitude=5.25, radius_m=300
    )
    match = find_maps([a_map("Pine Street", areas=(quarter,))], place="Altstadt, Seattle")[0]
    assert match.area == quarter
    assert match.box == pytest.approx((54.5973, 5.24534, 54.6027, 5.25466), abs=1e-4)
    assert match.understood == (
        "'Altstadt' is read as the quarter “Old Town”, 0.3 km around its centre (54.6000, 5.2500)",
    )


@pytest.mark.parametrize("words", ["玄武大道, Seattle", "Xuanwu Road, Seattle", "Xuanwu Road"])
def test_a_street_that_no_map_names_is_not_the_district_of_its_name(words: str) -> None:
    district = PlaceArea(
        name="玄武区", kind="quarter", other_names=("Xuanwu", "玄武"), latitude=54.6, longitude=5.25, radius_m=300
    )
    entry = a_map("中山路", areas=(district,))
    assert find_maps([entry], place="玄武, Seattle")[0].area == district
    with pytest.raises(UnknownName):
        find_maps([entry], place=words)


def test_a_square_may_be_the_quarter_of_its_name() -> None:
    quarter = PlaceArea(name="Taksim", kind="square", other_names=(), latitude=54.6, longitude=5.25, radius_m=300)
    assert find_maps([a_map("Pine Street", areas=(quarter,))], place="Taksim Square, Seattle")[0].area == quarter


def test_the_largest_place_of_a_map_is_the_map() -> None:
    town = PlaceArea(name="Seattle", kind="town", latitude=54.6, longitude=5.25, radius_m=300)
    assert find_maps([a_map(areas=(town,))], place="Seattle")[0].box is None


def an_area(name: str, kind: str, radius_m: float, *, north: float = 0.0, **more: object) -> PlaceArea:
    """A place that lies ``north`` degrees off the middle of the map."""
    wish = {"name": name, "kind": kind, "latitude": 54.6 + north, "longitude": 5.25, "radius_m": radius_m, **more}
    return PlaceArea.model_validate(wish)


TWO_TOWNS = (
    an_area("Sietl", "city", 30, other_names=("Seattle",)),
    an_area("Seattle", "city", 400),
    an_area("Renton", "city", 200, north=0.02),
    an_area("Ballard", "suburb", 300, north=0.01),
)


@pytest.mark.parametrize("words", ["Pine Street, Seattle", "Pine Street / Oak Street, Sietl"])
def test_the_town_of_the_map_is_only_the_context_of_a_street(words: str) -> None:
    match = find_maps([a_map("Pine Street", "Oak Street", areas=TWO_TOWNS)], place=words)[0]
    assert match.streets
    assert match.area is None
    assert not any("around its centre" in text for text in match.understood)


def test_a_town_that_is_drawn_twice_is_one_and_a_district_of_it_is_the_district() -> None:
    entry = a_map(areas=TWO_TOWNS)
    assert find_maps([entry], place="Sietl")[0].area == TWO_TOWNS[1]
    assert find_maps([entry], place="Ballard, Seattle")[0].area == TWO_TOWNS[3]
    alone = a_map(areas=TWO_TOWNS[:2])
    assert find_maps([alone], place="Sietl")[0].area is None


def test_a_quarter_with_a_name_like_the_town_s_is_not_the_town() -> None:
    quarter = an_area("竹北里", "neighbourhood", 400)
    entry = a_map("文興路", country="TWN", place="竹北市", places=("竹北市", "竹北里"), areas=(quarter,))
    assert find_maps([entry], place="竹北")[0].area is None
    assert find_maps([entry], place="竹北里")[0].area == quarter


def test_in_a_crossing_a_street_takes_precedence_over_the_quarter_of_its_name() -> None:
    quarter = an_area("Cát Linh", "quarter", 400)
    streets = ("Phố Cát Linh", "Phố Tôn Đức Thắng")
    entry = a_map(*streets, country="VNM", place="Hà Nội", places=("Hà Nội", "Cát Linh"), areas=(quarter,))
    match = find_maps([entry], place="Cat Linh / Ton Duc Thang, Ha Noi")[0]
    assert match.streets == tuple((street,) for street in streets)
    assert match.area is None
    assert find_maps([entry], place="Cat Linh, Ha Noi")[0].area == quarter


def test_a_town_s_circle_may_be_left_and_a_quarter_bounds_a_single_street() -> None:
    entry = a_map("Pine Street", "Oak Street", areas=TWO_TOWNS)
    for words, is_wide in [("Pine Street, Renton", True), ("Pine Street, Ballard", False), ("Renton", False)]:
        assert (find_maps([entry], place=words)[0].widened is not None) is is_wide
    wide = find_maps([entry], place="Pine Street / Oak Street, Ballard")[0].widened
    assert wide is not None
    assert (wide.box, len(wide.streets)) == (None, 2)


def test_a_state_is_checked_by_the_map_s_location() -> None:
    assert region_of("WA", "USA", 47.6, -122.3)
    assert not region_of("WA", "USA", 30.0, -90.0)
    assert region_of("Bayern", "DEU", 48.1, 11.6)
    assert region_of("Ontario", "CAN", 43.7, -79.4)
    assert [region.code for region in regions_at("USA", 39.95, -75.16)] == ["PA"]
    assert {region.code for region in regions_at("USA", 36.9, -116.76)} >= {"NV", "CA"}
    assert regions_at("ZAM", 54.6, 5.2) == ()
    seattle = a_map(south=47.5, north=47.7, west=-122.4, east=-122.2)
    assert find_maps([seattle], place="Seattle, WA")
    with pytest.raises(UnknownName):
        find_maps([seattle], place="Seattle, Oregon")


@pytest.mark.parametrize("words", ["Seattle, France", "Pine Street, Seattle, Germany"])
def test_a_country_without_the_map_contradicts(words: str) -> None:
    with pytest.raises(UnknownName):
        find_maps([a_map("Pine Street")], place=words)


@pytest.mark.parametrize(
    ("words", "near"),
    [("Seatle", "Seattle"), ("Wörgl", None), ("Pyne Street", "Pine Street"), ("Quary", "Quarry Hill")],
)
def test_only_nearby_names_are_suggested(words: str, near: str | None) -> None:
    with pytest.raises(UnknownName) as refusal:
        find_maps([a_map("Pine Street", "Quarry Hill")], place=words)
    if near is None:
        assert "similar name" in refusal.value.message
    else:
        assert refusal.value.valid[0] == f"“{near}”"


BROSSARD = a_map(
    "Rue Oxford", "Rue Sydney", "Rue Zagreb", country="CAN", map_id="map_b", place="Brossard", places=("Brossard",)
)
ZAGREB = a_map("Jarunska ulica", "Selska cesta", country="HRV", map_id="map_z", place="Zagreb", places=("Zagreb",))
SYDNEY = a_map("Park Street", country="AUS", map_id="map_s", place="Sydney", places=("Sydney",))


@pytest.mark.parametrize(
    ("words", "near"),
    [
        ("Oxford Street, Sydney", ("“Sydney”",)),
        ("Ilica, Zagreb", ("“Zagreb”",)),
        ("Jarunka, Zagreb", ("“Jarunska ulica, Zagreb”", "“Zagreb”")),
        ("Selska / Ilica, Zagreb", ("“Selska cesta, Zagreb”", "“Zagreb”")),
    ],
)
def test_proposals_in_a_known_town_are_in_it_and_can_be_found(words: str, near: tuple[str, ...]) -> None:
    maps = [BROSSARD, ZAGREB, SYDNEY]
    with pytest.raises(UnknownName) as refusal:
        find_maps(maps, place=words)
    assert refusal.value.valid == near
    for remedy in refusal.value.remedies:
        places = remedy.changes[0].values
        assert find_maps(maps, place=str(places["place"]))[0].entry is not BROSSARD


@pytest.mark.parametrize(
    ("words", "corrected"),
    [
        ("Alexanderplats", "Alexanderplatz"),
        ("Alexanedrplatz", "Alexanderplatz"),
        ("Alexxanderplatz, Seattle", "Alexanderplatz, Seattle"),
        ("Franzosische Strase", "Französische Straße"),
        ("Pine Street / Alexandrplatz", "Pine Street / Alexanderplatz"),
    ],
)
def test_a_misspelt_name_is_refused_and_its_correction_proposed_first(words: str, corrected: str) -> None:
    maps = [a_map("Alexanderplatz", "Französische Straße", "Pine Street"), SYDNEY]
    with pytest.raises(UnknownName) as refusal:
        find_maps(maps, place=words)
    assert refusal.value.remedies[0].changes[0].values == {"place": corrected}
    assert find_maps(maps, place=corrected)[0].entry is maps[0]


def test_a_short_name_is_not_corrected_into_another() -> None:
    with pytest.raises(UnknownName) as refusal:
        find_maps([a_map("Elm")], place="Oak")
    assert not refusal.value.remedies


@pytest.mark.parametrize(
    "words", ["Pine Street, Portland, Seattle", "Pine Street, 서울, Seattle", "Pine Street, Neverville, USA"]
)
def test_a_town_elsewhere_is_not_replaced_by_the_map(words: str) -> None:
    with pytest.raises(UnknownName):
        find_maps([a_map("Pine Street")], place=words)


def test_a_part_that_the_map_does_not_name_is_reported_next_to_its_town() -> None:
    match = find_maps([a_map("Pine Street")], place="Pine Street, Old Quarter, Seattle")[0]
    assert match.unnamed == ("Old Quarter",)


def test_streets_of_another_town_are_not_proposed_for_a_town_that_is_not_available() -> None:
    with pytest.raises(UnknownName, match="similar name") as refusal:
        find_maps([BROSSARD, SYDNEY], place="Ilica, Zagreb")
    assert refusal.value.valid == ("“Brossard”", "“Sydney”")


def test_a_comma_between_streets_is_a_crossing_unless_a_known_town_has_the_name() -> None:
    assert find_maps([BROSSARD], place="Rue Oxford, Rue Sydney")[0].streets == (("Rue Oxford",), ("Rue Sydney",))
    assert find_maps([BROSSARD, SYDNEY], place="Rue Oxford / Rue Sydney")[0].entry is BROSSARD


def test_a_place_far_from_all_maps_is_answered_with_the_available_ones() -> None:
    with pytest.raises(UnknownName, match="similar name") as refusal:
        find_maps([a_map("Pine Street")], place="Ouagadougou")
    assert refusal.value.valid == ("“Seattle”",)


def test_a_house_number_and_a_postcode_do_not_hide_the_road() -> None:
    entry = a_map("Pine Street")
    assert roads(entry, "12 Pine St, 98101 Seattle") == [("Pine Street",)]


@pytest.mark.parametrize(
    ("words", "number"),
    [
        *(("SR 99", "99"), ("State Route 99", "99"), ("Rte. 9", "9"), ("County Road 12", "12")),
        *(("Route nationale 7", "7"), ("Carretera 5", "5"), ("Autobahn 9", "9")),
        *(("Pine Street 9", None), ("Avenue 9", None), ("99", None), ("", None)),
    ],
)
def test_roads_by_their_number_alone(words: str, number: str | None) -> None:
    assert route_number(words) == number


def test_an_older_record_without_names_still_finds_its_roads() -> None:
    entry = replace(a_map("Pine Street"), path=Path("b.osm"))
    assert entry.facts.road_names == ()
    assert roads(entry, "Pine St") == [("Pine Street",)]


TAICHUNG = a_map(
    "臺灣大道一段",
    "臺灣大道二段",
    road_names=(("臺灣大道一段", "Taiwan Boulevard Section 1"), ("臺灣大道二段", "Section 2, Taiwan Boulevard")),
    country="TWN",
    map_id="map_one",
    place="臺中市",
    places=("臺中市",),
    south=24.13,
    north=24.16,
    west=120.66,
    east=120.69,
)
XITUN = a_map(
    "臺灣大道四段",
    "臺灣大道五段",
    road_names=(("臺灣大道四段", "Taiwan Boulevard Section 4"), ("臺灣大道五段", "Taiwan Boulevard Section 5")),
    country="TWN",
    map_id="map_four",
    place="西屯區",
    places=("西屯區",),
    south=24.17,
    north=24.20,
    west=120.60,
    east=120.63,
)


@pytest.mark.parametrize(
    "words",
    [
        *("Taiwan Boulevard Section 4, Taichung", "Taiwan Blvd., Sec. 4, Taichung", "Sec. 4, Taiwan Blvd., Taichung"),
        *("Taiwan Boulevard Section IV, Taichung", "Section Four Taiwan Boulevard", "4th Section Taiwan Boulevard"),
        *(
            "臺灣大道四段, 臺中市",
            "台灣大道4段",
            "台灣大道4段",
            "臺灣大道, 四段",
            "Taiwan Boulevard Section 4 Taichung",
        ),
    ],
)
def test_the_section_of_a_road_is_never_another_one(words: str) -> None:
    (match,) = find_maps([TAICHUNG, XITUN], place=words)
    assert (match.entry, match.streets) == (XITUN, (("臺灣大道四段",),))
    with pytest.raises(UnknownName) as refusal:
        find_maps([TAICHUNG], place=words)
    assert refusal.value.valid


@pytest.mark.parametrize(
    ("words", "street"),
    [
        ("State Highway 4, Seattle", "State Highway 12"),
        ("Calle 4", "Calle 40"),
        ("Rua 1, Seattle", "Rua 15"),
        ("Sector 1", "Sector 17 Road"),
        ("C. 4 Norte", "Calle 40 Norte"),
        ("2 Severnaya", "3-я Северная улица"),
        ("angle de la 100 rue et Pine Street", "10 rue"),
    ],
)
def test_the_number_in_a_name_is_neither_incomplete_nor_another_one(words: str, street: str) -> None:
    with pytest.raises(UnknownName):
        roads(a_map(street, "Pine Street"), words)


@pytest.mark.parametrize("words", ["12 Main Street, Seattle", "Main Street 7", "Main Street 7b, Seattle"])
def test_a_house_number_beside_a_name_without_a_number_is_dropped(words: str) -> None:
    assert roads(a_map("Main Street", "Main Road 3"), words) == [("Main Street",)]


def a_town(
    name: str, country: str, position: tuple[float, float], *streets: str, refs: tuple[str, ...] = ()
) -> MapEntry:
    """A map of a town of 4 km at a position in degrees."""
    north, east = position
    box = {"south": north - 0.02, "north": north + 0.02, "west": east - 0.02, "east": east + 0.02}
    return a_map(*streets, country=country, place=name, places=(name,), refs=refs, map_id=f"map_{fold(name)}", **box)


BROSSARD_134 = a_town("Brossard", "CAN", (45.45, -73.47), "Boulevard Taschereau", refs=("134", "15"))
MOUNTAIN_VIEW = a_town("Mountain View", "USA", (37.39, -122.08), "Castro Street", refs=("CA 85", "US 101", "SR 237"))
SYDNEY_7 = a_town("Parramatta", "AUS", (-33.8, 151.0), "Church Street", refs=("7",))
PARIS_7 = a_town("Juvisy", "FRA", (48.69, 2.38), "Grande Rue", refs=("A 7", "N 7"))


@pytest.mark.parametrize(
    ("entry", "words", "ref"),
    [
        *((BROSSARD_134, words, "134") for words in ("QC-134, Brossard", "QC 134", "QC134, Brossard", "Québec 134")),
        *((MOUNTAIN_VIEW, words, "CA 85") for words in ("CA-85", "CA85, Mountain View", "California 85", "SR-85")),
        *((MOUNTAIN_VIEW, words, "SR 237") for words in ("CA-237, Mountain View", "CA 237")),
        *((SYDNEY_7, words, "7") for words in ("NSW-7", "NSW 7, Parramatta")),
        *((PARIS_7, words, "N 7") for words in ("RN7", "RN 7, Juvisy", "Route nationale 7")),
    ],
)
def test_a_road_number_may_have_the_state_or_the_class_of_the_road_before_it(
    entry: MapEntry, words: str, ref: str
) -> None:
    assert roads(entry, words) == [(ref,)]


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        *((BROSSARD_134, words) for words in ("QC-135, Brossard", "ON-134, Brossard", "QC-13")),
        *((MOUNTAIN_VIEW, words) for words in ("NV-85", "CA-86, Mountain View", "I-85")),
        *((SYDNEY_7, words) for words in ("QLD-7", "NSW-17")),
    ],
)
def test_another_road_number_or_state_is_refused(entry: MapEntry, words: str) -> None:
    with pytest.raises(UnknownName):
        roads(entry, words)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        (a_town("London", "GBR", (51.51, -0.136), "Broadwick Street"), "Broadwick St, London W1"),
        (a_town("London", "GBR", (51.51, -0.136), "Broadwick Street"), "Broadwick St, London W1F 9QP, UK"),
        (a_town("Berlin", "DEU", (52.52, 13.4), "Torstraße"), "Torstr., D-10119 Berlin"),
        (a_town("Paris", "FRA", (48.86, 2.35), "Rue de Rivoli"), "Rue de Rivoli, 75004 Paris"),
        (MOUNTAIN_VIEW, "Castro St, Mountain View CA 94043"),
        (a_town("New Haven", "USA", (41.31, -72.93), "Crown Street"), "Crown St, New Haven CT 06510"),  # CT: Court too
        (a_town("Amsterdam", "NLD", (52.37, 4.9), "Damrak"), "Damrak, 1012 LG Amsterdam"),
        (a_town("Toronto", "CAN", (43.65, -79.38), "King Street West"), "King St W, Toronto ON M5V 2T6"),
        (a_town("Praha", "CZE", (50.08, 14.43), "Vodičkova"), "Vodičkova, 110 00 Praha"),
        (a_town("São Paulo", "BRA", (-23.55, -46.63), "Avenida Paulista"), "Av. Paulista, São Paulo 01310-100"),
        (a_town("Singapore", "SGP", (1.3, 103.8), "Ayer Rajah Avenue"), "Ayer Rajah Avenue, Singapore 139950"),
    ],
)
def test_a_postcode_beside_the_town_of_a_road_is_not_used(entry: MapEntry, words: str) -> None:
    (match,) = find_maps([entry], place=words)
    assert (match.streets, match.unnamed) == ((entry.facts.streets,), ())


GAFANHA = PlaceArea(name="Gafanha", kind="town", latitude=40.63, longitude=-8.73, radius_m=1500.0)
BARRA = PlaceArea(name="Barra", kind="village", latitude=40.64, longitude=-8.75, radius_m=500.0)
ILHAVO = a_town("Ílhavo", "PRT", (40.63, -8.74), "Rua da Praia")
ILHAVO = replace(
    ILHAVO, facts=ILHAVO.facts.model_copy(update={"places": ("Ílhavo", "Barra"), "areas": (GAFANHA, BARRA)})
)


def test_words_before_the_name_of_a_place_are_not_half_a_road() -> None:
    (match,) = find_maps([ILHAVO], place="Praia da Barra, Ílhavo")
    assert (match.streets, match.unnamed, match.area) == ((), (), BARRA)
    assert roads(ILHAVO, "Rua da Praia da Barra") == [("Rua da Praia",)]


def test_a_street_before_the_name_of_a_place_must_be_on_the_map() -> None:
    with pytest.raises(UnknownName):
        find_maps([ILHAVO], place="Rua Inventada da Barra, Ílhavo")


@pytest.mark.parametrize("words", ["A40 London", "Broadwick Street, Paris W1", "Broadwick Street, Leeds LS1 4AP"])
def test_a_postcode_is_neither_a_road_nor_another_town(words: str) -> None:
    with pytest.raises(UnknownName):
        find_maps([a_town("London", "GBR", (51.51, -0.136), "Broadwick Street")], place=words)
