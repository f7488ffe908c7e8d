"""Reads arguments as small models write them, if they are unambiguous; notes report each interpretation.

It accepts other forms of the same value: a number as text, with its unit; one value for a list; JSON text for a list or
an object; an id as a number; different case. A field's name may lack its unit. Ambiguous values stay as they are, and
the model of the arguments rejects them.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from ...schemas.text import uncited

_UNITS: Mapping[str, tuple[str, ...]] = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "m": ("m", "meter", "meters", "metre", "metres"),
    "mps": ("m/s", "mps"),
}
"""The unit suffixes of field names, and how people write these units after a number."""
_ENDINGS = ("_id", "_s", "_m", "_mps")
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*([a-z/]*)\s*", re.IGNORECASE)
_SHOWN = 40
"""Maximum characters of a value in a note (chosen)."""


@dataclass
class LooseReading:
    """Arguments with corrected names and forms; ``notes`` describe each interpretation."""

    values: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def read_loosely(model: type[BaseModel], given: Mapping[str, Any], where: str = "") -> LooseReading:
    """Return the given values in the forms that a model's fields accept; unreadable values stay as they are."""
    reading = LooseReading()
    for name, value in given.items():
        resolved = _resolve_field(model, name, given)
        path = f"{where}{resolved}"
        if resolved != name:
            reading.notes.append(f"the argument {where}{name} was taken as {path}")
        if resolved not in model.model_fields:
            reading.values[name] = value
            continue
        if value is None and not _accepts_none(model.model_fields[resolved].annotation):
            reading.notes.append(f"{path}=null is read as not given")
            continue
        field_of = model.model_fields[resolved]
        written = _as_assignments(value) if _takes_assignments(field_of) else value
        read = _value(field_of.annotation, written, path, reading.notes)
        if not _is_same(read, value):
            reading.notes.append(f"{path}={_short(value)} is read as {_short(read)}")
        reading.values[resolved] = read
    return reading


def _takes_assignments(field_of: FieldInfo) -> bool:
    """Return whether a field takes a list of texts such as ``jerk=0.5``, as its description shows."""
    return "list[str]" in str(field_of.annotation) and "=" in (field_of.description or "")


def _as_assignments(value: Any) -> Any:
    """Return a value with each object of names and values, such as ``{"jerk": 0.5}``, as texts: ``jerk=0.5``."""
    if isinstance(value, str) and value.lstrip().startswith("{"):
        try:
            value = json.loads(value)
        except (ValueError, RecursionError):
            return value
    parts = value if isinstance(value, list) else [value]
    if not any(isinstance(part, dict) for part in parts):
        return value
    return [text for part in parts for text in (_assignments_of(part) if isinstance(part, dict) else [part])]


def _assignments_of(pairs: dict[str, Any]) -> list[Any]:
    plain = all(isinstance(value, int | float | str) and not isinstance(value, bool) for value in pairs.values())
    return [f"{name}={value}" for name, value in pairs.items()] if plain else [pairs]


def _resolve_field(model: type[BaseModel], name: str, given: Mapping[str, Any]) -> str:
    """Return the only field that a name can refer to, ignoring case and a missing unit; else the name itself."""
    fields = model.model_fields
    if name in fields:
        return name
    plain = _plain(name)
    alike = [known for known in fields if _plain(known) == plain]
    stems = [
        known
        for known in fields
        if any(known.endswith(end) and _plain(known[: -len(end)]) == plain for end in _ENDINGS)
    ]
    lists = [known for known in fields if known in (f"{name}s", f"{name}es")]
    for candidates in (alike, stems, lists):
        free = [known for known in candidates if known not in given]
        if len(free) == 1:
            return free[0]
    return name


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _arms(annotation: Any) -> tuple[Any, ...]:
    return get_args(annotation) if get_origin(annotation) in (Union, UnionType) else (annotation,)


def _accepts_none(annotation: Any) -> bool:
    return type(None) in _arms(annotation)


def _value(annotation: Any, value: Any, path: str, notes: list[str], *, in_list: bool = False) -> Any:
    """Return a value in the form an annotation accepts; a list of one becomes its element unless ``in_list``."""
    arms = [arm for arm in _arms(annotation) if arm is not type(None)]
    if value is None or len(arms) != 1:
        return value
    arm = arms[0]
    if get_origin(arm) in (list, tuple):
        return _elements(get_args(arm)[0], value, path, notes)
    if get_origin(arm) is Literal:
        return _choice(get_args(arm), value)
    if not in_list and isinstance(value, list) and len(value) == 1 and not isinstance(value[0], list | dict):
        value = value[0]
    if isinstance(arm, type) and issubclass(arm, BaseModel):
        return _object(arm, value, path, notes)
    if arm in (int, float):
        return _number(value, path) if isinstance(value, str) else value
    if arm is str and isinstance(value, int | float) and not isinstance(value, bool):
        return f"{value:g}" if isinstance(value, float) else str(value)
    return uncited(value) if arm is str and isinstance(value, str) else value


def _elements(element: Any, value: Any, path: str, notes: list[str]) -> Any:
    if isinstance(value, str) and value.lstrip().startswith(("[", "{")):
        try:
            value = json.loads(value)
        except (ValueError, RecursionError):
            return value
    listed = value if isinstance(value, list) else [value]
    return [_value(element, one, f"{path}[{index}]", notes, in_list=True) for index, one in enumerate(listed)]


def _object(model: type[BaseModel], value: Any, path: str, notes: list[str]) -> Any:
    if isinstance(value, str) and value.lstrip().startswith("{"):
        try:
            value = json.loads(value)
        except (ValueError, RecursionError):
            return value
    if not isinstance(value, dict):
        return value
    inner = read_loosely(model, value, f"{path}.")
    notes += inner.notes
    return inner.values


def _choice(choices: tuple[Any, ...], value: Any) -> Any:
    if not isinstance(value, str) or value in choices:
        return value
    alike = [choice for choice in choices if isinstance(choice, str) and _plain(choice) == _plain(value)]
    return alike[0] if len(alike) == 1 else value


def _number(text: str, path: str) -> Any:
    """Return the number in a text, with or without the unit of its field."""
    found = _NUMBER.fullmatch(text)
    if found is None:
        return text
    unit = path.rpartition("_")[2]
    if found[2] and found[2].lower() not in _UNITS.get(unit, ()):
        return text
    number = float(found[1])
    return int(number) if number.is_integer() and "." not in found[1] and "e" not in found[1].lower() else number


def _is_same(read: Any, value: Any) -> bool:
    """Return whether a value was used unchanged; lists of objects always count as unchanged, since objects have
    notes.
    """
    if isinstance(read, list) and isinstance(value, list) and any(isinstance(one, dict) for one in read):
        return all(isinstance(one, dict) for one in value)
    return type(read) is type(value) and read == value


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 1]}…"
