"""Base classes of all models, the form of an answer, and our own messages for values that a model refuses."""

import html
import json
import re
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Final

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from .errors import closest
from .text import counted, one_line, quoted, stated_once

LONGEST_PATH = 4000
"""The maximum length of a path in characters. Linux allows 4,096 bytes."""


class Model(BaseModel):
    """A frozen model that rejects unknown fields and numbers that are not finite.

    Its validator is built at first use, because the server uses few models at start-up.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, ser_json_inf_nan="constants", defer_build=True
    )


class Arguments(Model):
    """The arguments of a tool: flat (primitives, enumerations, lists of primitives or of one flat object)."""

    longest_texts: ClassVar[Mapping[str, int]] = {}
    """The maximum lengths of text arguments that are not names or ids (which may have 200), in characters."""
    usual_values: ClassVar[Mapping[str, Any]] = {}
    """The values that a refusal suggests for required arguments."""
    examples: ClassVar[Mapping[str, Any]] = {}
    """Values that a refusal names for required arguments without a usual value, to show their form."""


@dataclass(frozen=True)
class Answer:
    """The text of an answer, in reading order. Each part has one line per item and may be empty.

    - ``headline``: the result, with its id
    - ``decided``: what was done or chosen, and why
    - ``figures``: measured values
    - ``listed``: the requested list, one item per line
    - ``warnings``: what requires an action
    - ``next_step``: the next call

    Technical notes are in the structured answer, and in the text only if ``detail`` requests them.
    """

    headline: str
    decided: Sequence[str] = ()
    figures: Sequence[str] = ()
    listed: Sequence[str] = ()
    warnings: Sequence[str] = ()
    next_step: str = ""

    def to_text(self) -> str:
        """Return the parts in order, one line each."""
        warnings = (f"Warning: {warning}" for warning in self.warnings)
        following = [f"Next: {self.next_step}"] if self.next_step else []
        parts = [self.headline, *self.decided, *self.figures, *self.listed, *warnings, *following]
        return stated_once("\n".join(parts))


def first_of(lines: Sequence[str], most: int, rest: str) -> list[str]:
    """Return the first ``most`` lines; if there are more, add their number and ``rest``, the call that shows them."""
    more = len(lines) - most
    return [*lines[:most], *([f"… {more} more: {rest}"] if more > 0 else [])]


COMMON_FIELDS: Final[Mapping[str, str]] = {
    "artifact_id": "id of the artifact",
    "batch_id": "id of the batch",
    "config_id": "id of the configuration",
    "config_name": "name of the configuration",
    "job_id": "id of the job, for get_job; null or empty if no job is running",
    "lanelet_id": "id of the lanelet in the scenario",
    "map_id": "id of the map",
    "next_step": "the next call",
    "notes": "remarks, one sentence each",
    "obstacle_class": "type of the other road user",
    "obstacle_id": "id of the other road user in the scenario; null without one",
    "outcome": "how the run ended",
    "p_holm": "p after Holm's adjustment over all tests of the answer",
    "plan_id": "id of the coverage plan",
    "prediction": "the prediction of the others",
    "problem_id": "id of the planning problem in the scenario",
    "run_id": "id of the run",
    "run_ids": "ids of the runs behind it",
    "scenario_id": "id of the scenario",
    "search_id": "id of the search, which other tools accept instead of scenarios",
    "state": "state of the work",
    "study_id": "id of the study",
    "traffic": "whether the others follow their recording or react to the ego",
    "unit": "unit of the values",
    "vehicle_id": "id of the vehicle in the scenario",
}
"""The meanings of fields with these names, unless the field has its own description; units are in names."""


class Result(Model):
    """The structured answer of a tool. Its text says the same, because hosts show the model only one of them."""

    @abstractmethod
    def answer(self) -> Answer:
        """Return the parts of the text."""

    def to_text(self) -> str:
        """Return the answer as compact text."""
        return self.answer().to_text()

    def _repr_html_(self) -> str:
        return f'<pre style="white-space: pre-wrap">{html.escape(self.to_text())}</pre>'


def problems_of(model: type[BaseModel], error: ValidationError, noun: str = "field") -> list[tuple[str, list[str]]]:
    """Return each problem with the valid values, nearest first; ``noun`` is the word for a field."""
    return [problem_of(model, detail, noun) for detail in error.errors(include_url=False)]


def problem_of(
    model: type[BaseModel], detail: ErrorDetails, noun: str = "field", *, ranged: bool = True, alone: bool = False
) -> tuple[str, list[str]]:
    """Return a problem with the valid values, nearest first.

    ``ranged``: whether the problem states the valid range, too, because its text is used without the values.
    ``alone``: whether it is the only problem, so that its values need not name the field.
    The text is never pydantic's, which refers to Python's types. An unknown kind of error is described by the values
    that the field accepts. Messages of our own checks are used unchanged.
    """
    kind, path = detail["type"], _path(detail["loc"])
    if kind == "extra_forbidden":
        fields = list(model_at(model, detail["loc"]).model_fields)
        return f"there is no {noun} '{path}'", closest(str(detail["loc"][-1]), fields, limit=len(fields))
    wanted, described = _expected(model, detail["loc"])
    if kind == "missing":
        is_choice = re.fullmatch(r"\w+(, \w+)+", wanted) is not None
        if alone and not ranged and is_choice:
            return f"the required {noun} '{path}' is missing", wanted.split(", ")
        return f"the required {noun} '{path}' ({wanted}) is missing", []
    if kind in CHOICES and (allowed := choices_of(detail)):
        return f"{path} cannot be {_short(detail['input'])}", closest(str(detail["input"]), allowed, limit=len(allowed))
    valid = [f"{'' if alone else f'{path}: '}{wanted}{'' if kind in CLOSED_RANGES else described}"]
    if kind == "json_invalid":
        return f"{path} is not valid JSON", valid
    if kind in _OWN_CHECK:
        message = re.sub(r"^(Value error|Assertion failed), ", "", detail["msg"])
        return f"{path}: {message[:1].lower()}{message[1:]} (given: {_short(detail['input'])})", valid
    given = detail["input"]
    if ranged:
        return f"{path} takes {wanted}, not {_given(kind, given)}", valid
    part = "element" if kind in ("too_short", "too_long") else "character"
    if _given(kind, given) != _short(given):
        return f"{path} cannot {f'have {counted(len(given), part)}' if given else 'be empty'}", valid
    return f"{path} cannot be {_short(given)}", valid


def choices_of(detail: ErrorDetails) -> list[str]:
    """Return the valid values of a field, as listed in the error; empty if the error lists no values."""
    context = detail.get("ctx", {})
    return re.findall(r"'([^']*)'", str(context.get("expected", context.get("expected_tags", ""))))


def model_at(model: type[BaseModel], location: tuple[int | str, ...]) -> type[BaseModel]:
    """Return the model that contains the last part of the location: the arguments, or an object in a list."""
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


def _path(location: tuple[int | str, ...]) -> str:
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text or "it"


def _expected(model: type[BaseModel], location: tuple[int | str, ...]) -> tuple[str, str]:
    """Return a description of the values that an argument accepts, and the argument's own description in brackets."""
    named = [place for place, part in enumerate(location) if isinstance(part, str)]
    name = str(location[named[-1]]) if named else ""
    holder = model_at(model, location[: named[-1] + 1] if named else ())
    schema = _properties(holder).get(name, {} if named else {"type": "object"})
    arms = [arm for arm in schema.get("anyOf", [schema]) if arm.get("type") != "null"]
    arm = arms[0] if arms else {}
    if location and isinstance(location[-1], int):
        arm = arm.get("items", {})
    described = f" ({schema['description']})" if schema.get("description") else ""
    return _in_words(arm), described


@cache
def _properties(model: type[BaseModel]) -> Mapping[str, Any]:
    """Return the JSON schemas of a model's fields, which take pydantic 5 ms each time."""
    properties: Mapping[str, Any] = model.model_json_schema().get("properties", {})
    return properties


def _in_words(schema: Mapping[str, Any]) -> str:
    if "enum" in schema:
        return ", ".join(map(str, schema["enum"]))
    if "const" in schema:
        return str(schema["const"])
    kind = "object" if "$ref" in schema else schema.get("type", "")
    words = _FORMATS.get(schema.get("format", "")) or _KINDS.get(kind, "a value")
    if kind in _SIZES:
        least, most, part = _SIZES[kind]
        words += _size_in_words(schema.get(least), schema.get(most), part)
    form = f" that matches {schema['pattern']}" if "pattern" in schema else ""
    bounds = [(key, word) for key, word in _BOUNDS if key in schema]
    if len(bounds) == 1:
        key = bounds[0][0]
        if key in _OPEN_ENDED:
            return f"{words}, {_number(schema[key])} or {_OPEN_ENDED[key]}{form}"
    return " ".join([words, *(f"{word} {_number(schema[key])}" for key, word in bounds)]) + form


def _size_in_words(least: int | None, most: int | None, part: str) -> str:
    if least and most:
        return f" of {least} to {counted(most, part)}" if least != most else f" of {counted(most, part)}"
    if least:
        return f" of at least {counted(least, part)}"
    return "" if most is None else f" of at most {counted(most, part)}"


def _given(kind: str, value: Any) -> str:
    """Return the given value, or the size of a list or text that is too short or too long."""
    if kind in ("too_short", "too_long") and hasattr(value, "__len__"):
        return f"{len(value):,}"
    if kind in ("string_too_short", "string_too_long") and isinstance(value, str):
        return f"{len(value):,}"
    return _short(value)


def _number(value: float) -> str:
    """Return a number as people write it: with thousands separators, and without a decimal part if it is whole."""
    return f"{value:,.0f}" if float(value).is_integer() else f"{value:g}"


def _short(value: Any) -> str:
    if isinstance(value, str):
        return quoted(value, _SHOWN_CHARACTERS)
    if isinstance(value, float) and value.is_integer() and abs(value) < _WRITTEN_OUT:
        return _number(value)
    return one_line(json.dumps(value, default=str), _SHOWN_CHARACTERS)


_WRITTEN_OUT = 1e12
"""Whole numbers below this are written with all their digits (chosen)."""
_SHOWN_CHARACTERS = 60
"""The maximum length of a given value that a refusal repeats, in characters (chosen)."""
CHOICES = ("literal_error", "enum", "union_tag_invalid")
CLOSED_RANGES = ("greater_than", "greater_than_equal", "less_than", "less_than_equal", "finite_number")
"""Pydantic's error types for a value outside a set of names, and for a number beyond its bounds."""
_OWN_CHECK = ("value_error", "assertion_error")
_KINDS = {
    "array": "a list",
    "string": "text",
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "object": "an object",
}
_FORMATS = {"path": "a path", "uri": "an address (URL)", "date-time": "a date and a time"}
_SIZES = {"array": ("minItems", "maxItems", "element"), "string": ("minLength", "maxLength", "character")}
_OPEN_ENDED = {"minimum": "greater", "maximum": "less"}
_BOUNDS = (("minimum", "from"), ("exclusiveMinimum", "above"), ("maximum", "to"), ("exclusiveMaximum", "below"))


DRIVEN_OTHERWISE = (
    "modify_scenario with set_ego and vehicle_class=truck, or configure_planner with vehicle=4, which drives the "
    "tractor alone"
)
"""What to do about an ego that no planner can drive, such as a vehicle with a trailer."""
