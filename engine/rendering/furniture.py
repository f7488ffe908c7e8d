"""Draws what surrounds a drawing: its title, and a legend of its content."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from .canvas import EGO_COLOUR, INK, MUTED, SMALL_PT, TEXT_PT, TITLE_PT, class_colour, light_mark, series_style
from .content import ScenarioView, Viewport

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Handle = TypeVar("Handle")


def write_title(figure: "Figure", title: str, subtitle: str, *, x: float = 0.012, top_px: float = 10) -> None:
    """Write title and subtitle at the top left, in pixels from the top edge."""
    height = figure.get_figheight() * figure.dpi
    figure.text(x, 1 - top_px / height, title, fontsize=TITLE_PT, fontweight="bold", va="top")
    figure.text(x, 1 - (top_px + 26) / height, subtitle, fontsize=TEXT_PT, color=MUTED, va="top")


def write_legend(figure: "Figure", x: float, columns: int, **style: Any) -> None:
    """Draw a legend at the bottom of the figure, starting at ``x`` (share of the width)."""
    corner, size = (x, 0), SMALL_PT + 0.5
    figure.legend(loc="lower left", ncols=columns, frameon=False, bbox_to_anchor=corner, fontsize=size, **style)


def shortened(text: str, length: int) -> str:
    """Return the text cut to a length, with an ellipsis if anything was cut off."""
    return text if len(text) <= length else text[: length - 1] + "…"


@dataclass(frozen=True)
class Inventory:
    """The content of a picture, with one entry per entry of the legend; ``runs``: label and series."""

    kinds: tuple[str, ...]
    signals: tuple[str, ...]
    runs: tuple[tuple[str, int], ...]
    has_ego: bool
    ego_name: str
    has_goal: bool
    has_stop_lines: bool
    has_collision: bool

    @classmethod
    def of(
        cls, views: Sequence[ScenarioView], viewports: Sequence[Viewport], steps: Sequence[int] | None = None
    ) -> "Inventory":
        """Return the content of the given views at their own step, or at any of ``steps`` if given."""
        kinds, signals = set(), set()
        runs: dict[int, str] = {}
        stop_lines = collision = False
        for view, viewport in zip(views, viewports, strict=True):
            content, shown = view.content, [view.step] if steps is None else steps
            seen = [signal for signal in content.signals if viewport.contains(signal.position[None, :])]
            for step in shown:
                kinds |= {vehicle.kind for vehicle in content.vehicles_at(step) if viewport.contains(vehicle.corners)}
                signals |= {signal.state_at(step) for signal in seen}
            for path in view.paths:
                runs.setdefault(path.series, path.label if len(views) == 1 else path.name)
            stop_lines |= any(viewport.contains(line) for line in content.stop_lines)
            hits = [path.record.collision for path in view.paths]
            collision |= any(hit is not None and hit.obstacle_id is not None and hit.step <= max(shown) for hit in hits)
        return cls(
            kinds=tuple(sorted(kinds)),
            signals=tuple(sorted(signals)),
            runs=tuple((label, series) for series, label in sorted(runs.items())),
            ego_name=names.pop() if len(names := {view.ego_name for view in views}) == 1 else "ego",
            has_ego=any(view.content.ego_position is not None and len(view.paths) < 2 for view in views),
            has_goal=any(view.content.goals for view in views),
            has_stop_lines=stop_lines,
            has_collision=collision,
        )

    @property
    def columns(self) -> int:
        """The number of legend entries per row, which is small for runs, since they have long names."""
        return 4 if self.runs else 7

    @property
    def rows(self) -> int:
        """The number of rows of the legend."""
        flags = (self.has_ego, self.has_goal, self.has_stop_lines, self.has_collision)
        entries = len(self.kinds) + len(self.signals) + len(self.runs) + sum(flags)
        return max(math.ceil(entries / self.columns), 1)


_CLASS_WORDS = {"priorityVehicle": "emergency vehicle", "parkedVehicle": "parked vehicle", "unknown": "other"}
_LIGHT_WORDS = {"redYellow": "red and yellow", "inactive": "off"}


def draw_legend(figure: "Figure", shown: Inventory) -> None:
    """Draw one legend at the bottom of the figure, with entries only for what is present."""
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
        handles.append(Patch(facecolor=EGO_COLOUR, edgecolor=INK, label=shown.ego_name))
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
    """Return legend entries reordered so that they read row by row, since matplotlib fills columns."""
    rows = math.ceil(len(handles) / columns)
    if rows == 1:
        return handles
    full = len(handles) - (rows - 1) * columns
    heights = [rows if column < full else rows - 1 for column in range(columns)]
    return [handles[row * columns + column] for column, height in enumerate(heights) for row in range(height)]
