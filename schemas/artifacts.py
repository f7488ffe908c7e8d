"""Arguments and answers of the tools that import, list and export, and the workers' export requests."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import Field

from .base import LONGEST_PATH, Answer, Arguments, Model, Result, first_of
from .jobs import JobState
from .planning import PlannerConfiguration
from .results import Rate
from .runs import LostCell, Prediction, RunRecord, ScenarioSource, Traffic
from .text import counted, plural, printable, shown_name
from .worlds import PERFECT_NAME

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
    "openlabel",
    "suite",
]
CostFunctionId = Literal["JB1", "SA1", "WX1", "SM1", "SM2", "SM3", "MW1", "TR1", "TR2"]
"""CommonRoad's cost functions by their identifiers in a benchmark id."""


class ListArtifactsArguments(Arguments):
    """Artifacts of this workspace, newest first; batches with their success rates."""

    kind: Literal["scenario", "search", "config", "run", "batch", "map", "plan", "study", "boundary", "job"] | None = (
        None
    )
    """List only artifacts of this kind."""
    parent: str | None = Field(None, description="id it was made from")
    text: str | None = Field(None, description="in ids, names and recipes")
    limit: int = Field(10, ge=1, le=50)
    """How many to list."""
    offset: int = Field(0, ge=0)
    """Artifacts to skip."""


class ConfigSuccess(Model):
    """How often a configuration reached the goal in a batch; ``invalid`` runs could not be attempted."""

    config_id: str
    config_name: str
    success: Rate = Field(description="its share of valid runs that reached the goal")
    invalid: int


_MOST_CONFIGS = 3
"""How many configurations the line of a batch shows (chosen); analyze_results with a breakdown shows all."""


class BatchSummary(Model):
    """The result of a batch and its conditions; ``lost`` counts cells without a run."""

    prediction: Prediction
    traffic: Traffic
    scenarios: int = Field(description="scenarios run")
    scenario_id: str = Field("", exclude_if=lambda scenario_id: not scenario_id, description="the only one of them")
    configs: tuple[ConfigSuccess, ...] = Field(description="success of each configuration")
    lost: int = 0
    world: str = Field(
        PERFECT_NAME, exclude_if=lambda world: world == PERFECT_NAME, description="the sensors; absent: perfect"
    )

    def in_words(self) -> str:
        """Return text such as ``recorded traffic, 25 scenarios: goal reached by Default 18/25 = 72%``."""
        shown = [f"{one.config_name} {one.success.in_words()}" for one in self.configs[:_MOST_CONFIGS]]
        left_out = len(self.configs) - len(shown)
        more = [f"{counted(left_out, 'configuration')} more"] if left_out else []
        invalid = sum(one.invalid for one in self.configs)
        apart = [f"{invalid} invalid"] * bool(invalid) + [f"{self.lost} lost"] * bool(self.lost)
        rates = ", ".join([*shown, *more, *apart])
        rates = f"goal reached by {rates}" if shown else rates or "no run"
        prediction = self.prediction.replace("_", " ")
        world = "" if self.world == PERFECT_NAME else f", world {self.world}"
        where = self.scenario_id or counted(self.scenarios, "scenario")
        return f"{prediction}, {self.traffic} traffic{world}, {where}: {rates}"


class ListedArtifact(Model):
    """One artifact in a list; ``batch`` holds the result of a batch if batches were requested."""

    artifact_id: str
    kind: str = Field(description="kind of the artifact")
    name: str = Field(description="its name")
    made_by: str = Field(description="the tool that made it")
    parents: tuple[str, ...] = Field(description="ids of the artifacts it was made from")
    made_at: str = Field(description="when it was made, in UTC")
    uri: str = Field(description="address of the resource that describes it")
    batch: BatchSummary | None = Field(None, exclude_if=lambda batch: batch is None)

    def in_words(self) -> str:
        """Return the line of an answer: id (after the kind if the id does not begin with it), description, and time."""
        stated = self.kind in self.artifact_id or self.artifact_id.startswith("cfg_")
        who = self.artifact_id if stated else f"{self.kind} {self.artifact_id}"
        if self.batch is not None:
            return f"{who}, {self.made_at}: {self.batch.in_words()}"
        shown = self.name if self.kind == "job" else shown_name(self.name)  # a job's name is its state, in our words
        name = f" ({shown})" if self.name and self.name != self.artifact_id else ""
        more = len(self.parents) - _MOST_PARENTS
        rest = f" and {more} more" if more > 0 else ""
        parents = f" from {', '.join(self.parents[:_MOST_PARENTS])}{rest}" if self.parents else ""
        made_by = _MADE_WITHOUT_TOOL.get(self.made_by, f" by {self.made_by}")
        return f"{who}{name}{made_by}{parents}, {self.made_at}"


_MADE_WITHOUT_TOOL = {"starter": " from the starter set", "preset": ", a preset"}
"""Sources of artifacts that no tool made, in words."""
_MOST_PARENTS = 4
"""How many parents the line of an artifact shows (chosen)."""
_MADE_WITH: Mapping[str, str] = {
    "scenario": "generate_scenarios or import_files",
    "search": "find_scenarios",
    "config": "configure_planner or import_files",
    "run": "run_planner",
    "batch": "run_planner",
    "map": "describe_catalog with facet maps lists the built-in maps; import_files adds one",
    "plan": "generate_scenarios with cover",
    "study": "optimize_planner",
    "boundary": "explore_boundary",
    "job": "generate_scenarios, run_planner or optimize_planner",
}
"""The calls that create artifacts of each kind."""


class ListArtifactsResult(Result):
    """Artifacts, newest first; ``more`` if the list continues after ``limit``."""

    artifacts: tuple[ListedArtifact, ...] = Field(description="the artifacts, newest first")
    more: bool = Field(description="whether the list continues")
    kind: str | None = Field(None, exclude=True)
    is_filtered: bool = Field(False, exclude=True)

    def answer(self) -> Answer:
        """Return one line per artifact."""
        if not self.artifacts:
            following = _MADE_WITH.get(self.kind or "", "generate_scenarios, find_scenarios or import_files")
            what = "imported map" if self.kind == "map" else self.kind or "artifact"
            missing = f"No {what} has these properties." if self.is_filtered else f"There are no {plural(what)} yet."
            return Answer(missing, next_step="leave out text and parent" if self.is_filtered else following)
        lines = [item.in_words() for item in self.artifacts]
        rated = sum(item.batch is not None for item in self.artifacts)
        steps = ["raise offset for more"] * self.more + ["compare two of them with compare_results"] * (rated > 1)
        return Answer(lines[0], listed=lines[1:], next_step="; ".join(steps))


class SuccessRequest(Model):
    """Sets of trials to compute a rate for; a trial is its scenario and whether the run reached the goal."""

    sets: tuple[tuple[tuple[str, bool], ...], ...]


class SuccessRates(Model):
    """The rate of each set, in the order of the request, with the scenario as the unit."""

    rates: tuple[Rate, ...]


class ExportArtifactsArguments(Arguments):
    """Write files of artifacts into a folder inside an allowed root.

    html: one report on scenarios and batches; solution: CommonRoad file of a run; csv, parquet: runs of a batch, steps
    of a run. Scenarios for other tools: opendrive, openscenario; their tags: openlabel. Runs or a batch as a test
    suite: suite.

    Existing files are refused unless overwrite.
    """

    longest_texts: ClassVar[Mapping[str, int]] = {"folder": LONGEST_PATH}
    usual_values: ClassVar[Mapping[str, Any]] = {"folder": "plannerforge-export"}
    examples: ClassVar[Mapping[str, Any]] = {"ids": ["latest"]}

    ids: list[str] = Field(min_length=1, max_length=200)
    """The artifacts to write."""
    folder: str
    """The target folder, inside a folder that the server may use. It is created if necessary."""
    formats: list[ExportFormat] = Field([], description="none: all stored files")
    overwrite: bool = False
    """Replace existing files."""


SAME_BOUND_M = 0.1
"""A bound in another format matches the lanelet's within this distance (chosen: netconvert's precision)."""


class RoadGeometry(Model):
    """Distances between the lane bounds read back from a written file and those of the lanelets, in both directions."""

    points: int = Field(description="points of the compared bounds")
    within_share: float = Field(description="share of them that are closer than 0.1 m, from 0 to 1")
    """The share of the points that are at most ``SAME_BOUND_M`` away."""
    max_m: float = Field(description="the largest distance")

    def in_words(self) -> str:
        """Return the distances as text."""
        share = f"{math.floor(self.within_share * 1000) / 10:g}%"
        return (
            f"{share} of {self.points:,} lane boundary points within {SAME_BOUND_M:g} m of the scenario's, "
            f"the farthest {self.max_m:.2f} m off"
        )


def shown_path(path: Path) -> str:
    """Return a path as answers state it: without characters that cannot be printed."""
    return printable(str(path), kept="")


class ExportedFile(Model):
    """One written file; ``lost`` lists what a format of another tool cannot represent.

    ``warning`` says what a reader of the file may not accept.
    """

    artifact_id: str = Field(description="id of its artifact")
    format: str = Field(description="format of the file")
    path: str = Field(description="path of the file")
    size_bytes: int = Field(description="its size")
    lost: tuple[str, ...] = ()
    geometry: RoadGeometry | None = Field(
        None, description="how well its roads match the scenario's; null without roads"
    )
    warning: str = ""

    @classmethod
    def of(cls, artifact_id: str, form: str, path: Path) -> "ExportedFile":
        """Return the entry of a file that exists now."""
        return cls(artifact_id=artifact_id, format=form, path=shown_path(path), size_bytes=path.stat().st_size)

    def in_words(self) -> str:
        """Return the line of an answer."""
        of = "" if self.format == "suite" else f" of {self.artifact_id}"  # a suite has several runs
        line = f"{self.path} ({self.size_bytes:,} bytes, {self.format}{of})"
        more = ([self.geometry.in_words()] if self.geometry else []) + (
            [f"lost: {', '.join(self.lost)}"] if self.lost else []
        )
        return "; ".join([line, *more, *([self.warning] if self.warning else [])])


class ExportArtifactsResult(Result):
    """The files that were written."""

    folder: str = Field(description="where the files are")
    files: tuple[ExportedFile, ...] = Field(description="each file written")

    def answer(self) -> Answer:
        """Return the folder, then one line per file."""
        rest = "the structured answer lists all"
        return Answer(
            f"{counted(len(self.files), 'file')} in {self.folder}:",
            listed=first_of([file.in_words() for file in self.files], 40, rest),
        )


class SolutionRequest(Model):
    """A run to write as a CommonRoad solution file."""

    record: RunRecord
    configuration: PlannerConfiguration
    scenario_path: str
    steps_path: str
    target_path: str
    cost_function: CostFunctionId = Field("SM1", description="CommonRoad cost function of the file")


class RunTableRequest(Model):
    """The cells of a batch to write as a table; with steps and scenarios, all measures are computed."""

    records: tuple[RunRecord, ...]
    steps_paths: dict[str, str] = Field(default_factory=dict, description="by run id")
    scenarios: tuple[ScenarioSource, ...] = ()
    lost: tuple[LostCell, ...]
    configurations: tuple[PlannerConfiguration, ...]
    form: Literal["csv", "parquet"]
    target_path: str


class StepTableRequest(Model):
    """A run with time steps to write as a table, with its series and debug values."""

    record: RunRecord
    steps_path: str
    form: Literal["csv", "parquet"]
    target_path: str


class FileWritten(Model):
    """The file that a worker wrote."""

    path: str


class ForeignExportRequest(Model):
    """A scenario to write in another tool's format; ``roads`` is the name of the file with its roads."""

    scenario_path: str
    target_path: str
    roads: str = ""


class ForeignExport(Model):
    """The file that a worker wrote, what it cannot represent of the scenario, and how closely its roads match."""

    path: str
    lost: tuple[str, ...] = ()
    geometry: RoadGeometry | None = None


class ImportFilesArguments(Arguments):
    """Import CommonRoad files or folders, maps (.osm, .pbf, .net.xml), cost YAML or OpenLABEL tags from an allowed
    root. Result: ids, what was refused and why; over 100 files: a job."""

    longest_texts: ClassVar[Mapping[str, int]] = {"path": LONGEST_PATH}
    examples: ClassVar[Mapping[str, Any]] = {"path": "maps/town.osm"}

    path: str
    """A file or a folder, in a folder that the server may use."""
    kind: Literal["auto", "scenario", "map", "config"] = "auto"
    """The kind of the files; `auto` detects it."""
    name: str | None = None
    """The name for a map or a configuration."""
    country: str | None = Field(None, description="of maps")


class ImportedItem(Model):
    """An imported file; ``reused`` if the same content was already stored."""

    file: str = Field(description="path of the file")
    kind: Literal["scenario", "map", "config"] = Field(description="the kind it was imported as")
    artifact_id: str = Field(description="id of its artifact")
    summary: str = Field(description="its content in one line")
    reused: bool = Field(False, description="whether the same content was there already")


class RefusedItem(Model):
    """A file that was not imported, and the reason."""

    file: str = Field(description="path of the file")
    reason: str = Field(description="why it was not imported")


class ImportFilesResult(Result):
    """The imported and refused files, so far if a long import is still running."""

    added: int = Field(description="files added")
    reused: int = Field(description="files with content that was already there")
    refused: int = Field(description="files refused")
    items: tuple[ImportedItem, ...] = Field(description="at most 20")
    refusals: tuple[RefusedItem, ...] = Field(description="at most 20")
    job_id: str = ""
    state: JobState = "done"
    note: str = Field("", description="why the job failed, or the progress on another server")

    def answer(self) -> Answer:
        """Return the counts, then one line per file."""
        counts = f"{self.added} added, {self.reused} already stored, {self.refused} refused."
        summary = [counts] if self.added + self.reused + self.refused or not self.note else []
        if self.job_id and (self.state != "done" or self.note):
            summary.append(f"{self.job_id}: {self.state}. {self.note}".rstrip())
        elif self.note and summary:
            summary.append(f"{self.note[0].upper()}{self.note[1:]}.")
        lines = [f"- {i.artifact_id}: {i.summary}{' (already stored)' if i.reused else ''}" for i in self.items]
        lines += [f"- refused {shown_name(item.file)}: {item.reason}" for item in self.refusals]
        hidden = self.added + self.reused + self.refused - len(self.items) - len(self.refusals)
        if hidden:
            lines.append(f"… {hidden} more files; describe_catalog counts all.")
        following = "get_job waits for the rest" if self.state == "running" else ""
        return Answer(summary[0], summary[1:], listed=lines, next_step=following)

    def to_line(self) -> str:
        """Return counts and refusals in one line, as the result of a job."""
        refused = "; ".join(f"{shown_name(item.file)}: {item.reason}" for item in self.refusals)
        counts = f"{self.added} added, {self.reused} already stored, {self.refused} refused"
        return f"{counts}: {refused}" if refused else counts
