"""Base classes of all models: frozen, strict about unknown fields and finite numbers; how an answer is written; and
what is wrong with values that a model refuses, in words of ours.
"""

import html
import json
import re
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from .errors import closest
from .text import counted, one_line, quoted

LONGEST_PATH = 4000
"""Characters; the limit of Linux is 4,096 bytes."""


class Model(BaseModel):
    """A frozen value that refuses unknown fields and numbers that are not finite.

    What checks a model is built when the model is first used: a server that starts uses few of them.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, ser_json_inf_nan="constants", defer_build=True
    )


class Arguments(Model):
    """The arguments of a tool: flat (primitives, enumerations, lists of primitives or of one flat object)."""

    longest_texts: ClassVar[Mapping[str, int]] = {}
    """Characters that an argument's text may have where it is no name or id, which have 200 at most."""
    usual_values: ClassVar[Mapping[str, Any]] = {}
    """What a refusal proposes for an argument that must be given and is not."""


@dataclass(frozen=True)
class Answer:
    """What a tool says, in the order in which it is read: each part one line an item, an empty part none.

    ``headline``: what came out, with its id; ``decided``: what was done or chosen and why; ``figures``: what was
    measured; ``listed``: what was asked to be listed, an item a line; ``warnings``: what needs an act; ``next_step``:
    the call that goes on from here. Technical notes stand in the structured answer, and here where a detail asks.
    """

    headline: str
    decided: Sequence[str] = ()
    figures: Sequence[str] = ()
    listed: Sequence[str] = ()
    warnings: Sequence[str] = ()
    next_step: str = ""

    def to_text(self) -> str:
        """Return the parts in their order."""
        warnings = (f"Warning: {warning}" for warning in self.warnings)
        following = [f"Next: {self.next_step}"] if self.next_step else []
        return "\n".join([self.headline, *self.decided, *self.figures, *self.listed, *warnings, *following])


def first_of(lines: Sequence[str], most: int, rest: str) -> list[str]:
    """Return the first ``most`` lines; where there are more, how many, and ``rest``: the call that shows them."""
    more = len(lines) - most
    return [*lines[:most], *([f"… {more} more: {rest}"] if more > 0 else [])]


COMMON_FIELDS: Final[Mapping[str, str]] = {
    "artifact_id": "id of the artifact",
    "batch_id": "id of the batch",
    "config_id": "id of the configuration",
    "config_name": "name of the configuration",
    "job_id": "id of the job, for get_job; null or empty where nothing runs",
    "lanelet_id": "id of the lanelet in the scenario",
    "map_id": "id of the map",
    "next_step": "the call that goes on from here",
    "notes": "what is to be known beside it, a sentence each",
    "obstacle_class": "type of the other road user",
    "obstacle_id": "id of the other road user in the scenario; null where there is none",
    "outcome": "how the run ended",
    "p_holm": "p after Holm's adjustment over all that are tested together",
    "plan_id": "id of the coverage plan",
    "prediction": "how the planner foresees the others",
    "problem_id": "id of the planning problem in the scenario",
    "run_id": "id of the run",
    "run_ids": "ids of the runs behind it",
    "scenario_id": "id of the scenario",
    "search_id": "id of the search, which other tools take in the place of scenarios",
    "state": "how the work stands",
    "study_id": "id of the study",
    "traffic": "whether the others follow their recording or react to the ego",
    "unit": "unit of the values",
    "vehicle_id": "id of the vehicle in the scenario",
}
"""What fields of these names mean in every answer where the field itself says nothing else; units are in names."""


class Result(Model):
    """The structured answer of a tool; its text says the same, because hosts show the model only one of them."""

    @abstractmethod
    def answer(self) -> Answer:
        """Return what the text says."""

    def to_text(self) -> str:
        """Return the answer as compact text."""
        return self.answer().to_text()

    def _repr_html_(self) -> str:
        return f'<pre style="white-space: pre-wrap">{html.escape(self.to_text())}</pre>'


def problems_of(model: type[BaseModel], error: ValidationError, noun: str = "field") -> list[tuple[str, list[str]]]:
    """Return each problem in words, with what would be valid, the nearest first; ``noun``: what a field is called."""
    return [problem_of(model, detail, noun) for detail in error.errors(include_url=False)]


def problem_of(model: type[BaseModel], detail: ErrorDetails, noun: str = "field") -> tuple[str, list[str]]:
    """Return a problem in words, with what would be valid, the nearest first.

    The words are never pydantic's, which speak of Python's types: of a kind of error that is not named here it is said
    what the field takes. What a check of our own says is said as it is.
    """
    kind, path = detail["type"], _path(detail["loc"])
    if kind == "extra_forbidden":
        fields = list(model_at(model, detail["loc"]).model_fields)
        return f"there is no {noun} '{path}'", closest(str(detail["loc"][-1]), fields, limit=len(fields))
    wanted, described = _wanted(model, detail["loc"])
    if kind == "missing":
        return f"the {noun} '{path}' is missing", [f"{path}={wanted}{described}"]
    if kind in _CHOICES and (allowed := choices_of(detail)):
        return f"{path} cannot be {_short(detail['input'])}", closest(str(detail["input"]), allowed, limit=len(allowed))
    valid = [f"{path}: {wanted}{described}"]
    if kind == "json_invalid":
        return f"{path} is no JSON", valid
    if kind in _OWN_CHECK:
        message = re.sub(r"^(Value error|Assertion failed), ", "", detail["msg"])
        return f"{path}: {message[:1].lower()}{message[1:]} (given: {_short(detail['input'])})", valid
    return f"{path} takes {wanted}, not {_given(kind, detail['input'])}", valid


def choices_of(detail: ErrorDetails) -> list[str]:
    """Return the values of which a field takes one, as the error names them; empty if it names none."""
    context = detail.get("ctx", {})
    return re.findall(r"'([^']*)'", str(context.get("expected", context.get("expected_tags", ""))))


def model_at(model: type[BaseModel], location: tuple[int | str, ...]) -> type[BaseModel]:
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


def _path(location: tuple[int | str, ...]) -> str:
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text or "it"


def _wanted(model: type[BaseModel], location: tuple[int | str, ...]) -> tuple[str, str]:
    """Return what an argument takes, in words, and its description in brackets, from its schema."""
    named = [place for place, part in enumerate(location) if isinstance(part, str)]
    name = location[named[-1]] if named else ""
    holder = model_at(model, location[: named[-1] + 1] if named else ())
    schema = holder.model_json_schema().get("properties", {}).get(name, {} if named else {"type": "object"})
    arms = [arm for arm in schema.get("anyOf", [schema]) if arm.get("type") != "null"]
    arm = arms[0] if arms else {}
    if location and isinstance(location[-1], int):
        arm = arm.get("items", {})
    described = f" ({schema['description']})" if schema.get("description") else ""
    return _in_words(arm), described


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
    return " ".join([words, *(f"{word} {schema[key]:g}" for key, word in _BOUNDS if key in schema)]) + form


def _size_in_words(least: int | None, most: int | None, part: str) -> str:
    if least and most:
        return f" of {least} to {counted(most, part)}" if least != most else f" of {counted(most, part)}"
    if least:
        return f" of at least {counted(least, part)}"
    return "" if most is None else f" of at most {counted(most, part)}"


def _given(kind: str, value: Any) -> str:
    """Return what was given: of a list or text that is too short or too long its size says more than its beginning."""
    if kind in ("too_short", "too_long") and hasattr(value, "__len__"):
        return f"{len(value):,}"
    if kind in ("string_too_short", "string_too_long") and isinstance(value, str):
        return f"{len(value):,}"
    return _short(value)


def _short(value: Any) -> str:
    if isinstance(value, str):
        return quoted(value, _SHOWN_CHARACTERS)
    return one_line(json.dumps(value, default=str), _SHOWN_CHARACTERS)


_SHOWN_CHARACTERS = 60
"""Characters of a given value that a refusal repeats; chosen."""
_CHOICES = ("literal_error", "enum", "union_tag_invalid")
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
_BOUNDS = (("minimum", "from"), ("exclusiveMinimum", "above"), ("maximum", "to"), ("exclusiveMaximum", "below"))


DRIVEN_OTHERWISE = (
    "modify_scenario with set_ego and vehicle_class=truck, or configure_planner with vehicle=4, which drives the "
    "tractor alone"
)
"""What to do about an ego that no planner drives, as a vehicle with a trailer."""
