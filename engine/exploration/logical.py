"""Logical scenarios by name: those of the catalogue, and a user's own files in the same format."""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path

from pydantic import ValidationError

from ...schemas.errors import InvalidRequest, UnknownName, UnsafeInput, closest
from ...schemas.exploration import LogicalScenario
from ...schemas.text import shown_name

_CATALOGUE = "catalog/logical_scenarios.yaml"
_LARGEST_BYTES = 200_000
"""The largest file of logical scenarios (chosen): ten times the catalogue."""


@cache
def catalogue() -> Mapping[str, LogicalScenario]:
    """Return the logical scenarios of the catalogue by name."""
    return _read(files(__package__).joinpath(_CATALOGUE).read_text(encoding="utf-8"), _CATALOGUE)


def logical_scenario(name: str) -> LogicalScenario:
    """Return a logical scenario of the catalogue.

    Raises:
        UnknownName: there is no such logical scenario.
    """
    known = catalogue()
    folded = name.strip().lower().replace("-", "_").replace(" ", "_")
    if folded not in known:
        raise UnknownName(
            f"there is no logical scenario '{name}'", valid=closest(folded, list(known)) or list(known), given=name
        )
    return known[folded]


def logical_scenario_in(path: Path, name: str = "") -> LogicalScenario:
    """Return a logical scenario from a YAML file in the catalogue's format, by default the first one.

    Raises:
        UnsafeInput: the file is too large or cannot be read.
        InvalidRequest: it does not contain logical scenarios.
        UnknownName: it has no logical scenario with this name.
    """
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise UnsafeInput(f"{shown_name(path.name)} has more than {_LARGEST_BYTES:,} bytes")
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UnsafeInput(f"{shown_name(path.name)} cannot be read: {error}") from error
    found = _read(text, shown_name(path.name))
    if name and name not in found:
        raise UnknownName(f"{shown_name(path.name)} has no logical scenario '{name}'", valid=list(found))
    return found[name] if name else next(iter(found.values()))


def _read(text: str, source: str) -> dict[str, LogicalScenario]:
    import yaml

    try:
        entries = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InvalidRequest(f"{source} is not YAML: {error}") from error
    if not isinstance(entries, list) or not entries:
        raise InvalidRequest(f"{source} is not a list of logical scenarios")
    found: dict[str, LogicalScenario] = {}
    for number, entry in enumerate(entries):
        try:
            one = LogicalScenario.model_validate(entry)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise InvalidRequest(f"entry {number} of {source}: {where}: {first['msg']}") from error
        found[one.name] = one
    return found
