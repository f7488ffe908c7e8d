"""What tests of edits share: carrying edits out on a file and looking at what came of it."""

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
        """Ids of the first-level elements whose serialisation differs between the files, or that only one has."""
        old, new = elements(self.base), elements(self.xml)
        return {key for key in {*old, *new} if old.get(key) != new.get(key)}


Apply = Callable[..., Applied]
"""The fixture ``apply``: edits as dictionaries, ``builder`` for another scenario, anything else for the request."""


def apply_to(base: Path, output: Path, *edits: dict[str, Any], **request: Any) -> Applied:
    """Carry out edits (as dictionaries) on a file."""
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
    """First-level elements of a scenario file by id (or tag), as bytes."""
    root = etree.parse(path).getroot()
    return {
        str(element.get("id") or element.tag): etree.tostring(element, with_tail=False)
        for element in root
        if isinstance(element.tag, str)
    }


def schema_errors(path: Path) -> set[str]:
    """What CommonRoad's XML schema says against a file."""
    folder = Path(next(iter(commonroad.__path__))) / "scenario_definition" / "xml_definition_files"
    schema = etree.XMLSchema(etree.parse(os.fspath(folder / "XML_commonRoad_XSD.xsd")))
    schema.validate(etree.parse(path))
    return {str(error.message) for error in schema.error_log}
