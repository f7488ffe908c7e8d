"""Cost-weight files in the form of the Frenetix reference: ``cost_weights:`` with a number for each name.

Our own files also give the planner and the settings; a file without them is a Frenetix file with the default settings.
A user's file is kept with its configuration: written again, it keeps its comments, order and layout byte for byte, and
only changed numbers differ.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...schemas.errors import UnsafeInput
from ...schemas.planning import PlannerConfiguration, PlannerSettings
from ...schemas.text import cited, one_line, shown_name
from .tunings import tuning_of

if TYPE_CHECKING:
    import yaml

_LARGEST_BYTES = 20_000
"""Chosen: a file with all weights and settings has about a thousand bytes."""
_MOST_BRACKETS = 50
_NESTED_IN_A_LINE = re.compile(r"(?:[-?:]\s+){6}")
"""Nested lists and mappings, which take PyYAML quadratic time in their depth; a weight file has three levels."""
_MOST_ENTRIES = 200
"""Weights and settings of one file (chosen: no planner has half as many)."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,99}")
_PLANNER = re.compile(r"[A-Za-z][\w-]{0,59}", re.ASCII)
_NUMBER = re.compile(r"[+-]?(\d{1,30}(\.\d{0,30})?|\.\d{1,30})([eE][+-]?\d{1,3})?")
_SECTIONS = ("cost_weights", "external_cost_weights")


@dataclass(frozen=True)
class WeightFile:
    """A file's planner, its weights and settings as assignments ``name=value``, and the unchanged ``text``
    of the file.
    """

    planner: str
    weights: tuple[str, ...]
    settings: tuple[str, ...]
    text: str = ""


def read_weight_file(path: Path) -> WeightFile:
    """Read a weight file; names are checked when they are applied.

    Raises:
        UnsafeInput: The file is not YAML of this form, has aliases, or has a value that is not a finite number.
    """
    name = one_line(path.name)
    if path.stat().st_size > _LARGEST_BYTES:
        raise UnsafeInput(
            f"{name} is larger than {_LARGEST_BYTES:,} bytes, so it is not a weight file",
            next_step="export a configuration as yaml for an example",
        )
    content = read_yaml(path, _MOST_BRACKETS)
    if not isinstance(content, dict) or not isinstance(content.get("cost_weights"), dict):
        raise UnsafeInput(
            f"{name} has no section of cost weights",
            valid=[f"a section {section} with lines 'name: number'" for section in _SECTIONS],
            next_step="export a configuration as yaml for an example",
        )
    planner = content.get("planner", "frenetix")
    if not isinstance(planner, str) or not _PLANNER.fullmatch(planner):
        raise UnsafeInput(f"{name}: planner is {cited(planner)}, which is not a name")
    weights = [text for section in _SECTIONS for text in _assignments(path, content, section)]
    text = path.read_bytes().decode("utf-8")  # unchanged, including its line ends
    return WeightFile(planner, tuple(weights), tuple(_assignments(path, content, "settings")), text)


def to_yaml(configuration: PlannerConfiguration) -> str:
    """Return a cost-weight file: the user's own if the configuration comes from one, with the current numbers.

    Otherwise it has the form of the Frenetix reference, with every weight in order, the planner and the settings.
    """
    return _plain(configuration) if not configuration.template else _written_back(configuration)


def _plain(configuration: PlannerConfiguration) -> str:
    lines = [f"# {configuration.name} ({configuration.config_id})", "cost_weights:"]
    lines += [f"  {name}: {_number(value)}" for name, value in configuration.weights.items()]
    if configuration.external_weights:
        lines += [f"external_cost_weights:  # not acting in {configuration.planner}"]
        lines += [f"  {name}: {_number(value)}" for name, value in configuration.external_weights.items()]
    lines += [f"planner: {configuration.planner}", "settings:"]
    stated = configuration.settings.stated_values
    lines += [f"  {name}: {value:.12g}" for name, value in stated.items()]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class _Place:
    """A number in a text: its start, its end, and the quotes around it."""

    begin: int
    end: int
    quotes: str
    value: float


@dataclass(frozen=True)
class _Section:
    """A section of a text: its numbers by name, and the position and prefix of a new entry."""

    places: Mapping[str, _Place]
    end: int
    before_name: str


def _written_back(configuration: PlannerConfiguration) -> str:
    """Return the user's file with the current numbers; missing names are added if their values differ from the
    defaults.
    """
    text = configuration.template
    sections = dict(_sections_of(text))
    defaults = PlannerSettings().stated_values
    stated = configuration.settings.stated_values
    usual = tuning_of(configuration.planner)
    groups = (
        ("cost_weights", configuration.weights, usual.presets[usual.first_preset].weights),
        ("external_cost_weights", configuration.external_weights, dict.fromkeys(configuration.external_weights, 0.0)),
        ("settings", {name: float(value) for name, value in stated.items()}, defaults),
    )
    changes: list[tuple[int, int, str]] = []
    behind: list[str] = []
    elsewhere = {name for section in sections.values() for name in section.places}
    for title, values, lacking in groups:
        section = sections.get(title)
        for name, value in values.items():
            for found in sections.values():
                place = found.places.get(name)
                if place is not None and place.value != value:
                    changes.append((place.begin, place.end, f"{place.quotes}{_exact(value)}{place.quotes}"))
        added = [name for name in values if name not in elsewhere and values[name] != lacking.get(name)]
        if section is not None:
            changes += [(section.end, section.end, f"{section.before_name}{n}: {_exact(values[n])}") for n in added]
        elif added:
            behind += [f"{title}:", *(f"  {name}: {_exact(values[name])}" for name in added)]
    for begin, end, words in sorted(changes, key=lambda change: change[0], reverse=True):
        text = f"{text[:begin]}{words}{text[end:]}"
    if not behind:
        return text
    line = "\r\n" if "\r\n" in text else "\n"
    return f"{text}{'' if text.endswith(line) else line}{line.join(behind)}{line}"


def _sections_of(text: str) -> Iterator[tuple[str, _Section]]:
    """Yield the sections of a text with at least one number, by title."""
    import yaml

    root = yaml.compose(text, Loader=yaml.BaseLoader)
    for title, node in getattr(root, "value", ()):
        if title.value in (*_SECTIONS, "settings") and isinstance(node, yaml.MappingNode) and node.value:
            yield title.value, _section(text, node)


def _section(text: str, node: "yaml.MappingNode") -> _Section:
    places = {}
    for name, number in node.value:
        begin, end = number.start_mark.index, number.end_mark.index
        quotes = number.style if number.style in ("'", '"') else ""
        places[name.value] = _Place(begin, end, quotes, float(number.value))
    last_name, last = node.value[-1]
    if node.flow_style:
        return _Section(places, last.end_mark.index, ", ")
    line_end = re.compile(r"\r?\n|\Z").search(text, last.end_mark.index)
    indent = " " * int(last_name.start_mark.column)
    at = last.end_mark.index if line_end is None else line_end.start()
    return _Section(places, at, ("\r\n" if "\r\n" in text else "\n") + indent)


def _exact(value: float) -> str:
    """Return the number in its usual form, or with all its digits if the usual form would round it."""
    usual = _number(value)
    return usual if float(usual) == value else repr(value)


def _assignments(path: Path, content: dict[str, Any], section: str) -> list[str]:
    part = content.get(section) or {}
    file = shown_name(path.name)
    if not isinstance(part, dict) or len(part) > _MOST_ENTRIES:
        raise UnsafeInput(f"{file}: {section} is not a list of at most {_MOST_ENTRIES} name: number lines")
    assignments = []
    for name, text in part.items():
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise UnsafeInput(f"{file}: {section} has {cited(name)}, which is not the name of a weight or setting")
        if not isinstance(text, str) or not _NUMBER.fullmatch(text) or not math.isfinite(float(text)):
            raise UnsafeInput(f"{file}: {section}.{name} is {cited(text)}, which is not a finite number")
        assignments.append(f"{name}={text}")
    return assignments


def read_yaml(path: Path, most_brackets: int) -> Any:
    """Read a YAML file as mappings, lists and texts, since no YAML tag creates anything else.

    An alias repeats the whole of its target, and twelve nested levels expand a thousand bytes to billions of values;
    our files have no aliases. ``most_brackets``: limit for lists and mappings in brackets.

    Raises:
        UnsafeInput: The file cannot be read, is deeply nested, or has aliases.
    """
    import yaml

    try:
        text = path.read_text(encoding="utf-8")
        if text.count("[") + text.count("{") > most_brackets or _NESTED_IN_A_LINE.search(text):
            raise UnsafeInput(f"{shown_name(path.name)} has deeply nested or too many lists and mappings")
        if any(isinstance(token, yaml.AliasToken | yaml.AnchorToken) for token in yaml.scan(text)):
            raise UnsafeInput(f"{shown_name(path.name)} has YAML aliases", next_step="write out the values")
        return yaml.load(text, Loader=yaml.BaseLoader)  # noqa: S506 - it creates only texts, lists and mappings
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        what = getattr(error, "problem", None) or (str(error).splitlines() or [type(error).__name__])[0]
        what += "" if mark is None else f" (line {mark.line + 1})"
        raise UnsafeInput(f"{shown_name(path.name)} is not readable as YAML: {cited(what)}") from error


def _number(value: float) -> str:
    return f"{value:.12g}" if value != int(value) else f"{value:.1f}"
