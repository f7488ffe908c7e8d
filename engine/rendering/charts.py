"""What the chosen candidates' cost was made of, by configuration."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ...schemas.comparison import Comparison, Flip
from ...schemas.results import CostShare
from ...schemas.runs import Outcome, RunRecord, RunSteps
from ..analysis import rate
from .canvas import (
    INK,
    MUTED,
    PICTURE_WIDTH_PX,
    SMALL_PT,
    new_figure,
    outcome_colour,
    pixels,
    save_png,
    series_style,
    shortened,
)
from .furniture import write_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# ---------- profile_chart
# Speed and acceleration over time.

MOST_RUNS = 6


def draw_profile(runs: Sequence[tuple[RunRecord, RunSteps]], path: Path) -> tuple[tuple[int, int], str]:
    """Two panels over time since the start, one line a run (at most six), its end marked by outcome, as PNG.

    Returns:
        The size in pixels, and the alternative text.
    """
    shown = runs[:MOST_RUNS]
    scenarios = list(dict.fromkeys(record.scenario_id for record, _ in shown))
    rows = (len(shown) + 1) // 2
    height = 640 + 22 * rows
    figure = new_figure(PICTURE_WIDTH_PX, height)
    low = (64 + 22 * rows) / height
    panel = (height - 64 - 22 * rows - 92) / height / 2
    acceleration = figure.add_axes((0.07, low, 0.9, panel))
    speed = figure.add_axes((0.07, low + panel + 18 / height, 0.9, panel), sharex=acceleration)
    told = []
    for number, (record, steps) in enumerate(shown):
        colour, dashes = series_style(number)
        times = [index * record.step_s for index in range(len(steps.speed_mps))]
        name = record.config_name if len(scenarios) == 1 else f"{record.scenario_id}, {record.config_name}"
        label = f"{shortened(name, 52)}: {record.outcome.replace('_', ' ')}"
        for axes, values in ((speed, steps.speed_mps), (acceleration, steps.acceleration_mps2)):
            axes.plot(
                times, values, color=colour, linestyle=dashes, linewidth=2.2, label=label if axes is speed else None
            )
            marker = "o" if record.outcome == "goal_reached" else "X"
            axes.plot(times[-1], values[-1], marker=marker, color=colour, markersize=11, zorder=5, clip_on=False)
        fastest = f"{min(steps.speed_mps):.1f} to {max(steps.speed_mps):.1f} m/s over {times[-1]:.1f} s"
        told.append(f"{name} ({record.outcome.replace('_', ' ')}): {fastest}")
    for axes in (speed, acceleration):
        axes.grid(color="#E2E2E2", linewidth=0.8)
        axes.set_axisbelow(True)
    speed.set_ylim(bottom=min(0.0, speed.get_ylim()[0]))
    acceleration.axhline(0, color="#9A9A9A", linewidth=0.9)
    speed.set_ylabel("speed [m/s]")
    acceleration.set_ylabel("acceleration [m/s²]")
    acceleration.set_xlabel("time since the start [s]")
    speed.tick_params(labelbottom=False)
    figure.align_ylabels([speed, acceleration])
    figure.legend(loc="lower left", ncols=2, frameon=False, bbox_to_anchor=(0.06, 0), fontsize=SMALL_PT + 0.5)
    subtitle = "the ego; a disc ends a run that reached its goal, a cross one that did not"
    write_title(
        figure,
        f"Speed and acceleration on {scenarios[0] if len(scenarios) == 1 else f'{len(scenarios)} scenarios'}",
        subtitle,
    )
    image = pixels(figure)
    save_png(image, path)
    return image.size, f"Speed and acceleration of the ego. {'; '.join(told)}."


# ---------- flip_chart
# Which scenarios flipped between two configurations, and which way.

MOST_ROWS = 24
_DARK = ("goal_reached", "collision", "off_road")


def draw_flips(comparison: Comparison, path: Path) -> tuple[tuple[int, int], str]:
    """One row a flipped scenario, its outcome before and after; first those flipped to success, as PNG.

    Returns:
        The size in pixels, and the alternative text.
    """
    flips = [*comparison.to_success, *comparison.to_failure][:MOST_ROWS]
    height = 150 + 40 * max(len(flips), 1)
    figure = new_figure(PICTURE_WIDTH_PX, height)
    axes = figure.add_axes((0.01, 16 / height, 0.98, (height - 16 - 76) / height))
    axes.set_xlim(0, 100)
    axes.set_ylim(len(flips) if flips else 1, -1)
    axes.set_axis_off()
    for x, name in ((50, comparison.before), (83, comparison.after)):
        axes.text(x, -0.75, shortened(name, 34), ha="center", va="center", fontweight="bold")
    for row, flip in enumerate(flips):
        _draw_row(axes, row, flip)
    if not flips:
        axes.text(0.3, 0, "No scenario flipped.", va="center", color=MUTED)
    test = comparison.success
    subtitle = (
        f"{test.pairs} pairs: {test.both} reach the goal on both sides, {test.neither} on neither, "
        f"{test.only_after} flipped to success, {test.only_before} to failure"
    )
    more = comparison.to_success_count + comparison.to_failure_count - len(flips)
    write_title(figure, "Flipped scenarios", subtitle + (f"; {more} not shown" if more else ""))
    image = pixels(figure)
    save_png(image, path)
    told = [f"{flip.scenario_id} from {flip.before} to {flip.after}" for flip in flips]
    return image.size, f"Flipped scenarios: {subtitle}. {'; '.join(told)}".rstrip()


def _draw_row(axes: "Axes", row: int, flip: Flip) -> None:
    from matplotlib.patches import Rectangle

    axes.text(0.3, row, shortened(flip.scenario_id, 42), va="center")
    for x, outcome in ((50, flip.before), (83, flip.after)):
        axes.add_patch(Rectangle((x - 11, row - 0.36), 22, 0.72, facecolor=outcome_colour(outcome), edgecolor="none"))
        ink = "white" if outcome in _DARK else INK
        axes.text(x, row, outcome.replace("_", " "), ha="center", va="center", color=ink, fontsize=SMALL_PT + 1)
    axes.annotate("", (71, row), (62, row), arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.6})


# ---------- outcome_chart
# How the runs of each configuration ended, and the success rate with its interval.

_ORDER: tuple[Outcome, ...] = (
    "goal_reached",
    "goal_early",
    "goal_late",
    "goal_missed",
    "timeout",
    "infeasible",
    "off_road",
    "collision",
)


def draw_outcomes(groups: Sequence[tuple[str, Sequence[RunRecord]]], path: Path) -> tuple[tuple[int, int], str]:
    """Stacked shares by group on the left, success rate with 95 % Wilson interval on the right, as PNG.

    Returns:
        The size in pixels, and the alternative text.
    """
    from matplotlib.patches import Patch

    height = 150 + 62 * len(groups)
    figure = new_figure(PICTURE_WIDTH_PX, height)
    bottom, tall = 92 / height, (height - 92 - 78) / height
    shares = figure.add_axes((0.19, bottom, 0.5, tall))
    rates = figure.add_axes((0.73, bottom, 0.25, tall), sharey=shares)
    told, seen = [], set()
    for row, (_name, records) in enumerate(groups):
        valid = [record for record in records if record.outcome != "invalid"]
        counts = Counter(record.outcome for record in valid)
        seen |= set(counts)
        left = 0.0
        for outcome in _ORDER:
            width = 100 * counts[outcome] / len(valid) if valid else 0.0
            if width == 0:
                continue
            shares.barh(row, width, left=left, color=outcome_colour(outcome), edgecolor="white", height=0.62)
            ink = "white" if outcome in _DARK else INK
            shares.text(left + width / 2, row, str(counts[outcome]), ha="center", va="center", color=ink)
            left += width
        success = rate(counts["goal_reached"], len(valid))
        told.append(f"{groups[row][0]}: goal reached in {success.count} of {success.of}")
        if success.share is not None and success.low is not None and success.high is not None:
            rates.plot(
                [100 * success.low, 100 * success.high], [row, row], color=INK, linewidth=2, solid_capstyle="butt"
            )
            rates.plot(100 * success.share, row, "o", color=outcome_colour("goal_reached"), markersize=10, zorder=3)
            rates.annotate(
                f"{100 * success.share:.0f} %", (100 * success.share, row), xytext=(0, 9),
                textcoords="offset points", ha="center", fontsize=SMALL_PT,
            )  # fmt: skip
    _dress(shares, rates, groups)
    handles = [Patch(facecolor=outcome_colour(name), label=name.replace("_", " ")) for name in _ORDER if name in seen]
    figure.legend(
        handles=handles,
        loc="lower left",
        ncols=len(_ORDER),
        frameon=False,
        bbox_to_anchor=(0.19 if len(handles) < 6 else 0.0, 0),
        fontsize=SMALL_PT + 0.5,
        columnspacing=1.5,
        handlelength=1.5,
    )
    total = sum(len(records) for _, records in groups)
    write_title(figure, "Outcomes", f"{total} runs; numbers in the bars are runs; invalid runs are in no bar")
    image = pixels(figure)
    save_png(image, path)
    return image.size, f"Outcomes by configuration. {'; '.join(told)}."


def _dress(shares: "Axes", rates: "Axes", groups: Sequence[tuple[str, Sequence[RunRecord]]]) -> None:
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
    rates.set_xlabel("goal reached [%], 95 % interval")
    rates.tick_params(labelleft=False)
    rates.grid(axis="x", color="#DDDDDD", linewidth=0.8)
    rates.set_axisbelow(True)


# ---------- cost_chart
# What the chosen candidates' cost was made of, by configuration.

MOST_CONFIGURATIONS = 6
_HATCHES = ("", "//", "..", "xx", "\\\\", "--")


def draw_costs(costs: Sequence[CostShare], path: Path) -> tuple[tuple[int, int], str]:
    """Mean weighted cost per planning step of every term, one bar a configuration, as PNG.

    Returns:
        The size in pixels, and the alternative text.
    """
    configs = list(dict.fromkeys((item.config_id, item.config_name) for item in costs))[:MOST_CONFIGURATIONS]
    found = {(item.config_id, item.term): item for item in costs}
    terms = sorted({item.term for item in costs}, key=lambda term: (-_largest(costs, term), term))
    bar = 0.8 / len(configs)
    height = round(170 + len(terms) * (22 + 17 * len(configs)))
    figure = new_figure(PICTURE_WIDTH_PX, height)
    axes = figure.add_axes((0.22, 100 / height, 0.74, (height - 100 - 76) / height))
    for number, (config_id, name) in enumerate(configs):
        colour, _ = series_style(number)
        values = [found[config_id, term].mean_weighted if (config_id, term) in found else 0.0 for term in terms]
        rows = [row - 0.4 + bar * (number + 0.5) for row in range(len(terms))]
        runs = max(item.runs for item in costs if item.config_id == config_id)
        label = f"{shortened(name, 30)} ({runs} run{'' if runs == 1 else 's'})"
        axes.barh(
            rows, values, height=bar * 0.9, color=colour, hatch=_HATCHES[number], edgecolor="white", linewidth=0.5,
            label=label,
        )  # fmt: skip
        for row, term, value in zip(rows, terms, values, strict=True):
            share = found[config_id, term].share if (config_id, term) in found else None
            words = f" {value:.3g}" + (f" ({100 * share:.0f} %)" if share is not None else "")
            axes.text(value, row, words, va="center", fontsize=SMALL_PT, color=INK)
    axes.set_yticks(range(len(terms)), terms)
    axes.invert_yaxis()
    axes.set_xlabel(
        "mean weighted cost of the chosen candidate per planning step [1] (share of the configuration's total)"
    )
    axes.margins(x=0.16)
    figure.legend(loc="lower left", ncols=3, frameon=False, bbox_to_anchor=(0.21, 0), fontsize=SMALL_PT + 0.5)
    write_title(figure, "Cost terms", "raw cost × weight; terms that were always 0 are left out")
    image = pixels(figure)
    save_png(image, path)
    told = [f"{name}: {', '.join(_parts(costs, config_id))}" for config_id, name in configs]
    return image.size, f"Weighted cost terms. {'; '.join(told)}."


def _largest(costs: Sequence[CostShare], term: str) -> float:
    return max(item.mean_weighted for item in costs if item.term == term)


def _parts(costs: Sequence[CostShare], config_id: str) -> list[str]:
    mine = [item for item in costs if item.config_id == config_id and item.share is not None]
    return [f"{item.term} {100 * (item.share or 0):.0f} %" for item in mine[:4]]
