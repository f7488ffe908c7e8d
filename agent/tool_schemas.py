"""Schemas of tools for small models: flat, without references, with bounds and defaults in descriptions.

Model servers forward only the type, the items, the description and the choices of a property, so everything that a
model must know about it belongs in the description.
"""

from collections.abc import Mapping
from typing import Any

_WORDS = {
    "minimum": "at least {}",
    "maximum": "at most {}",
    "exclusiveMinimum": "more than {}",
    "exclusiveMaximum": "less than {}",
    "minLength": "at least {} characters",
    "maxLength": "at most {} characters",
    "minItems": "at least {} items",
    "maxItems": "at most {} items",
    "pattern": "of the form {}",
    "default": "default {}",
}
_KEPT = ("type", "description", "enum", "items", "properties", "required", "additionalProperties")
_DEEPEST = 8
"""Maximum nesting of references, since a schema may refer to itself (chosen)."""


def flattened(schema: Mapping[str, Any]) -> dict[str, Any]:
    """Return an object's schema with references inlined, null arms dropped, and bounds and defaults in descriptions."""
    definitions = schema.get("$defs", {})
    flat = _flat(schema, definitions, 0)
    flat.pop("description", None)
    return {"type": "object", "properties": {}, **flat}


def _flat(schema: Mapping[str, Any], definitions: Mapping[str, Any], depth: int) -> dict[str, Any]:
    if depth > _DEEPEST:
        return {}
    schema = _with_choices(_without_null(_resolved(schema, definitions), definitions))
    flat = {key: schema[key] for key in _KEPT if key in schema}
    if isinstance(flat.get("items"), Mapping):
        flat["items"] = _flat(flat["items"], definitions, depth + 1)
    if isinstance(flat.get("properties"), Mapping):
        flat["properties"] = {name: _flat(part, definitions, depth + 1) for name, part in flat["properties"].items()}
    notes = [words.format(schema[key]) for key, words in _WORDS.items() if schema.get(key) not in (None, "", [])]
    if notes:
        described = str(flat.get("description", "")).rstrip(". ")
        flat["description"] = f"{described} ({', '.join(notes)})".strip()
    return flat


def _with_choices(schema: Mapping[str, Any]) -> Mapping[str, Any]:
    if "const" not in schema:
        return schema
    return {**{key: value for key, value in schema.items() if key != "const"}, "enum": [schema["const"]]}


def _resolved(schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> Mapping[str, Any]:
    name = str(schema.get("$ref", "")).rpartition("/")[2]
    if not name:
        return schema
    others = {key: value for key, value in schema.items() if key != "$ref"}
    return {**definitions.get(name, {}), **others}


def _without_null(schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> Mapping[str, Any]:
    """Merge a schema's ``anyOf``: the single arm that is not null, or the types of all arms together."""
    arms = [_resolved(arm, definitions) for arm in schema.get("anyOf", schema.get("oneOf", ()))]
    arms = [_with_choices(arm) for arm in arms if arm.get("type") != "null"]
    others = {key: value for key, value in schema.items() if key not in ("anyOf", "oneOf")}
    if isinstance(others.get("type"), list):
        types = [kind for kind in others["type"] if kind != "null"]
        others["type"] = types[0] if len(types) == 1 else types
    if not arms:
        return others
    if len(arms) == 1:
        return {**arms[0], **others}
    together = dict(arms[0])
    types = list(dict.fromkeys(str(arm["type"]) for arm in arms if "type" in arm))
    choices = [choice for arm in arms for choice in arm.get("enum", ())]
    if all("enum" in arm for arm in arms):
        together["enum"] = choices
    else:
        together.pop("enum", None)
    if types:
        together["type"] = types[0] if len(types) == 1 else types
    return {**together, **others}
