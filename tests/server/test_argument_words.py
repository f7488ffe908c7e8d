"""No refusal speaks in pydantic's words: of no kind of its errors, and of no argument of any tool."""

import re
from collections.abc import Iterator
from functools import cache
from typing import Any, Literal, get_args

import pytest
from pydantic import BaseModel, Field, ValidationError
from pydantic_core import InitErrorDetails
from pydantic_core._pydantic_core import list_all_errors

from plannerforge.schemas.base import Arguments, Model, problem_of, problems_of
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.server.arguments.checking import read_arguments
from plannerforge.tools.registry import TOOLS

OWN_CHECK = {"value_error", "assertion_error"}
"""Kinds of errors whose words are those of a check of ours."""
LEAST_WORDS = 3
"""Words of a row of pydantic's by which it is known; two are anyone's."""
BAD_VALUES: dict[str, Any] = {
    "an empty list": [],
    "a long list": ["zz"] * 300,
    "null": None,
    "null in a list": [None],
    "nan": float("nan"),
    "nan in a list": [float("-inf")],
    "nan as text": "NaN",
    "a number as text": "12x",
    "a number of many digits as text": "9" * 199,
    "a fraction": 2.5,
    "below every bound": -1e14,
    "above every bound": 1e14,
    "true": True,
    "true in a list": [True],
    "an object": {"zz": {"zz": 1}},
    "an object in a list": [{"zz": {"zz": 1}}],
    "lists in each other": [[["zz"]]],
    "an empty text": "",
    "a text": "zz",
    "a huge text": "z" * 10_000,
}


@cache
def rows_of_pydantic() -> set[str]:
    """What pydantic writes between the values of its messages, for each kind of error."""
    templates = {
        row[form]
        for row in list_all_errors()
        for form in ("message_template_python", "message_template_json")
        if form in row and row["type"] not in OWN_CHECK
    }
    pieces = {piece.strip(" ,.:'") for template in templates for piece in re.split(r"\{\w+\}", template)}
    return {piece for piece in pieces if len(piece.split()) >= LEAST_WORDS} | {"Input should be", "after validation"}


def leaked(text: str) -> list[str]:
    told = text.lower()
    return sorted(row for row in rows_of_pydantic() if row.lower() in told)


def arguments_of_tools() -> Iterator[tuple[type[BaseModel], str, str]]:
    """Each argument of each tool, and each field of the objects in them, as the model, the list and the field."""
    for spec in TOOLS:
        for name, field in spec.arguments_type.model_fields.items():
            yield spec.arguments_type, "", name
            for part in (part for arm in (field.annotation, *get_args(field.annotation)) for part in get_args(arm)):
                if isinstance(part, type) and issubclass(part, BaseModel):
                    yield from ((spec.arguments_type, name, inner) for inner in part.model_fields)


def refusal(model: type[BaseModel], given: dict[str, Any]) -> str:
    try:
        read_arguments(model, given)
    except InvalidRequest as error:
        return error.text
    return ""


def called_with(value: Any, model: type[BaseModel], held_by: str, name: str) -> dict[str, Any]:
    """A call that is good but for one argument."""
    needed = {
        other: [{"op": "add_vehicle"}] if other == "edits" else ["x"] if "[" in str(field.annotation) else "x"
        for other, field in model.model_fields.items()
        if field.is_required()
    }
    return needed | ({held_by: [{"op": "add_vehicle", name: value}]} if held_by else {name: value})


@pytest.mark.parametrize("value", BAD_VALUES.values(), ids=BAD_VALUES.keys())
def test_no_argument_of_a_tool_is_refused_in_words_of_pydantic(value: Any) -> None:
    told = {
        (model.__name__, held_by, name): text
        for model, held_by, name in arguments_of_tools()
        if (text := refusal(model, called_with(value, model, held_by, name)))
    }
    assert {place: words for place, text in told.items() if (words := leaked(text))} == {}
    for (_, held_by, name), text in told.items():
        assert (held_by or name) in text
        assert "Valid: " in text or re.search(r"the required argument '[^']+' \([^)]+\) is missing", text)
        assert ". Next: " in text
        assert len(text) < 3000


def test_a_tried_call_differs_from_a_good_one_in_one_argument() -> None:
    tried = list(arguments_of_tools())
    assert ("edits", "spacing_m") in {(held_by, name) for _, held_by, name in tried}
    for spec in TOOLS:
        name = next(iter(spec.arguments_type.model_fields))
        good = called_with("x", spec.arguments_type, "", name)
        told = refusal(spec.arguments_type, {key: value for key, value in good.items() if key != name})
        assert not told or re.search(rf"the required argument '{name}' \([^)]+\) is missing", told)


class Anything(Model):
    field: list[int] = Field([], min_length=1)


@pytest.mark.parametrize("kind", list_all_errors(), ids=lambda kind: str(kind["type"]))
def test_no_error_uses_pydantic_s_text(kind: Any) -> None:
    detail = InitErrorDetails(type=kind["type"], loc=("field",), input="zz", ctx=kind["example_context"] or {})
    error = ValidationError.from_exception_data("Anything", [detail])
    ((problem, valid),) = problems_of(Anything, error)
    assert "field" in problem
    assert kind["type"] in OWN_CHECK or leaked(problem) == []
    assert leaked(" ".join(valid)) == []


def test_words_of_pydantic_are_seen() -> None:
    assert "after validation" in leaked("edits: list should have at least 1 item after validation, not 0")
    with pytest.raises(ValidationError) as caught:
        Anything(field=["x"])  # type: ignore[list-item]
    assert leaked(caught.value.errors()[0]["msg"])


class Sizes(Arguments):
    some: list[int] = Field([0], min_length=1, max_length=3)
    pair: tuple[float, ...] = Field((0, 0), min_length=2, max_length=2)
    many: list[str] = Field(["x"], min_length=1)
    few: list[str] = Field([], max_length=2)
    word: str = Field("abc", min_length=2, max_length=4, pattern="^[a-z]+$")
    fixed: Literal[1] = 1


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"some": []}, "some cannot be empty. Valid: a list of 1 to 3 elements."),
        ({"some": [1, 2, 3, 4]}, "some cannot have 4 elements"),
        ({"some": [1, "x"]}, "some[1] cannot be 'x'"),
        ({"pair": [1]}, "pair cannot have 1 element"),
        ({"many": []}, "many cannot be empty"),
        ({"few": ["a", "b", "c"]}, "few cannot have 3 elements"),
        ({"word": "a"}, "word cannot have 1 character"),
        ({"word": "ABC"}, "word cannot be 'ABC'"),
        ({"fixed": 2}, "fixed cannot be 2"),
    ],
)
def test_a_size_is_reported_with_its_bounds(given: dict[str, Any], told: str) -> None:
    assert told in refusal(Sizes, given)


def test_a_value_that_is_not_an_object_is_reported() -> None:
    for value, told in (("7", "it takes an object, not 7"), ("{", "it is not valid JSON")):
        with pytest.raises(ValidationError) as caught:
            Sizes.model_validate_json(value)
        assert problem_of(Sizes, caught.value.errors(include_url=False)[0])[0] == told
