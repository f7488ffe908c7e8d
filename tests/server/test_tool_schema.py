"""Schemas of tools: inputs lean enough for small models, outputs true enough for clients that validate."""

from collections.abc import Iterator
from enum import Enum
from typing import Any, Literal

import jsonschema
import pytest
from pydantic import Field

from plannerforge.schemas.base import Answer, Arguments, Model, Result
from plannerforge.server.tool_schema import folded, input_schema, output_schema, tool_description
from plannerforge.tools.registry import TOOLS, ToolSpec


class Class(Enum):
    CAR = "car"
    TRUCK = "truck"


class Target(Model):
    """An object that a list holds."""

    title: str
    speed_mps: float | None = Field(None, ge=0, description="where it differs")


class Told(Model):
    """An object that one field holds."""

    words: str


class Request(Arguments):
    """Ask for something.

    In two paragraphs.
    """

    title: str = Field(description="its name")
    anyOf: int = 3  # noqa: N815 - a name that means something in a schema
    limit: int | None = Field(None, ge=1, description="at most")
    vehicle_class: Class | None = None
    either: float | str | None = None
    targets: list[Target] = Field(default=[])
    nested: Target | None = Field(None, description="one of them")
    mode: Literal["a", "b"] | None = None
    flag: bool = False


class SchemaResult(Result):
    limit: int | None = Field(None, description="noise")
    targets: tuple[Target, ...] = ()

    def answer(self) -> Answer:
        return Answer("")


@pytest.fixture
def schema() -> dict[str, Any]:
    return input_schema(Request)


def schemas_in(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    yield schema
    for part in schema.get("properties", {}).values():
        yield from schemas_in(part)
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            yield from schemas_in(schema[key])
    for arm in schema.get("anyOf", ()):
        yield from schemas_in(arm)


def assert_lean(schema: dict[str, Any]) -> None:
    for part in schemas_in(schema):
        assert not {"title", "$ref", "$defs"} & set(part), part
        assert part.get("type") != "null"
        assert part.get("default", "") is not None


def test_input_has_no_titles_references_and_null_arms(schema: dict[str, Any]) -> None:
    assert_lean(schema)
    assert schema["type"] == "object"
    assert schema["additionalProperties"] is False
    assert schema["required"] == ["title"]
    assert "description" not in schema, "it is the tool's"


def test_input_keeps_meaning_bounds_choices_and_defaults(schema: dict[str, Any]) -> None:
    properties = schema["properties"]
    assert properties["title"] == {"type": "string", "description": "its name"}
    assert properties["anyOf"] == {"type": "integer", "default": 3}
    assert properties["limit"] == {"type": "integer", "minimum": 1, "description": "at most"}
    assert properties["vehicle_class"] == {"type": "string", "enum": ["car", "truck"]}
    assert properties["either"] == {"anyOf": [{"type": "number"}, {"type": "string"}]}
    assert properties["mode"] == {"type": "string", "enum": ["a", "b"]}
    assert properties["flag"] == {"type": "boolean", "default": False}
    assert properties["nested"]["description"] == "one of them"
    target = properties["targets"]["items"]
    assert target["properties"]["title"] == {"type": "string"}
    assert target["required"] == ["title"]


def test_the_input_schema_accepts_what_the_model_accepts(schema: dict[str, Any]) -> None:
    validator = jsonschema.Draft202012Validator(schema)
    assert validator.is_valid({"title": "x", "limit": 2, "vehicle_class": "car", "targets": [{"title": "y"}]})
    assert not validator.is_valid({"title": "x", "limit": 0})
    assert not validator.is_valid({"title": "x", "unknown": 0})


def test_output_keeps_null_arms_so_that_real_answers_validate() -> None:
    schema = output_schema(SchemaResult)
    assert "title" in schema["$defs"]["Target"]["properties"]
    assert "title" not in schema
    jsonschema.validate(SchemaResult(targets=(Target(title="x"),)).model_dump(mode="json"), schema)


class Pair(Result):
    """Two of a kind that is named twice, and one of a kind that is named once."""

    first: Target
    second: Target | None
    told: Told | None = None
    anyOf: int = 3  # noqa: N815 - a name that means something in a schema

    def answer(self) -> Answer:
        """Nothing that matters here."""
        return Answer("a pair")


def test_the_folded_output_names_only_repeated_parts_and_has_null_first() -> None:
    schema = folded(output_schema(Pair))
    assert list(schema["$defs"]) == ["Target"]
    assert schema["properties"]["second"]["anyOf"][0] == {"type": "null"}
    assert schema["properties"]["told"]["anyOf"][1]["properties"] == {"words": {"type": "string"}}
    answer = Pair(first=Target(title="a"), second=None, told=Told(words="b")).model_dump(mode="json")
    jsonschema.validate(answer, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**answer, "told": {"words": 1}}, schema)


@pytest.mark.parametrize("spec", TOOLS, ids=lambda spec: spec.name)
def test_every_tool_has_a_lean_flat_input_and_a_description(spec: ToolSpec) -> None:
    tool = tool_description(spec)
    assert_lean(tool.input_schema)
    assert tool.description
    assert "\n" not in tool.description
    assert (tool.output_schema is None) == (spec.result_type is None)
    for name, part in tool.input_schema["properties"].items():
        assert part.get("type") != "object", f"{name} nests"
        for inner in part.get("items", {}).get("properties", {}).values():
            assert inner.get("type") != "object", f"{name} nests twice"
