"""Pictures, animations, charts, the report and views: requests and results.

To add a chart, add its kind to ``PictureKind``, add its place in a report to ``REPORT_PICTURES`` if it has one, and add
its function to ``CHARTS`` in ``engine/rendering/charts.py``.
"""

from dataclasses import dataclass
from typing import Final, Literal

from pydantic import Field

from .analysis.optimization import StudyRecord
from .base import Arguments, Model
from .boundaries import BoundaryRecord
from .results import ConfigWeights
from .runs import BatchRecord, Lineage, RunSource, ScenarioSource

PictureKind = Literal[
    "auto",
    "picture",
    "animation",
    "outcomes",
    "causes",
    "strata",
    "distributions",
    "flips",
    "costs",
    "terms",
    "profile",
    "timeline",
    "search",
    "boundary",
]


ReportPart = Literal["overview", "comparison", "findings", "one_run", "same_scenario"]
"""A part of the report on a batch. ``one_run`` shows the most informative run, ``same_scenario`` all runs on its
scenario."""


@dataclass(frozen=True)
class ReportPicture:
    """A picture in the report: the part that it belongs to, and its caption."""

    part: ReportPart
    caption: str


REPORT_PICTURES: Final[dict[PictureKind, ReportPicture]] = {
    "outcomes": ReportPicture("overview", "How the runs ended, by configuration"),
    "causes": ReportPicture("overview", "Who hit whom, and whether a reference driver in the ego's place prevents it"),
    "strata": ReportPicture("overview", "Success by conditions, road and density of traffic"),
    "distributions": ReportPicture("comparison", "The metrics of all runs, by configuration"),
    "flips": ReportPicture("comparison", "Scenarios that flipped between the first two configurations"),
    "costs": ReportPicture("findings", "Mean weighted cost by term and configuration"),
    "picture": ReportPicture("one_run", "The run from above, at its end"),
    "animation": ReportPicture("one_run", "The run from above in motion; slower around its key moment"),
    "timeline": ReportPicture("one_run", "The run over time, with its key moments"),
    "terms": ReportPicture("one_run", "Cost terms of the chosen trajectories over time"),
    "profile": ReportPicture("same_scenario", "Speed and acceleration of all runs on this scenario"),
}
"""The pictures of a report on a batch. A kind without an entry is in no report."""


class RenderArguments(Arguments):
    """Picture, animation or chart; two ids: side by side."""

    ids: list[str] = Field(["latest"], min_length=1, max_length=200, description="scenario, run or batch ids")
    kind: PictureKind = "auto"
    """What to draw; `auto` draws the outcomes of runs on several scenarios, otherwise a picture."""
    time_s: float | None = Field(None, ge=0, description="default: start or run's end")
    focus: int | None = Field(None, description="centred vehicle")


class RenderRequest(Model):
    """The request of the drawing operation: files, records and the folder for the pictures.

    ``scenarios`` are in drawing order, ``runs`` may be empty, and ``folder`` exists. ``study`` is the search that a
    search chart shows, ``boundary`` the map that a boundary chart shows. ``lineage`` lists edited scenarios with their
    originals; each original and its edits count as one in every rate.
    """

    kind: PictureKind
    scenarios: tuple[ScenarioSource, ...] = ()
    runs: tuple[RunSource, ...] = ()
    configs: tuple[ConfigWeights, ...] = ()
    lineage: tuple[Lineage, ...] = Field((), exclude_if=lambda lineage: not lineage)
    time_s: float | None = None
    focus: int | None = Field(None, exclude_if=lambda focus: focus is None)
    study: StudyRecord | None = Field(None, exclude_if=lambda study: study is None)
    boundary: BoundaryRecord | None = Field(None, exclude_if=lambda boundary: boundary is None)
    folder: str


class RenderedImage(Model):
    """One image file; ``alt_text`` describes it in words."""

    path: str
    mime_type: Literal["image/png", "image/gif"]
    width_px: int
    height_px: int
    size_bytes: int
    alt_text: str


PICTURE_FORMAT = 2
"""The version of drawn images. Raise it if the same request would give different images."""


class Rendered(Model):
    """The images; ``notes`` say what was left out and why."""

    kind: PictureKind
    images: tuple[RenderedImage, ...]
    notes: tuple[str, ...] = ()


class ReportImage(Model):
    """A picture in the report: file, caption and alternative text."""

    path: str
    caption: str
    alt_text: str


class ReportTable(Model):
    """A table, with numbers formatted for readers."""

    caption: str = ""
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


class ReportSection(Model):
    """One stage of the work: the request and its result, with tables, pictures and findings."""

    title: str
    asked: str = Field("", description="the request in words")
    text: tuple[str, ...] = Field((), description="paragraphs")
    findings: tuple[str, ...] = ()
    tables: tuple[ReportTable, ...] = ()
    images: tuple[ReportImage, ...] = ()
    took_s: float | None = None
    view: str = Field("", description="name of the file next to the report that shows it in motion")


class ReportRequest(Model):
    """A one-page report: sections in reading order, written to ``path`` as one self-contained HTML file."""

    title: str
    introduction: str = ""
    sections: tuple[ReportSection, ...]
    footer: str = ""
    path: str


class ReportWritten(Model):
    """The path and size of the report."""

    path: str
    size_bytes: int
    sections: int
    images: int


ViewKind = Literal["player", "board"]
"""``player``: one scenario or run in motion, or two side by side. ``board``: the runs of batches at a glance."""
VIEW_FORMAT = 3
"""The version of the data of views. Raise it if their meaning changes."""


class ViewPane(Model):
    """One half of a player: a scenario and the run on it (None for the recording alone).

    ``plans_path`` is the path of the run's plans (``RunPlans``), or empty if they are not shown; ``note`` says why.
    """

    scenario: ScenarioSource
    run: RunSource | None = None
    plans_path: str = ""
    note: str = ""


class ViewRequest(Model):
    """The request to the operation for views, and the path of the JSON file that it writes.

    A player has one or two ``panes``. A board has ``runs``, their ``scenarios``, their ``batches`` if any, and the
    ``lineage`` of edited scenarios, which count as one in every rate. With ``whole``, a board includes the data of its
    player, for a page without a server.
    """

    kind: ViewKind
    title: str
    panes: tuple[ViewPane, ...] = ()
    batches: tuple[BatchRecord, ...] = ()
    runs: tuple[RunSource, ...] = ()
    scenarios: tuple[ScenarioSource, ...] = ()
    lineage: tuple[Lineage, ...] = Field((), exclude_if=lambda lineage: not lineage)
    whole: bool = True
    path: str


class ViewWritten(Model):
    """The path and size of a view's data; ``notes`` say what was left out, and why."""

    kind: ViewKind
    path: str
    size_bytes: int
    notes: tuple[str, ...] = ()
