"""Checks that a stored artifact matches its record, its recipe and its files, in archives and workspaces.

An id identifies content. The id of a run, batch, search, plan, study, map or boundary is the digest of its recipe,
that of a configuration the digest of its weights, and a scenario's record has the digest of its file. Mismatches are
rejected. Whether a run really happened as recorded is not verifiable, so runs of an archive are marked as imported
(:meth:`Workspace.mark_imported`).
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

_FROM_RECIPE: tuple[ArtifactKind, ...] = ("run", "batch", "search", "plan", "study", "map", "boundary")
"""Kinds with ids of the form ``kind_digest``."""
_TEXTS_ON_ONE_LINE: tuple[ArtifactKind, ...] = ("run", "batch", "map", "scenario", "config")
"""Kinds of records with texts from files and programs, or with our own sentences, which are all on one line."""
_AS_GIVEN = ("template",)
"""Fields with an unmodified file: the YAML of a configuration."""
_LONGEST_RECORD_TEXT = LONGEST_PATH
"""Most characters of a text in a record: the longest are paths; error messages have at most 2,000."""


def record_type(kind: ArtifactKind) -> type[Model]:
    """Return the model that the record of an artifact of this kind must satisfy."""
    from ...schemas.analysis.optimization import StudyRecord
    from ...schemas.boundaries import BoundaryRecord
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
        "boundary": BoundaryRecord,
    }
    return types[kind]


def record_fault(
    kind: ArtifactKind, artifact_id: str, recipe: Recipe, record: dict[str, Any], folder: Path | None = None
) -> str:
    """Return a short text on why an artifact is inconsistent; empty if it is consistent.

    Args:
        folder: The folder of its files; if it is None, the files are not read.
    """
    try:
        read = record_type(kind).model_validate(record)
    except (ValidationError, RecursionError) as error:
        problem = problems_of(record_type(kind), error)[0][0] if isinstance(error, ValidationError) else "too deep"
        return f"its record cannot be read: {cited(problem)}"
    if kind in _FROM_RECIPE and artifact_id != f"{kind}_{recipe.digest}":
        return f"its recipe gives {kind}_{recipe.digest}"
    own_id = _own_id(kind, read)
    if own_id not in (None, artifact_id):
        return f"its record is that of {shown_name(own_id)}"
    if kind == "run" and folder is not None and (fault := _names_fault(_names_in_files(folder))):
        return fault
    if kind == "scenario" and folder is not None:
        file = folder / "scenario.xml"
        if file.is_file() and content_digest(file) != getattr(read, "content", None):
            return "its file does not match the digest in its record"
    return ""


def text_fault(kind: ArtifactKind, name: str, record: dict[str, Any]) -> str:
    """Return the problem with the name and the texts of a stored record; empty if they are fit for answers.

    Each must be on one line, printable and of bounded length. New texts are converted to this form before they are
    stored, but an older workspace may have other texts. An archive's texts are converted on import
    (:func:`in_one_line`). A caller's text in a search, a plan or a study, and the file of a configuration, stay
    unmodified.
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
    """Yield the texts of a record, including keys, each with the name of its field."""
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
    """Return a description of the first invalid name from a planner program; empty if all names are valid.

    Newer versions refuse programs that print invalid names (:data:`~plannerforge.schemas.planning.PrintedName`).
    """
    from ...schemas.planning import LONGEST_NAME

    wrong = next((name for name in names if one_line(name, LONGEST_NAME) != name), None)
    return "" if wrong is None else f"{cited(wrong, LONGEST_NAME)} in it is not a valid name from a planner"


def _names_in_files(folder: Path) -> Iterator[str]:
    """Yield the names that a planner gave in the files of a run; an unreadable file has no names."""
    from ...schemas.runs import RunSeries, RunSteps

    with suppress(OSError, ValueError):
        steps = RunSteps.model_validate_json((folder / "steps.json").read_bytes())
        yield from (*steps.costs, *steps.rejected)
    with suppress(OSError, ValueError):
        series = RunSeries.model_validate_json((folder / "series.json").read_bytes())
        yield from (*series.numbers, *series.texts, *(polygon.name for polygon in series.polygons))


def _own_id(kind: ArtifactKind, record: Model) -> str | None:
    """Return the id that a record states or implies, or None."""
    from ...schemas.planning import PlannerConfiguration
    from ...schemas.scenarios import ScenarioRecord

    if isinstance(record, ScenarioRecord):
        return record.facts.scenario_id
    if isinstance(record, PlannerConfiguration):
        return record.content_id
    stated = getattr(record, f"{kind}_id", None)
    return None if stated is None else str(stated)
