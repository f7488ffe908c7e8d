"""Logical scenarios by name: those of the catalogue, and a user's own files in the same format."""

from collections.abc import Callable, Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path

from pydantic import ValidationError

from ...schemas.errors import InvalidRequest, NotPossible, UnknownName, UnsafeInput, closest
from ...schemas.exploration import LogicalScenario, PreCrashType
from ...schemas.text import shown_name

_CATALOGUE = "catalog/logical_scenarios.yaml"
_PRE_CRASH_TYPES = "catalog/pre_crash_types.yaml"
_TYPOLOGY = "nhtsa"
"""The prefix of a number of NHTSA's typology."""
_LARGEST_BYTES = 200_000
"""The largest file of logical scenarios (chosen): ten times the catalogue."""


@cache
def catalogue() -> Mapping[str, LogicalScenario]:
    """Return the logical scenarios of the catalogue by name."""
    return _read(files(__package__).joinpath(_CATALOGUE).read_text(encoding="utf-8"), _CATALOGUE)


@cache
def pre_crash_types() -> tuple[PreCrashType, ...]:
    """Return the types of NHTSA's pre-crash typology, in its order."""
    import yaml

    entries = yaml.safe_load(files(__package__).joinpath(_PRE_CRASH_TYPES).read_text(encoding="utf-8"))
    return tuple(PreCrashType.model_validate(entry) for entry in entries)


def logical_scenario(name: str) -> LogicalScenario:
    """Return a logical scenario of the catalogue, or the usual one of a type of NHTSA's typology (``nhtsa:26``).

    Raises:
        UnknownName: there is no such logical scenario or type.
        NotPossible: there is no logical scenario of this type.
    """
    known = catalogue()
    asked = pre_crash_type(name)
    if asked is not None:
        return known[asked.scenarios[0]]
    folded = name.strip().lower().replace("-", "_").replace(" ", "_")
    if folded not in known:
        raise UnknownName(
            f"there is no logical scenario '{name}'", valid=closest(folded, list(known)) or list(known), given=name
        )
    return known[folded]


def pre_crash_type(text: str) -> PreCrashType | None:
    """Return the type that a text such as ``nhtsa:26`` names, or None if it names no type.

    Raises:
        UnknownName: there is no type with this number.
        NotPossible: there is no logical scenario of this type.
    """
    prefix, mark, number = (part.strip() for part in text.partition(":"))
    if not mark or prefix.lower() != _TYPOLOGY:
        return None
    types = pre_crash_types()
    valid = [f"{_TYPOLOGY}:{one.number}" for one in sorted(types, key=lambda one: one.number) if one.scenarios]
    found = next((one for one in types if str(one.number) == number), None)
    if found is None:
        raise UnknownName(
            f"NHTSA's typology has the types 1 to {len(types)}, but not '{number}'; {len(valid)} of the types have a "
            "logical scenario",
            valid=valid,
            next_step="read plannerforge://vocabulary/pre_crash_types for the types",
            complete=True,
        )
    if not found.scenarios:
        raise NotPossible(
            f"there is no logical scenario of NHTSA pre-crash type {number} ({found.name}), because {found.reason}",
            valid=valid,
            next_step="use another type, or write a YAML file with a logical scenario",
        )
    return found


def logical_scenario_in(path: Path, name: str = "", allowed: Callable[[str], Path] = Path) -> LogicalScenario:
    """Return a logical scenario from a file: the first one of a YAML file by default, or that of an OpenSCENARIO file.

    Args:
        path: the file; ``.xosc`` for OpenSCENARIO XML.
        name: the name of a logical scenario of a YAML file.
        allowed: returns the path of a file that the OpenSCENARIO file refers to, or raises OutsideRoots.

    Raises:
        UnsafeInput: the file is too large or cannot be read.
        InvalidRequest: it does not contain logical scenarios, or an element has no counterpart among the edits.
        UnknownName: it has no logical scenario with this name.
    """
    if path.suffix.lower() == ".xosc":
        from .openscenario_story import logical_scenario_of  # loads CommonRoad, which names alone do not need

        return logical_scenario_of(path, allowed)
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
