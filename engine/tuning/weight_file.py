"""Cost-weight files in the form of the Frenetix reference: ``cost_weights:`` with a number for each name.

Those written here also name the planner and the settings; a file without them is one of Frenetix with the default
settings.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...schemas.errors import UnsafeInput
from ...schemas.planning import PlannerConfiguration
from ...schemas.text import one_line, quoted

_LARGEST_BYTES = 20_000
"""Chosen: a file of all weights and settings has about a thousand bytes."""
_MOST_BRACKETS = 50
_NESTED_IN_A_LINE = re.compile(r"(?:[-?:]\s+){6}")
"""Lists and mappings in each other, whose depth costs PyYAML its square; a weight file has three levels."""
_MOST_ENTRIES = 200
"""Weights and settings of one file; chosen: no planner has half as many."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,99}")
_NUMBER = re.compile(r"[+-]?(\d{1,30}(\.\d{0,30})?|\.\d{1,30})([eE][+-]?\d{1,3})?")
_SECTIONS = ("cost_weights", "external_cost_weights")


@dataclass(frozen=True)
class WeightFile:
    """A file's planner, and its weights and settings as assignments ``name=value``."""

    planner: str
    weights: tuple[str, ...]
    settings: tuple[str, ...]


def read_weight_file(path: Path) -> WeightFile:
    """What a file holds; names are checked where they are applied.

    Raises:
        UnsafeInput: not a YAML file of this form, one with aliases, or a value that is no finite number.
    """
    name = one_line(path.name)
    if path.stat().st_size > _LARGEST_BYTES:
        raise UnsafeInput(
            f"{name} is larger than {_LARGEST_BYTES:,} bytes; a weight file is not",
            next_step="export a configuration as yaml to see the form",
        )
    content = read_yaml(path, _MOST_BRACKETS)
    if not isinstance(content, dict) or not isinstance(content.get("cost_weights"), dict):
        raise UnsafeInput(
            f"{name} has no section of cost weights",
            valid=[f"{section}: with name: number lines" for section in _SECTIONS],
            next_step="export a configuration as yaml to see the form",
        )
    planner = content.get("planner", "frenetix")
    if not isinstance(planner, str):
        raise UnsafeInput(f"{name}: planner is {quoted(planner)}, which is no name")
    weights = [text for section in _SECTIONS for text in _assignments(path, content, section)]
    return WeightFile(planner, tuple(weights), tuple(_assignments(path, content, "settings")))


def to_yaml(configuration: PlannerConfiguration) -> str:
    """The cost-weight file in the form of the Frenetix reference, every weight in its order; planner and settings."""
    lines = [f"# {configuration.name} ({configuration.config_id})", "cost_weights:"]
    lines += [f"  {name}: {_number(value)}" for name, value in configuration.weights.items()]
    if configuration.external_weights:
        lines += [f"external_cost_weights:  # not acting in {configuration.planner}"]
        lines += [f"  {name}: {_number(value)}" for name, value in configuration.external_weights.items()]
    lines += [f"planner: {configuration.planner}", "settings:"]
    stated = configuration.settings.model_dump(exclude_none=True)
    lines += [f"  {name}: {value:.12g}" for name, value in stated.items()]
    return "\n".join(lines) + "\n"


def _assignments(path: Path, content: dict[str, Any], section: str) -> list[str]:
    part = content.get(section) or {}
    file = one_line(path.name)
    if not isinstance(part, dict) or len(part) > _MOST_ENTRIES:
        raise UnsafeInput(f"{file}: {section} is no list of at most {_MOST_ENTRIES} name: number lines")
    assignments = []
    for name, text in part.items():
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise UnsafeInput(f"{file}: {section} has {quoted(name)}, which is no name of a weight or setting")
        if not isinstance(text, str) or not _NUMBER.fullmatch(text) or not math.isfinite(float(text)):
            raise UnsafeInput(f"{file}: {section}.{name} is {quoted(text)}, which is no finite number")
        assignments.append(f"{name}={text}")
    return assignments


def read_yaml(path: Path, most_brackets: int) -> Any:
    """A YAML file as mappings, lists and texts: no tag of YAML's makes anything else of them.

    An alias stands for the whole of what it names, and twelve levels of them make thousands of millions of values from
    a thousand bytes: no file of ours has one. ``most_brackets``: lists and mappings that are written in brackets.

    Raises:
        UnsafeInput: it cannot be read, is deeply nested, or has aliases.
    """
    import yaml

    try:
        text = path.read_text(encoding="utf-8")
        if text.count("[") + text.count("{") > most_brackets or _NESTED_IN_A_LINE.search(text):
            raise UnsafeInput(f"{one_line(path.name)} has lists and mappings deep in each other, or many")
        if any(isinstance(token, yaml.AliasToken | yaml.AnchorToken) for token in yaml.scan(text)):
            raise UnsafeInput(f"{one_line(path.name)} has YAML aliases", next_step="write the values out")
        return yaml.load(text, Loader=yaml.BaseLoader)  # noqa: S506 - it makes nothing but texts, lists and mappings
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UnsafeInput(f"{one_line(path.name)} is not readable as YAML: {one_line(what)}") from error


def _number(value: float) -> str:
    return f"{value:.12g}" if value != int(value) else f"{value:.1f}"
