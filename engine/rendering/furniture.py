"""What stands around a scenario: title, scale bar, and a legend of what it shows."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ..geometry import Points
from .canvas import EGO_COLOUR, INK, MUTED, SMALL_PT, TEXT_PT, TITLE_PT, class_colour, light_mark, series_style
from .content import ScenarioView, Viewport
from .vehicles import vehicles_at

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Handle = TypeVar("Handle")


def write_title(figure: "Figure", title: str, subtitle: str, *, x: float = 0.012, top_px: float = 10) -> None:
    """Title and subtitle at the top left, in pixels from the top edge."""
    height = figure.get_figheight() * figure.dpi
    figure.text(x, 1 - top_px / height, title, fontsize=TITLE_PT, fontweight="bold", va="top")
    figure.text(x, 1 - (top_px + 26) / height, subtitle, fontsize=TEXT_PT, color=MUTED, va="top")


def draw_scale_bar(axes: "Axes", viewport: Viewport) -> None:
    """A bar of a round length at the lower left of the axes, on a white ground."""
    length = round_length(viewport.width_m / 5)
    x, y = scale_bar_area(viewport)[0] + (0, viewport.height_m * 0.02)
    tick = viewport.height_m * 0.012
    axes.plot(
        [x, x, x, x + length, x + length, x + length],
        [y + tick, y - tick, y, y, y - tick, y + tick],
        color=INK,
        linewidth=1.6,
        zorder=9,
    )
    axes.text(
        x + length / 2,
        y + tick * 1.4,
        f"{length:g} m",
        ha="center",
        va="bottom",
        fontsize=SMALL_PT,
        zorder=9,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
    )


def scale_bar_area(viewport: Viewport) -> Points:
    """Lower left and upper right corner of what the scale bar covers, in scenario coordinates, shape (2, 2)."""
    low = np.array([viewport.x_min + viewport.width_m * 0.02, viewport.y_min + viewport.height_m * 0.025])
    size = np.array([round_length(viewport.width_m / 5), viewport.height_m * 0.06])
    return np.stack([low, low + size])


def round_length(about_m: float) -> float:
    """The largest of 1, 2, 5 × 10ⁿ metres that is not above the given length."""
    power = 10.0 ** math.floor(math.log10(about_m))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= about_m)


@dataclass(frozen=True)
class Inventory:
    """What a picture shows; everything named here gets an entry in the legend; ``runs``: label and series."""

    kinds: tuple[str, ...]
    signals: tuple[str, ...]
    runs: tuple[tuple[str, int], ...]
    has_ego: bool
    has_goal: bool
    has_stop_lines: bool
    has_collision: bool

    @property
    def columns(self) -> int:
        """Entries beside each other; runs have long names."""
        return 4 if self.runs else 7

    @property
    def rows(self) -> int:
        """Lines of the legend."""
        flags = (self.has_ego, self.has_goal, self.has_stop_lines, self.has_collision)
        entries = len(self.kinds) + len(self.signals) + len(self.runs) + sum(flags)
        return max(math.ceil(entries / self.columns), 1)


def inventory(
    views: Sequence[ScenarioView], viewports: Sequence[Viewport], steps: Iterable[int] | None = None
) -> Inventory:
    """What these views show at their own step, or at any of ``steps``."""
    moments = None if steps is None else list(steps)
    kinds, signals = set(), set()
    runs: dict[int, str] = {}
    stop_lines = collision = False
    for view, viewport in zip(views, viewports, strict=True):
        shown = [view.step] if moments is None else moments
        for step in shown:
            kinds |= {vehicle.kind for vehicle in vehicles_at(view.content, step) if viewport.contains(vehicle.corners)}
            signals |= {
                signal.state_at(step) for signal in view.content.signals if viewport.contains(signal.position[None, :])
            }
        for path in view.paths:
            runs.setdefault(path.series, path.label if len(views) == 1 else path.name)
        stop_lines |= any(viewport.contains(line) for line in view.content.stop_lines)
        collisions = [path.record.collision for path in view.paths if path.record.collision is not None]
        collision |= any(hit.step <= max(shown) for hit in collisions)
    return Inventory(
        kinds=tuple(sorted(kinds)),
        signals=tuple(sorted(signals)),
        runs=tuple((label, series) for series, label in sorted(runs.items())),
        has_ego=any(view.content.ego_position is not None and len(view.paths) < 2 for view in views),
        has_goal=any(len(view.content.goal_points()) for view in views),
        has_stop_lines=stop_lines,
        has_collision=collision,
    )


_CLASS_WORDS = {"priorityVehicle": "emergency vehicle", "parkedVehicle": "parked vehicle", "unknown": "other"}
_LIGHT_WORDS = {"redYellow": "red and yellow", "inactive": "off"}


def draw_legend(figure: "Figure", shown: Inventory) -> None:
    """One legend at the bottom of the figure, naming only what is there."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    def mark(marker: str, face: str, size: float, label: str) -> Line2D:
        return Line2D(
            [], [], marker=marker, color=face, markeredgecolor=INK, markersize=size, linestyle="none", label=label
        )

    handles: list[Line2D | Patch] = []
    for label, series in shown.runs:
        colour, dashes = series_style(series)
        handles.append(Line2D([], [], color=colour, linestyle=dashes, linewidth=3, label=label))
    if shown.has_collision:
        handles.append(mark("X", "white", 10, "collision"))
    if shown.has_ego:
        handles.append(Patch(facecolor=EGO_COLOUR, edgecolor=INK, label="ego"))
    if shown.has_goal:
        handles.append(Patch(facecolor="none", edgecolor=EGO_COLOUR, hatch="////", label="goal"))
    handles += [
        Patch(facecolor=class_colour(kind), edgecolor=INK, label=_CLASS_WORDS.get(kind, kind)) for kind in shown.kinds
    ]
    if shown.has_stop_lines:
        handles.append(Line2D([], [], color=INK, linewidth=2.6, label="stop line"))
    handles += [
        mark(*light_mark(state), 7, f"traffic light: {_LIGHT_WORDS.get(state, state)}") for state in shown.signals
    ]
    if handles:
        figure.legend(
            handles=_by_rows(handles, shown.columns),
            loc="lower left",
            ncols=min(len(handles), shown.columns),
            frameon=False,
            fontsize=SMALL_PT + 0.5,
            bbox_to_anchor=(0.004, 0.0),
            handlelength=2.6 if shown.runs else 1.8,
            columnspacing=1.4,
        )


def _by_rows(handles: list[Handle], columns: int) -> list[Handle]:
    """Matplotlib fills a legend column by column; this order makes it read row by row."""
    rows = math.ceil(len(handles) / columns)
    if rows == 1:
        return handles
    full = len(handles) - (rows - 1) * columns
    heights = [rows if column < full else rows - 1 for column in range(columns)]
    return [handles[row * columns + column] for column, height in enumerate(heights) for row in range(height)]
