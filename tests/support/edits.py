"""Shared helpers of the edit tests: apply edits to a file and examine the result."""

import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import commonroad
from lxml import etree

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.commonroad.tracks import Track, recorded_tracks
from plannerforge.engine.edits.apply import apply_edits
from plannerforge.engine.execution.executor import silent
from plannerforge.schemas.modification import Edit, ModificationOutcome, ModificationRequest

NEW_ID = "ZAM_Builder-1_1_T-123456789"


@dataclass(frozen=True)
class Applied:
    """An outcome and its base file."""

    base: Path
    outcome: ModificationOutcome

    @property
    def xml(self) -> Path:
        """The new file."""
        assert self.outcome.xml is not None
        return self.outcome.xml

    def tracks(self) -> dict[int, Track]:
        """Recorded tracks of the new file."""
        return recorded_tracks(read_scenario(self.xml).scenario)

    def base_tracks(self) -> dict[int, Track]:
        """Recorded tracks of the base."""
        return recorded_tracks(read_scenario(self.base).scenario)

    def changed_elements(self) -> set[str]:
        """Return ids of the first-level elements that differ between the files or exist in only one."""
        old, new = elements(self.base), elements(self.xml)
        return {key for key in {*old, *new} if old.get(key) != new.get(key)}


Apply = Callable[..., Applied]
"""The fixture ``apply``: edits as dictionaries, ``builder`` for another scenario, anything else for the request."""


def apply_to(base: Path, output: Path, *edits: dict[str, Any], **request: Any) -> Applied:
    """Apply edits (as dictionaries) to a file."""
    asked = ModificationRequest(
        xml=base,
        edits=tuple(Edit.model_validate(edit) for edit in edits),
        benchmark_id=request.pop("benchmark_id", NEW_ID),
        output=output,
        **request,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return Applied(base, apply_edits(asked, silent))


def elements(path: Path) -> dict[str, bytes]:
    """Return first-level elements of a scenario file by id (or tag), as bytes."""
    root = etree.parse(path).getroot()
    return {
        str(element.get("id") or element.tag): etree.tostring(element, with_tail=False)
        for element in root
        if isinstance(element.tag, str)
    }


def schema_errors(path: Path) -> set[str]:
    """Return the errors of CommonRoad's XML schema for a file."""
    folder = Path(next(iter(commonroad.__path__))) / "scenario_definition" / "xml_definition_files"
    schema = etree.XMLSchema(etree.parse(os.fspath(folder / "XML_commonRoad_XSD.xsd")))
    schema.validate(etree.parse(path))
    return {str(error.message) for error in schema.error_log}
