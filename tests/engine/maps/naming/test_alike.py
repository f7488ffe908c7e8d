"""Maps found by words that are only like what they show: other scripts, half-typed and compound words."""

from pathlib import Path

import pytest

from plannerforge.engine.maps.index import Closeness, MapEntry, built_in_maps, find_maps
from plannerforge.engine.maps.naming.alike import (
    has_initials,
    is_abbreviated,
    is_half_of,
    is_transliterated,
    is_with_kind,
)
from plannerforge.schemas.errors import UnknownName, with_values


def a_map(*streets: str, file_name: str = "a.osm", **facts: object) -> MapEntry:
    """A map in the south-west of Manchester, which does not say where it is."""
    here = {"south": 53.44, "north": 53.45, "west": -2.31, "east": -2.30, "country": "GBR"}
    known = {"place": "a", "places": (), "areas": (), "refs": ("A56",), "road_names": (), "streets": streets}
    changes = {"map_id": "map_a", "file_name": file_name, **here, **known, **facts}
    return MapEntry(built_in_maps()[0].facts.model_copy(update=changes), Path(file_name))


@pytest.mark.parametrize(
    ("typed", "name"),
    [
        ("Leninsky Prospekt", "Ленинский проспект"),
        ("Leninskij pr.", "Ленинский проспект"),
        ("Odos Ermou", "Οδός Ερμού"),
        ("Khreshchatyk", "Хрещатик"),
        ("Невский", "Nevsky"),
        ("포르투", "Porto"),
        ("ポルト", "Porto"),
        ("कियोतो", "Kyoto"),
    ],
)
def test_a_transliteration_is_alike(typed: str, name: str) -> None:
    assert is_transliterated(typed, name)


@pytest.mark.parametrize(
    ("typed", "name"),
    [("Leninsky Street", "Ленинский проспект"), ("Pushkin", "Ленинский проспект"), ("Main Street", "Maine Street")],
)
def test_another_name_is_not_alike(typed: str, name: str) -> None:
    assert not is_transliterated(typed, name)


@pytest.mark.parametrize(
    ("typed", "name"),
    [
        ("V. del Corso", "Via del Corso"),
        ("R. da Consolação", "Rua da Consolação"),
        ("Av. D. Pedro I", "Avenida Dom Pedro I"),
        ("Avenida Brig. Luis Antonio", "Avenida Brigadeiro Luís Antônio"),
        ("B-dul Decebal", "Bulevardul Decebal"),
        ("Ελ. Βενιζέλου", "Λεωφόρος Ελευθερίου Βενιζέλου"),
        ("A. Volta", "Via Alessandro Volta"),
    ],
)
def test_words_may_be_shortened(typed: str, name: str) -> None:
    assert is_abbreviated(typed, name)


@pytest.mark.parametrize(
    ("typed", "name"),
    [("Kent Street", "Kensington Street"), ("Av. Dom Pedro I", "Avenida Dom Pedro IV"), ("Via Corso", "Via del Mare")],
)
def test_another_name_is_not_shortened(typed: str, name: str) -> None:
    assert not is_abbreviated(typed, name)


@pytest.mark.parametrize(
    ("typed", "name"),
    [
        ("MG Road", "Mahatma Gandhi Road"),
        ("M.G. Road", "Mahatma Gandhi Road"),
        ("MLK Blvd", "Dr. Martin Luther King Jr. Boulevard"),
        ("JFK", "John F. Kennedy Boulevard"),
        ("NSC Bose Road", "Netaji Subhash Chandra Bose Road"),
        ("Av. JK", "Avenida Juscelino Kubitschek"),
        ("WHC Road", "West High Court Road"),
    ],
)
def test_initials_stand_for_words_of_a_name(typed: str, name: str) -> None:
    assert has_initials(typed, name)


@pytest.mark.parametrize(
    ("typed", "name"),
    [
        ("MG Street", "Mahatma Gandhi Road"),
        ("MG", "Mahatma Gandhi Road"),
        ("MG Road", "Mahatma Gandhi Station Road"),
        ("GM Road", "Mahatma Gandhi Road"),
        ("Main Road", "Mahatma Gandhi Road"),
        ("S Road", "South Road"),
    ],
)
def test_other_letters_are_not_the_initials_of_a_name(typed: str, name: str) -> None:
    assert not has_initials(typed, name)


def test_initials_are_accepted_only_for_a_single_road_of_the_map() -> None:
    one = a_map("Mahatma Gandhi Road", "Residency Road")
    assert find_maps([one], place="MG Road")[0].streets == (("Mahatma Gandhi Road",),)
    with pytest.raises(UnknownName):
        find_maps([a_map("Mahatma Gandhi Road", "Mount Gilbert Road")], place="MG Road")


def test_a_country_s_code_is_not_the_initials_of_a_street() -> None:
    with pytest.raises(UnknownName):
        find_maps([a_map("Jan Paul Neumann Weg", country="DEU")], place="JPN")


@pytest.mark.parametrize(
    ("words", "street"),
    [
        ("Rua Vinte e Cinco de Março", "Rua 25 de Março"),
        ("Rua 25 de Março", "Rua Vinte e Cinco de Março"),
        ("Twenty-Fifth Street", "25th Street"),
        ("Calle Treinta y Uno", "Calle 31"),
        ("Rue du Quatre-Vingt-Neuvième Régiment", "Rue du 89e Régiment"),
        ("Fünfundzwanzigste Straße", "25. Straße"),
        ("улица Двадцать Пятого Октября", "улица 25 Октября"),
    ],
)
def test_several_words_may_be_one_number(words: str, street: str) -> None:
    assert find_maps([a_map(street)], place=words)[0].streets == ((street,),)


def test_a_number_of_several_words_is_not_a_crossing_of_two_numbered_streets() -> None:
    with pytest.raises(UnknownName):
        find_maps([a_map("Rua Vinte", "Rua Cinco")], place="Rua Vinte e Cinco")


def test_words_of_arabic_that_lack_vowels_are_no_abbreviations() -> None:
    with pytest.raises(UnknownName):
        find_maps([a_map("شارع عاصم عبد الحميد", country="EGY")], place="SM Boulevard")


def test_a_kind_of_road_may_be_added_to_a_name_without_one() -> None:
    assert is_with_kind("Dien Bien Phu St", "Điện Biên Phủ")
    assert not is_with_kind("Pasteur Street", "Pasteur Avenue")
    assert not is_with_kind("Pasteur", "Pasteur")


@pytest.mark.parametrize("words", ["Lille, Belgium", "Lille België"])
def test_a_settlement_named_with_its_country_is_known_in_its_outskirts(words: str) -> None:
    outskirts = a_map("Kerkstraat", south=51.254, west=4.774, north=51.276, east=4.804, country="BEL")
    match = find_maps([outskirts], place=words)[0]
    assert any("Lille in GeoNames" in text for text in match.understood)


@pytest.mark.parametrize("words", ["Dublin 4", "Dublin 6"])
def test_the_number_of_a_district_that_the_map_does_not_name_is_reported(words: str) -> None:
    dublin = a_map("Amiens Street", place="Dublin", places=("Dublin",))
    assert find_maps([dublin], place=words)[0].understood == (
        f"{words!r} is read as Dublin: the map has no district with that number",
    )


def test_the_number_of_a_district_is_reported_for_a_place_in_another_language() -> None:
    praha = a_map("Odborů", place="Praha", places=("Praha",), country="CZE")
    assert find_maps([praha], place="Prague 2")[0].understood == (
        "'Prague 2' is read as Prague: the map has no district with that number",
    )


@pytest.mark.parametrize("words", ["Via IV Novembre", "Via Quattro Novembre", "via 4 novembre"])
def test_numbers_of_any_language_are_words_or_figures(words: str) -> None:
    assert find_maps([a_map("Via Quattro Novembre")], place=words)[0].streets == (("Via Quattro Novembre",),)


@pytest.mark.parametrize(
    ("typed", "name", "half"),
    [
        ("Edge", "Edge Lane", True),
        ("Andorra la V", "Andorra la Vella", True),
        ("la", "Andorra la Vella", False),
        ("ابا ال", "ابا الحنين", True),
        ("中山", "中山北路", True),
        ("ul. Reymonta", "Władysława Reymonta", True),
        ("Edge Street", "Edge Lane", False),
        ("ععع", "ععع الحنين", False),
    ],
)
def test_half_of_a_name_is_some_of_its_words_or_their_beginning(typed: str, name: str, half: bool) -> None:
    assert is_half_of(typed, name) is half


@pytest.mark.parametrize("words", ["Stretford", "Манчестер", "A56 Stretford", "Stretford, Edge Lane"])
def test_a_settlement_that_the_map_does_not_name_is_known_by_its_location(words: str) -> None:
    match = find_maps([a_map("Edge Lane")], place=words)[0]
    assert any("GeoNames" in text for text in match.understood)
    assert match.unnamed == ()


def test_a_settlement_elsewhere_is_not_half_of_a_street() -> None:
    with pytest.raises(UnknownName) as refusal:
        find_maps([a_map("Berlin Road")], place="Berlin")
    assert refusal.value.valid == ("“Berlin Road”",)
    assert refusal.value.remedies == (with_values(place="Berlin Road"),)
    assert find_maps([a_map("Berlin Road")], place="Berlin Road")


def test_a_city_elsewhere_in_the_country_is_not_the_beginning_of_a_word() -> None:
    with pytest.raises(UnknownName):
        find_maps([a_map("Londonderry Road")], place="London")
    assert find_maps([a_map("London Road")], place="London")
    assert find_maps([a_map("Londonderry Road")], place="Londond")


def test_the_closest_maps_hide_merely_similar_ones() -> None:
    same, half = a_map("Elm", map_id="map_same"), a_map("Elm Grove", map_id="map_half")
    assert [match.entry for match in find_maps([half, same], place="Elm")] == [same]
    assert [match.entry for match in find_maps([half], place="Elm")] == [half]
    with pytest.raises(UnknownName):
        find_maps([half], place="Elm", closeness=Closeness.HEARD)


def found_roads(maps: list[MapEntry], place: str) -> dict[str, tuple[str, ...]]:
    """The roads that the words may mean, by the ids of the maps that were found."""
    return {match.entry.facts.map_id: match.streets[0] for match in find_maps(maps, place=place)}


def test_the_beginning_of_a_name_counts_in_addition_to_a_spelling_of_another_name() -> None:
    washington, paris = a_map("B Street", map_id="map_w"), a_map("Rue de Bretagne", "Rue Bouchardon", map_id="map_p")
    both = {"map_w": ("B Street",), "map_p": ("Rue de Bretagne",)}
    assert found_roads([paris, washington], "Rue de B") == both


def test_the_beginning_of_a_name_counts_on_the_map_that_has_the_other_name() -> None:
    timor = a_map("Rua", "Rua secundária", "Rua de Balibó", map_id="map_t")
    assert set(found_roads([timor], "Rua sec")["map_t"]) == {"Rua", "Rua secundária"}
    cairo = a_map("شارع محمد توفيق", "شارع محمد توفيق دياب", map_id="map_c")
    assert set(found_roads([cairo], "شارع محمد تو")["map_c"]) == {"شارع محمد توفيق", "شارع محمد توفيق دياب"}


@pytest.mark.parametrize("words", ["Main St", "Main Street"])
def test_a_name_or_its_abbreviation_is_not_extended(words: str) -> None:
    maps = [a_map("Main Street", "Main Station Road", map_id="map_1"), a_map("Main Streetcar Way", map_id="map_2")]
    assert found_roads(maps, words) == {"map_1": ("Main Street",)}


def test_a_kind_of_road_alone_is_the_beginning_of_every_name_with_it() -> None:
    havana, bogota = a_map("Calle", map_id="map_h"), a_map("Calle 122", "Carrera 7", map_id="map_b")
    assert found_roads([havana, bogota], "Calle") == {"map_h": ("Calle",), "map_b": ("Calle 122",)}


@pytest.mark.parametrize("kept", ["ring.net.xml", "ring.roads.xml", "ring.xml", "ring.osm"])
@pytest.mark.parametrize("typed", ["ring", "ring.xodr", "ring.osm.pbf", "RING.OSM.XML.GZ"])
def test_a_file_is_known_by_its_name_after_any_conversion(kept: str, typed: str) -> None:
    assert find_maps([a_map(file_name=kept)], place=typed)
