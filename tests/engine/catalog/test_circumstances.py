"""Weather and times of day are found where a catalogue states any; where it states none, they are refused as before."""

from collections.abc import Mapping
from typing import Any

import pytest
from support.catalog import catalogue, facts

from plannerforge.engine.catalog import Search, description_of
from plannerforge.engine.catalog.facets import scenario_facets
from plannerforge.schemas.catalog import FindScenariosArguments, FindScenariosResult
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.scenarios import ScenarioFacts

HELD = {"A": ("night", "snow"), "B": ("rush_hour",), "C": ("light_rain", "rush_hour"), "D": ()}


def entry(name: str, circumstances: tuple[str, ...]) -> ScenarioFacts:
    plain = facts(f"DEU_{name}-1_1_T-1", tags=["urban"])
    return plain.model_copy(update={"circumstances": circumstances})


def answer(held: Mapping[str, tuple[str, ...]] = HELD, **slots: Any) -> FindScenariosResult:
    search = Search(catalogue([entry(*one) for one in held.items()]), FindScenariosArguments(**slots))
    return search.answer("search", search.find(None), None)


@pytest.mark.parametrize(
    ("slots", "names"),
    [
        ({"tags": ["night"]}, "A"),
        ({"tags": ["night", "snow"]}, "A"),
        ({"features": ["rush hour"]}, "BC"),
        ({"tags": ["rain"]}, "C"),
        ({"tags": ["!rain", "urban"]}, "ABD"),
        ({"tags": ["snowy|light_rain"]}, "AC"),
        ({"tags": ["fog"]}, ""),
    ],
)
def test_weather_and_time_are_found_by_the_words_that_people_use(slots: dict[str, Any], names: str) -> None:
    matches = answer(**slots).matches
    assert [one.scenario_id for one in matches] == [f"DEU_{name}-1_1_T-1" for name in names]


def test_an_answer_states_where_it_looked_and_the_fact() -> None:
    found = answer(tags=["night"])
    assert found.notes == ("'night' is not a tag; it was looked up among weather and times of day.",)
    assert found.matches[0].satisfied == ("weather or time night",)


def test_existing_words_are_named_if_nothing_matches() -> None:
    found = answer(tags=["fog"])
    assert found.emptied_by is not None
    assert "weather and times of day" in found.emptied_by.note
    assert all(word in found.emptied_by.note for word in ("snow", "night", "light_rain", "rush_hour"))
    assert any("'fog'" in note and "weather or time of day" in note for note in found.notes)


def test_a_catalogue_without_circumstances_refuses_them_as_unknown_words() -> None:
    with pytest.raises(UnknownName, match="'night' is not a tag"):
        answer({"A": ()}, tags=["night"])


def test_circumstances_are_in_descriptions_and_among_the_facets_of_tags() -> None:
    assert "Circumstances: night, snow." in description_of(entry("A", HELD["A"]))
    assert "Circumstances" not in description_of(entry("D", ()))
    _, facets = scenario_facets(catalogue([entry(*one) for one in HELD.items()]), "tags", None)
    assert facets[-1].counts == {"rush_hour": 2, "light_rain": 1, "night": 1, "snow": 1}
    _, without = scenario_facets(catalogue([entry("D", ())]), "tags", None)
    assert len(without) == 1


def test_facts_without_circumstances_are_written_as_before() -> None:
    assert "circumstances" not in entry("D", ()).model_dump(mode="json")
