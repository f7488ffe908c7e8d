"""Charts of runs: outcomes, cost terms and flips; and the table of all charts.

Charts of causes and strata are in ``cause_charts.py``, of metrics in ``distributions.py``, of single runs over time in
``courses.py``. A chart is a function ``(runs) -> Drawing``. To add one, write the function, add it to ``CHARTS`` and
its kind to ``PictureKind``, and test it.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from ...schemas.analysis.comparison import CompareRequest, Flip, Side
from ...schemas.errors import NotPossible
from ...schemas.rendering import PictureKind
from ...schemas.results import CostShare
from ...schemas.runs import Outcome, RunRecord
from ...schemas.text import counted
from ..analysis import RunSet, compare, cost_shares
from ..execution import silent
from .canvas import (
    HATCHES,
    INK,
    MUTED,
    PICTURE_WIDTH_PX,
    SMALL_PT,
    Drawing,
    ink_on_outcome,
    new_figure,
    outcome_colour,
    series_style,
)
from .cause_charts import causes, strata
from .content import short_names
from .courses import profile, terms, timeline
from .distributions import distributions
from .furniture import shortened, write_legend, write_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_OUTCOME_ORDER: tuple[Outcome, ...] = (
    "goal_reached",
    "goal_refused",
    "goal_early",
    "goal_late",
    "goal_missed",
    "timeout",
    "infeasible",
    "off_road",
    "collision",
)
"""The order of a bar from left to right."""


def _outcomes(runs: RunSet) -> Drawing:
    """Draw shares of outcomes by configuration on the left, and success rates with 95% intervals on the right."""
    from matplotlib.patches import Patch

    names = short_names(runs.records)
    groups = [(names[config_id], records) for config_id, records in runs.by_config(runs.records).items()]
    height = 150 + 62 * len(groups)
    figure = new_figure(PICTURE_WIDTH_PX, height)
    bottom, tall = 92 / height, (height - 92 - 78) / height
    shares = figure.add_axes((0.19, bottom, 0.5, tall))
    rates = figure.add_axes((0.73, bottom, 0.25, tall), sharey=shares)
    texts, seen = [], set()
    for row, (name, records) in enumerate(groups):
        valid = [record for record in records if record.outcome != "invalid"]
        counts = Counter(record.outcome for record in valid)
        seen |= set(counts)
        _draw_shares(shares, row, counts)
        success = runs.rate(valid)
        texts.append(f"{name}: goal reached in {success.count} of {success.of}")
        if success.share is not None and success.low is not None and success.high is not None:
            interval = [100 * success.low, 100 * success.high]
            rates.plot(interval, [row, row], color=INK, linewidth=2, solid_capstyle="butt")
            rates.plot(100 * success.share, row, "o", color=outcome_colour("goal_reached"), markersize=10, zorder=3)
            rates.annotate(
                f"{100 * success.share:.0f}%", (100 * success.share, row), xytext=(0, 9),
                textcoords="offset points", ha="center", fontsize=SMALL_PT,
            )  # fmt: skip
    _label_outcome_axes(shares, rates, groups)
    shown = [name for name in _OUTCOME_ORDER if name in seen]
    write_legend(
        figure,
        0.19 if len(shown) < 6 else 0.0,
        len(_OUTCOME_ORDER),
        handles=[Patch(facecolor=outcome_colour(name), label=name.replace("_", " ")) for name in shown],
        columnspacing=1.5,
        handlelength=1.5,
    )
    total = len(runs.sources)
    write_title(figure, "Outcomes", f"{counted(total, 'run')}; numbers in the bars count runs, without invalid ones")
    return Drawing(figure, f"Outcomes by configuration. {'; '.join(texts)}.")


def _draw_shares(axes: "Axes", row: int, counts: Mapping[Outcome, int]) -> None:
    left, total = 0.0, sum(counts.values())
    for outcome in _OUTCOME_ORDER:
        if counts[outcome]:
            width = 100 * counts[outcome] / total
            axes.barh(row, width, left=left, color=outcome_colour(outcome), edgecolor="white", height=0.62)
            ink = ink_on_outcome(outcome)
            axes.text(left + width / 2, row, str(counts[outcome]), ha="center", va="center", color=ink)
            left += width


def _label_outcome_axes(shares: "Axes", rates: "Axes", groups: Sequence[tuple[str, Sequence[RunRecord]]]) -> None:
    labels = []
    for name, records in groups:
        invalid = sum(record.outcome == "invalid" for record in records)
        extra = f", {invalid} invalid" if invalid else ""
        labels.append(f"{shortened(name, 26)}\n{len(records) - invalid} valid{extra}")
    shares.set_yticks(range(len(groups)), labels)
    shares.invert_yaxis()
    shares.set_xlim(0, 100)
    shares.set_xlabel("share of the valid runs [%]")
    rates.set_xlim(-2, 102)
    rates.set_xlabel("goal reached [%], 95% interval")
    rates.tick_params(labelleft=False)
    rates.grid(axis="x", color="#DDDDDD", linewidth=0.8)
    rates.set_axisbelow(True)


def _costs(runs: RunSet) -> Drawing:
    """Draw the mean weighted cost per planning step of every term, one bar per configuration.

    Raises:
        NotPossible: No run has recorded cost terms.
    """
    costs = cost_shares(runs)
    if not costs:
        raise NotPossible("no cost terms were recorded", next_step="render kind=outcomes")
    configs = list(dict.fromkeys((item.config_id, item.config_name) for item in costs))[: len(HATCHES)]
    by_term = {(item.config_id, item.term): item for item in costs}
    largest = {item.term: item.mean_weighted for item in sorted(costs, key=lambda item: item.mean_weighted)}
    terms = sorted(largest, key=lambda term: (-largest[term], term))
    bar = 0.8 / len(configs)
    height = round(170 + len(terms) * (22 + 17 * len(configs)))
    figure = new_figure(PICTURE_WIDTH_PX, height)
    axes = figure.add_axes((0.22, 100 / height, 0.74, (height - 100 - 76) / height))
    for number, (config_id, name) in enumerate(configs):
        colour, _ = series_style(number)
        values = [by_term[config_id, term].mean_weighted if (config_id, term) in by_term else 0.0 for term in terms]
        rows = [row - 0.4 + bar * (number + 0.5) for row in range(len(terms))]
        count = max(item.runs for item in costs if item.config_id == config_id)
        label = f"{shortened(name, 30)} ({count} run{'' if count == 1 else 's'})"
        axes.barh(
            rows, values, height=bar * 0.9, color=colour, hatch=HATCHES[number], edgecolor="white", linewidth=0.5,
            label=label,
        )  # fmt: skip
        for row, term, value in zip(rows, terms, values, strict=True):
            share = by_term[config_id, term].share if (config_id, term) in by_term else None
            words = f" {value:.3g}" + (f" ({100 * share:.0f}%)" if share is not None else "")
            axes.text(value, row, words, va="center", fontsize=SMALL_PT, color=INK)
    axes.set_yticks(range(len(terms)), terms)
    axes.invert_yaxis()
    axes.set_xlabel(
        "mean weighted cost of the chosen candidate per planning step [1] (share of the configuration's total)"
    )
    axes.margins(x=0.16)
    write_legend(figure, 0.21, 3)
    write_title(figure, "Cost terms", "raw cost × weight; without terms that were always 0")
    texts = [f"{name}: {', '.join(_largest_shares(costs, config_id))}" for config_id, name in configs]
    return Drawing(figure, f"Weighted cost terms. {'; '.join(texts)}.")


def _largest_shares(costs: Sequence[CostShare], config_id: str) -> list[str]:
    """Return the four largest terms of a configuration with their shares."""
    mine = [item for item in costs if item.config_id == config_id and item.share is not None]
    return [f"{item.term} {100 * (item.share or 0):.0f}%" for item in mine[:4]]


_MOST_FLIPS = 24
"""Most rows of the chart of flips, as many as a screen shows (chosen)."""
_LISTED_FLIPS = 12
"""Flips per direction that the comparison lists for it, half of them."""


def _flips(runs: RunSet) -> Drawing:
    """Draw the first two configurations: one row per flipped scenario with both outcomes, flips to success first.

    Raises:
        NotPossible: There are fewer than two configurations, or no common problem.
        InvalidRequest: A configuration has the same problem twice.
    """
    names = short_names(runs.records)
    sides = tuple(
        Side(
            label=names[config_id],
            config_id=config_id,
            config_name=records[0].config_name,
            run_ids=tuple(record.run_id for record in records),
        )
        for config_id, records in runs.by_config(runs.records).items()
    )
    request = CompareRequest(
        sides=sides[:2], runs=runs.sources, configs=runs.configs, lineage=runs.lineage, limit=_LISTED_FLIPS
    )
    comparison = compare(request, silent).comparisons[0]
    flips = [*comparison.to_success, *comparison.to_failure][:_MOST_FLIPS]
    height = 150 + 40 * max(len(flips), 1)
    figure = new_figure(PICTURE_WIDTH_PX, height)
    axes = figure.add_axes((0.01, 16 / height, 0.98, (height - 16 - 76) / height))
    axes.set_xlim(0, 100)
    axes.set_ylim(len(flips) if flips else 1, -1)
    axes.set_axis_off()
    for x, name in ((50, comparison.before), (83, comparison.after)):
        axes.text(x, -0.75, shortened(name, 34), ha="center", va="center", fontweight="bold")
    for row, flip in enumerate(flips):
        _draw_flip(axes, row, flip)
    if not flips:
        axes.text(0.3, 0, "No scenario flipped.", va="center", color=MUTED)
    test = comparison.success
    subtitle = (
        f"{test.pairs} pairs: {test.both} reach the goal on both sides, {test.neither} on neither side, "
        f"{test.only_after} flipped to success, {test.only_before} to failure"
    )
    more = comparison.to_success_count + comparison.to_failure_count - len(flips)
    write_title(figure, "Flipped scenarios", subtitle + (f"; {more} not shown" if more else ""))
    texts = [
        f"{flip.scenario_id} from {flip.before.replace('_', ' ')} to {flip.after.replace('_', ' ')}" for flip in flips
    ]
    notes = ("only the first two configurations are compared",) if len(sides) > 2 else ()
    return Drawing(figure, f"Flipped scenarios of {subtitle}. {'; '.join(texts)}".rstrip(), notes)


def _draw_flip(axes: "Axes", row: int, flip: Flip) -> None:
    from matplotlib.patches import Rectangle

    axes.text(0.3, row, shortened(flip.scenario_id, 42), va="center")
    for x, outcome in ((50, flip.before), (83, flip.after)):
        axes.add_patch(Rectangle((x - 11, row - 0.36), 22, 0.72, facecolor=outcome_colour(outcome), edgecolor="none"))
        ink = ink_on_outcome(outcome)
        axes.text(x, row, outcome.replace("_", " "), ha="center", va="center", color=ink, fontsize=SMALL_PT + 1)
    axes.annotate("", (71, row), (62, row), arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.6})


CHARTS: dict[PictureKind, Callable[[RunSet], Drawing]] = {
    "outcomes": _outcomes,
    "causes": causes,
    "strata": strata,
    "distributions": distributions,
    "flips": _flips,
    "costs": _costs,
    "terms": terms,
    "profile": profile,
    "timeline": timeline,
}
"""The charts by kind."""
