"""Validation errors in one clear line: which argument, what was given, what is allowed, what was probably meant."""

import json
import re
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from ..schemas.errors import InvalidRequest, closest

_Arguments = TypeVar("_Arguments", bound=BaseModel)
_SHOWN_CHARACTERS = 60
"""Characters of a given value that a refusal repeats; chosen."""


def read_arguments(model: type[_Arguments], given: Mapping[str, Any]) -> _Arguments:
    """The arguments as their model.

    Hosts and small models send lists as JSON text, or one element without its list: both are unambiguous and taken.

    Raises:
        InvalidRequest: one line that names every problem.
    """
    try:
        return model.model_validate({name: _unwrapped(model, name, value) for name, value in given.items()})
    except ValidationError as error:
        raise _explained(model, error) from None


def _unwrapped(model: type[BaseModel], name: str, value: Any) -> Any:
    field = model.model_fields.get(name)
    if field is None or value is None or not re.search(r"\b(list|tuple)\[", str(field.annotation)):
        return value
    if isinstance(value, str) and value.lstrip().startswith(("[", "{")):
        try:
            value = json.loads(value)
        except (ValueError, RecursionError):
            return value
    return value if isinstance(value, list) else [value]


def _explained(model: type[BaseModel], error: ValidationError) -> InvalidRequest:
    problems = [_problem(model, detail) for detail in error.errors(include_url=False)]
    valid = [name for _, names in problems for name in names]
    return InvalidRequest("; ".join(text for text, _ in problems), valid=dict.fromkeys(valid))


def _problem(model: type[BaseModel], detail: ErrorDetails) -> tuple[str, list[str]]:
    path = _path(detail["loc"])
    if detail["type"] == "extra_forbidden":
        fields = list(_model_at(model, detail["loc"]).model_fields)
        return f"there is no argument '{path}'", closest(str(detail["loc"][-1]), fields, limit=len(fields))
    if detail["type"] == "missing":
        return f"the argument '{path}' is missing", [f"{path}={_wanted(model, detail['loc'])}"]
    given = _short(detail["input"])
    if detail["type"] == "literal_error":
        allowed = re.findall(r"'([^']*)'", str(detail.get("ctx", {}).get("expected", "")))
        return f"{path} cannot be {given}", closest(str(detail["input"]), allowed, limit=len(allowed))
    message = detail["msg"][:1].lower() + detail["msg"][1:]
    message = re.sub(r"^(value error|assertion failed), ", "", message)
    return f"{path}: {message} (given: {given})", [f"{path}: {_wanted(model, detail['loc'])}"]


def _path(location: tuple[int | str, ...]) -> str:
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text or "arguments"


def _model_at(model: type[BaseModel], location: tuple[int | str, ...]) -> type[BaseModel]:
    """The model that holds the last part of the location: the arguments themselves, or the flat object of a list."""
    current = model
    for part in location[:-1]:
        if isinstance(part, str) and part in current.model_fields:
            nested = _nested(current.model_fields[part].annotation)
            current = nested or current
    return current


def _nested(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for part in getattr(annotation, "__args__", ()):
        model = _nested(part)
        if model is not None:
            return model
    return None


def _wanted(model: type[BaseModel], location: tuple[int | str, ...]) -> str:
    """What an argument takes, in words, from its schema."""
    name = next((part for part in reversed(location) if isinstance(part, str)), "")
    holder = _model_at(model, location)
    schema = holder.model_json_schema().get("properties", {}).get(name, {})
    arms = [arm for arm in schema.get("anyOf", [schema]) if arm.get("type") != "null"]
    arm = arms[0] if arms else {}
    if location and isinstance(location[-1], int):
        arm = arm.get("items", {})
    kind = {"array": "a list", "string": "text", "integer": "a whole number", "number": "a number"}.get(
        arm.get("type", "")
    )
    bounds = [f"{word} {arm[key]:g}" for key, word in _BOUNDS if key in arm]
    choices = ", ".join(map(str, arm.get("enum", ())))
    described = f" ({schema['description']})" if schema.get("description") else ""
    return " ".join([choices or kind or "a value", *bounds]) + described


_BOUNDS = (("minimum", "from"), ("exclusiveMinimum", "above"), ("maximum", "to"), ("exclusiveMaximum", "below"))


def _short(value: Any) -> str:
    text = repr(value) if isinstance(value, str) else json.dumps(value, default=str)
    return text if len(text) <= _SHOWN_CHARACTERS else text[:_SHOWN_CHARACTERS] + "…"
