"""Arguments and answers of the tools that list and export what was made, and what a worker writes for an export."""

from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import Field

from .base import LONGEST_PATH, Answer, Arguments, Model, Result, first_of
from .planning import PlannerConfiguration
from .runs import LostCell, RunRecord

ExportFormat = Literal["xml", "net", "yaml", "json", "recipe", "png", "gif", "html", "solution", "csv", "parquet"]
CostFunctionId = Literal["JB1", "SA1", "WX1", "SM1", "SM2", "SM3", "MW1", "TR1", "TR2"]
"""CommonRoad's cost functions by their identifiers in a benchmark id."""


class ListArtifactsArguments(Arguments):
    """What was made in this workspace, newest first."""

    kind: Literal["scenario", "search", "config", "run", "batch", "map", "plan", "job"] | None = None
    parent: str | None = Field(None, description="id that it was made from")
    text: str | None = Field(None, description="in ids, names and recipes")
    limit: int = Field(10, ge=1, le=50)
    offset: int = Field(0, ge=0)


class ListedArtifact(Model):
    """One artifact in a list."""

    artifact_id: str
    kind: str
    name: str
    made_by: str
    parents: tuple[str, ...]
    made_at: str
    uri: str


class ListArtifactsResult(Result):
    """Artifacts, newest first; ``more`` where the list goes on after ``limit``."""

    artifacts: tuple[ListedArtifact, ...]
    more: bool

    def answer(self) -> Answer:
        """One line each."""
        if not self.artifacts:
            following = "generate_scenarios, find_scenarios or import_files"
            return Answer("Nothing was made yet that fits.", next_step=following)
        lines = [
            f"{item.kind} {item.artifact_id}"
            + (f" ({item.name})" if item.name and item.name != item.artifact_id else "")
            + f" by {item.made_by}"
            + (f" from {', '.join(item.parents[:4])}" if item.parents else "")
            + f", {item.made_at}"
            for item in self.artifacts
        ]
        return Answer(lines[0], listed=lines[1:], next_step="raise offset for more" if self.more else "")


class ExportArtifactsArguments(Arguments):
    """Write files of artifacts into a folder inside an allowed root.

    html: one report on scenarios and batches; solution: CommonRoad file of a run; csv, parquet: runs of a batch.

    Existing files are refused unless overwrite.
    """

    longest_texts: ClassVar[Mapping[str, int]] = {"folder": LONGEST_PATH}

    ids: list[str] = Field(min_length=1, max_length=200)
    folder: str
    formats: list[ExportFormat] = Field([], description="none: all stored files")
    overwrite: bool = False


class ExportedFile(Model):
    """A written file."""

    artifact_id: str
    format: str
    path: str
    size_bytes: int


class ExportArtifactsResult(Result):
    """What was written."""

    folder: str
    files: tuple[ExportedFile, ...]

    def answer(self) -> Answer:
        """The folder, then one line a file."""
        lines = [f"{file.path} ({file.size_bytes:,} bytes, {file.format} of {file.artifact_id})" for file in self.files]
        rest = "the structured answer names all"
        return Answer(f"{len(self.files)} files in {self.folder}:", listed=first_of(lines, 40, rest))


class SolutionRequest(Model):
    """A run that is to be written as a CommonRoad solution file."""

    record: RunRecord
    configuration: PlannerConfiguration
    scenario_path: str
    steps_path: str
    target_path: str
    cost_function: CostFunctionId = Field("SM1", description="CommonRoad cost function that the file is entered for")


class RunTableRequest(Model):
    """The cells of a batch that are to be written as a table."""

    records: tuple[RunRecord, ...]
    lost: tuple[LostCell, ...]
    configurations: tuple[PlannerConfiguration, ...]
    form: Literal["csv", "parquet"]
    target_path: str


class FileWritten(Model):
    """The file that a worker wrote."""

    path: str
