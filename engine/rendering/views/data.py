"""The data of views as pages read them: whole numbers, differences, and text that is printable and on one line.

Only the scripts of the pages read them again (``scene.js``, ``player.js``, ``board.js``).
"""

from typing import Literal

from pydantic import Field

from ....schemas.base import Model
from ....schemas.rendering import VIEW_FORMAT
from ....schemas.runs import Outcome, Prediction, Traffic

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


class PlanView(Model):
    """What a planner had in mind from a step on: its plan, other candidates, where it expected others."""

    step: int
    plan: Line
    candidates: tuple[Line, ...]
    predictions: tuple[Line, ...]


class AreaView(Model):
    """An outline that a planner reported at a planning step, by the name that it gave."""

    step: int
    name: str
    outline: Line


class DriveView(Model):
    """A run over a scene: the ego, and a value a driven state of what passengers feel and how near others were.

    ``series``: further values, one for each driven state, by name with unit. ``planned`` and ``told``: numbers and
    texts, one for each planning step, among them the planner's debug values. ``areas``: the polygons that it reported.

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
    plans: tuple[PlanView, ...] = ()
    series: dict[str, tuple[float | None, ...]] = Field(default_factory=dict)
    planned: dict[str, tuple[float | None, ...]] = Field(default_factory=dict)
    told: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    areas: tuple[AreaView, ...] = ()


class PaneView(Model):
    """One half of a player: the scene of ``scenario_id`` and the run over it."""

    title: str
    scenario_id: str
    drive: DriveView | None = None


class PlayerView(Model):
    """All that a player shows."""

    format: int = VIEW_FORMAT
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
    """All that a board shows.

    ``scenes`` and ``drives`` (by run): what its player shows without asking anybody; ``lost``: cells without a run.
    """

    format: int = VIEW_FORMAT
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
