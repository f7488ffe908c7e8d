"""What an answer says of each entry: which conditions it meets and misses, by which fact, and what a choice covers."""

import sqlite3
from typing import Any

import pytest
from support.catalog import catalogue, facts

from plannerforge.engine.catalog import Search, description_of
from plannerforge.engine.catalog.words import summary
from plannerforge.schemas.catalog import FindScenariosArguments, FindScenariosResult
from plannerforge.schemas.scenarios import RoadFacts, ScenarioFacts

ROADS = RoadFacts(
    lanelets=3,
    signs_ego=("speed_limit", "stop"),
    signs_map=("speed_limit", "stop", "yield"),
    traffic_lights_map=1,
    limits_ego_kmh=(30.0, 50.0),
    limits_map_kmh=(30.0, 50.0, 80.0),
)


def made(**changes: Any) -> ScenarioFacts:
    values = {"tags": ["urban"], "features": ["ramp"], "counts": {"car": 3, "truck": 2}, "lanes": 2, "roads": ROADS}
    return facts("DEU_Bonn-1_1_T-1", **(values | changes))


def answer(*all_facts: ScenarioFacts, **slots: Any) -> FindScenariosResult:
    search = Search(catalogue(all_facts), FindScenariosArguments(**slots))
    return search.answer("search", search.find(None), None)


@pytest.mark.parametrize(
    ("slots", "evidence"),
    [
        ({"city": "bonn"}, "Bonn, DEU"),
        ({"tags": ["urban"]}, "tag urban"),
        ({"tags": ["!rural"]}, "no tag rural"),
        ({"tags": ["rural|urban"]}, "tag urban"),
        ({"tags": ["!rural|critical"]}, "no tag rural or critical"),
        ({"features": ["ramp"]}, "feature ramp"),
        ({"features": ["horizon>=5s"]}, "horizon 5 s"),
        ({"features": ["density<1"]}, "density 0 vehicles/km"),
        ({"features": ["ttc>=5s"]}, "no collision if the ego continues"),
        ({"obstacles": ["truck"]}, "truck=2"),
        ({"obstacles": ["!bus"]}, "bus=0"),
        ({"ego_speed": "10m/s"}, "ego 10.00 m/s (36.0 km/h)"),
        ({"road_net": ["lanes=2"]}, "lanes=2"),
        ({"road_net": ["speed_limit=50km/h"]}, "limit 30/50 km/h"),
        ({"road_net": ["speed_limit@map=80km/h"]}, "limit 30/50/80 km/h"),
        ({"road_net": ["stop"]}, "stop"),
        ({"road_net": ["!yield"]}, "no yield"),
        ({"road_net": ["yield@map"]}, "yield on the map"),
        ({"road_net": ["!traffic_light"]}, "no traffic_light"),
        ({"road_net": ["traffic_light@map"]}, "traffic_light on the map"),
    ],
)
def test_a_met_condition_is_shown_by_the_fact_behind_it(slots: dict[str, Any], evidence: str) -> None:
    (match,) = answer(made(), **slots).matches
    assert (match.satisfied, match.unmet) == ((evidence,), ())


def test_a_time_to_conflict_is_shown_in_seconds() -> None:
    one = made()
    soon = one.model_copy(update={"egos": (one.egos[0].model_copy(update={"time_to_conflict_s": 2.5}),)})
    assert answer(soon, features=["ttc<=3s"]).matches[0].satisfied == ("ttc 2.5 s",)


def test_without_an_ego_its_facts_are_reported_as_missing() -> None:
    nobody = made().model_copy(update={"egos": ()})
    found = answer(nobody, road_net=["!lanes=2"], tags=["urban"])
    assert found.matches[0].satisfied == ("tag urban", "no ego")
    (nearest,) = answer(nobody, ego_speed="10m/s", tags=["urban"]).fallback
    assert nearest.unmet == ("ego_speed 10m/s (no ego)",)


def test_the_nearest_scenario_names_its_missing_conditions_and_its_own_values() -> None:
    found = answer(made(), tags=["urban", "rural"], obstacles=["truck=1"], road_net=["speed_limit=100km/h"])
    (nearest,) = found.fallback
    assert nearest.satisfied == ("tag urban",)
    assert nearest.unmet == (*("rural", "speed_limit=100km/h (limit 30/50 km/h)", "truck=1 (truck=2)"),)
    assert found.matches == ()


def test_the_stages_count_their_remaining_scenarios() -> None:
    others = [facts(f"DEU_Bonn-{n}_1_T-1", tags=["urban"]) for n in (2, 3)]
    found = answer(made(), *others, facts("ESP_Vigo-1_1_T-1"), country="DEU", tags=["urban"], obstacles=["car"])
    assert [(stage.stage, stage.left) for stage in found.stages] == [("location", 3), ("tags", 3), ("obstacles", 1)]
    assert (found.catalogue, found.total) == (4, 1)


def test_pages_follow_each_other_without_overlap() -> None:
    many = [facts(f"DEU_Bonn-{n}_1_T-1") for n in range(1, 8)]
    pages = [[one.scenario_id for one in answer(*many, limit=3, offset=begin).matches] for begin in (0, 3, 6)]
    assert [len(page) for page in pages] == [3, 3, 1]
    assert sorted(key for page in pages for key in page) == [one.scenario_id for one in many]


def test_the_most_critical_comes_first_and_entries_without_an_ego_last() -> None:
    def after(name: str, time_s: float | None) -> ScenarioFacts:
        one = facts(name)
        return one.model_copy(update={"egos": (one.egos[0].model_copy(update={"time_to_conflict_s": time_s}),)})

    empty = facts("DEU_A-1_1_T-1").model_copy(update={"egos": ()})
    ranked = answer(empty, after("DEU_B-1_1_T-1", None), after("DEU_C-1_1_T-1", 4.0), after("DEU_D-1_1_T-1", 1.0))
    assert [one.scenario_id[4] for one in ranked.matches] == ["A", "B", "C", "D"]
    by_time = answer(
        *(empty, after("DEU_B-1_1_T-1", None), after("DEU_C-1_1_T-1", 4.0), after("DEU_D-1_1_T-1", 1.0)),
        sort="criticality",
    )
    assert [one.scenario_id[4] for one in by_time.matches] == ["D", "C", "B", "A"]


@pytest.fixture
def unlike() -> list[ScenarioFacts]:
    """Two that are alike, one that adds a truck and a speed, one that adds a lane and a country."""
    return [
        facts("DEU_A-1_1_T-1", counts={"car": 1}, speed_mps=0.4),
        facts("DEU_B-1_1_T-1", counts={"car": 1}, speed_mps=0.4),
        facts("DEU_C-1_1_T-1", counts={"car": 1, "truck": 5}, speed_mps=10.0),
        facts("ESP_D-1_1_T-1", counts={"car": 50}, speed_mps=25.0, lanes=3),
    ]


def test_a_diverse_choice_covers_most_and_leaves_out_similar_scenarios(unlike: list[ScenarioFacts]) -> None:
    found = answer(*unlike, diverse=3)
    assert [one.scenario_id[4] for one in found.matches] == ["C", "D", "A"]
    covered = {one.dimension: (one.covered, one.missed) for one in found.coverage}
    assert covered == {
        "countries": (("DEU", "ESP"), ()),
        "density_per_km": (("<2",), ()),
        "ego_speed_mps": (("10..15", "<0.5", ">=25"), ()),
        "lanes": (("1", "3"), ()),
        "obstacles": (("car", "truck"), ()),
        "obstacles_total": (("1..6", "6..20", ">=50"), ()),
        "ttc_s": (("never",), ()),
    }


def test_a_smaller_choice_states_what_it_misses(unlike: list[ScenarioFacts]) -> None:
    found = answer(*unlike, diverse=2)
    missed = {one.dimension: one.missed for one in found.coverage if one.missed}
    assert missed == {"ego_speed_mps": ("<0.5",), "obstacles_total": ("1..6",)}


def test_when_all_is_covered_the_choice_begins_again_with_the_rest() -> None:
    alike = [facts(f"DEU_{letter}-1_1_T-1") for letter in "ABC"]
    assert [one.scenario_id[4] for one in answer(*alike, diverse=2).matches] == ["A", "B"]


@pytest.mark.parametrize(
    ("time_s", "band"), [(0.5, "<1"), (1.0, "1..3"), (5.9, "3..6"), (6.0, ">=6"), (1e6, ">=6"), (None, "never")]
)
def test_bands_begin_with_their_lower_bound(time_s: float | None, band: str) -> None:
    one = facts()
    timed = one.model_copy(update={"egos": (one.egos[0].model_copy(update={"time_to_conflict_s": time_s}),)})
    covered = {each.dimension: each.covered for each in answer(timed, diverse=1).coverage}
    assert covered["ttc_s"] == (band,)


def test_a_line_tells_traffic_speed_lanes_and_manoeuvre() -> None:
    turning = made(features=["ego_turns_left", "ramp"], counts={"bus": 2, "car": 3, "truck": 2}, lanes=1)
    assert summary(turning) == "3 cars, 2 buses, 2 trucks, ego 10.0 m/s (1 lane), turns left"
    assert summary(made(counts={}).model_copy(update={"egos": ()})) == "no traffic, no planning problem, so no ego"


def test_a_description_states_the_facts_in_sentences() -> None:
    one = made(tags=["multi_lane", "urban"], features=["roundabout", "ego_turns_left"], counts={"bus": 2, "car": 1})
    assert description_of(one) == (
        "Traffic scenario in Bonn, DEU. Tagged multi lane, urban. The road shows a roundabout. Road: 2 lanes in the "
        "ego's direction; speed limit 30 and 50 km/h; traffic lights elsewhere on the map; signs: stop. Little "
        "traffic: 2 buses, 1 car. The ego vehicle starts at 10 m/s (36 km/h) and turns left to its goal, within 5 s."
    )


def test_a_description_leaves_out_missing_facts() -> None:
    bare = facts("DEU_Bonn-1_1_T-1", speed_mps=0.4, lanes=0)
    expected = "Traffic scenario in Bonn, DEU. No other traffic. The ego vehicle stands, within 5 s."
    assert description_of(bare) == expected
    assert description_of(bare.model_copy(update={"egos": ()})) == expected.partition(" The ego")[0]
    lit = facts(roads=RoadFacts(lanelets=1, traffic_light_ego=True, traffic_lights_map=3))
    assert "a traffic light on the ego's lane." in description_of(lit)


@pytest.mark.parametrize(("count", "word"), [(5, "Little"), (6, "Some"), (19, "Some"), (20, "Dense")])
def test_traffic_is_little_some_or_dense_by_its_number(count: int, word: str) -> None:
    assert f"{word} traffic: {count} cars." in description_of(facts(counts={"car": count}))


def test_an_empty_catalogue_has_no_facets_and_no_matches() -> None:
    connection: sqlite3.Connection = catalogue([])
    search = Search(connection, FindScenariosArguments(diverse=3))
    found = search.answer("search", search.find(None), None)
    assert (found.total, found.matches, found.coverage) == (0, (), ())


def test_all_participants_together_can_be_counted() -> None:
    busy, quiet = facts("DEU_A-1_1_T-1", counts={"car": 14, "bus": 6}), facts("DEU_A-2_1_T-1", counts={"car": 3})
    search = Search(catalogue([busy, quiet]), FindScenariosArguments(obstacles=["participants>=20"]))
    answer = search.answer("search", search.find(None), None)
    assert [(one.scenario_id, one.satisfied) for one in answer.matches] == [("DEU_A-1_1_T-1", ("participants=20",))]
    search = Search(catalogue([quiet]), FindScenariosArguments(obstacles=["participants>=20"]))
    emptied = search.answer("search", search.find(None), None).emptied_by
    assert emptied is not None
    assert "numbers of participants: 3" in emptied.note
