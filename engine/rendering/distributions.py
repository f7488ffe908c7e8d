"""Draws the distribution of every metric by configuration, and the pairs of two configurations."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...schemas.errors import NotPossible
from ...schemas.measures import metric_words
from ...schemas.results import figure as in_figures
from ...schemas.results import with_unit
from ...schemas.runs import RunRecord
from ..analysis import METRICS, MetricSpec, RunSet
from ..geometry import Values
from .canvas import INK, MUTED, PICTURE_WIDTH_PX, SMALL_PT, Drawing, new_figure, series_style
from .content import short_names
from .furniture import shortened, write_legend, write_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS, _MOST_CONFIGS, _ROW_PX, _HEAD_PX = 2, 4, 34, 82
"""Chosen for the sizes of text."""
_FAR = 5.0
"""Values farther beyond the middle 80% than this multiple of their range are drawn at the edge (chosen)."""
_BETTER, _WORSE = series_style(2)[0], series_style(1)[0]
_Pair = tuple[float, float]


def distributions(runs: RunSet) -> Drawing:
    """Draw a panel per metric: runs are dots, a box spans the middle half, a line is the median, and pairs are joined.

    Raises:
        NotPossible: No valid run has a metric.
    """
    groups = dict(list(runs.by_config(runs.valid).items())[:_MOST_CONFIGS])
    names = short_names(runs.records)
    specs = [spec for spec in METRICS if len(groups) == 1 or not spec.within_one_configuration]
    specs = [spec for spec in specs if any(len(_values(spec, records)) for records in groups.values())]
    if not specs:
        raise NotPossible("no valid run has a metric", next_step="render kind=outcomes")
    rows = -(-len(specs) // _COLUMNS)
    panel = _HEAD_PX + _ROW_PX * len(groups)
    legend_px = 20 + 24 * (len(groups) + 1) // 2 if len(groups) > 1 else 14
    height = 80 + rows * panel + legend_px
    figure = new_figure(PICTURE_WIDTH_PX, height)
    texts = []
    for number, spec in enumerate(specs):
        row, column = divmod(number, _COLUMNS)
        bottom = height - 80 - (row + 1) * panel + 46
        axes = figure.add_axes((0.145 + 0.49 * column, bottom / height, 0.345, _ROW_PX * len(groups) / height))
        texts.append(_draw_metric(axes, spec, groups, names))
    paired = len(groups) == 2
    if len(groups) > 1:
        _legend(figure, [names[config] for config in groups], paired=paired)
    joined = "; lines join runs of the same problem" if paired else ""
    explanation = "dots: runs, boxes: middle half, bars: medians; ↑ more is better, ↓ less"
    write_title(figure, "Metrics of the runs", f"{explanation}{joined}")
    more = len(runs.by_config(runs.valid)) - len(groups)
    notes = (f"configurations not shown: {more}",) if more else ()
    shown = " | ".join(records[0].config_name for records in groups.values())
    return Drawing(figure, f"Distributions; medians for {shown}: {'; '.join(texts)}.", notes)


def _values(spec: MetricSpec, records: Sequence[RunRecord]) -> Values:
    chosen = [record for record in records if spec.basis == "valid" or record.outcome == "goal_reached"]
    return np.array([value for record in chosen if (value := spec.value(record)) is not None], dtype=float)


def _draw_metric(axes: "Axes", spec: MetricSpec, groups: dict[str, list[RunRecord]], names: dict[str, str]) -> str:
    """Draw one metric and return its description."""
    from matplotlib.ticker import MaxNLocator

    samples = [_values(spec, records) for records in groups.values()]
    low, high = _shown_range(np.concatenate(samples))
    if len(groups) == 2:
        _draw_pairs(axes, spec, *groups.values(), span=(low, high))
    beyond = 0
    for row, values in enumerate(samples):
        if not len(values):
            axes.text(low, row, " none", va="center", color=MUTED, fontsize=SMALL_PT)
            continue
        beyond += int(((values < low) | (values > high)).sum())
        _draw_sample(axes, row, np.clip(values, low, high), series_style(row)[0])
    margin = 0.04 * (high - low)
    axes.set_xlim(low - margin, high + margin)
    axes.set_ylim(len(samples) - 0.5, -0.5)
    axes.set_yticks(
        range(len(samples)),
        [
            f"{number}. {shortened(names[config], 11)} ({len(values)})"
            for number, (config, values) in enumerate(zip(groups, samples, strict=True), start=1)
        ],
    )
    if all(bool((one == np.round(one)).all()) for one in samples):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="x", color="#E2E2E2", linewidth=0.8)
    axes.set_axisbelow(True)
    unit = "" if spec.unit == "1" else f" [{spec.unit}]"
    better = "" if spec.better is None else " ↑" if spec.better == "higher" else " ↓"
    basis = "" if spec.basis == "valid" else " · goal reached"
    far = f" · {beyond} outliers at the edge" if beyond else ""
    words = metric_words(spec.name).partition(" (")[0]
    axes.set_title(f"{words}{unit}{better}{basis}{far}", fontsize=SMALL_PT + 1, loc="left", pad=5)
    medians = [in_figures(float(np.median(values))) if len(values) else "none" for values in samples]
    return f"{metric_words(spec.name)} {with_unit(' | '.join(medians), spec.unit)}"


def _shown_range(values: Values) -> tuple[float, float]:
    """Return the range of the values without outliers, or a range around the value if all are equal."""
    first, last = np.percentile(values, [10, 90])
    reach = _FAR * (last - first) or np.inf
    inside = values[(values >= first - reach) & (values <= last + reach)]
    low, high = float(inside.min()), float(inside.max())
    if high - low < 1e-9 * max(abs(high), 1.0):
        around = max(0.05 * abs(high), 0.5)
        return low - around, high + around
    return low, high


def _draw_sample(axes: "Axes", row: int, values: Values, colour: str) -> None:
    first, middle, third = np.percentile(values, [25, 50, 75])
    axes.barh(row, third - first, left=first, height=0.56, color=colour, alpha=0.22, linewidth=0)
    axes.plot([middle, middle], [row - 0.36, row + 0.36], color=INK, linewidth=2.4, zorder=4)
    axes.plot(np.sort(values), row + _spread(len(values)), "o", color=colour, markersize=4, alpha=0.75, zorder=3)


def _spread(count: int) -> Values:
    """Return offsets across the row that separate neighbours: the fractional parts of multiples of the golden ratio."""
    golden = (np.sqrt(5) - 1) / 2
    offsets: Values = 0.44 * ((np.arange(count) * golden) % 1.0 - 0.5)
    return offsets


def _draw_pairs(
    axes: "Axes",
    spec: MetricSpec,
    before: Sequence[RunRecord],
    after: Sequence[RunRecord],
    *,
    span: tuple[float, float],
) -> None:
    """Draw a line for each common problem, green if the second configuration is better."""
    for first, second in _pairs(spec, before, after):
        moved = spec.difference(first, second)
        if moved == 0 or spec.better is None:
            colour = "#9A9A9A"
        else:
            colour = _BETTER if (moved > 0) == (spec.better == "higher") else _WORSE
        ends = np.clip([first, second], *span)
        style = "solid" if colour != _WORSE else (0, (4, 2))
        axes.plot(ends, [0.28, 0.72], color=colour, linewidth=0.9, alpha=0.75, linestyle=style, zorder=2)


def _pairs(spec: MetricSpec, before: Sequence[RunRecord], after: Sequence[RunRecord]) -> list[_Pair]:
    def by_problem(records: Sequence[RunRecord]) -> dict[tuple[object, ...], float]:
        return {
            (one.scenario_id, one.problem_id, one.prediction, one.traffic, one.seed, one.world): value
            for one in records
            if (spec.basis == "valid" or one.outcome == "goal_reached") and (value := spec.value(one)) is not None
        }

    first, second = by_problem(before), by_problem(after)
    return [(first[key], second[key]) for key in first if key in second]


def _legend(figure: "Figure", names: Sequence[str], *, paired: bool) -> None:
    """Draw the legend of the configurations with full names and, for two, of the joining lines' colours."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=series_style(row)[0], marker="o", linestyle="none", label=f"{row + 1}. {name}")
        for row, name in enumerate(names)
    ]
    if paired:
        handles.append(Line2D([], [], color=_BETTER, linestyle="solid", label="better below"))
        handles.append(Line2D([], [], color=_WORSE, linestyle=(0, (4, 2)), label="worse below"))
    write_legend(figure, 0.135, 3 if paired else 2, handles=handles)
