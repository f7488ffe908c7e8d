"""The schemas of all tools are part of the contract: a change shows in the files that the server sends."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from plannerforge.server.tool_schema import described_tool, tool_description
from plannerforge.tools.registry import TOOLS, ToolSpec

SNAPSHOTS = Path(__file__).parents[2] / "server" / "descriptions"


def _keys_within(schema: object) -> Iterator[str]:
    if isinstance(schema, dict):
        yield from schema
    for part in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
        yield from _keys_within(part)


@pytest.mark.parametrize("spec", TOOLS, ids=lambda spec: spec.name)
def test_no_schema_has_a_bound_that_some_hosts_refuse(spec: ToolSpec) -> None:
    described = described_tool(spec)
    for schema in (described.input_schema, described.output_schema):
        assert not {"exclusiveMinimum", "exclusiveMaximum"} & set(_keys_within(schema))


@pytest.mark.parametrize("spec", TOOLS, ids=lambda spec: spec.name)
def test_the_schema_of_a_tool_is_the_one_in_its_snapshot(spec: ToolSpec, request: pytest.FixtureRequest) -> None:
    described = tool_description(spec).model_dump(mode="json", by_alias=True, exclude_none=True)
    current = json.dumps(described, indent=1, ensure_ascii=False) + "\n"
    snapshot = SNAPSHOTS / f"{spec.name}.json"
    if request.config.getoption("--update-snapshots"):
        SNAPSHOTS.mkdir(exist_ok=True)
        snapshot.write_text(current, encoding="utf-8")
    assert current == snapshot.read_text(encoding="utf-8"), "run pytest tests/contract --update-snapshots and look"


@pytest.mark.parametrize("spec", TOOLS, ids=lambda spec: spec.name)
def test_the_server_s_schemas_match_the_models(spec: ToolSpec) -> None:
    assert described_tool(spec) == tool_description(spec)


@pytest.mark.parametrize("spec", TOOLS, ids=lambda spec: spec.name)
def test_a_tool_has_its_title_also_for_older_clients(spec: ToolSpec) -> None:
    tool = described_tool(spec)
    assert tool.title == spec.title
    assert tool.annotations is not None
    assert tool.annotations.title == spec.title


def test_every_snapshot_belongs_to_a_tool() -> None:
    assert {path.stem for path in SNAPSHOTS.glob("*.json")} == {spec.name for spec in TOOLS}


@pytest.mark.parametrize("spec", TOOLS, ids=lambda spec: spec.name)
def test_input_schemas_are_flat(spec: ToolSpec) -> None:
    text = json.dumps(tool_description(spec).input_schema)
    assert "$ref" not in text
    assert "anyOf" not in text
    assert '"additionalProperties": false' in text
    for name, part in tool_description(spec).input_schema["properties"].items():
        nested = part.get("items", {})
        assert part.get("type") != "object", name
        assert all(inner.get("type") != "object" for inner in nested.get("properties", {}).values()), name
