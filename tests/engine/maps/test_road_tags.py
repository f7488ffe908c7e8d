from pathlib import Path

import pytest
from support.streets import crossing

from plannerforge.engine.generation.site_network import convert_map
from plannerforge.engine.maps.drawn_library import Sketch
from plannerforge.engine.maps.osm import OsmMap, read_osm
from plannerforge.engine.maps.road_classes import ROADS
from plannerforge.engine.maps.road_tags.access import barrier_of, is_for_access_only, users_of
from plannerforge.engine.maps.road_tags.lanes import SHARED_LANE_M, arrows, lanes_of
from plannerforge.engine.maps.road_tags.legal_speeds import MPH_KMH, legal_speeds, parse_filter
from plannerforge.engine.maps.road_tags.limits import Jurisdiction, limit_of
from plannerforge.engine.maps.site_roads.cut import cut_map
from plannerforge.engine.maps.site_roads.jurisdictions import jurisdiction_of
from plannerforge.engine.maps.site_roads.road_reader import RoadReader
from plannerforge.engine.maps.site_search.built_up import BuiltUp
from plannerforge.engine.maps.site_search.finder import SiteFinder
from plannerforge.engine.network import SumoNet, read_net
from plannerforge.schemas.errors import UnsafeInput

GERMANY = Jurisdiction("DE", (), "Germany")
MIDDLE = (48.1, 11.5)


def cut(osm: OsmMap, folder: Path, country: str | None = "DEU") -> tuple[OsmMap, list[str]]:
    """The roads of a map as they are written for netconvert, and what is told of them."""
    reader = RoadReader(BuiltUp(osm), jurisdiction_of(country, MIDDLE), lefthand=False)
    cut_map(osm, MIDDLE, 1000.0, ROADS, folder / "site.osm", None, reader)
    return read_osm(folder / "site.osm"), reader.notes()


def net_of(osm: OsmMap, folder: Path) -> SumoNet:
    cut(osm, folder)
    convert_map(folder / "site.osm", folder / "site.net.xml", lefthand=False)
    return read_net(folder / "site.net.xml")


@pytest.mark.parametrize(
    ("tags", "users"),
    [
        ({"access": "no"}, ""),
        ({"access": "no", "vehicle": "yes"}, "car taxi truck van bus motorcycle"),
        ({"vehicle": "no", "motorcar": "yes"}, "car taxi"),
        ({"motor_vehicle": "no", "psv": "yes"}, "bus taxi"),
        ({"motor_vehicle": "no", "bus": "yes"}, "bus"),
        ({"hgv": "no"}, "car taxi van bus motorcycle"),
        ({"access": "private"}, ""),
        ({"motor_vehicle": "destination"}, "car taxi truck van bus motorcycle"),
        ({"motor_vehicle": "agricultural;forestry"}, ""),
        ({"access": "nonsense"}, "car taxi truck van bus motorcycle"),
        ({"motorcar:forward": "no", "motorcar:backward": "no"}, "truck van bus motorcycle"),
    ],
)
def test_the_more_special_access_tag_decides(tags: dict[str, str], users: str) -> None:
    assert users_of(tags) == frozenset(users.split())


def test_a_road_for_destination_traffic_is_distinguished_from_a_closed_one() -> None:
    assert is_for_access_only({"motor_vehicle": "destination"})
    assert not is_for_access_only({"vehicle": "destination", "motor_vehicle": "yes"})
    assert not is_for_access_only({"access": "private"})


@pytest.mark.parametrize(
    ("tags", "stops"),
    [
        ({"barrier": "bollard"}, True),
        ({"barrier": "bollard", "motor_vehicle": "yes"}, False),
        ({"barrier": "bollard", "bollard": "rising"}, False),
        ({"barrier": "gate"}, False),
        ({"barrier": "gate", "access": "private"}, True),
        ({"barrier": "gate", "locked": "yes"}, True),
        ({"barrier": "cattle_grid"}, False),
        ({"motor_vehicle": "no"}, True),
        ({"highway": "crossing"}, False),
    ],
)
def test_barriers_stop_cars_by_their_kind_and_their_access(tags: dict[str, str], stops: bool) -> None:
    assert bool(barrier_of(tags)) is stops


@pytest.mark.parametrize(
    ("tags", "kmh"),
    [
        ({"maxspeed": "30 mph"}, 30 * MPH_KMH),
        ({"maxspeed": "10 knots"}, 18.52),
        ({"maxspeed": "50;30"}, 30.0),
        ({"maxspeed": "DE:urban"}, 50.0),
        ({"maxspeed": "DE:rural"}, 100.0),
        ({"maxspeed": "DE:zone:30"}, 30.0),
        ({"maxspeed": "AT:zone30"}, 30.0),
        ({"source:maxspeed": "DE:urban"}, 50.0),
        ({"maxspeed:type": "GB:nsl_single"}, 60 * MPH_KMH),
        ({"maxspeed:type": "GB:nsl_dual"}, 70 * MPH_KMH),
        ({"zone:maxspeed": "DE:30"}, 30.0),
        ({"zone:traffic": "RU:urban"}, 60.0),
        ({"maxspeed": "60", "maxspeed:forward": "40"}, 40.0),
        ({"maxspeed:lanes": "80|100"}, 100.0),
        ({"maxspeed": "walk"}, 7.0),
        ({"highway": "motorway", "maxspeed": "none"}, 130.0),
        ({"maxspeed": "signals"}, 100.0),
        ({"maxspeed": "99999"}, 100.0),
    ],
)
def test_limits_are_read_as_openstreetmap_documents_them(tags: dict[str, str], kmh: float) -> None:
    limit = limit_of({"highway": "secondary", **tags}, GERMANY, urban=False)
    assert limit.kmh == pytest.approx(kmh, abs=0.2)


def test_a_limit_that_cannot_be_read_is_reported() -> None:
    limit = limit_of({"highway": "secondary", "maxspeed": "signals"}, GERMANY, urban=True)
    assert (limit.kmh, limit.source, limit.unread) == (50.0, "law", "maxspeed=signals")


def test_a_usual_speed_below_the_law_is_not_called_law() -> None:
    drive = limit_of({"highway": "service"}, GERMANY, urban=True)
    ramp = limit_of({"highway": "secondary_link", "maxspeed": "DE:rural"}, GERMANY, urban=False)
    assert (drive.kmh, drive.source) == (20.0, "driven")
    assert (ramp.kmh, ramp.source) == (100.0, "code")


def test_without_a_tag_the_law_of_country_and_kind_of_road_applies() -> None:
    table = legal_speeds()
    for country, town, country_road, motorway in (("DE", 50, 100, 130), ("FR", 50, 80, 130), ("PL", 50, 90, 140)):
        kinds = (("secondary", True, town), ("secondary", False, country_road), ("motorway", False, motorway))
        for road_class, urban, kmh in kinds:
            limit = table.find(country, {"highway": road_class}, urban=urban)
            assert limit is not None
            assert limit.kmh == kmh
    britain = table.find("GB", {"highway": "motorway"}, urban=False)
    assert britain is not None
    assert britain.kmh == pytest.approx(70 * MPH_KMH, abs=0.1)


def test_of_states_with_different_laws_the_most_frequent_limit_applies() -> None:
    anywhere = legal_speeds().find("US", {"highway": "secondary"}, urban=False)
    arizona = legal_speeds().find("US", {"highway": "motorway"}, urban=False, states=("US-AZ",))
    assert anywhere is not None
    assert anywhere.states > 40
    assert arizona is not None
    assert arizona.code == "US-AZ"
    assert legal_speeds().find("XX", {"highway": "secondary"}, urban=False) is None
    assert legal_speeds().anywhere({"highway": "motorway"}, urban=False).kmh >= 100


def test_the_language_of_the_table_is_read() -> None:
    test = parse_filter('highway~trunk|primary and !{urban} and (lanes>=2 or "motorroad"=yes)')
    assert test({"highway": "trunk", "lanes": "2"}, lambda _: False)
    assert test({"highway": "primary", "motorroad": "yes"}, lambda _: False)
    assert not test({"highway": "trunk", "lanes": "2"}, lambda _: True)
    assert not test({"highway": "secondary", "lanes": "4"}, lambda _: False)
    with pytest.raises(ValueError, match="bracket"):
        parse_filter("(highway")


@pytest.mark.parametrize(
    ("tags", "oneway", "forward", "backward", "note"),
    [
        ({"lanes": "2"}, 0, 1, 1, None),
        ({"lanes": "4"}, 0, 2, 2, None),
        ({"lanes": "3"}, 0, 2, 1, "odd_lanes"),
        ({"lanes": "3", "lanes:backward": "2"}, 0, 1, 2, None),
        ({"lanes": "5", "lanes:both_ways": "1"}, 0, 2, 2, "middle_lane"),
        ({"lanes": "3", "centre_turn_lane": "yes"}, 0, 1, 1, "middle_lane"),
        ({"lanes": "1"}, 0, 1, 1, "one_lane"),
        ({"oneway": "yes", "turn:lanes": "left||right"}, 1, 3, None, None),
        ({"oneway": "-1", "lanes": "2"}, -1, None, 2, None),
        ({"oneway": "yes", "lanes": "2", "vehicle:lanes": "yes|yes|no"}, 1, 2, None, None),
        ({"oneway": "reversible", "lanes": "2"}, 1, 2, None, "reversible"),
    ],
)
def test_lanes_are_counted_by_direction(
    tags: dict[str, str], oneway: int, forward: int | None, backward: int | None, note: str | None
) -> None:
    lanes = lanes_of(tags, lefthand=False)
    assert (lanes.oneway, lanes.forward.count, lanes.backward.count) == (oneway, forward, backward)
    assert (note in lanes.notes) if note else not lanes.notes


def test_a_lane_without_an_arrow_leads_straight_on_and_to_its_side() -> None:
    assert arrows(["left", "", ""]) == ("left", "through", "right;through")
    assert arrows(["left", "through;right"]) == ("left", "right;through")


@pytest.mark.parametrize(
    ("tags", "width_m", "too_narrow"),
    [
        ({"lanes": "1"}, 2 * SHARED_LANE_M, False),
        ({"width": "3"}, 2 * SHARED_LANE_M, False),
        ({"width": "1.5"}, None, True),
        ({"oneway": "yes", "width": "5'0\""}, None, True),
        ({"width": "7 m"}, 7.0, False),
        ({"lanes": "4", "width": "3.5"}, None, False),
    ],
)
def test_every_lane_that_is_drawn_is_wide_enough_for_a_car(
    tags: dict[str, str], width_m: float | None, too_narrow: bool
) -> None:
    lanes = lanes_of(tags, lefthand=False)
    assert (lanes.width_m, lanes.too_narrow) == (width_m, too_narrow)


def test_a_road_closed_to_motor_vehicles_is_not_an_arm_and_is_reported(tmp_path: Path) -> None:
    osm = read_osm(crossing(tmp_path / "map.osm", {"west": {"motor_vehicle": "no"}, "north": {"access": "private"}}))
    assert SiteFinder(osm).find("intersection") == []
    written, notes = cut(osm, tmp_path)
    assert {way.way_id for way in written.ways} == {2, 3}
    assert any("motor_vehicle=no" in note and "access=private" in note for note in notes)


def test_a_map_of_closed_roads_is_refused_with_this_reason(tmp_path: Path) -> None:
    with pytest.raises(UnsafeInput, match="access=no"):
        read_osm(crossing(tmp_path / "map.osm", {"all": {"access": "no"}}))


def test_a_bollard_ends_the_road_on_either_side(tmp_path: Path) -> None:
    osm = read_osm(crossing(tmp_path / "map.osm", {}, nodes={"west2": {"barrier": "bollard"}}))
    written, notes = cut(osm, tmp_path)
    west = [way for way in written.ways if way.tags["name"] == "Aaweg"]
    assert len(west) == 3
    assert 12 not in {key for way in west for key in way.node_ids}
    assert any("barrier=bollard" in note for note in notes)


def test_deleted_and_invisible_objects_are_not_there(tmp_path: Path) -> None:
    gone = {"west": {"action": "delete"}, "north": {"visible": "false"}}
    osm = read_osm(crossing(tmp_path / "map.osm", {}, attributes=gone))
    assert {way.way_id for way in osm.ways} == {2, 3}


def test_no_road_in_a_town_has_the_limit_of_a_country_road(tmp_path: Path) -> None:
    tags = {"all": {"maxspeed": ""}}
    town, told = cut(read_osm(crossing(tmp_path / "town.osm", tags, houses=True, segments=9)), tmp_path)
    limits = {way.tags["name"]: way.tags["maxspeed"] for way in town.ways}
    assert limits == {"Aaweg": "50", "Beweg": "100"}
    assert any("Germany" in note and "50 km/h in town (Aaweg)" in note for note in told)
    unknown, told = cut(read_osm(tmp_path / "town.osm"), tmp_path, None)
    assert {way.tags["maxspeed"] for way in unknown.ways} == {"50", "90"}
    assert any("median" in note for note in told)


def test_a_road_in_a_marked_settlement_core_is_in_town_even_without_houses(tmp_path: Path) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(-500, 0), (0, 0), (500, 0)], "secondary", "Main Road")
    sketch.road([(4000, 0), (4500, 0), (5000, 0)], "secondary", "Far Road")
    sketch.road([(9000, 0), (9100, 0)], "residential", "Side Road")
    sketch.write(tmp_path / "map.osm")
    osm = read_osm(tmp_path / "map.osm")
    reader = RoadReader(BuiltUp(osm), GERMANY, lefthand=False)
    urban = {way.tags["name"]: reader.is_urban(way, [osm.nodes[key] for key in way.node_ids]) for way in osm.ways}
    assert (urban["Main Road"], urban["Far Road"]) == (True, False)


def test_a_road_in_the_core_of_a_known_city_is_in_town_if_the_map_lacks_houses(tmp_path: Path) -> None:
    def is_urban(latitude: float, longitude: float, *, houses: bool) -> bool:
        sketch = Sketch("", latitude, longitude)
        sketch.road([(-500, 0), (0, 0), (500, 0)], "secondary", "Main Road")
        sketch.road([(9000, 0), (9100, 0)], "residential", "Side Road")
        if houses:
            sketch.mark((9050, 20), building="yes", addr_housenumber="1")
        sketch.write(tmp_path / "map.osm")
        text = (tmp_path / "map.osm").read_text().replace('"town"', '"locality"').replace("addr_", "addr:")
        (tmp_path / "map.osm").write_text(text)
        osm = read_osm(tmp_path / "map.osm")
        road = next(way for way in osm.ways if way.tags.get("name") == "Main Road")
        reader = RoadReader(BuiltUp(osm), GERMANY, lefthand=False)
        return reader.is_urban(road, [osm.nodes[key] for key in road.node_ids])

    assert is_urban(12.97, 77.59, houses=False)  # Bangalore
    assert not is_urban(12.97, 77.59, houses=True)
    assert not is_urban(54.6, 5.2, houses=False)  # the North Sea


def test_each_limit_is_reported_with_its_law(tmp_path: Path) -> None:
    tags = {"all": {"maxspeed": ""}, "west": {"highway": "motorway"}}
    _, told = cut(read_osm(crossing(tmp_path / "town.osm", tags, houses=True)), tmp_path, "KEN")
    law, median = (note for note in told if "without a signed speed limit" in note)
    assert "Kenya" in law
    assert "motorways" not in law
    assert "median" in median
    assert "in town" not in median


def test_the_net_has_lanes_users_and_turns_of_the_tags(tmp_path: Path) -> None:
    both = {"lanes": "4", "turn:lanes:forward": "left|through;right", "turn:lanes:backward": "left|through;right"}
    tags = {
        "west": both,
        "east": both,
        "north": {"hgv": "no", "maxspeed:forward": "30"},
        "south": {"lanes": "4", "bus:lanes:forward": "yes|designated", "maxspeed": "60", "maxspeed:hgv": "40"},
    }
    net = net_of(read_osm(crossing(tmp_path / "map.osm", tags)), tmp_path)
    turns = {(turn.from_lane, turn.direction) for turn in net.connections if turn.from_edge == "1"}
    assert turns == {("1_0", "r"), ("1_0", "s"), ("1_1", "l")}
    assert "truck" not in net.lanes["4_0"].allowed
    assert "passenger" in net.lanes["4_0"].allowed
    assert [round(net.lanes[key].speed_mps * 3.6) for key in ("4_0", "-4_0")] == [30, 50]
    assert "passenger" not in net.lanes["3_0"].allowed
    assert "bus" in net.lanes["3_0"].allowed
    assert "passenger" in net.lanes["3_1"].allowed


@pytest.mark.parametrize(
    ("tags", "is_told"),
    [
        ({"oneway": "yes", "lanes": "2", "placement": "right_of:1"}, False),
        ({"oneway": "yes", "lanes": "2", "placement": "right_of:3"}, True),
        ({"oneway": "yes", "lanes": "2", "placement": "transition"}, True),
        ({"lanes": "2", "placement:forward": "right_of:1"}, True),
        ({"oneway": "-1", "lanes": "2", "placement": "right_of:1"}, True),
        ({"oneway": "yes", "lanes": "2"}, False),
    ],
)
def test_a_placement_off_the_nodes_is_drawn_or_reported(tags: dict[str, str], is_told: bool, tmp_path: Path) -> None:
    written, told = cut(read_osm(crossing(tmp_path / "map.osm", {"west": tags})), tmp_path)
    assert any("placement" in note for note in told) is is_told
    assert any("placement" in way.tags for way in written.ways) is ("placement" in tags and not is_told)


def test_a_road_against_its_nodes_is_written_along_them(tmp_path: Path) -> None:
    tags = {"oneway": "-1", "lanes": "2", "turn:lanes:backward": "left|through", "sidewalk": "left"}
    source = read_osm(crossing(tmp_path / "map.osm", {"west": tags}))
    (before,) = [way for way in source.ways if way.tags.get("oneway") == "-1"]
    written, _ = cut(source, tmp_path)
    (after,) = [way for way in written.ways if way.way_id == before.way_id]
    assert after.node_ids == before.node_ids[::-1]
    assert (after.tags["oneway"], after.tags["turn:lanes:forward"]) == ("yes", "left|through")
    assert after.tags["sidewalk"] == "right"


@pytest.mark.parametrize(("posted", "urban"), [("40", True), ("100", False)])
def test_posted_limits_of_meeting_roads_tell_whether_a_road_is_in_a_town(
    tmp_path: Path, posted: str, urban: bool
) -> None:
    sketch = Sketch("Town", 50.0, 8.0)
    sketch.road([(5000, 0), (5200, 0), (5400, 0)], "secondary", "Main Road")
    sketch.road([(5200, 0), (5200, 400)], "secondary", "Side Road", maxspeed=posted)
    sketch.road([(9000, 0), (9100, 0)], "residential", "Far Road")
    sketch.write(tmp_path / "map.osm")
    osm = read_osm(tmp_path / "map.osm")
    reader = RoadReader(BuiltUp(osm), GERMANY, lefthand=False)
    main = next(way for way in osm.ways if way.tags["name"] == "Main Road")
    assert reader.is_urban(main, [osm.nodes[key] for key in main.node_ids]) is urban
