"""Creates figures and writes their files: one style, and the same bytes every time.

Colours and line styles are distinguishable with any colour vision (Okabe and Ito 2008, Color universal design).
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
"""Colours with a meaning, which stay exact if an image is reduced to a palette."""
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
    """Return the fill colour of a CommonRoad obstacle type, or grey if the type has no colour."""
    return _CLASS_COLOURS.get(obstacle_type, _GREY)


def light_mark(state: str) -> tuple[str, str]:
    """Return the marker and colour of a traffic light, which both show its state; inactive: a grey dot."""
    return _LIGHT_MARKS.get(state, ("o", _LIGHT_OFF))


def outcome_colour(outcome: str) -> str:
    """Return the colour of a run's outcome in every chart."""
    return _OUTCOME_COLOURS.get(outcome, _GREY)


def ink_on_outcome(outcome: str) -> str:
    """Return the colour of text on the colour of an outcome."""
    return "white" if outcome in ("goal_reached", "collision", "off_road") else INK


HATCHES = ("", "//", "..", "xx", "\\\\", "--")
"""One hatch per series of bars, for viewers who cannot see its colour; further series are not drawn."""


def series_style(index: int) -> tuple[str, LineStyle]:
    """Return the colour and dash pattern of the n-th series; they repeat after six."""
    return _SERIES[index % len(_SERIES)]


PICTURE_WIDTH_PX = 1200
"""Width of a single picture or chart (chosen: readable in a chat and on a page)."""
_DPI = 100
SMALL_PT, TEXT_PT, TITLE_PT = 9.5, 11.0, 14.0
"""Sizes of ids and ticks, of text, and of titles (chosen)."""
_CLOSE = 10
"""Invisible differences of a colour channel (of 255)."""
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
    """A figure that is ready to write, its description in words, and notes on what it leaves out."""

    figure: "Figure"
    alt_text: str
    notes: tuple[str, ...] = ()


def new_figure(width_px: int, height_px: int) -> "Figure":
    """Return an empty figure of a size in pixels, drawn by Agg and bound to no window."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    mpl.rcParams.update(_STYLE)
    figure = Figure(figsize=(width_px / _DPI, height_px / _DPI), dpi=_DPI)
    FigureCanvasAgg(figure)
    return figure


def image_at(path: Path, size_px: tuple[int, int], alt_text: str) -> RenderedImage:
    """Return the answer's entry for a written image file."""
    return RenderedImage(
        path=str(path),
        mime_type="image/gif" if path.suffix == ".gif" else "image/png",
        width_px=size_px[0],
        height_px=size_px[1],
        size_bytes=path.stat().st_size,
        alt_text=alt_text,
    )


def write_png(figure: "Figure", path: Path) -> tuple[int, int]:
    """Write a figure with at most 256 colours, which suffice for flat drawings, and without a date; the file is small.

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
    """Return a palette that contains the meaningful colours exactly; its other colours are chosen for the images."""
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
    # Pillow finds only an approximate nearest entry: entries close to an exact colour would win over it.
    distance = np.abs(free[:, None, :] - fixed[None, :, :]).max(axis=2)
    free = np.where(distance.min(axis=1, keepdims=True) <= _CLOSE, fixed[distance.argmin(axis=1)], free)
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.vstack([fixed, free]).ravel().tolist())
    return palette
