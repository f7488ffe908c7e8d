"""Manoeuvres in a text are conditions on what was computed; roads that merge or cross are not."""

from collections.abc import Sequence

import pytest
from support.catalog import catalogue, facts

from plannerforge.engine.catalog.search import Ranking, Search
from plannerforge.engine.catalog.text_conditions import conditions_in_text
from plannerforge.schemas.catalog import FindScenariosArguments
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.scenarios import ScenarioFacts


@pytest.mark.parametrize(
    ("text", "labels"),
    [
        ("truck cuts in", ["feature cut_in:truck"]),
        ("a cut-in by a bus on a motorway", ["feature cut_in:bus"]),
        ("another vehicle is cutting in", ["feature cut_in"]),
        ("the lead vehicle brakes hard", ["feature lead_brakes_hard"]),
        ("hard braking of the lead", ["feature lead_brakes_hard"]),
        ("pedestrian crossing the road", ["feature crossing:pedestrian"]),
        ("oncoming car turns left", ["feature oncoming_turns:car"]),
        ("an unprotected left turn", ["feature unprotected_left"]),
        ("emergency braking of the lead", ["feature lead_brakes_hard"]),
        ("a motorcycle overtakes a truck", ["feature overtaking:motorcycle"]),
        ("a lorry merges onto the motorway", ["feature merging:truck"]),
        ("make a U-turn", ["feature ego_turns_back"]),
        ("ego turns left", ["feature ego_turns_left"]),
        ("merging lanes near a pedestrian crossing in town", []),
        ("dense traffic without overtaking", []),
        ("a rainy evening", []),
        ("no trucks, left turn", ["!truck"]),
        ("a junction without lorries or buses", ["!truck", "!bus"]),
        ("no cars and a roundabout", ["!car"]),
        ("no car ahead", []),
        ("no cars or buses ahead", []),
    ],
)
def test_a_text_about_a_manoeuvre_is_a_condition(text: str, labels: Sequence[str]) -> None:
    assert [one.label for one in conditions_in_text(text).constraints] == labels


def doing(scenario_id: str, *manoeuvres: str) -> ScenarioFacts:
    """Facts of a scenario in which road users do this."""
    made = facts(scenario_id, features=[one.partition(":")[0] for one in manoeuvres], counts={"truck": 1, "car": 2})
    egos = tuple(ego.model_copy(update={"manoeuvres": manoeuvres}) for ego in made.egos)
    return made.model_copy(update={"egos": egos})


ALL = ("DEU_A-1_1_T-1", "DEU_B-1_1_T-1", "DEU_C-1_1_T-1")


def searched(**slots: object) -> Search:
    """A search among a truck that cuts in, a car that does, and traffic that does nothing."""
    connection = catalogue([doing(ALL[0], "cut_in:truck"), doing(ALL[1], "cut_in:car"), doing(ALL[2])])
    return Search(connection, FindScenariosArguments.model_validate(slots))


def test_a_text_matches_manoeuvres_and_not_all_scenarios_with_its_words() -> None:
    search = searched(text="truck cuts in")
    ranking = Ranking(ALL, dict.fromkeys(ALL, 0.5))
    answer = search.answer("search", search.find(ranking), ranking)
    assert [match.scenario_id for match in answer.matches] == [ALL[0]]
    assert any("features=cut_in:truck" in note for note in answer.notes)


def test_a_manoeuvre_is_requested_with_or_without_the_road_user() -> None:
    assert len(searched(features=["cut_in"]).funnel.matches) == 2
    assert len(searched(features=["cut_in:lorry"]).funnel.matches) == 1
    assert len(searched(features=["!cut_in:truck"]).funnel.matches) == 2


def test_a_feature_that_is_not_a_manoeuvre_takes_no_type() -> None:
    with pytest.raises(UnknownName):
        searched(features=["roundabout:truck"])


def test_scenarios_from_before_manoeuvres_were_computed_are_reported() -> None:
    search = Search(catalogue([facts(ALL[0]), doing(ALL[1])]), FindScenariosArguments(features=["cut_in"]))
    assert any("for 1 scenario " in note for note in search.answer("search", search.find(None), None).notes)


def test_the_text_only_ranks_if_features_name_the_manoeuvre() -> None:
    search = searched(text="the overtaking bug", features=["cut_in"])
    assert [one.label for one in search.funnel.constraints] == ["feature cut_in"]
