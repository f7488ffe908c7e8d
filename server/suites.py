"""Reads suites as people write them: a YAML file with arguments that are checked like a call's."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..engine.tuning import DEFAULT_CONFIGURATION, read_yaml
from ..schemas.analysis.suite import Suite, SuiteConfiguration, SuiteFile, SuiteFiles, SuiteWeightFile
from ..schemas.catalog import FindScenariosArguments
from ..schemas.errors import InvalidRequest
from ..schemas.generation import GenerateScenariosArguments
from ..schemas.planning import ConfigurePlannerArguments
from ..schemas.text import one_line, quoted
from ..schemas.worlds import world_of
from ..workflows.analysis.suite import limits_of
from .arguments.checking import read_arguments

LARGEST_BYTES, MOST_BRACKETS = 1_000_000, 20_000
"""Chosen: a suite of a thousand scenarios is smaller."""
_ENTRIES = ("an id", "preset:N", "files: PATH", "find: {…}", "generate: {…}")
_FORM = "see docs/gate.md for the form of a suite"


def read_suite(path: Path) -> Suite:
    """Return the suite in a file, with its arguments read like a call's, and its limits parsed.

    Raises:
        InvalidRequest, UnknownName: an entry is invalid; the error gives the fault and the entry.
        UnsafeInput: it is not a plain YAML file.
    """
    name = one_line(path.name)
    if path.stat().st_size > LARGEST_BYTES:
        raise InvalidRequest(f"{name} is larger than {LARGEST_BYTES:,} bytes; a suite is not")
    content = read_yaml(path, MOST_BRACKETS)
    if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
        raise InvalidRequest(f"{name} is not a suite", valid=list(SuiteFile.model_fields), next_step=_FORM)
    with _at(name):
        written = read_arguments(SuiteFile, content)
    scenarios = [_scenario(entry, f"{name}, scenario {i}") for i, entry in enumerate(written.scenarios, 1)]
    configurations = [
        _configuration(entry, f"{name}, configuration {i}") for i, entry in enumerate(written.configurations, 1)
    ]
    with _at(f"{name}, world"):
        world = world_of(written.world)
    suite = Suite(
        name=written.name,
        scenarios=tuple(scenarios),
        configurations=tuple(configurations),
        prediction=written.prediction,
        traffic=written.traffic,
        world=world,
        seed=written.seed,
        limits=written.limits,
    )
    limits_of(suite)
    return suite


@contextmanager
def _at(place: str) -> Iterator[None]:
    """Add the suite's entry to a refusal."""
    try:
        yield
    except InvalidRequest as error:
        raise InvalidRequest(f"{place}: {error.message}", valid=error.valid, next_step=_FORM) from error


def _scenario(
    entry: str | dict[str, Any], place: str
) -> str | SuiteFiles | FindScenariosArguments | GenerateScenariosArguments:
    if isinstance(entry, str):
        return entry
    with _at(place):
        if len(entry) != 1 or not entry.keys() <= {"files", "find", "generate"}:
            raise InvalidRequest(f"{quoted(', '.join(map(str, entry)))} is not a scenario", valid=_ENTRIES)
        ((kind, value),) = entry.items()
        if kind == "files":
            return read_arguments(SuiteFiles, value if isinstance(value, dict) else {"path": value})
        if not isinstance(value, dict):
            raise InvalidRequest(f"{kind}: {quoted(str(value))} is not a mapping of arguments", valid=_ENTRIES)
        if kind == "find":
            return read_arguments(FindScenariosArguments, value)
        return read_arguments(GenerateScenariosArguments, value)


def _configuration(entry: str | dict[str, Any], place: str) -> str | SuiteConfiguration | SuiteWeightFile:
    if isinstance(entry, str):
        return entry
    with _at(place):
        if "file" in entry:
            return read_arguments(SuiteWeightFile, entry)
        given = {"base": DEFAULT_CONFIGURATION, **entry}
        name = str(given.pop("name", ""))
        return SuiteConfiguration(name=name, arguments=read_arguments(ConfigurePlannerArguments, given))
