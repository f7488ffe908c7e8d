"""The data of views for their pages: whole numbers, differences, and printable text on one line.

Only the scripts of the pages read them (``scene.js``, ``player.js``, ``board.js``).
"""

from typing import Literal

from pydantic import Field

from ....schemas.base import Model
from ....schemas.rendering import VIEW_FORMAT
from ....schemas.runs import Outcome, Prediction, Traffic

Line = tuple[int, ...]
"""Points as x, y, x, y, … in cm from the origin of the scene; after the first point, differences from the previous one.

This takes a quarter of the digits, and a browser adds them up quickly.
"""


class TrackView(Model):
    """The motion of one road user: a sample every ``stride`` steps from ``first_step``.

    Each array has a first value, followed by differences: centre in cm from the origin, unwrapped heading in mrad,
    speed in cm/s. ``driven``: moved by reactive traffic instead of its recording.
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
    """A traffic light: its states in order, with the number of steps of each; empty if it is off."""

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
    """The static parts of a scene. ``arrows``: x, y in cm and heading in mrad of marks along the lanelets, in sequence.

    ``edges``: edges of the road; ``dividers``: lines between lanes; ``crossings``: their stripes.
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
    """A scenario in the player's format. ``origin_m``: origin of its coordinates, in those of the scenario.

    ``shown_cm``: left, bottom, right and top of the initial view. ``start``: the ego at its start.
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
    """A moment of a run that you can jump to in the player: its step and a description."""

    step: int
    words: str
    decisive: bool = False


class PlanView(Model):
    """A planner's state at a step: its plan, other candidates, and the predicted positions of other road users."""

    step: int
    plan: Line
    candidates: tuple[Line, ...]
    predictions: tuple[Line, ...]


class AreaView(Model):
    """An outline that a planner reported at a planning step, with its name."""

    step: int
    name: str
    outline: Line


class DriveView(Model):
    """A run over a scene: the ego, with accelerations and nearness to others per driven state.

    ``series``: further values per driven state, by name with unit. ``planned`` and ``told``: numbers and texts per
    planning step, including the planner's debug values. ``areas``: the polygons that it reported.

    ``acceleration_cmps2``: along the path. ``gap_cm``: the gap to the nearest road user; ``nearest``: its id.
    ``collision_cs``: time to collision in 1/100 s. None means no road user within 60 m, or no collision course.
    ``costs``, ``rejected``: as stored, one value per planning step. ``others``: the motion of reactive traffic.
    ``figures``: metrics in words.
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
    """The whole content of a player."""

    format: int = VIEW_FORMAT
    kind: Literal["player"] = "player"
    title: str
    scenes: tuple[SceneView, ...]
    panes: tuple[PaneView, ...]
    notes: tuple[str, ...] = ()


class BoardColumn(Model):
    """One column of a board: the runs of one batch (if any) with the same configuration, prediction, traffic and seed.

    ``success``: the rate in words, with its interval; ``outcomes``: the number of runs per outcome.
    """

    title: str
    success: str
    outcomes: dict[Outcome, int]


class BoardRow(Model):
    """One problem of a board; ``about``: its road and road users in words."""

    title: str
    scenario_id: str
    about: str


class BoardMetric(Model):
    """A metric of a board; ``better``: the better direction, if there is one."""

    words: str
    unit: str
    better: Literal["lower", "higher"] | None


class BoardRun(Model):
    """A run on a board: its position, its outcome, its metrics in the board's order.

    ``flip``: set if exactly one of this run and the first column's run in its row reached the goal, and both were
    valid.
    """

    run_id: str
    row: int
    column: int
    outcome: Outcome
    ending: str
    flip: Literal["to_success", "to_failure"] | None
    values: tuple[float | None, ...]


class BoardView(Model):
    """The whole content of a board.

    ``scenes`` and ``drives`` (by run): what its player can show without a request. ``lost``: the cells without a run.
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
