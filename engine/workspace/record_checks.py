"""Whether a stored artifact is what its record, its recipe and its files say: asked of archives and of workspaces.

An id stands for content: that of a run, batch, search, plan, study or map is the digest of its recipe, that of a
configuration the digest of its weights, and a scenario's record names the digest of its file. What does not fit is not
believed. Whether a run really went as its record says cannot be seen from the record; runs of an archive are therefore
marked as imported (:meth:`Workspace.mark_imported`).
"""

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ...schemas.base import Model, problems_of
from ...schemas.text import cited, printable, shown_name
from .artifacts import ArtifactKind
from .recipe import Recipe, content_digest

_FROM_RECIPE: tuple[ArtifactKind, ...] = ("run", "batch", "search", "plan", "study", "map")
"""Kinds with ids of the form ``kind_digest``."""


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
    if kind == "scenario" and folder is not None:
        file = folder / "scenario.xml"
        if file.is_file() and content_digest(file) != getattr(read, "content", None):
            return "its file is not the one that its record names"
    return ""


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


def in_one_line(value: Any) -> Any:
    """Return a record with each of its texts on one line, without control and direction characters."""
    if isinstance(value, str):
        return value if value.isprintable() else " ".join(printable(" ".join(value.split()), kept="").split())
    if isinstance(value, dict):
        return {in_one_line(key): in_one_line(part) for key, part in value.items()}
    if isinstance(value, list):
        return [in_one_line(part) for part in value]
    return value
