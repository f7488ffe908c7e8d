"""How the runs of each configuration ended, and the success rate with its interval."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from plannerforge.engine.analysis.intervals import rate
from plannerforge.engine.rendering.canvas import PICTURE_WIDTH_PX, SMALL_PT, new_figure, pixels, save_png, shortened
from plannerforge.engine.rendering.flip_chart import _DARK
from plannerforge.engine.rendering.furniture import write_title
from plannerforge.engine.rendering.palette import INK, outcome_colour
from plannerforge.schemas.runs import Outcome, RunRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
