"""Pictures, animations, charts, the report and views: what is asked and what was made.

To add a chart, name its kind in ``PictureKind``, say in ``REPORT_PICTURES`` where a report shows it, if it does, and
write its function into ``CHARTS`` of ``engine/rendering/charts.py``.
"""

from dataclasses import dataclass
from typing import Final, Literal

from pydantic import Field

from .analysis.optimization import StudyRecord
from .base import Arguments, Model
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
]


ReportPart = Literal["overview", "comparison", "findings", "one_run", "same_scenario"]
"""A part of the report on a batch. ``one_run`` shows the run that tells most, ``same_scenario`` all on its scenario."""


@dataclass(frozen=True)
class ReportPicture:
    """A picture in the report: the part in which it stands, in the order of the table, and its caption."""

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
    "animation": ReportPicture("one_run", "The run from above in motion; slower around its decisive moment"),
    "timeline": ReportPicture("one_run", "The run over time, with its moments"),
    "terms": ReportPicture("one_run", "What the cost of the chosen trajectories was made of over time"),
    "profile": ReportPicture("same_scenario", "Speed and acceleration of all runs on this scenario"),
}
"""The pictures that a report on a batch shows; a kind without an entry is in no report."""


class RenderArguments(Arguments):
    """Picture, animation or chart; two ids: side by side."""

    ids: list[str] = Field(["latest"], min_length=1, max_length=200, description="scenario, run or batch ids")
    kind: PictureKind = "auto"
    """What is drawn; `auto`: the outcomes of runs on several scenarios, else a picture."""
    time_s: float | None = Field(None, ge=0, description="default: start or a run's end")
    focus: int | None = Field(None, description="vehicle to centre on")


class RenderRequest(Model):
    """What the drawing operation needs: files, records and where to put the pictures.

    ``scenarios`` in the order in which they are drawn; ``runs`` may be empty; ``folder`` exists. ``study``: what a
    chart of a search shows; ``lineage``: of edited scenarios, which count as one in every rate.
    """

    kind: PictureKind
    scenarios: tuple[ScenarioSource, ...] = ()
    runs: tuple[RunSource, ...] = ()
    configs: tuple[ConfigWeights, ...] = ()
    lineage: tuple[Lineage, ...] = Field((), exclude_if=lambda lineage: not lineage)
    time_s: float | None = None
    focus: int | None = Field(None, exclude_if=lambda focus: focus is None)
    study: StudyRecord | None = Field(None, exclude_if=lambda study: study is None)
    folder: str


class RenderedImage(Model):
    """One image file; ``alt_text`` says in words what can be seen on it."""

    path: str
    mime_type: Literal["image/png", "image/gif"]
    width_px: int
    height_px: int
    size_bytes: int
    alt_text: str


PICTURE_FORMAT = 2
"""Of what is drawn for a request; it rises when another set of images is made."""


class Rendered(Model):
    """The images that were made; ``notes`` name what was left out of them and why."""

    kind: PictureKind
    images: tuple[RenderedImage, ...]
    notes: tuple[str, ...] = ()


class ReportImage(Model):
    """A picture on the report: file, caption and the words for those who cannot see it."""

    path: str
    caption: str
    alt_text: str


class ReportTable(Model):
    """A table; numbers are given as they shall be read."""

    caption: str = ""
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


class ReportSection(Model):
    """One stage of the work: what was asked, what came of it, with tables, pictures and findings."""

    title: str
    asked: str = Field("", description="what was asked, in words")
    text: tuple[str, ...] = Field((), description="paragraphs")
    findings: tuple[str, ...] = ()
    tables: tuple[ReportTable, ...] = ()
    images: tuple[ReportImage, ...] = ()
    took_s: float | None = None
    view: str = Field("", description="name of the file beside the report that shows it in motion")


class ReportRequest(Model):
    """A one-page report: sections in reading order, written to ``path`` as one self-contained HTML file."""

    title: str
    introduction: str = ""
    sections: tuple[ReportSection, ...]
    footer: str = ""
    path: str


class ReportWritten(Model):
    """Where the report lies and how large it is."""

    path: str
    size_bytes: int
    sections: int
    images: int


ViewKind = Literal["player", "board"]
"""``player``: a scenario or a run in motion, or two side by side; ``board``: the runs of batches at a glance."""
VIEW_FORMAT = 3
"""Of the data of views; it rises when their meaning changes."""


class ViewPane(Model):
    """What one half of a player shows: a scenario, and the run over it (None: the recording alone).

    ``plans_path``: the run's plans (``RunPlans``); empty: they are not shown, for what ``note`` says.
    """

    scenario: ScenarioSource
    run: RunSource | None = None
    plans_path: str = ""
    note: str = ""


class ViewRequest(Model):
    """What the operation for views needs, and the JSON file that it writes.

    ``panes``: of a player, one or two; ``runs``: of a board, with their scenarios in ``scenarios``, the ``batches``
    that they are of, if any, and the ``lineage`` of edited scenarios, which count as one in every rate. ``whole``: a
    board holds what its player shows, for a page that has nobody to ask for it.
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
    """Where the data of a view lie and how large they are; ``notes``: what was left out and why."""

    kind: ViewKind
    path: str
    size_bytes: int
    notes: tuple[str, ...] = ()
