"""Reading cost-weight files in the form of the Frenetix reference: ``cost_weights:`` with a number for each name."""

import math
from pathlib import Path
from typing import Any

from plannerforge.schemas.errors import UnsafeInput

LARGEST_BYTES = 1_000_000
SECTIONS = ("cost_weights", "external_cost_weights")


def read_weight_file(path: Path) -> tuple[str, ...]:
    """The weights of a file as assignments ``name=value``; names are checked where they are applied.

    Raises:
        UnsafeInput: not a YAML file of this form, or a value that is no finite number.
    """
    if path.stat().st_size > LARGEST_BYTES:
        raise UnsafeInput(f"{path.name} is larger than {LARGEST_BYTES:,} bytes; a weight file is not")
    content = _content(path)
    if not isinstance(content, dict) or not isinstance(content.get("cost_weights"), dict):
        raise UnsafeInput(
            f"{path.name} has no section of cost weights",
            valid=[f"{section}: with name: number lines" for section in SECTIONS],
            next_step="export a configuration as yaml to see the form",
        )
    found = []
    for section in SECTIONS:
        for name, value in (content.get(section) or {}).items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise UnsafeInput(f"{path.name}: {section}.{name} is '{value}', which is no finite number")
            found.append(f"{name}={value!r}")
    return tuple(found)


def _content(path: Path) -> Any:
    import yaml

    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise UnsafeInput(f"{path.name} is not readable as YAML: {str(error).splitlines()[0]}") from error
