"""Validation errors in one line, for every shape of argument and whatever is sent."""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, field_validator

from plannerforge.schemas.base import Arguments, Model
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.server.arguments.checking import read_arguments

ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


class Change(Model):
    op: Literal["remove", "add"]
    position_m: float = Field(0, ge=-10, description="along the lane")


class Request(Arguments):
    place: str
    count: int = Field(1, ge=1, le=50)
    kinds: list[Literal["car", "truck"]] | None = None
    limits: tuple[float, ...] = ()
    changes: list[Change] = Field(default=[])
    mode: Literal["auto", "fast"] = "auto"

    @field_validator("place")
    @classmethod
    def _known(cls, value: str) -> str:
        if value == "Atlantis":
            raise ValueError("no map holds 'Atlantis'")
        return value


def refusal(**given: Any) -> InvalidRequest:
    with pytest.raises(InvalidRequest) as caught:
        read_arguments(Request, given)
    return caught.value


def test_good_arguments_become_their_model() -> None:
    assert read_arguments(Request, {"place": "Bonn", "kinds": ["car"]}) == Request(place="Bonn", kinds=["car"])


@pytest.mark.parametrize(
    ("given", "message", "valid"),
    [
        ({"place": "B", "Cuont": 1}, "there is no argument 'Cuont'", "count"),
        ({"place": "B", "kinds": ["trcuk"]}, "kinds[0] cannot be 'trcuk'", "truck"),
        ({"place": "B", "mode": "slow"}, "mode cannot be 'slow'", "auto"),
        ({"place": "B", "count": 2.5}, "count cannot be 2.5", "a whole number from 1 to 50"),
        ({"place": "B", "limits": [1, "x"]}, "limits[1] cannot be 'x'", "a number"),
        (
            {"place": "B", "changes": [{"op": "add", "position_m": -11}]},
            "changes[0].position_m cannot be -11",
            "a number, -10 or greater",
        ),
        ({"place": "B", "changes": [{"op": "add"}, 7]}, "changes[1] cannot be 7", None),
        ({"place": "Atlantis"}, "place: no map holds 'Atlantis' (given: 'Atlantis')", "text"),
    ],
)
def test_problem_is_named_with_the_nearest_valid_value(given: dict[str, Any], message: str, valid: str | None) -> None:
    error = refusal(**given)
    assert message in error.message
    assert valid is None or error.valid[0] == valid


def test_all_problems_are_named_at_once() -> None:
    error = refusal(cout=3, mode="x")
    assert error.message.count(";") == 2
    for part in ("'place' (text) is missing", "no argument 'cout'", "mode cannot be 'x'"):
        assert part in error.message


@pytest.mark.parametrize("given", [{}, {"kinds": ["car"]}])
def test_a_missing_argument_is_refused_with_an_example(given: dict[str, Any]) -> None:
    class Exemplary(Request):
        examples: ClassVar[Mapping[str, Any]] = {"place": "Munich"}

    with pytest.raises(InvalidRequest) as refused:
        read_arguments(Exemplary, given)
    assert any('"Munich"' in value for value in refused.value.valid)


def test_long_values_are_cut() -> None:
    assert len(refusal(place=["x" * 10_000]).text) < 300


@given(st.dictionaries(st.sampled_from([*Request.model_fields, "other", ""]), ANYTHING, max_size=4))
def test_any_argument_is_accepted_or_refused_in_one_line(given: dict[str, Any]) -> None:
    try:
        read_arguments(Request, given)
    except InvalidRequest as error:
        text = error.text
    else:
        return
    assert text.startswith("[invalid_request] ")
    assert "https://" not in text


@pytest.mark.parametrize(
    ("given", "what", "valid", "next_step"),
    [
        ({"place": "x" * 300}, "place: a text of 300 characters", "at most 200 characters", "shorten it"),
        ({"place": "x\ud800"}, "place: half a character", "whole Unicode characters", "leave it out"),
        ({"count": 1e16}, "count: a number beyond ±1e+15", "-1e+15 to 1e+15", "send a smaller one"),
        ({"limits": [1.0] * 2001}, "limits: 2,001 elements", "at most 2,000 elements", "use several calls"),
        (
            {"kinds": [[[[[[[[]]]]]]]]},
            "kinds: more than 6 levels",
            "at most 6 levels",
            "in the form of the tool's input schema",
        ),
        ({f"a{n}": [0] * 1500 for n in range(8)}, "more than 10,000 values", "at most 10,000 values", "several calls"),
    ],
    ids=["text", "surrogate", "number", "list", "depth", "values"],
)
def test_any_argument_that_is_too_large_is_reported_with_a_remedy(
    given: dict[str, Any], what: str, valid: str, next_step: str
) -> None:
    error = refusal(**{"place": "B", **given})
    assert what in error.message
    assert valid in error.valid[0]
    assert next_step in error.next_step
