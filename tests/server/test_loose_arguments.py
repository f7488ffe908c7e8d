"""Arguments as small models write them are read as what they can only mean, and the answer says so."""

from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from plannerforge.schemas.base import Arguments, Model
from plannerforge.schemas.errors import InvalidRequest, followed
from plannerforge.server.arguments.checking import read_arguments


class Change(Model):
    op: Literal["remove", "set_goal"]
    vehicles: list[str] = Field(default=[])
    offset_m: float | None = None


class Request(Arguments):
    scenario_id: str
    duration_s: float = Field(20, ge=5)
    count: int = 1
    traffic: Literal["recorded", "reactive"] = "recorded"
    tags: list[str] = Field(default=[])
    edits: list[Change] = Field(default=[])
    city: str | None = None


@pytest.mark.parametrize(
    ("written", "meant", "note"),
    [
        ({"duration_s": "20"}, {"duration_s": 20}, 'duration_s="20" is read as 20'),
        ({"duration_s": "20 s"}, {"duration_s": 20}, 'duration_s="20 s" is read as 20'),
        ({"duration_s": "7.5 seconds"}, {"duration_s": 7.5}, "is read as 7.5"),
        ({"duration": 30}, {"duration_s": 30}, "duration was taken as duration_s"),
        ({"Traffic": "REACTIVE"}, {"traffic": "reactive"}, "Traffic was taken as traffic"),
        ({"tags": "highway"}, {"tags": ["highway"]}, 'tags="highway" is read as ["highway"]'),
        ({"tag": "highway"}, {"tags": ["highway"]}, "tag was taken as tags"),
        ({"tags": [7]}, {"tags": ["7"]}, "tags=[7] is read as"),
        ({"tags": None}, {}, "tags=null is read as not given"),
        ({"city": None}, {}, ""),
        ({"scenario_id": ["A"]}, {"scenario_id": "A"}, 'scenario_id=["A"] is read as "A"'),
        (
            {"edits": '{"op": "Set-Goal", "vehicles": 320}'},
            {"edits": [{"op": "set_goal", "vehicles": ["320"]}]},
            "edits[0].vehicles=320 is read as",
        ),
        ({"edits": {"op": "remove", "offset": "4 m"}}, {"edits": [{"op": "remove", "offset_m": 4}]}, "edits[0].offset"),
    ],
)
def test_an_argument_with_one_possible_meaning_is_accepted_and_reported(
    written: dict[str, Any], meant: dict[str, Any], note: str
) -> None:
    notes: list[str] = []
    read = read_arguments(Request, {"scenario_id": "A", **written}, notes)
    assert read == Request.model_validate({"scenario_id": "A", **meant})
    assert any(note in told for told in notes) if note else notes == []


@pytest.mark.parametrize(
    "written",
    [
        {"duration_s": "20 km"},
        {"duration_s": "20..30"},
        {"duration_s": "long"},
        {"count": "2 s"},
        {"traffic": "react"},
        {"reason": "the user asked"},
        {"duration_s": 20, "duration": 30},
        {"tags": "[broken"},
        {"scenario_id": ["A", "B"]},
    ],
)
def test_an_ambiguous_argument_is_refused(written: dict[str, Any]) -> None:
    with pytest.raises(InvalidRequest):
        read_arguments(Request, {"scenario_id": "A", **written})


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ({"trafic": "reactiv", "count": 2}, {"count": 2, "traffic": "reactive"}),
        ({"duration_s": 1}, {"duration_s": 5}),
        ({"reasoning": "it is so"}, {}),
        ({"count": "many"}, {}),
        ({"traffic": "angry"}, {}),
    ],
    ids=["misspelt", "bound", "unknown", "type", "choice"],
)
def test_a_refusal_carries_the_call_that_mends_it(wrong: dict[str, Any], right: dict[str, Any]) -> None:
    given = {"scenario_id": "A", **wrong}
    with pytest.raises(InvalidRequest) as caught:
        read_arguments(Request, given)
    mended = followed(caught.value.remedies[0], "request", given)
    assert mended is not None
    assert mended.arguments == {"scenario_id": "A", **right}


def test_a_missing_required_argument_has_no_correction() -> None:
    with pytest.raises(InvalidRequest) as caught:
        read_arguments(Request, {"count": 2})
    assert not caught.value.remedies


@given(
    st.fixed_dictionaries(
        {"scenario_id": st.text(min_size=1, max_size=5)},
        optional={
            "duration_s": st.floats(5, 100),
            "count": st.integers(1, 50),
            "traffic": st.sampled_from(["recorded", "reactive"]),
            "tags": st.lists(st.text(max_size=4), max_size=3),
        },
    )
)
def test_valid_arguments_are_unchanged(arguments: dict[str, Any]) -> None:
    notes: list[str] = []
    assert read_arguments(Request, arguments, notes) == Request.model_validate(arguments)
    assert notes == []


class Weighing(Arguments):
    weights: list[str] = Field(default=[], description="'jerk=0.5'")
    ids: list[str] = Field(default=[], description="ids")


@pytest.mark.parametrize("written", [{"jerk": 0.5}, [{"jerk": 0.5}], '{"jerk": 0.5}'])
def test_an_object_is_read_as_assignments_where_a_field_takes_them(written: Any) -> None:
    notes: list[str] = []
    assert read_arguments(Weighing, {"weights": written}, notes).weights == ["jerk=0.5"]
    assert len(notes) == 1
    with pytest.raises(InvalidRequest):
        read_arguments(Weighing, {"ids": written})
