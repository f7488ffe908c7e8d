"""What the chosen candidates' cost was made of, by configuration."""

from collections.abc import Sequence
from pathlib import Path

from plannerforge.engine.rendering.canvas import PICTURE_WIDTH_PX, SMALL_PT, new_figure, pixels, save_png, shortened
from plannerforge.engine.rendering.furniture import write_title
from plannerforge.engine.rendering.palette import INK, series_style
from plannerforge.schemas.results import CostShare

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
