"""Whether a stored artifact is what its record, its recipe and its files say: asked of archives and of workspaces.

An id stands for content: that of a run, batch, search, plan, study or map is the digest of its recipe, that of a
configuration the digest of its weights, and a scenario's record names the digest of its file. What does not fit is not
believed. Whether a run really went as its record says cannot be seen from the record; runs of an archive are therefore
marked as imported (:meth:`Workspace.mark_imported`).
"""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ...schemas.base import LONGEST_PATH, Model, problems_of
from ...schemas.text import cited, one_line, printable, shown_name
from .artifacts import ArtifactKind
from .recipe import Recipe, content_digest

_FROM_RECIPE: tuple[ArtifactKind, ...] = ("run", "batch", "search", "plan", "study", "map")
"""Kinds with ids of the form ``kind_digest``."""
_TEXTS_ON_ONE_LINE: tuple[ArtifactKind, ...] = ("run", "batch", "map", "scenario", "config")
"""Kinds of records with texts from files and programs, or with sentences of ours, which are all on one line."""
_AS_GIVEN = ("template",)
"""Fields that hold a file as it was given: the YAML of a configuration."""
_LONGEST_RECORD_TEXT = LONGEST_PATH
"""Characters of a text in a record: the longest are paths; messages of errors have 2,000 at most."""


def record_type(kind: ArtifactKind) -> type[Model]:
    """Return the model that the record of an artifact of this kind has to pass."""
    from ...schemas.analysis.optimization import StudyRecord
    from ...schemas.catalog import SearchRecord
    from ...schemas.generation import MapFacts, PlanRecord
    from ...schemas.planning import PlannerConfiguration
    from ...schemas.runs import BatchRecord, RunRecord
    from ...schemas.scenarios import ScenarioRecord

    types: dict[ArtifactKind, type[Model]] = {
        "scenario": ScenarioRecord,
        "search": SearchRecord,
        "config": PlannerConfiguration,
        "run": RunRecord,
        "batch": BatchRecord,
        "map": MapFacts,
        "plan": PlanRecord,
        "study": StudyRecord,
    }
    return types[kind]


def record_fault(
    kind: ArtifactKind, artifact_id: str, recipe: Recipe, record: dict[str, Any], folder: Path | None = None
) -> str:
    """Return in a few words why an artifact is not what it says; empty if it is.

    Args:
        folder: where its files are; they are left unread if it is left out.
    """
    try:
        read = record_type(kind).model_validate(record)
    except (ValidationError, RecursionError) as error:
        problem = problems_of(record_type(kind), error)[0][0] if isinstance(error, ValidationError) else "too deep"
        return f"its record cannot be read: {cited(problem)}"
    if kind in _FROM_RECIPE and artifact_id != f"{kind}_{recipe.digest}":
        return f"its recipe makes {kind}_{recipe.digest}"
    own_id = _own_id(kind, read)
    if own_id not in (None, artifact_id):
        return f"its record is that of {shown_name(own_id)}"
    if kind == "run" and folder is not None and (fault := _names_fault(_names_in_files(folder))):
        return fault
    if kind == "scenario" and folder is not None:
        file = folder / "scenario.xml"
        if file.is_file() and content_digest(file) != getattr(read, "content", None):
            return "its file is not the one that its record names"
    return ""


def text_fault(kind: ArtifactKind, name: str, record: dict[str, Any]) -> str:
    """Return what is wrong with the name and the texts of a stored record; empty if they are fit for answers.

    Each is on one line, printable and of bounded length since texts are made so before they are stored; those of a
    workspace that was filled before need not be. An archive's are made so when it is taken in (:func:`in_one_line`).
    The words of a caller in a search, a plan or a study, and the file of a configuration, are kept as they were given.
    """
    if kind not in _TEXTS_ON_ONE_LINE:
        return ""
    kept = {key: part for key, part in record.items() if key not in _AS_GIVEN}
    for field, text in (("name", name), *_texts(kept)):
        if len(text) > _LONGEST_RECORD_TEXT:
            return f"a text of its record has {len(text):,} characters: {shown_name(field)}"
        if printable(text, kept="") != text:
            return f"a text of its record has several lines or hidden characters: {shown_name(field)}"
    return _names_fault(record.get("rejected_candidates", ())) if kind == "run" else ""


def _texts(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Yield the texts of a record, keys included, each with the name of the field that it stands in."""
    if isinstance(value, str):
        yield name, value
    elif isinstance(value, dict):
        for key, part in value.items():
            yield name or "a key", key
            yield from _texts(part, name or key)
    elif isinstance(value, list):
        for part in value:
            yield from _texts(part, name)


def _names_fault(names: Iterable[str]) -> str:
    """Return which name that a planner program gave is none; empty if all of them are names.

    Programs that print such names are refused since (:data:`~plannerforge.schemas.planning.PrintedName`).
    """
    from ...schemas.planning import LONGEST_NAME

    wrong = next((name for name in names if one_line(name, LONGEST_NAME) != name), None)
    return "" if wrong is None else f"{cited(wrong, LONGEST_NAME)} in it is no name that a planner may give"


def _names_in_files(folder: Path) -> Iterator[str]:
    """Yield the names that a planner gave in the files of a run; a file that cannot be read holds none."""
    from ...schemas.runs import RunSeries, RunSteps

    with suppress(OSError, ValueError):
        steps = RunSteps.model_validate_json((folder / "steps.json").read_bytes())
        yield from (*steps.costs, *steps.rejected)
    with suppress(OSError, ValueError):
        series = RunSeries.model_validate_json((folder / "series.json").read_bytes())
        yield from (*series.numbers, *series.texts, *(polygon.name for polygon in series.polygons))


def _own_id(kind: ArtifactKind, record: Model) -> str | None:
    """Return the id that a record states or that follows from it; None if there is none in it."""
    from ...schemas.planning import PlannerConfiguration
    from ...schemas.scenarios import ScenarioRecord

    if isinstance(record, ScenarioRecord):
        return record.facts.scenario_id
    if isinstance(record, PlannerConfiguration):
        return record.content_id
    stated = getattr(record, f"{kind}_id", None)
    return None if stated is None else str(stated)
