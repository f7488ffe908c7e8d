"""Cost-weight files in the form of the Frenetix reference: ``cost_weights:`` with a number for each name.

Those written here also name the planner and the settings; a file without them is one of Frenetix with the default
settings.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...schemas.errors import UnsafeInput
from ...schemas.planning import PlannerConfiguration

_LARGEST_BYTES = 1_000_000
"""Chosen: a file of all weights and settings has about a thousand bytes."""
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
        UnsafeInput: not a YAML file of this form, or a value that is no finite number.
    """
    if path.stat().st_size > _LARGEST_BYTES:
        raise UnsafeInput(f"{path.name} is larger than {_LARGEST_BYTES:,} bytes; a weight file is not")
    content = _content(path)
    if not isinstance(content, dict) or not isinstance(content.get("cost_weights"), dict):
        raise UnsafeInput(
            f"{path.name} has no section of cost weights",
            valid=[f"{section}: with name: number lines" for section in _SECTIONS],
            next_step="export a configuration as yaml to see the form",
        )
    planner = content.get("planner", "frenetix")
    if not isinstance(planner, str):
        raise UnsafeInput(f"{path.name}: planner is '{planner}', which is no name")
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
    if not isinstance(part, dict):
        raise UnsafeInput(f"{path.name}: {section} is no list of name: number lines")
    for name, value in part.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise UnsafeInput(f"{path.name}: {section}.{name} is '{value}', which is no finite number")
    return [f"{name}={value!r}" for name, value in part.items()]


def _content(path: Path) -> Any:
    import yaml

    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise UnsafeInput(f"{path.name} is not readable as YAML: {str(error).splitlines()[0]}") from error


def _number(value: float) -> str:
    return f"{value:.12g}" if value != int(value) else f"{value:.1f}"
