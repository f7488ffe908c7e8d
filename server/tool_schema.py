"""JSON Schemas of the tools, as lean as possible but complete; and the server's icon.

The server reads them from files rather than computing them, so that the first answer is fast. The files are the
reviewed contract: ``pytest tests/contract --update-snapshots`` generates them from the models, and the contract tests
fail if the two differ.
"""

import base64
from collections import Counter
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from typing import Any

from mcp.types import Icon, Tool, ToolAnnotations
from pydantic import BaseModel

from ..resources.apps import page_uri
from ..tools.registry import ToolSpec

_LENGTHS = ("minItems", "maxItems")
"""Bounds that an input schema omits."""


def described_tool(spec: ToolSpec) -> Tool:
    """Return the tool with its description, schemas and annotations, without importing its models.

    If a tool that is still in development has no description file, its description is built from the models.
    """
    file = files("plannerforge.server").joinpath("descriptions", f"{spec.name}.json")
    if not file.is_file():
        return _without_unlisted(tool_description(spec), spec)
    return _without_unlisted(Tool.model_validate_json(file.read_text(encoding="utf-8")), spec)


def server_icons() -> list[Icon]:
    """Return the server's icon for hosts, embedded in the message, so that nothing needs to be fetched.

    Clients must be able to draw PNG and should be able to draw SVG. Tools have no icon, because it would be repeated 17
    times.
    """
    found = []
    for name, mime_type, size in (("icon.svg", "image/svg+xml", "any"), ("icon.png", "image/png", "48x48")):
        data = base64.b64encode(files("plannerforge.server").joinpath("descriptions", name).read_bytes()).decode()
        found.append(Icon(src=f"data:{mime_type};base64,{data}", mime_type=mime_type, sizes=[size]))
    return found


def _without_unlisted(tool: Tool, spec: ToolSpec) -> Tool:
    """Return the tool without the arguments that this listing omits; callers may still use them."""
    listed = tool.input_schema.get("properties", {})
    kept = {name: schema for name, schema in listed.items() if name not in spec.unlisted}
    is_reading = spec.read_only and not spec.making
    hints = tool.annotations and tool.annotations.model_copy(update={"read_only_hint": is_reading})
    shown = tool.model_copy(update={"annotations": hints})
    return shown.model_copy(update={"input_schema": {**tool.input_schema, "properties": kept}}) if listed else shown


@cache
def tool_description(spec: ToolSpec) -> Tool:
    """Return the tool as a client sees it: name, description, schemas, annotations."""
    arguments, result = spec.arguments_type, spec.result_type
    return Tool(
        name=spec.name,
        title=spec.title,
        description=" ".join((arguments.__doc__ or "").split()),
        input_schema=input_schema(arguments),
        output_schema=None if result is None else folded(output_schema(result)),
        annotations=ToolAnnotations(
            title=spec.title,
            read_only_hint=spec.read_only and not spec.making,
            destructive_hint=False,
            idempotent_hint=True,
            open_world_hint=spec.open_world,
        ),
        _meta=None if spec.view is None else {"ui": {"resourceUri": page_uri(spec.view)}},
    )


def input_schema(model: type[BaseModel]) -> dict[str, Any]:
    """Return the schema without titles, references, null arms and lengths of lists, which a refusal states.

    This takes fewer tokens, and small models understand it.
    """
    schema = model.model_json_schema(mode="validation")
    lean = _lean(schema, schema.get("$defs", {}))
    lean.pop("description", None)
    return {"type": "object", **lean}


def output_schema(model: type[BaseModel]) -> dict[str, Any]:
    """Return the schema of a structured answer; null arms stay, because clients validate against it."""
    schema: dict[str, Any] = _without_noise(model.model_json_schema(mode="serialization"))
    return schema


def folded(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema with definitions used once inlined, and null as the first arm.

    Clients check every answer against it: following a name, or trying an arm in vain, takes longer than checking a
    value.
    """
    definitions = schema.get("$defs", {})
    names = Counter(_names(schema))

    def placed(part: Any) -> Any:
        if isinstance(part, list):
            return [placed(entry) for entry in part]
        if not isinstance(part, dict):
            return part
        name = _name_of(part)
        if names[name] == 1:
            return placed({**definitions[name], **{key: value for key, value in part.items() if key != "$ref"}})
        whole = {key: placed(value) for key, value in part.items()}
        if isinstance(whole.get("anyOf"), list):
            whole["anyOf"].sort(key=lambda arm: arm.get("type") != "null")
        return whole

    kept = {name: part for name, part in definitions.items() if names[name] > 1}
    rest = {key: part for key, part in schema.items() if key != "$defs"}
    whole: dict[str, Any] = placed({"$defs": kept, **rest} if kept else rest)
    return whole


def _names(schema: Any) -> Iterator[str]:
    """Yield the name of each definition, as often as a schema refers to it."""
    if isinstance(schema, dict) and "$ref" in schema:
        yield _name_of(schema)
    for part in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
        yield from _names(part)


def _name_of(schema: dict[str, Any]) -> str:
    """Return the name of the definition that a schema refers to, or an empty string."""
    return str(schema.get("$ref", "")).rpartition("/")[2]


def _lean(schema: Any, definitions: dict[str, Any]) -> Any:
    if isinstance(schema, list):
        return [_lean(part, definitions) for part in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        target = {**definitions[schema["$ref"].rpartition("/")[2]]}
        if "description" not in schema:
            target.pop("description", None)
        return _lean({**target, **{k: v for k, v in schema.items() if k != "$ref"}}, definitions)
    kept = {
        key: part
        for key, part in schema.items()
        if key not in ("$defs", *_LENGTHS) and not (key == "title" and isinstance(part, str))
    }
    if "anyOf" in kept:
        arms = [arm for arm in kept["anyOf"] if arm.get("type") != "null"]
        del kept["anyOf"]
        if len(arms) == 1:
            return _lean({**arms[0], **kept}, definitions)
        kept["anyOf"] = arms
    if kept.get("default", "") in (None, []):  # what is left out anyway
        del kept["default"]
    return {
        key: {name: _lean(part, definitions) for name, part in value.items()}
        if key == "properties"
        else _lean(value, definitions)
        for key, value in kept.items()
    }


def _without_noise(schema: Any) -> Any:
    if isinstance(schema, list):
        return [_without_noise(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    return {
        key: {name: _without_noise(part) for name, part in value.items()}
        if key in ("properties", "$defs")
        else _without_noise(value)
        for key, value in schema.items()
        if not (key in ("title", "description") and isinstance(value, str))
    }
