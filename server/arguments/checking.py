"""The gate of every call: limits the size of arguments, and turns validation errors into one clear line.

A refusal states the argument, the given value, the valid values, and the probable intention. Sizes are checked before
anything is parsed, compared or printed.
"""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from ...schemas.base import CHOICES, CLOSED_RANGES, Arguments, choices_of, model_at, problem_of
from ...schemas.errors import Change, InvalidRequest, Remedy, misspelt_names
from ...schemas.text import LONGEST_TEXT, one_line
from .loose_reading import read_loosely

_Arguments = TypeVar("_Arguments", bound=BaseModel)
_SHOWN_CHARACTERS = 60
"""Maximum characters of a given value in a refusal; chosen."""
_SHOWN_NOTE = 400
"""Maximum characters of a corrected call, or of a note on an interpretation; chosen."""
_CORRECTIONS = 3
"""Maximum rounds of correction until a call is valid: a name first, then what depends on it (chosen)."""
_SHOWN_PROBLEMS = 10
"""Maximum problems that a refusal lists; chosen."""
_LONGEST_LIST, _MOST_VALUES, _DEEPEST = 2000, 10_000, 6
"""Maximum elements of a list, values of a call, and levels of nested lists and objects; chosen far above any use."""
_LONGEST_LIST_TEXT = 50_000
"""Maximum characters of a list that is sent as JSON text; chosen."""
_LARGEST_NUMBER = 1e15
"""Whole numbers up to this are exact as floating-point numbers; larger ones have no use here."""


def read_arguments(model: type[_Arguments], given: Mapping[str, Any], notes: list[str] | None = None) -> _Arguments:
    """Return the arguments as their model; add a note to ``notes`` for each value that was interpreted.

    Raises:
        InvalidRequest: one line with the problems, and the corrected call if there is one.
    """
    _refuse_oversized(model, given)
    reading = read_loosely(model, given)
    _refuse_oversized(model, {name: value for name, value in reading.values.items() if value is not given.get(name)})
    try:
        read = model.model_validate(reading.values)
    except ValidationError as error:
        raise _explained(model, error, reading.values) from None
    if notes is not None:
        notes += [f"Note: {one_line(note, _SHOWN_NOTE)}" for note in reading.notes[:_SHOWN_PROBLEMS]]
    return read


@dataclass(frozen=True)
class _Oversize:
    """A problem with the size of a value: what is too large, the limit, and the remedy."""

    what: str
    valid: str
    next_step: str


def _refuse_oversized(model: type[BaseModel], given: Mapping[str, Any]) -> None:
    longest = model.longest_texts if issubclass(model, Arguments) else {}
    count = 0
    for name, value in given.items():
        most = _LONGEST_LIST_TEXT if _is_list_text(model, name, value) else longest.get(name, LONGEST_TEXT)
        for problem in _oversizes(value, most):
            count += 1
            if problem is not None:
                what = f"{one_line(name, _SHOWN_CHARACTERS)}: {problem.what}"
                raise InvalidRequest(what, valid=[problem.valid], next_step=problem.next_step)
            if count > _MOST_VALUES:
                raise InvalidRequest(
                    f"the arguments have more than {_MOST_VALUES:,} values",
                    valid=[f"at most {_MOST_VALUES:,} values"],
                    next_step="use several calls",
                )


def _oversizes(value: Any, longest: int, depth: int = 0) -> Iterator[_Oversize | None]:
    """Yield one entry for each value within ``value``, outermost first: its size problem, or None if it has none."""
    if isinstance(value, str):
        if len(value) > longest:
            yield _Oversize(f"a text of {len(value):,} characters", f"at most {longest:,} characters", "shorten it")
        yield None if value.isascii() or _is_unicode(value) else _HALF_A_CHARACTER
    elif isinstance(value, dict | list):
        if depth == _DEEPEST:
            what = f"more than {_DEEPEST} levels of nested lists and objects"
            yield _Oversize(what, f"at most {_DEEPEST} levels", "send it in the form of the tool's input schema")
        parts = f"{len(value):,} elements"
        is_long = len(value) > _LONGEST_LIST
        yield _Oversize(parts, f"at most {_LONGEST_LIST:,} elements", "use several calls") if is_long else None
        for part in (*value, *value.values()) if isinstance(value, dict) else value:
            yield from _oversizes(part, longest, depth + 1)
    elif isinstance(value, int | float) and _LARGEST_NUMBER < abs(value) < math.inf:
        bound = f"{_LARGEST_NUMBER:g}"
        yield _Oversize(f"a number beyond ±{bound}", f"-{bound} to {bound}", "send a smaller one")
    else:
        yield None


_HALF_A_CHARACTER = _Oversize(
    "half a character (a lone surrogate) is not text", "whole Unicode characters", "leave it out"
)


def _is_unicode(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _is_list_text(model: type[BaseModel], name: str, value: Any) -> bool:
    return _takes_list(model, name) and isinstance(value, str) and value.lstrip().startswith(("[", "{"))


def _takes_list(model: type[BaseModel], name: str) -> bool:
    field = model.model_fields.get(name)
    return field is not None and re.search(r"\b(list|tuple)\[", str(field.annotation)) is not None


def _explained(model: type[BaseModel], error: ValidationError, given: Mapping[str, Any]) -> InvalidRequest:
    details = error.errors(include_url=False)
    problems = [
        problem_of(model, detail, "argument", ranged=False, alone=len(details) == 1)
        for detail in details[:_SHOWN_PROBLEMS]
    ]
    more = [f"and {len(details) - _SHOWN_PROBLEMS:,} more like these"] if len(details) > _SHOWN_PROBLEMS else []
    valid = [name for _, names in problems for name in names]
    valid += _examples(model, details)
    corrected = _corrected(model, details, given)
    these = "this argument" if len(details) == 1 else "these arguments"
    remedies, step = list[Remedy](), f"correct {these} and call again"
    if all(detail["type"] == "missing" for detail in details):
        step = f"call again with {these}"
    if corrected is not None:
        is_replaced = all(set(detail["loc"][:1]) <= {*corrected} for detail in details if detail["type"] in CHOICES)
        step = "" if is_replaced else "use a valid value"
        names = dict.fromkeys((*given, *corrected))
        changed = {name: corrected.get(name) for name in names if corrected.get(name) != given.get(name)}
        remedies.append(Remedy((Change(values=changed),), corrects_spelling=is_replaced))
    return InvalidRequest(
        "; ".join([*(text for text, _ in problems), *more]),
        valid=dict.fromkeys(valid),
        next_step=step,
        remedies=remedies,
        complete=all(detail["type"] in ("literal_error", "enum", *CLOSED_RANGES) for detail in details),
    )


def _examples(model: type[BaseModel], details: Sequence[ErrorDetails]) -> Iterator[str]:
    """Yield an example of each required argument that is missing or empty, if the arguments have one."""
    shown = model.examples if issubclass(model, Arguments) else {}
    for detail in details:
        name = str(detail["loc"][0]) if len(detail["loc"]) == 1 else ""
        if name in shown and detail["type"] in ("missing", "too_short", "string_too_short"):
            yield f"for instance {name}={json.dumps(shown[name])}"


def _corrected(
    model: type[BaseModel], details: Sequence[ErrorDetails], given: Mapping[str, Any]
) -> dict[str, Any] | None:
    """Return arguments with invalid values replaced by the nearest valid ones or removed, or None if that fails."""
    values = json.loads(json.dumps(given, default=str))
    for _ in range(_CORRECTIONS):
        # From the back, so that removing a list element does not move the others.
        mended = [_correct_fault(model, detail, values) for detail in reversed(details)]
        if not all(mended):
            return None
        try:
            model.model_validate(values)
        except ValidationError as error:
            details = error.errors(include_url=False)
            continue
        return values if isinstance(values, dict) else None
    return None


def _correct_fault(model: type[BaseModel], detail: ErrorDetails, values: Any) -> bool:
    """Replace an invalid value by the nearest valid value, or remove it; return whether that was possible."""
    *holder, last = detail["loc"] or ("",)
    place: Any = values
    try:
        for part in holder:
            place = place[part]
        if detail["type"] == "missing":
            usual = _usual_value(model, detail["loc"])
            if usual is not None:
                place[last] = usual
            return usual is not None
        if detail["type"] == "extra_forbidden":
            near = _nearest(str(last), model_at(model, detail["loc"]).model_fields)
            value = place.pop(last)
            if near and near not in place:
                place[near] = value
            return True
        near = _nearest(str(detail["input"]), choices_of(detail))
        if near:
            place[last] = near
            return True
        bound = _nearest_bound(detail)
        if bound is not None:
            place[last] = bound
            return True
        return _without(model, detail["loc"], values)
    except (KeyError, IndexError, TypeError):
        return False


def _nearest_bound(detail: ErrorDetails) -> Any:
    """Return the bound that a number violates, or the allowed part of a list; None for any other fault."""
    limits = detail.get("ctx", {})
    if detail["type"] in ("greater_than_equal", "less_than_equal"):
        bound = limits["ge"] if "ge" in limits else limits["le"]
        return int(bound) if isinstance(detail["input"], int) and float(bound).is_integer() else bound
    if detail["type"] == "too_long" and isinstance(detail["input"], list):
        return detail["input"][: limits["max_length"]]
    if detail["type"] == "int_from_float" and isinstance(detail["input"], float) and math.isfinite(detail["input"]):
        return round(detail["input"])
    return None


def _usual_value(model: type[BaseModel], location: tuple[int | str, ...]) -> Any:
    """Return the usual value of a required field, or None."""
    holder = model_at(model, location)
    return holder.usual_values.get(str(location[-1])) if issubclass(holder, Arguments) else None


def _without(model: type[BaseModel], location: tuple[int | str, ...], values: Any) -> bool:
    """Remove a field with an invalid value, or reset it to its usual value; return whether the model allows that."""
    named = max((index for index, part in enumerate(location) if isinstance(part, str)), default=-1)
    if named < 0:
        return False
    holder: Any = values
    for part in location[:named]:
        holder = holder[part]
    name = str(location[named])
    field = model_at(model, location[: named + 1]).model_fields[name]
    usual = _usual_value(model, location[: named + 1])
    if usual is not None:
        holder[name] = usual
    elif field.is_required():
        return False
    else:
        holder.pop(name, None)
    return True


def _nearest(name: str, known: Iterable[str]) -> str:
    """Return the valid name that a word most likely misspells, or an empty string."""
    return next(iter(misspelt_names(name, known)), "")
