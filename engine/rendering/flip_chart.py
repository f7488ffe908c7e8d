"""Which scenarios flipped between two configurations, and which way."""

from pathlib import Path
from typing import TYPE_CHECKING

from plannerforge.engine.rendering.canvas import PICTURE_WIDTH_PX, SMALL_PT, new_figure, pixels, save_png, shortened
from plannerforge.engine.rendering.furniture import write_title
from plannerforge.engine.rendering.palette import INK, MUTED, outcome_colour
from plannerforge.schemas.comparison import Comparison, Flip

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
