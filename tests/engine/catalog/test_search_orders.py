"""The orders of an answer: by size, by both rankings, and few unlike ones."""

import sqlite3
from typing import Any

import pytest
from support.catalog import catalogue, facts

from plannerforge.engine.catalog import search as search_module
from plannerforge.engine.catalog.search import Ranking, Search
from plannerforge.schemas.catalog import FindScenariosArguments, FindScenariosResult

SMALL, LARGE, ABROAD = "DEU_Bonn-1_1_T-1", "DEU_Bonn-2_1_T-1", "ESP_Bilbao-1_1_T-1"


@pytest.fixture
def three() -> sqlite3.Connection:
    return catalogue([facts(SMALL, tags=["urban"]), facts(LARGE, tags=["urban"], counts={"car": 9}), facts(ABROAD)])


def answer(connection: sqlite3.Connection, ranked: tuple[str, ...] = (), **slots: Any) -> FindScenariosResult:
    search = Search(connection, FindScenariosArguments(**slots))
    chosen = tuple(key for key in ranked if key in search.candidates())
    ranking = Ranking(chosen, {key: 1.0 / place for place, key in enumerate(chosen, start=1)}) if ranked else None
    return search.answer("search", search.find(ranking), ranking)


def ids(found: FindScenariosResult) -> list[str]:
    return [match.scenario_id for match in found.matches]


def test_the_largest_traffic_comes_first(three: sqlite3.Connection) -> None:
    assert ids(answer(three, sort="size")) == [LARGE, SMALL, ABROAD]


def test_hybrid_ranks_the_country_and_matches_satisfy_all(three: sqlite3.Connection) -> None:
    order = (ABROAD, LARGE, SMALL)
    found = answer(three, order, method="hybrid", text="a town", country="DEU", tags=["urban"])
    assert ids(found) == [LARGE, SMALL]
    assert found.fallback == ()


def test_rrf_puts_scenarios_high_in_both_rankings_first_and_the_rest_apart(three: sqlite3.Connection) -> None:
    found = answer(three, (ABROAD, LARGE, SMALL), method="rrf", text="a town", tags=["urban"])
    assert set(ids(found)) == {SMALL, LARGE}
    assert [one.scenario_id for one in found.fallback] == [ABROAD]


def test_every_match_has_the_score_of_its_text(three: sqlite3.Connection) -> None:
    found = answer(three, (ABROAD, LARGE, SMALL), text="a town")
    assert [(one.scenario_id, one.score) for one in found.matches] == [(ABROAD, 1.0), (LARGE, 0.5), (SMALL, 1 / 3)]
    assert {one.score for one in answer(three).matches} == {None}


def test_a_diverse_choice_states_which_matches_it_did_not_examine(
    three: sqlite3.Connection, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert answer(three, diverse=2).notes == ()
    monkeypatch.setattr(search_module, "MOST_CONSIDERED", 2)
    assert "first 2 of 3 matches" in answer(three, diverse=2).to_text()


def test_notes_say_what_decides_the_order(three: sqlite3.Connection) -> None:
    by_text = answer(three, (ABROAD, LARGE, SMALL), text="zzz")
    by_size = answer(three, (ABROAD, LARGE, SMALL), text="zzz", sort="size")
    assert ids(by_size) == [LARGE, SMALL, ABROAD]
    assert "sort=size" in " ".join(by_size.notes)
    assert "similarity" not in " ".join(by_size.notes)
    assert "sort=" not in " ".join(by_text.notes)
    assert any("ttc" in note for note in answer(three, sort="criticality").notes)


def test_a_sorted_diverse_choice_is_listed_in_that_order_and_says_so(three: sqlite3.Connection) -> None:
    found = answer(three, diverse=3, sort="size")
    assert ids(found) == [LARGE, SMALL, ABROAD]
    assert any("sort=size" in note for note in found.notes)


def test_stages_say_which_arguments_left_the_others_out(three: sqlite3.Connection) -> None:
    found = answer(three, tags=["urban"], country="DEU")
    assert [stage.kinds for stage in found.stages] == [("place",), ("tags",)]
    found = answer(three, features=["ttc<=3s"], ego_speed="0..50m/s")
    assert [kind for stage in found.stages for kind in stage.kinds][:1] == ["features"]
    assert "tags" not in found.to_text().split("[")[0]
