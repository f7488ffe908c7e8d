"""What the catalogue holds, counted: whole for one facet, cut short where all are asked for."""

import sqlite3

import pytest
from support.catalog import catalogue, facts

from plannerforge.engine.catalog import scenario_facets
from plannerforge.schemas.scenarios import RoadFacts
from plannerforge.schemas.vocabulary import FEATURES, OBSTACLE_TYPES, SIGNS, TAGS

STOP = RoadFacts(lanelets=3, signs_ego=("stop",), signs_map=("stop", "yield"), limits_ego_kmh=(30.0, 50.0))
LIGHT = RoadFacts(lanelets=3, signs_map=("stop",), traffic_lights_map=2, limits_ego_kmh=(50.0,), limits_map_kmh=(80.0,))


@pytest.fixture
def three() -> sqlite3.Connection:
    return catalogue(
        [
            facts("DEU_Bonn-1_1_T-1", tags=["urban"], counts={"car": 2, "bus": 1}, speed_mps=4.9, lanes=2, roads=STOP),
            facts("DEU_Bonn-2_1_T-1", tags=["urban", "critical"], counts={"car": 9}, speed_mps=5.0, lanes=10),
            facts("ESP_Vigo-1_1_T-1", features=["ramp"], counts={"truck": 1}, speed_mps=20.0, lanes=10, roads=LIGHT),
        ]
    )


def counted(
    connection: sqlite3.Connection, wanted: str, within: frozenset[str] | None = None
) -> dict[str, dict[str, int]]:
    return {facet.facet: facet.counts for facet in scenario_facets(connection, wanted, within)[1]}


def notes(connection: sqlite3.Connection, wanted: str) -> dict[str, str]:
    return {facet.facet: facet.note for facet in scenario_facets(connection, wanted, None)[1]}


def test_all_facets_count_scenarios_the_most_frequent_first(three: sqlite3.Connection) -> None:
    found = counted(three, "all")
    assert list(found) == [
        *("countries", "places", "tags", "features", "road_net", "lanes", "speed_limit", "obstacles", "ego_speed")
    ]
    assert list(found["countries"].items()) == [("DEU", 2), ("ESP", 1)]
    assert list(found["places"].items()) == [("Bonn", 2), ("Vigo", 1)]
    assert list(found["tags"].items()) == [("urban", 2), ("critical", 1)]
    assert found["features"] == {"ramp": 1}
    assert list(found["obstacles"].items()) == [("car", 2), ("bus", 1), ("truck", 1)]
    assert list(found["lanes"].items()) == [("2", 1), ("10", 2)]
    assert list(found["speed_limit"].items()) == [("50", 2), ("30", 1)]


def test_speeds_are_counted_in_bands_that_begin_with_their_bound(three: sqlite3.Connection) -> None:
    assert counted(three, "all")["ego_speed"] == {"<5m/s": 1, "5..10m/s": 1, "10..20m/s": 0, ">=20m/s": 1}
    assert notes(three, "all")["ego_speed"] == "at the start; highest 20 m/s"
    assert "ego_speed" not in counted(three, "all", frozenset())


def test_a_single_facet_lists_unused_values_with_0(three: sqlite3.Connection) -> None:
    assert counted(three, "tags") == {"tags": dict.fromkeys(TAGS, 0) | {"urban": 2, "critical": 1}}
    assert counted(three, "features") == {"features": dict.fromkeys(FEATURES, 0) | {"ramp": 1}}
    kinds = {"car": 2, "bus": 1, "truck": 1}
    assert counted(three, "obstacles") == {"obstacles": dict.fromkeys(OBSTACLE_TYPES, 0) | kinds}
    assert counted(three, "places") == {"countries": {"DEU": 2, "ESP": 1}, "places": {"DEU Bonn": 2, "ESP Vigo": 1}}


def test_unused_values_of_all_facets_are_in_a_note(three: sqlite3.Connection) -> None:
    found = notes(three, "all")
    assert found["tags"] == f"in no scenario: {', '.join(tag for tag in TAGS if tag not in ('urban', 'critical'))}"
    assert found["obstacles"] == f"scenarios with at least one; {len(OBSTACLE_TYPES) - 3} types in no scenario"
    assert found["places"] == ""
    # On the maps: stop, yield and a light; speed_limit is a sign that limits stand for.
    missing = {*SIGNS, "traffic_light"} - {"stop", "yield", "traffic_light", "speed_limit"}
    assert found["road_net"] == f"on the ego's lane; @map: anywhere; {len(missing)} keys in no scenario"


def test_signs_are_counted_on_the_ego_s_lane_and_on_the_map(three: sqlite3.Connection) -> None:
    whole = counted(three, "road_net")["road_net"]
    held = {name: count for name, count in whole.items() if count}
    on_lane = {"stop": 1, "speed_limit": 2}
    assert held == on_lane | {"stop@map": 2, "yield@map": 1, "traffic_light@map": 1, "speed_limit@map": 1}
    assert {*SIGNS, "traffic_light"} <= {name.removesuffix("@map") for name in whole}
    assert notes(three, "road_net")["road_net"] == "on the ego's lane; @map: anywhere"


def test_only_requested_facets_are_counted(three: sqlite3.Connection) -> None:
    within = frozenset({"DEU_Bonn-2_1_T-1", "ESP_Vigo-1_1_T-1"})
    number, _ = scenario_facets(three, "all", within)
    found = counted(three, "all", within)
    assert number == 2
    assert found["countries"] == {"DEU": 1, "ESP": 1}
    assert found["tags"] == {"critical": 1, "urban": 1}
    assert found["obstacles"] == {"car": 1, "truck": 1}
    assert found["speed_limit"] == {"50": 1}
    assert found["road_net"] == {"speed_limit": 1, "stop@map": 1, "traffic_light@map": 1, "speed_limit@map": 1}


def test_long_facets_are_shortened_with_the_number_of_hidden_entries() -> None:
    limits = (30.0, 40.0, 50.0, 60.0)
    codes = ("ARG", "AUT", "BEL", "BRA", "CHN", "DEU", "ESP", "FRA", "GRC", "ITA", "JPN", "POL", "USA")
    roads = RoadFacts(lanelets=1, limits_ego_kmh=limits, limits_map_kmh=limits, signs_ego=("stop", "yield", "priority"))
    many = catalogue([facts(f"{code}_In{code}-1_1_T-1", roads=roads) for code in codes])
    short, whole = counted(many, "all"), counted(many, "places") | counted(many, "road_net")
    assert [len(short[name]) for name in ("countries", "places", "speed_limit", "road_net")] == [12, 6, 3, 4]
    assert [len(whole[name]) for name in ("countries", "places", "speed_limit")] == [13, 13, 4]
    assert notes(many, "all")["places"] == "7 more: facet=places"
    assert whole["road_net"]["speed_limit"] == 13
    assert "in 13 scenarios" in notes(many, "all")["speed_limit"], "as many as have the sign, whatever is listed"
    assert "1 more limit: facet=road_net" in notes(many, "all")["speed_limit"]
    assert "facet=maps" in notes(many, "places")["places"]
