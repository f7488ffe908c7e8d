"""Figures and their files: one look, and the same bytes every time.

Colours and line styles are told apart with any colour vision (Okabe and Ito 2008, Color universal design).
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...schemas.rendering import RenderedImage

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image

_BLACK, _ORANGE, _SKY_BLUE, _GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
_YELLOW, _BLUE, _VERMILLION, _PURPLE, _GREY = "#F0E442", "#0072B2", "#D55E00", "#CC79A7", "#8C8C8C"
_WINE = "#882255"
EGO_COLOUR = _VERMILLION
INK = "#1A1A1A"
MUTED = "#5A5A5A"
ROAD, ROAD_EDGE, DIRECTION, PAVEMENT = "#E4E4E4", "#9A9A9A", "#B4B4B4", "#F4EBDD"
_LIGHT_RED, _LIGHT_YELLOW, _LIGHT_GREEN, _LIGHT_OFF = "#D62728", "#E6B800", "#1A9850", "#C8C8C8"
_EXACT = (
    "#FFFFFF", INK, MUTED, ROAD, ROAD_EDGE, DIRECTION, _LIGHT_RED, _LIGHT_YELLOW, _LIGHT_GREEN, _LIGHT_OFF,
    _BLACK, _ORANGE, _SKY_BLUE, _GREEN, _YELLOW, _BLUE, _VERMILLION, _PURPLE, _GREY, _WINE,
)  # fmt: skip
"""Colours that carry a meaning: they stay exact where an image is reduced to a palette."""
_CLASS_COLOURS = {
    "car": _SKY_BLUE,
    "taxi": _ORANGE,
    "truck": _GREEN,
    "bus": _YELLOW,
    "motorcycle": _PURPLE,
    "bicycle": _PURPLE,
    "pedestrian": _BLACK,
    "priorityVehicle": _BLUE,
    "train": _GREEN,
}
_OUTCOME_COLOURS = {
    "goal_reached": _BLUE,
    "goal_refused": _WINE,
    "collision": _VERMILLION,
    "timeout": _ORANGE,
    "goal_missed": _YELLOW,
    "goal_early": _SKY_BLUE,
    "goal_late": _GREEN,
    "infeasible": _PURPLE,
    "off_road": _BLACK,
    "invalid": "#BDBDBD",
}
_LIGHT_MARKS = {
    "red": ("s", _LIGHT_RED),
    "redYellow": ("s", _LIGHT_YELLOW),
    "yellow": ("D", _LIGHT_YELLOW),
    "green": ("o", _LIGHT_GREEN),
}
LineStyle = Literal["solid"] | tuple[float, tuple[float, ...]]
_SERIES: tuple[tuple[str, LineStyle], ...] = (
    (_BLUE, "solid"),
    (_VERMILLION, (0, (6, 2))),
    (_GREEN, (0, (1, 1))),
    (_PURPLE, (0, (6, 2, 1, 2))),
    (_ORANGE, (0, (3, 1))),
    (_BLACK, (0, (8, 2, 1, 2, 1, 2))),
)


def class_colour(obstacle_type: str) -> str:
    """Fill colour of a CommonRoad obstacle type; grey for those without a class of their own."""
    return _CLASS_COLOURS.get(obstacle_type, _GREY)


def light_mark(state: str) -> tuple[str, str]:
    """Marker and fill colour of a traffic light in a state: the shape says it as well; a light grey dot if inactive."""
    return _LIGHT_MARKS.get(state, ("o", _LIGHT_OFF))


def outcome_colour(outcome: str) -> str:
    """Colour of a run's outcome in every chart."""
    return _OUTCOME_COLOURS.get(outcome, _GREY)


def ink_on_outcome(outcome: str) -> str:
    """Colour of text on the colour of an outcome."""
    return "white" if outcome in ("goal_reached", "collision", "off_road") else INK


HATCHES = ("", "//", "..", "xx", "\\\\", "--")
"""One a series of bars, for those who do not see its colour; further series are not drawn."""


def series_style(index: int) -> tuple[str, LineStyle]:
    """Colour and dash pattern of the n-th series; they repeat after six."""
    return _SERIES[index % len(_SERIES)]


PICTURE_WIDTH_PX = 1200
"""Width of a single picture or chart (chosen): readable in a chat and on a page."""
_DPI = 100
SMALL_PT, TEXT_PT, TITLE_PT = 9.5, 11.0, 14.0
"""Sizes of ids and ticks, of text, and of titles (chosen)."""
_CLOSE = 10
"""Differences of a colour channel (of 255) that cannot be seen."""
_STYLE: Any = {  # Any: matplotlib's stubs list every key as a literal
    "font.family": "DejaVu Sans",
    "font.size": TEXT_PT,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "axes.titlesize": TITLE_PT,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": SMALL_PT + 0.5,
    "ytick.labelsize": SMALL_PT + 0.5,
    "hatch.linewidth": 0.9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.facecolor": "white",
    "path.simplify": True,
    "svg.hashsalt": "plannerforge",
}


@dataclass(frozen=True)
class Drawing:
    """A figure that is ready to be written, what can be seen on it in words, and what was left out of it and why."""

    figure: "Figure"
    alt_text: str
    notes: tuple[str, ...] = ()


def new_figure(width_px: int, height_px: int) -> "Figure":
    """An empty figure of a size in pixels, drawn by Agg and bound to no window."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    mpl.rcParams.update(_STYLE)
    figure = Figure(figsize=(width_px / _DPI, height_px / _DPI), dpi=_DPI)
    FigureCanvasAgg(figure)
    return figure


def image_at(path: Path, size_px: tuple[int, int], alt_text: str) -> RenderedImage:
    """An image file that was written, as answers name it."""
    return RenderedImage(
        path=str(path),
        mime_type="image/gif" if path.suffix == ".gif" else "image/png",
        width_px=size_px[0],
        height_px=size_px[1],
        size_bytes=path.stat().st_size,
        alt_text=alt_text,
    )


def write_png(figure: "Figure", path: Path) -> tuple[int, int]:
    """Write a figure with at most 256 colours, which flat drawings do not miss: small files, no dates inside.

    Returns:
        The size in pixels.
    """
    from PIL import Image

    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI, metadata={"Software": None})
    buffer.seek(0)
    image = Image.open(buffer).convert("RGB")
    flat = image.quantize(palette=exact_palette([image], 256), dither=Image.Dither.NONE)
    flat.save(path, format="PNG", optimize=True)
    return image.size


def exact_palette(images: Sequence["Image"], colours: int) -> "Image":
    """A palette in which the colours that mean something stay exact; the rest is chosen after the images."""
    from PIL import Image

    height = max(image.height for image in images)
    together = Image.new("RGB", (sum(image.width for image in images), height), "white")
    left = 0
    for image in images:
        together.paste(image, (left, 0))
        left += image.width
    chosen = together.quantize(colors=colours - len(_EXACT), method=Image.Quantize.MEDIANCUT).getpalette() or []
    fixed = np.array([[int(colour[place : place + 2], 16) for place in (1, 3, 5)] for colour in _EXACT])
    free = np.array(chosen[: 3 * (colours - len(_EXACT))]).reshape(-1, 3)
    # Pillow finds the nearest entry only roughly: entries close to an exact colour would win over it.
    distance = np.abs(free[:, None, :] - fixed[None, :, :]).max(axis=2)
    free = np.where(distance.min(axis=1, keepdims=True) <= _CLOSE, fixed[distance.argmin(axis=1)], free)
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.vstack([fixed, free]).ravel().tolist())
    return palette
