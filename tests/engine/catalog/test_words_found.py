"""Where a search finds the words that it was given: among tags, features and obstacles, in texts, or nowhere."""

import sqlite3
from typing import Any

import pytest
from support.catalog import catalogue, facts

from plannerforge.engine.catalog import Ranking, Search, scenario_facets
from plannerforge.schemas.catalog import FindScenariosArguments, FindScenariosResult
from plannerforge.schemas.errors import UnknownName

TAGGED, BUILT, PLAIN = "DEU_Bonn-1_1_T-1", "ESP_Vigo-1_1_T-1", "ZAM_Test-1_1_T-1"


@pytest.fixture
def three() -> sqlite3.Connection:
    return catalogue(
        [
            facts(TAGGED, tags=["roundabout", "simulated"], counts={"car": 2, "bus": 1}, source="OpenStreetMap, SUMO"),
            facts(BUILT, features=["roundabout"], counts={"bicycle": 2}, source="Next Generation Simulation (NGSIM)"),
            facts(PLAIN, counts={"car": 9}, source="hand-crafted"),
        ]
    )


def answer(connection: sqlite3.Connection, likeness: float = 0.1, **slots: Any) -> FindScenariosResult:
    search = Search(connection, FindScenariosArguments(**slots))
    keys = (PLAIN, TAGGED, BUILT)
    ranking = Ranking(keys, dict.fromkeys(keys, likeness), least_likeness=0.2) if search.needs_ranking else None
    return search.answer("search", search.find(ranking), ranking)


def ids(found: FindScenariosResult) -> list[str]:
    return sorted(one.scenario_id for one in found.matches)


@pytest.mark.parametrize(
    ("slot", "called"), [("tags", "a tag"), ("features", "a feature"), ("road_net", "a road_net key")]
)
def test_an_obstacle_in_another_argument_is_looked_for_there(three: sqlite3.Connection, slot: str, called: str) -> None:
    found = answer(three, **{slot: ["bus"]})
    assert ids(found) == [TAGGED]
    assert f"'bus' is not {called}; it was looked up among obstacles." in found.notes


def test_a_name_of_a_tag_and_a_feature_among_obstacles_means_either(three: sqlite3.Connection) -> None:
    found = answer(three, obstacles=["roundabout"])
    assert ids(found) == [TAGGED, BUILT]
    assert {one.satisfied for one in found.matches} == {("tag roundabout",), ("feature roundabout",)}
    assert "'roundabout' is not an obstacle type; it was looked up among tags and features." in found.notes


@pytest.mark.parametrize(("word", "note"), [("omnibus", "'omnibus' is read as bus."), ("buses", ""), ("bus", "")])
def test_an_everyday_word_is_reported_with_the_type_that_it_selects(
    three: sqlite3.Connection, word: str, note: str
) -> None:
    found = answer(three, obstacles=[word])
    assert ids(found) == [TAGGED]
    assert [text for text in found.notes if "read as" in text] == [note] * bool(note)


def test_a_word_of_no_vocabulary_is_refused_as_before(three: sqlite3.Connection) -> None:
    with pytest.raises(UnknownName, match="'zebrafish' is not a tag"):
        answer(three, tags=["zebrafish"])


def test_a_tag_that_is_a_feature_too_is_counted_as_both() -> None:
    many = [facts(TAGGED, tags=["roundabout"]), facts(BUILT, features=["roundabout"])]
    many.append(facts(PLAIN, features=["roundabout"]))
    found = answer(catalogue(many), tags=["roundabout"])
    assert ids(found) == [TAGGED]
    (note,) = found.notes
    assert note == "'roundabout' is a tag of 1 scenario (searched) and in the features of 2."


def test_words_of_a_text_are_reported_by_where_they_were_found(three: sqlite3.Connection) -> None:
    found = answer(three, text="bikes at a roundabout")
    assert found.notes == (
        (
            "Words found: 'bikes' (read as bicycle) in 1 scenario (obstacle); "
            "'roundabout' in 1 scenario (tag), 1 scenario (feature)."
        ),
    )
    assert found.total == 3


def test_a_text_without_any_match_gives_no_scenarios_and_says_so(three: sqlite3.Connection) -> None:
    found = answer(three, text="zebrafish")
    assert (found.total, found.matches) == (0, ())
    assert found.notes == (
        "'zebrafish' does not occur in any title, tag, place or description; the text matches nothing.",
    )
    assert [one.unmet for one in found.fallback] == [("the text",)] * 3


def test_unknown_words_with_a_similar_meaning_still_rank(three: sqlite3.Connection) -> None:
    found = answer(three, likeness=0.3, text="gridlock")
    assert found.total == 3
    assert found.notes == (
        "'gridlock' does not occur in any title, tag, place or description; results are ranked by semantic similarity.",
    )


def test_conditions_match_although_a_text_occurs_nowhere(three: sqlite3.Connection) -> None:
    found = answer(three, text="zebrafish", country="ESP")
    assert ids(found) == [BUILT]
    assert (
        "'zebrafish' does not occur in any title, tag, place or description; the text matches nothing." in found.notes
    )


@pytest.mark.parametrize("slots", [{"country": "ITA", "obstacles": ["car"]}, {"text": "zebrafish"}])
def test_without_a_fallback_only_matches_are_shown(three: sqlite3.Connection, slots: dict[str, Any]) -> None:
    assert answer(three, **slots).fallback != ()
    assert answer(three, fallback="none", **slots).fallback == ()


@pytest.mark.parametrize(
    ("origin", "matching", "evidence"),
    [
        ("recorded", BUILT, "origin recorded, by “Next Generation Simulation (NGSIM)”"),
        ("simulated", TAGGED, "origin simulated, by “OpenStreetMap, SUMO”"),
        ("artificial", PLAIN, "origin artificial, by “hand-crafted”"),
    ],
)
def test_the_origin_of_a_scenario_is_a_condition(
    three: sqlite3.Connection, origin: str, matching: str, evidence: str
) -> None:
    found = answer(three, origin=origin)
    assert ids(found) == [matching]
    assert found.matches[0].satisfied == (evidence,)


def test_an_unused_origin_lists_the_existing_ones(three: sqlite3.Connection) -> None:
    found = answer(three, origin="recorded", country="DEU")
    assert found.emptied_by is not None
    assert "available origins: simulated" in found.emptied_by.note


def test_lists_of_places_contain_only_places(three: sqlite3.Connection) -> None:
    _, facets = scenario_facets(three, "places", None)
    assert [list(facet.counts) for facet in facets] == [["DEU", "ESP"], ["DEU Bonn", "ESP Vigo"]]
    assert facets[0].note == "without 1 on artificial networks, ZAM"
    found = answer(three, city="Atlantis")
    assert found.emptied_by is not None
    assert "Test" not in found.emptied_by.note
    assert "Bonn" in found.emptied_by.note


def test_a_misspelt_city_is_refused_with_the_name_that_it_misspells(three: sqlite3.Connection) -> None:
    with pytest.raises(UnknownName) as refusal:
        answer(three, city="Viggo")
    assert refusal.value.valid[0] == "Vigo"
    assert refusal.value.remedies
    assert answer(three, city="Madrid").total == 0, "a known settlement without scenarios is not misspelt"


@pytest.mark.parametrize(
    ("country", "proposed"), [("Germny", ["DEU"]), ("Spian", ["ESP"]), ("Frnace", []), ("Atlantis", [])]
)
def test_a_misspelt_country_is_corrected_only_to_one_that_the_catalogue_has(
    three: sqlite3.Connection, country: str, proposed: list[str]
) -> None:
    with pytest.raises(UnknownName) as refused:
        answer(three, country=country)
    words = [word for remedy in refused.value.remedies for change in remedy.changes for word in change.words.values()]
    assert words == proposed
    assert set(refused.value.valid) == {"DEU", "ESP", "ZAM"}
