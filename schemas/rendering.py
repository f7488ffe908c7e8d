"""Pictures, animations, charts, the report and views: what is asked and what was made."""

from typing import Literal

from pydantic import Field

from .analysis.optimization import StudyRecord
from .base import Arguments, Model
from .results import ConfigWeights
from .runs import BatchRecord, Outcome, Prediction, RunSource, ScenarioSource, Traffic

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


class RenderArguments(Arguments):
    """Picture, animation or chart of scenarios, runs or batches; two ids: side by side."""

    ids: list[str] = Field(["latest"], min_length=1, max_length=200, description="scenario, run or batch ids")
    kind: PictureKind = "auto"
    time_s: float | None = Field(None, ge=0, description="moment of a picture; default: the start, or a run's end")


class RenderRequest(Model):
    """What the drawing operation needs: files, records and where to put the pictures.

    ``scenarios`` in the order in which they are drawn; ``runs`` may be empty; ``folder`` exists. ``study``: what a
    chart of a search shows.
    """

    kind: PictureKind
    scenarios: tuple[ScenarioSource, ...] = ()
    runs: tuple[RunSource, ...] = ()
    configs: tuple[ConfigWeights, ...] = ()
    time_s: float | None = None
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


class ViewPane(Model):
    """What one half of a player shows: a scenario, and the run over it (None: the recording alone)."""

    scenario: ScenarioSource
    run: RunSource | None = None


class ViewRequest(Model):
    """What the operation for views needs, and the JSON file that it writes.

    ``panes``: of a player, one or two; ``runs``: of a board, with their scenarios in ``scenarios``, the ``batches``
    that they are of, if any. ``whole``: a board holds what its player shows, for a page that has nobody to ask for it.
    """

    kind: ViewKind
    title: str
    panes: tuple[ViewPane, ...] = ()
    batches: tuple[BatchRecord, ...] = ()
    runs: tuple[RunSource, ...] = ()
    scenarios: tuple[ScenarioSource, ...] = ()
    whole: bool = True
    path: str


class ViewWritten(Model):
    """Where the data of a view lie and how large they are; ``notes``: what was left out and why."""

    kind: ViewKind
    path: str
    size_bytes: int
    notes: tuple[str, ...] = ()


Line = tuple[int, ...]
"""Points as x, y, x, y, … in cm from the origin of the scene; from the second point on, differences to the one before.

A line of a road is written with a quarter of the digits so, and a browser adds them up in no time.
"""


class TrackView(Model):
    """How one road user moved: a sample every ``stride`` steps from ``first_step`` on.

    Each array begins with a value, and differences to the one before follow: centre in cm from the origin, unwrapped
    heading in mrad, speed in cm/s. ``driven``: moved by reactive traffic instead of its recording.
    """

    obstacle_id: int
    kind: str
    length_cm: int
    width_cm: int
    first_step: int
    stride: int = 1
    x_cm: tuple[int, ...]
    y_cm: tuple[int, ...]
    heading_mrad: tuple[int, ...]
    speed_cmps: tuple[int, ...]
    driven: bool = False


class LaneletView(Model):
    """A lanelet: the outline of its surface."""

    lanelet_id: int
    outline: Line


class SignalView(Model):
    """A traffic light: its states one after the other with how many steps each stays; none: it is off."""

    signal_id: int
    x_cm: int
    y_cm: int
    states: tuple[str, ...]
    steps: tuple[int, ...]
    offset: int


class StandingView(Model):
    """An obstacle that never moves: its outline."""

    obstacle_id: int
    kind: str
    outline: Line


class RoadView(Model):
    """What does not move. ``arrows``: x, y in cm and heading in mrad of marks along the lanelets, one after the other.

    ``edges``: where the road ends; ``dividers``: between lanes; ``crossings``: their stripes.
    """

    lanelets: tuple[LaneletView, ...]
    edges: tuple[Line, ...]
    dividers: tuple[Line, ...]
    arrows: tuple[int, ...]
    stop_lines: tuple[Line, ...]
    pavements: tuple[Line, ...]
    crossings: tuple[Line, ...]
    goals: tuple[Line, ...]
    signals: tuple[SignalView, ...]
    standing: tuple[StandingView, ...]


class SceneView(Model):
    """A scenario as a player draws it. ``origin_m``: what its coordinates are counted from, in those of the scenario.

    ``shown_cm``: left, bottom, right and top of what matters at the start. ``start``: the ego where it begins.
    """

    scenario_id: str
    step_s: float
    origin_m: tuple[float, float]
    first_step: int
    last_step: int
    shown_cm: tuple[int, int, int, int]
    road: RoadView
    tracks: tuple[TrackView, ...]
    start: TrackView | None


class MomentView(Model):
    """A moment of a run that a player leads to: its step, and what happens then."""

    step: int
    words: str
    decisive: bool = False


class DriveView(Model):
    """A run over a scene: the ego, and a value a driven state of what passengers feel and how near others were.

    ``acceleration_cmps2``: along the path; ``gap_cm`` to the nearest other, ``nearest`` which one, ``collision_cs``:
    time to collision in 1/100 s; None: no other within 60 m, or none on a collision course. ``costs``, ``rejected``: as
    stored, one value a planning step. ``others``: how reactive traffic moved. ``figures``: metrics in words.
    """

    run_id: str
    config_id: str
    name: str
    outcome: Outcome
    ending: str
    prediction: Prediction
    traffic: Traffic
    ego: TrackView
    acceleration_cmps2: tuple[int, ...]
    gap_cm: tuple[int | None, ...]
    nearest: tuple[int | None, ...]
    collision_cs: tuple[int | None, ...]
    plan_steps: tuple[int, ...]
    costs: dict[str, tuple[float, ...]]
    rejected: dict[str, tuple[int, ...]]
    collision_step: int | None
    collision_id: int | None
    moments: tuple[MomentView, ...]
    figures: tuple[tuple[str, str], ...]
    others: tuple[TrackView, ...]


class PaneView(Model):
    """One half of a player: the scene of ``scenario_id`` and the run over it."""

    title: str
    scenario_id: str
    drive: DriveView | None = None


class PlayerView(Model):
    """All that a player shows; ``format`` rises when its meaning changes."""

    format: Literal[1] = 1
    kind: Literal["player"] = "player"
    title: str
    scenes: tuple[SceneView, ...]
    panes: tuple[PaneView, ...]
    notes: tuple[str, ...] = ()


class BoardColumn(Model):
    """One side of a board: a configuration under one prediction and traffic, of one batch where there are several.

    ``success``: the rate in words, with its interval; ``outcomes``: how many runs ended so.
    """

    title: str
    success: str
    outcomes: dict[Outcome, int]


class BoardRow(Model):
    """One problem of a board: ``about``: its road and road users in words."""

    title: str
    scenario_id: str
    about: str


class BoardMetric(Model):
    """A metric of a board; ``better``: which direction is, where one is."""

    words: str
    unit: str
    better: Literal["lower", "higher"] | None


class BoardRun(Model):
    """A run of a board: its place, how it ended, its metrics in the board's order.

    ``flip``: whether it reached the goal where the first column's run of its row did not, or the other way round; both
    could be attempted.
    """

    run_id: str
    row: int
    column: int
    outcome: Outcome
    ending: str
    flip: Literal["to_success", "to_failure"] | None
    values: tuple[float | None, ...]


class BoardView(Model):
    """All that a board shows; ``format`` rises when its meaning changes.

    ``scenes`` and ``drives`` (by run): what its player shows without asking anybody; ``lost``: cells without a run.
    """

    format: Literal[1] = 1
    kind: Literal["board"] = "board"
    title: str
    columns: tuple[BoardColumn, ...]
    rows: tuple[BoardRow, ...]
    metrics: tuple[BoardMetric, ...]
    runs: tuple[BoardRun, ...]
    lost: tuple[str, ...] = ()
    scenes: tuple[SceneView, ...] = ()
    drives: dict[str, DriveView] = Field(default_factory=dict)
    notes: tuple[str, ...] = ()
