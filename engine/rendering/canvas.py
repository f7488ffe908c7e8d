"""Figures and their files: one look, and the same bytes every time."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image

# ---------- palette
# Colours and line styles that are told apart with any colour vision (Okabe and Ito 2008, Color universal design).

BLACK = "#000000"
ORANGE = "#E69F00"
SKY_BLUE = "#56B4E9"
GREEN = "#009E73"
YELLOW = "#F0E442"
BLUE = "#0072B2"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#8C8C8C"
EGO_COLOUR = VERMILLION
INK = "#1A1A1A"
MUTED = "#5A5A5A"
ROAD, ROAD_EDGE, DIRECTION = "#E4E4E4", "#9A9A9A", "#B4B4B4"
LIGHT_RED, LIGHT_YELLOW, LIGHT_GREEN, LIGHT_OFF = "#D62728", "#E6B800", "#1A9850", "#C8C8C8"
EXACT = (
    "#FFFFFF", INK, MUTED, ROAD, ROAD_EDGE, DIRECTION, LIGHT_RED, LIGHT_YELLOW, LIGHT_GREEN, LIGHT_OFF,
    BLACK, ORANGE, SKY_BLUE, GREEN, YELLOW, BLUE, VERMILLION, PURPLE, GREY,
)  # fmt: skip
"""Colours that carry a meaning: they stay exact where an image is reduced to a palette."""
_CLASS_COLOURS = {
    "car": SKY_BLUE,
    "taxi": ORANGE,
    "truck": GREEN,
    "bus": YELLOW,
    "motorcycle": PURPLE,
    "bicycle": PURPLE,
    "pedestrian": BLACK,
    "priorityVehicle": BLUE,
    "train": GREEN,
}
_OUTCOME_COLOURS = {
    "goal_reached": BLUE,
    "collision": VERMILLION,
    "timeout": ORANGE,
    "goal_missed": YELLOW,
    "goal_early": SKY_BLUE,
    "goal_late": GREEN,
    "infeasible": PURPLE,
    "off_road": BLACK,
    "invalid": "#BDBDBD",
}
_LIGHT_MARKS = {
    "red": ("s", LIGHT_RED),
    "redYellow": ("s", LIGHT_YELLOW),
    "yellow": ("D", LIGHT_YELLOW),
    "green": ("o", LIGHT_GREEN),
}
LineStyle = Literal["solid"] | tuple[float, tuple[float, ...]]
_SERIES: tuple[tuple[str, LineStyle], ...] = (
    (BLUE, "solid"),
    (VERMILLION, (0, (6, 2))),
    (GREEN, (0, (1, 1))),
    (PURPLE, (0, (6, 2, 1, 2))),
    (ORANGE, (0, (3, 1))),
    (BLACK, (0, (8, 2, 1, 2, 1, 2))),
)


def class_colour(obstacle_type: str) -> str:
    """Fill colour of a CommonRoad obstacle type; grey for those without a class of their own."""
    return _CLASS_COLOURS.get(obstacle_type, GREY)


def light_mark(state: str) -> tuple[str, str]:
    """Marker and fill colour of a traffic light in a state: the shape says it as well; a light grey dot if inactive."""
    return _LIGHT_MARKS.get(state, ("o", LIGHT_OFF))


def outcome_colour(outcome: str) -> str:
    """Colour of a run's outcome in every chart."""
    return _OUTCOME_COLOURS.get(outcome, GREY)


def series_style(index: int) -> tuple[str, LineStyle]:
    """Colour and dash pattern of the n-th series; they repeat after six."""
    return _SERIES[index % len(_SERIES)]


# ---------- canvas
# Figures and their files: one look, and the same bytes every time.

PICTURE_WIDTH_PX = 1200
DPI = 100
SMALL_PT, TEXT_PT, TITLE_PT = 9.5, 11.0, 14.0
CLOSE = 10
"""Differences of a colour channel (of 255) that nobody sees."""
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


def new_figure(width_px: int, height_px: int) -> "Figure":
    """An empty figure of so many pixels, drawn by Agg and bound to no window."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    mpl.rcParams.update(_STYLE)
    figure = Figure(figsize=(width_px / DPI, height_px / DPI), dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


def pixels(figure: "Figure") -> "Image":
    """The figure as an RGB image."""
    from PIL import Image

    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    buffer.seek(0)
    return Image.open(buffer).convert("RGB")


def save_png(image: "Image", path: Path) -> Path:
    """Write an image with at most 256 colours, which flat drawings do not miss: small files, no dates inside."""
    from PIL import Image

    flat = image.quantize(palette=exact_palette([image], 256), dither=Image.Dither.NONE)
    flat.save(path, format="PNG", optimize=True)
    return path


def exact_palette(images: Sequence["Image"], colours: int) -> "Image":
    """A palette in which the colours that mean something stay exact; the rest is chosen after the images."""
    from PIL import Image

    height = max(image.height for image in images)
    together = Image.new("RGB", (sum(image.width for image in images), height), "white")
    left = 0
    for image in images:
        together.paste(image, (left, 0))
        left += image.width
    chosen = together.quantize(colors=colours - len(EXACT), method=Image.Quantize.MEDIANCUT).getpalette() or []
    fixed = np.array([[int(colour[place : place + 2], 16) for place in (1, 3, 5)] for colour in EXACT])
    free = np.array(chosen[: 3 * (colours - len(EXACT))]).reshape(-1, 3)
    # Pillow finds the nearest entry only roughly: entries close to an exact colour would win over it.
    distance = np.abs(free[:, None, :] - fixed[None, :, :]).max(axis=2)
    free = np.where(distance.min(axis=1, keepdims=True) <= CLOSE, fixed[distance.argmin(axis=1)], free)
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.vstack([fixed, free]).ravel().tolist())
    return palette


def shortened(text: str, length: int) -> str:
    """The text cut to a length, with an ellipsis where something is missing."""
    return text if len(text) <= length else text[: length - 1] + "…"
