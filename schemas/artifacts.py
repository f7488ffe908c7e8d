"""Arguments and answers of the tools that import, list and export, and what a worker writes for an export."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from pydantic import Field

from .base import LONGEST_PATH, Answer, Arguments, Model, Result, first_of
from .jobs import JobState
from .planning import PlannerConfiguration
from .results import Rate
from .runs import LostCell, Prediction, RunRecord, ScenarioSource, Traffic
from .text import counted, shown_name

RESOURCE_SCHEME = "plannerforge://"
"""The scheme of all resource addresses."""
ExportFormat = Literal[
    "xml",
    "net",
    "yaml",
    "json",
    "recipe",
    "png",
    "gif",
    "html",
    "solution",
    "csv",
    "parquet",
    "opendrive",
    "openscenario",
]
CostFunctionId = Literal["JB1", "SA1", "WX1", "SM1", "SM2", "SM3", "MW1", "TR1", "TR2"]
"""CommonRoad's cost functions by their identifiers in a benchmark id."""


class ListArtifactsArguments(Arguments):
    """What was made in this workspace, newest first; batches with their success rates."""

    kind: Literal["scenario", "search", "config", "run", "batch", "map", "plan", "study", "job"] | None = None
    """Only artifacts of this kind."""
    parent: str | None = Field(None, description="id that it was made from")
    text: str | None = Field(None, description="in ids, names and recipes")
    limit: int = Field(10, ge=1, le=50)
    """How many are listed."""
    offset: int = Field(0, ge=0)
    """Artifacts to pass over."""


class ConfigSuccess(Model):
    """How often a configuration reached the goal in a batch; ``invalid``: runs that could not be attempted."""

    config_id: str
    config_name: str
    success: Rate = Field(description="its share of valid runs that reached the goal")
    invalid: int


_MOST_CONFIGS = 3
"""Configurations of a batch that its line names (chosen): analyze_results with a breakdown names all."""


class BatchSummary(Model):
    """What came out of a batch, and under which conditions; ``lost``: cells that gave no run."""

    prediction: Prediction
    traffic: Traffic
    scenarios: int = Field(description="scenarios that were run")
    configs: tuple[ConfigSuccess, ...] = Field(description="how each configuration did")
    lost: int = 0

    def in_words(self) -> str:
        """Return ``lane prediction, recorded traffic, 25 scenarios: Default 18/25 = 72 % (95 %: 52–86 %)``."""
        told = [f"{one.config_name} {one.success.in_words()}" for one in self.configs[:_MOST_CONFIGS]]
        left_out = len(self.configs) - len(told)
        more = [f"{counted(left_out, 'configuration')} more"] if left_out else []
        invalid = sum(one.invalid for one in self.configs)
        apart = [f"{invalid} invalid"] * bool(invalid) + [f"{self.lost} lost"] * bool(self.lost)
        rates = ", ".join([*told, *more, *apart]) or "no run"
        prediction = self.prediction.replace("_", " ")
        return f"{prediction}, {self.traffic} traffic, {counted(self.scenarios, 'scenario')}: {rates}"


class ListedArtifact(Model):
    """One artifact in a list; ``batch``: what came out of it, where batches were asked for, and left out elsewhere."""

    artifact_id: str
    kind: str = Field(description="kind of the artifact")
    name: str = Field(description="what it is called")
    made_by: str = Field(description="the tool that made it")
    parents: tuple[str, ...] = Field(description="ids of what it was made from")
    made_at: str = Field(description="when it was made, in UTC")
    uri: str = Field(description="address of the resource that describes it")
    batch: BatchSummary | None = Field(None, exclude_if=lambda batch: batch is None)

    def in_words(self) -> str:
        """Return the line of an answer: kind, id, what it is, when it was made."""
        if self.batch is not None:
            return f"{self.kind} {self.artifact_id}, {self.made_at}: {self.batch.in_words()}"
        name = f" ({shown_name(self.name)})" if self.name and self.name != self.artifact_id else ""
        parents = f" from {', '.join(self.parents[:4])}" if self.parents else ""
        return f"{self.kind} {self.artifact_id}{name} by {self.made_by}{parents}, {self.made_at}"


class ListArtifactsResult(Result):
    """Artifacts, newest first; ``more`` where the list goes on after ``limit``."""

    artifacts: tuple[ListedArtifact, ...] = Field(description="the artifacts, newest first")
    more: bool = Field(description="whether the list goes on")

    def answer(self) -> Answer:
        """Return one line each."""
        if not self.artifacts:
            following = "generate_scenarios, find_scenarios or import_files"
            return Answer("Nothing was made yet that fits.", next_step=following)
        lines = [item.in_words() for item in self.artifacts]
        rated = sum(item.batch is not None for item in self.artifacts)
        steps = ["raise offset for more"] * self.more + ["compare_results tests two of them"] * (rated > 1)
        return Answer(lines[0], listed=lines[1:], next_step="; ".join(steps))


class SuccessRequest(Model):
    """Sets of trials that a rate each is wanted of; a trial is its scenario and whether the goal was reached."""

    sets: tuple[tuple[tuple[str, bool], ...], ...]


class SuccessRates(Model):
    """The rate of each set, in the order of the request, with the scenario as the unit."""

    rates: tuple[Rate, ...]


class ExportArtifactsArguments(Arguments):
    """Write files of artifacts into a folder inside an allowed root.

    html: one report on scenarios and batches; solution: CommonRoad file of a run; csv, parquet: runs of a batch, steps
    of a run; opendrive, openscenario: scenarios for other tools.

    Existing files are refused unless overwrite.
    """

    longest_texts: ClassVar[Mapping[str, int]] = {"folder": LONGEST_PATH}
    usual_values: ClassVar[Mapping[str, Any]] = {"folder": "plannerforge-export"}

    ids: list[str] = Field(min_length=1, max_length=200)
    """What is to be written."""
    folder: str
    """Where to, in a folder that the server may use; it is made where it is not there."""
    formats: list[ExportFormat] = Field([], description="none: all stored files")
    overwrite: bool = False
    """Replace files that are there."""


SAME_BOUND_M = 0.1
"""A bound in another format is near the lanelet's within this distance (chosen: what netconvert works with)."""


class RoadGeometry(Model):
    """How far bounds of lanes in a written file lie from the lanelets', looked at from both, as the file reads back."""

    points: int = Field(description="points of the bounds that were compared")
    within_share: float = Field(description="share of them that are closer than 0.1 m, from 0 to 1")
    """Of the points that are at most ``SAME_BOUND_M`` away."""
    max_m: float = Field(description="the largest distance")

    def told(self) -> str:
        """In words."""
        share = f"{math.floor(self.within_share * 1000) / 10:g} %"
        return f"{share} of {self.points:,} points on bounds within {SAME_BOUND_M:g} m, {self.max_m:.2f} m at most"


class ExportedFile(Model):
    """One file that was written; ``lost``: what a format of other tools does not hold of it.

    ``warning``: what a reader of the file may not accept.
    """

    artifact_id: str = Field(description="id of what it holds")
    format: str = Field(description="format of the file")
    path: str = Field(description="path of the file")
    size_bytes: int = Field(description="its size")
    lost: tuple[str, ...] = ()
    geometry: RoadGeometry | None = Field(
        None, description="how well its roads fit the scenario's; null if it holds none"
    )
    warning: str = ""

    def told(self) -> str:
        """Return the line of an answer."""
        line = f"{self.path} ({self.size_bytes:,} bytes, {self.format} of {self.artifact_id})"
        more = ([self.geometry.told()] if self.geometry else []) + (
            [f"lost: {', '.join(self.lost)}"] if self.lost else []
        )
        return "; ".join([line, *more, *([self.warning] if self.warning else [])])


class ExportArtifactsResult(Result):
    """What was written."""

    folder: str = Field(description="where the files are")
    files: tuple[ExportedFile, ...] = Field(description="each file that was written")

    def answer(self) -> Answer:
        """Return the folder, then one line a file."""
        rest = "the structured answer names all"
        return Answer(
            f"{len(self.files)} files in {self.folder}:",
            listed=first_of([file.told() for file in self.files], 40, rest),
        )


class SolutionRequest(Model):
    """A run that is to be written as a CommonRoad solution file."""

    record: RunRecord
    configuration: PlannerConfiguration
    scenario_path: str
    steps_path: str
    target_path: str
    cost_function: CostFunctionId = Field("SM1", description="CommonRoad cost function that the file is entered for")


class RunTableRequest(Model):
    """The cells of a batch that are to be written as a table; with steps and scenarios, all measures are computed."""

    records: tuple[RunRecord, ...]
    steps_paths: dict[str, str] = Field(default_factory=dict, description="by run id")
    scenarios: tuple[ScenarioSource, ...] = ()
    lost: tuple[LostCell, ...]
    configurations: tuple[PlannerConfiguration, ...]
    form: Literal["csv", "parquet"]
    target_path: str


class StepTableRequest(Model):
    """A run, the steps of which are to be written as a table, with its series and debug values."""

    record: RunRecord
    steps_path: str
    form: Literal["csv", "parquet"]
    target_path: str


class FileWritten(Model):
    """The file that a worker wrote."""

    path: str


class ForeignExportRequest(Model):
    """A scenario that is to be written in another tool's format; ``roads``: the name of the file with its roads."""

    scenario_path: str
    target_path: str
    roads: str = ""


class ForeignExport(Model):
    """The file that a worker wrote, what of the scenario it does not hold, in words, and how near its roads are."""

    path: str
    lost: tuple[str, ...] = ()
    geometry: RoadGeometry | None = None


class ImportFilesArguments(Arguments):
    """Take in CommonRoad files or folders, maps (.osm, .pbf, .net.xml) or cost YAML from an allowed root. Result: ids,
    what was refused and why; over 100 files: a job."""

    longest_texts: ClassVar[Mapping[str, int]] = {"path": LONGEST_PATH}

    path: str
    """A file or a folder, in a folder that the server may use."""
    kind: Literal["auto", "scenario", "map", "config"] = "auto"
    """What the files are; `auto` looks into them."""
    name: str | None = None
    """What a map or a configuration is to be called."""
    country: str | None = Field(None, description="of maps")


class ImportedItem(Model):
    """A file that went in; ``reused`` where the same content was there already."""

    file: str = Field(description="path of the file")
    kind: Literal["scenario", "map", "config"] = Field(description="what it was taken as")
    artifact_id: str = Field(description="id of what it became")
    summary: str = Field(description="what it holds, in a line")
    reused: bool = Field(False, description="whether the same content was there already")


class RefusedItem(Model):
    """A file that stayed out, and why."""

    file: str = Field(description="path of the file")
    reason: str = Field(description="why it stayed out")


class ImportFilesResult(Result):
    """What was added and what was refused; until now, where the job of a long import still runs."""

    added: int = Field(description="files that went in")
    reused: int = Field(description="files whose content was there already")
    refused: int = Field(description="files that stayed out")
    items: tuple[ImportedItem, ...] = Field(description="at most 20")
    refusals: tuple[RefusedItem, ...] = Field(description="at most 20")
    job_id: str = ""
    state: JobState = "done"
    note: str = Field("", description="why the job failed, or how far another server is with it")

    def answer(self) -> Answer:
        """Return the answer: counts first, then one line per file."""
        counts = f"{self.added} added, {self.reused} known already, {self.refused} refused."
        told = [counts] if self.added + self.reused + self.refused or not self.note else []
        if self.job_id and (self.state != "done" or self.note):
            told.append(f"{self.job_id}: {self.state}. {self.note}".rstrip())
        elif self.note and told:
            told.append(f"{self.note[0].upper()}{self.note[1:]}.")
        lines = [f"- {i.artifact_id}: {i.summary}{' (reused)' if i.reused else ''}" for i in self.items]
        lines += [f"- refused {shown_name(item.file)}: {item.reason}" for item in self.refusals]
        hidden = self.added + self.reused + self.refused - len(self.items) - len(self.refusals)
        if hidden:
            lines.append(f"… {hidden} more files; describe_catalog counts what is there.")
        following = "get_job waits for the rest" if self.state == "running" else ""
        return Answer(told[0], told[1:], listed=lines, next_step=following)

    def to_line(self) -> str:
        """Return counts and refusals in one line, as the last word of a job."""
        refused = "; ".join(f"{shown_name(item.file)}: {item.reason}" for item in self.refusals)
        counts = f"{self.added} added, {self.reused} known already, {self.refused} refused"
        return f"{counts}: {refused}" if refused else counts
