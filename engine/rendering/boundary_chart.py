"""The map of where planners fail over two parameters, with lines where the reference drivers begin to fail."""

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...schemas.boundaries import LATTICE, OUTCOME_WORDS, BoundaryMap, BoundaryRecord
from ...schemas.exploration import FAILURES, PointOutcome
from ..exploration import labels_on
from .canvas import INK, MUTED, PICTURE_WIDTH_PX, SMALL_PT, Drawing, new_figure
from .furniture import shortened, write_legend, write_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PIXELS = 2 * LATTICE
"""Pixels of a map along each side (chosen)."""
_COLUMNS, _PANEL_PX, _TOP_PX, _LEGEND_PX = 3, 400, 70, 92
"""Maps side by side, and heights (chosen)."""
_LOOKS: dict[PointOutcome, tuple[str, str, str]] = {
    "safe": ("#CFE6F5", "o", "#0072B2"),
    "failed_avoidably": ("#D55E00", "X", "#5C2800"),
    "failed_unavoidably": ("#8C8C8C", "s", "#303030"),
    "implausible": ("#FFFFFF", "+", "#8C8C8C"),
    "invalid": ("#F0E442", "v", "#5A5A5A"),
}
"""The fill of an outcome, and its points' mark and colour: they differ in lightness and mark too (Okabe and Ito)."""
_REFERENCE_LINES: dict[str, tuple[Literal["-", "--"], str]] = {
    "r157_careful": ("-", "careful driver"),
    "fsm": ("--", "fuzzy driver"),
}


def boundary_chart(record: BoundaryRecord) -> Drawing:
    """Draw a map per planner and slice: outcomes as fills, points as marks, the edges of the reference drivers as
    lines.
    """
    maps = [one for one in record.maps if not one.is_reference]
    columns = min(len(maps), _COLUMNS)
    rows = -(-len(maps) // columns)
    width_px = max(PICTURE_WIDTH_PX * columns // _COLUMNS, 620)
    height_px = _TOP_PX + rows * _PANEL_PX + _LEGEND_PX
    figure = new_figure(width_px, height_px)
    words = []
    for number, one in enumerate(maps):
        column, row = number % columns, number // columns
        bottom = (_LEGEND_PX + (rows - 1 - row) * _PANEL_PX + 52) / height_px
        left = (column + (0.16 if columns == 1 else 0.2)) / columns
        axes = figure.add_axes((left, bottom, 0.76 / columns, (_PANEL_PX - 84) / height_px))
        _draw(axes, record, one)
        words.append(_in_words(one))
    shown = list(dict.fromkeys(point.evaluation.outcome for one in maps for point in one.points))
    across, up = record.axes
    subtitle = f"{record.scenario.summary}: {across.title} × {up.title}"
    write_title(figure, f"Boundary: {record.scenario.name}", shortened(subtitle, width_px // 8))
    write_legend(figure, 0.012, 4 if columns > 1 else 2, handles=_legend(shown, record))
    text = f"Boundary of {record.scenario.name} ({record.scenario.summary}) over {across.title} × {up.title}."
    return Drawing(figure, f"{text} {' '.join(words)}")


def _raster(one: BoundaryMap) -> NDArray[Any]:
    """Return the outcome at each pixel's centre, rows upwards."""
    labels = {point.place: point.evaluation.outcome for point in one.points}
    return np.array(labels_on(labels, one.cells, _PIXELS), dtype=object)


def _draw(axes: "Axes", record: BoundaryRecord, one: BoundaryMap) -> None:
    first, second = record.axes
    extent = (first.low, first.high, second.low, second.high)
    raster = _raster(one)
    outcomes = list(_LOOKS)
    codes = np.array([[outcomes.index(label) if label in _LOOKS else 3 for label in row] for row in raster])
    fills = np.array([_rgb(_LOOKS[outcome][0]) for outcome in outcomes])
    axes.imshow(fills[codes], origin="lower", extent=extent, aspect="auto", interpolation="nearest")
    places = [np.linspace(axis.low, axis.high, 2 * _PIXELS + 1)[1::2] for axis in record.axes]
    _edge(axes, places, np.isin(raster, FAILURES), colors=INK, linewidths=1.8)
    for reference in record.maps:
        if reference.is_reference and reference.at == one.at and reference.planner in _REFERENCE_LINES:
            style = _REFERENCE_LINES[reference.planner][0]
            failing = np.isin(_raster(reference), FAILURES)
            _edge(axes, places, failing, colors="#CC79A7", linewidths=2.4, linestyles=style)
    for outcome, (_, mark, colour) in _LOOKS.items():
        there = [point.place for point in one.points if point.evaluation.outcome == outcome]
        if there:
            x, y = ([axis.at_share(place[at] / LATTICE) for place in there] for at, axis in enumerate(record.axes))
            axes.scatter(
                x, y, s=11 if mark == "o" else 18, marker=mark, c=colour, linewidths=0.7, clip_on=False, zorder=4
            )
    axes.set_xlabel(first.title)
    axes.set_ylabel(second.title)
    at = ", ".join(f"{name} {value:g}" for name, value in one.at.items())
    axes.set_title(shortened(f"{one.config_name}", 40), fontsize=SMALL_PT + 1.5, loc="left", pad=16)
    axes.text(0, 1.02, shortened(at, 60), transform=axes.transAxes, fontsize=SMALL_PT - 1, color=MUTED)


def _has_edge(one: BoundaryMap) -> bool:
    """Return whether a map has an edge between failures and other outcomes, which is then drawn."""
    return _is_divided(np.isin(_raster(one), FAILURES))


def _is_divided(failing: NDArray[Any]) -> bool:
    return bool(failing.any() and not failing.all())


def _edge(axes: "Axes", places: list[NDArray[Any]], failing: NDArray[Any], **style: Any) -> None:
    """Draw the edge of a failing region, if there is one."""
    if _is_divided(failing):
        axes.contour(places[0], places[1], failing.astype(float), levels=[0.5], **style)


def _rgb(colour: str) -> tuple[float, ...]:
    return tuple(int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5))


def _legend(shown: list[PointOutcome], record: BoundaryRecord) -> list[Any]:
    from matplotlib.lines import Line2D

    marks: list[Any] = []
    for outcome in _LOOKS:
        if outcome in shown:
            fill, mark, colour = _LOOKS[outcome]
            marks.append(
                Line2D(
                    [],
                    [],
                    marker="s",
                    markersize=11,
                    markerfacecolor=fill,
                    markeredgecolor=MUTED,
                    linewidth=0,
                    label=f"{OUTCOME_WORDS[outcome]} (points: {_MARK_WORDS[mark]})",
                )
            )
            del colour
    if any(_has_edge(one) for one in record.maps if not one.is_reference):
        marks.append(Line2D([], [], color=INK, linewidth=1.8, label="the planner's edge"))
    for planner, (style, words) in _REFERENCE_LINES.items():
        if any(one.is_reference and one.planner == planner and _has_edge(one) for one in record.maps):
            marks.append(Line2D([], [], color="#CC79A7", linewidth=2.4, linestyle=style, label=f"edge of the {words}"))
    return marks


_MARK_WORDS = {"o": "●", "X": "✖", "s": "■", "+": "+", "v": "▼"}


def _in_words(one: BoundaryMap) -> str:
    areas = ", ".join(area.in_words() for area in one.areas if area.share > 0)
    return f"{one.config_name}: {areas}."
