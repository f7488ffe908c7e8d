"""What mends a refused call: found in a refusal, put into the call, carried through a worker, written out."""

import json
from typing import Any

import pytest

from plannerforge.schemas.errors import (
    VEHICLES_LISTED,
    Faults,
    InvalidRequest,
    Remedy,
    UnknownName,
    calling,
    closest,
    followed,
    instead,
    rebuild,
    with_values,
)
from plannerforge.schemas.errors.remedies import SHOWN_CALL

GIVEN = {"scenario_id": "A", "edits": [{"op": "set_speed", "speed": "9"}, {"op": "set_behaviour", "preset": "wyld"}]}


def arguments_of(remedy: Remedy, given: dict[str, object] | None = None) -> object:
    call = followed(remedy, "tool", GIVEN if given is None else given)
    return None if call is None else call.arguments


def test_a_misspelt_name_is_replaced_in_place() -> None:
    error = UnknownName("there is no preset 'wyld'", valid=["wild", "mild"])
    assert arguments_of(error.remedies[0]) == {
        **GIVEN,
        "edits": [GIVEN["edits"][0], {"op": "set_behaviour", "preset": "wild"}],
    }


@pytest.mark.parametrize(
    ("message", "valid"),
    [
        ("there is no vehicle '4711'", ["4712"]),
        ("there is nothing called 'run_0123456789ab'", ["run_0123456bcdef"]),
        ("there is no class 'unicorn'", ["car", "truck"]),
        ("there is no scenario 'ZAM_Nowhere-1_1_T-1'", ["ZAM_Noproblem-1_1_T-1"]),
    ],
    ids=["number", "random_id", "unlike", "benchmark_id"],
)
def test_another_thing_is_not_proposed_in_place_of_an_unknown_one(message: str, valid: list[str]) -> None:
    assert not UnknownName(message, valid=valid).remedies


@pytest.mark.parametrize("names", [["latest", "latest_run"], ["latest_run", "latest"]])
def test_the_most_similar_name_is_proposed_first(names: list[str]) -> None:
    error = UnknownName("there is nothing called 'latest_rnu'", valid=names)
    assert arguments_of(error.remedies[0], {"ids": ["latest_rnu"]}) == {"ids": ["latest_run"]}


def test_a_refusal_of_an_unknown_name_counts_the_valid_names_that_it_leaves_out() -> None:
    known = [f"map_{index}" for index in range(3000)]
    error = UnknownName("there is no map 'x'", valid=closest("x", known))
    assert f"{len(known) - error.shown_values} more" in error.text


def test_valid_assignments_are_set_at_the_place_of_the_fault() -> None:
    faults = Faults()
    with faults.collecting("edit 1", ("edits", 1)):
        raise InvalidRequest("the place is taken", valid=["at=156 position='137.2m'", "another place"])
    with pytest.raises(InvalidRequest) as caught:
        faults.raise_all()
    (remedy,) = caught.value.remedies
    changed = arguments_of(remedy)
    assert changed == {
        **GIVEN,
        "edits": [GIVEN["edits"][0], {"op": "set_behaviour", "preset": "wyld", "at": "156", "position": "137.2m"}],
    }


def test_one_call_mends_all_faults() -> None:
    faults = Faults()
    with faults.collecting("", ("edits", 0)):
        raise InvalidRequest("no unit", remedies=[with_values(speed="9m/s")])
    with faults.collecting("", ("edits", 1)):
        raise UnknownName("there is no preset 'wyld'", valid=["wild"])
    with pytest.raises(InvalidRequest) as caught:
        faults.raise_all()
    edits = [{"op": "set_speed", "speed": "9m/s"}, {"op": "set_behaviour", "preset": "wild"}]
    assert [arguments_of(remedy) for remedy in caught.value.remedies] == [{**GIVEN, "edits": edits}]


def test_a_misspelt_word_is_replaced_in_the_edit_that_is_at_fault_alone() -> None:
    given = {"edits": [{"op": "set_behaviour", "preset": "wyld", "params": ["wyld"]}, {"preset": "wyld"}]}
    faults = Faults()
    with faults.collecting("edit 1", ("edits", 1)):
        raise UnknownName("there is no preset 'wyld'", valid=["wild"])
    with pytest.raises(UnknownName) as caught:
        faults.raise_all()
    assert [arguments_of(one, given) for one in caught.value.remedies] == [
        {"edits": [given["edits"][0], {"preset": "wild"}]}
    ]


def test_a_repeated_error_keeps_its_remedies() -> None:
    error = UnknownName("there is no preset 'wyld'", valid=["wild"])
    placed = [remedy.at(("edits", 1)) for remedy in error.remedies]
    again = rebuild(error.code, error.message, error.valid, error.next_step, error.reason, placed)
    assert again.remedies == tuple(placed)
    assert rebuild(error.code, error.message, error.valid, error.next_step).remedies == ()


def test_a_remedy_without_a_change_is_left_out() -> None:
    assert arguments_of(instead("absent", "other")) is None
    assert arguments_of(with_values(scenario_id="A")) is None
    assert arguments_of(with_values(speed=None).at(("edits", 7))) is None


def test_whole_words_alone_are_replaced() -> None:
    given = {"ids": ["A-1#7"], "text": "A-17"}
    assert arguments_of(instead("7", "12"), given) == {"ids": ["A-1#12"], "text": "A-17"}


def test_numbers_and_parts_of_numbers_are_not_words() -> None:
    given = {"vehicles": ["3"], "count": 3, "speed": "3.5m/s", "offset_m": 3.0, "goal_time": "1.3"}
    assert arguments_of(instead("3", "12"), given) == {**given, "vehicles": ["12"]}


def test_a_word_is_replaced_in_the_fields_that_a_remedy_names() -> None:
    given = {"edits": [{"to": ["3"], "vehicles": ["3"], "speed": "3 m/s"}]}
    remedy = Remedy.of_json(json.loads(json.dumps(instead("3", "12", "to", "via").at(("edits", 0)).to_json())))
    assert arguments_of(remedy, given) == {"edits": [{"to": ["12"], "vehicles": ["3"], "speed": "3 m/s"}]}
    assert arguments_of(instead("3", "12", "via").at(("edits", 0)), given) is None


def test_another_call_takes_over_the_arguments_that_it_needs() -> None:
    assert arguments_of(VEHICLES_LISTED) == {"scenario_id": "A", "detail": "vehicles"}
    assert arguments_of(calling("list_planners")) == {}


def test_the_refused_call_itself_is_not_proposed() -> None:
    given = {"scenario_id": "A", "detail": "vehicles"}
    assert followed(VEHICLES_LISTED, "describe_scenario", given) is None
    assert followed(VEHICLES_LISTED, "describe_scenario", {"scenario_id": "A"}) is not None
    assert followed(calling("list_planners"), "list_planners", {}) is None


def test_remedies_survive_json() -> None:
    for remedy in (instead("a", "b").at(("edits", 0)), with_values(lane=None), VEHICLES_LISTED):
        assert Remedy.of_json(json.loads(json.dumps(remedy.to_json()))) == remedy


def test_a_long_call_is_described_by_its_changes() -> None:
    given = {"text": "x" * SHOWN_CALL, "lane": "left", "edits": [{"speed": "9"}]}
    call = followed(Remedy((*with_values(lane=None).changes, *instead("9", "9m/s").changes)), "tool", given)
    assert call is not None
    assert call.text == 'call again with the same arguments, but without lane and with edits[0].speed="9m/s"'
    short = followed(instead("9", "8"), "tool", {"speed": "9"})
    assert short is not None
    assert short.text == 'call again with {"speed": "8"}'


@pytest.mark.parametrize(
    ("given", "remedy", "dropped"),
    [
        ({"goal": "merge", "count": 2}, with_values(goal=None), ("goal",)),
        ({"where": ["a=1", "b=2"]}, with_values(where=["b=2"]), ("'a=1' in where",)),
        ({"obstacles": ["car=many"]}, instead("car=many", "car"), ("'=many' in obstacles[0]",)),
        ({"speed": "9"}, instead("9", "8"), ()),
    ],
)
def test_a_call_says_what_it_leaves_out(given: dict[str, Any], remedy: Remedy, dropped: tuple[str, ...]) -> None:
    call = followed(remedy, "tool", given)
    assert call is not None
    assert call.dropped == dropped
    assert call.text.endswith(f" (without {', '.join(dropped)})" if dropped else "}")
