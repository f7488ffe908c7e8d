"""Figures and their files: one look, and the same bytes every time."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from plannerforge.engine.rendering.palette import EXACT, INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image

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
