"""The places that a map shows, and by which of them it is called."""

from pathlib import Path

from plannerforge.engine.maps.naming.shown import areas_shown, places_shown
from plannerforge.engine.maps.naming.tags import names_of, place_names_of, refs_of
from plannerforge.engine.maps.osm import OsmMap, OsmNode, OsmRelation, OsmWay, read_osm

ROAD = OsmWay(1, (1, 2), {"highway": "residential"})


def a_map(*tags: dict[str, str], relations: tuple[OsmRelation, ...] = ()) -> OsmMap:
    """A street in Lower Austria with nodes around it that have these tags."""
    ends = {number: OsmNode(number, 48.4, 15.6 + number / 1000, {}) for number in (1, 2)}
    places = {number: OsmNode(number, 48.4, 15.6, each) for number, each in enumerate(tags, start=3)}
    return OsmMap(ends | places, (ROAD,), relations, None)


def test_the_most_important_place_comes_first_in_any_order() -> None:
    village = {"place": "village", "name": "Neustift", "population": "257"}
    town = {"place": "town", "name": "Krems an der Donau", "name:en": "Krems an der Donau", "population": "24,000"}
    assert places_shown(a_map(village, town))[0] == "Krems an der Donau"
    assert places_shown(a_map(town, village))[0] == "Krems an der Donau"


def test_of_two_places_of_a_kind_the_one_with_more_inhabitants_comes_first() -> None:
    few = {"place": "village", "name": "Aldorf", "population": "80"}
    many = {"place": "village", "name": "Zedorf", "population": "3 000"}
    assert places_shown(a_map(few, many, {"place": "village", "name": "Bedorf"})) == ["Zedorf", "Aldorf", "Bedorf"]


def test_a_town_of_addresses_that_geonames_knows_is_more_than_a_village() -> None:
    village = {"place": "village", "name": "Aldorf"}
    assert places_shown(a_map(village, {"addr:city": "Krems an der Donau"}))[0] == "Krems an der Donau"
    assert places_shown(a_map(village, {"addr:city": "Nirgendheim"}))[0] == "Aldorf"


def test_districts_of_addresses_and_of_borders_are_shown() -> None:
    border = {"boundary": "administrative", "admin_level": "9", "name": "Lerchenfeld"}
    state = {"boundary": "administrative", "admin_level": "4", "name": "Niederösterreich"}
    relations = (OsmRelation(1, (), border), OsmRelation(2, (), state))
    shown = places_shown(a_map({"addr:suburb": "Stein", "addr:city": "Krems"}, relations=relations))
    assert shown == ["Krems", "Stein", "Lerchenfeld"]


def test_a_place_given_as_a_point_and_an_address_is_one_area() -> None:
    areas = areas_shown(
        a_map({"place": "suburb", "name": "Stein"}, {"place": "suburb", "name": "Stein", "alt_name": "X"})
    )
    assert [(area.name, area.other_names) for area in areas] == [("Stein", ("X",))]


def test_all_names_of_a_tag_count_but_no_facts_about_names() -> None:
    tags = {"name": "Bozen - Bolzano", "name:ru": "Больцано", "alt_name_1": "Balsan", "name:etymology:wikidata": "Q1"}
    assert names_of(tags) == ["Bozen - Bolzano", "Больцано", "Balsan"]
    assert place_names_of(tags) == ["Bozen - Bolzano", "Больцано", "Balsan", "Bozen", "Bolzano"]
    assert place_names_of({"name": "Shubra حي شبرا"})[1:] == ["Shubra", "حي شبرا"]
    assert refs_of({"ref": "A 22;SS 12", "int_ref": "E 45"}) == ["A 22", "SS 12", "E 45"]


def test_a_place_cut_by_the_extract_is_shown() -> None:
    nodes = {1: OsmNode(1, 48.0, 16.0, {}), 2: OsmNode(2, 48.001, 16.0, {})}
    cut = OsmWay(3, (1, 2), {"place": "suburb", "name": "пос. Метизный"})
    osm = OsmMap(nodes, [cut], (), None)
    assert places_shown(osm) == ["пос. Метизный"]
    assert [area.name for area in areas_shown(osm)] == ["пос. Метизный"]


def test_a_place_with_one_corner_in_the_extract_is_shown(tmp_path: Path) -> None:
    corners = "".join(f'<nd ref="{number}"/>' for number in (1, 8, 9, 1))
    road = '<way id="5"><nd ref="1"/><nd ref="2"/><tag k="highway" v="residential"/></way>'
    outline = f'<way id="6">{corners}<tag k="place" v="suburb"/><tag k="name" v="Байковский хутор"/></way>'
    nodes = '<node id="1" lat="47.23" lon="39.72"/><node id="2" lat="47.231" lon="39.72"/>'
    (tmp_path / "a.osm").write_text(f'<osm version="0.6">{nodes}{road}{outline}</osm>', encoding="utf-8")
    assert places_shown(read_osm(tmp_path / "a.osm")) == ["Rostov-on-Don", "Байковский хутор"]


def placed(latitude: float, longitude: float, *tags: dict[str, str]) -> OsmMap:
    """A map of 1 km with an object of each of these tags in its middle."""
    corners = [OsmNode(1, latitude - 0.005, longitude - 0.005, {}), OsmNode(2, latitude + 0.005, longitude + 0.005, {})]
    inside = [OsmNode(number, latitude, longitude, one) for number, one in enumerate(tags, 3)]
    road = OsmWay(9, (1, 2), {"highway": "residential"})
    return OsmMap({node.node_id: node for node in (*corners, *inside)}, (road,), (), None)


def test_a_town_on_the_map_comes_before_the_province_s_city_in_its_addresses() -> None:
    akcaabat, trabzon = {"place": "town", "name": "Akçaabat"}, {"addr:city": "Trabzon"}
    assert places_shown(placed(41.021, 39.573, akcaabat, trabzon))[:2] == ["Akçaabat", "Trabzon"]
    village = {"place": "village", "name": "St. Newlyn East"}
    assert places_shown(placed(50.367, -5.052, village, {"addr:city": "Newquay"}))[0] == "St. Newlyn East"
    assert (
        places_shown(placed(22.685, 114.2, {"place": "village", "name": "荷坳村"}, {"addr:city": "深圳市"}))[0]
        == "深圳市"
    )


def test_a_city_that_the_map_marks_as_a_suburb_comes_before_a_smaller_town() -> None:
    addresses = [{"addr:city": "Somerville"}, {"addr:city": "Somerville"}, {"addr:city": "Cambridge"}]
    shown = places_shown(placed(42.376, -71.109, {"place": "suburb", "name": "Cambridge"}, *addresses))
    assert shown[:2] == ["Cambridge", "Somerville"]


def test_a_map_that_shows_only_a_part_is_called_by_the_settlement_around_it() -> None:
    suburb = {"place": "suburb", "name": "Ponto Chic"}
    assert places_shown(placed(-27.0565, -49.5445, suburb)) == ["Ibirama", "Ponto Chic"]
    far_from_any = placed(-20.127, -44.117, {"place": "suburb", "name": "Córrego do Feijão"})
    assert places_shown(far_from_any) == ["Córrego do Feijão"]
    assert places_shown(placed(-27.0565, -49.5445)) == []
