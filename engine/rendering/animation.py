"""An animated GIF of a scenario, with the ego if there is a run; it slows down around the decisive moment.

A PNG strip of its moments comes with the GIF, for viewers that show no motion; most models see only a GIF's first
frame. The background is drawn once; every frame restores it and draws only what moves.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...schemas.rendering import RenderedImage
from ..execution import ProgressReporter
from .canvas import INK, MUTED, SMALL_PT, TEXT_PT, exact_palette, image_at, new_figure, series_style
from .content import DrivenPath, ScenarioView, VehicleShape, Viewport
from .furniture import Inventory, draw_legend, write_title
from .road import draw_signals
from .top_view import HEADER_PX, SIDE_PX, draw_background, figure_height
from .vehicles import draw_egos, draw_endings, draw_vehicles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from PIL.Image import Image

_WIDTH_PX, _TALLEST_PLOT_PX = 1000, 760.0
_MOST_FRAMES = 56
"""Limits drawing time and file size (chosen)."""
_PAUSE_MS = 1500
"""Time that the last frame stays before the animation restarts (chosen)."""
_SLOWED, _AROUND_S, _MOST_SLOW_FRAMES = 4, 1.0, 20
"""Slow-motion factor, its half duration around the moment in s, and its largest number of frames (chosen)."""
_HOLD_MS = 1000
"""Time that the frame of the moment stays (chosen)."""
_LARGEST_BYTES = 2_000_000
"""Larger files get fewer colours (chosen)."""
_STRIP_FRAMES, _STRIP_COLUMNS, _STRIP_WIDTH_PX, _STRIP_GAP_PX = 6, 3, 1500, 6
"""Moments of a strip, moments per row, its width and the gaps between them (chosen)."""
_MOST_LABELLED = 40
"""Largest number of vehicles that get ids, since more would cover each other (chosen)."""


@dataclasses.dataclass(frozen=True)
class Moment:
    """The moment at which an animation slows down: its step and a description."""

    step: int
    words: str


@dataclasses.dataclass(frozen=True)
class _Pace:
    """The steps that become frames, and the steps shown in slow motion."""

    steps: tuple[int, ...]
    step_s: float
    moment: Moment | None

    def is_slow(self, step: int) -> bool:
        """Return True if a step is near the moment."""
        return self.moment is not None and abs(step - self.moment.step) * self.step_s <= _AROUND_S + 1e-9

    def durations_ms(self) -> list[int]:
        """Return the duration of each frame: real time, longer around the moment, with a pause at it and at the end."""
        if len(self.steps) == 1:
            return [500]
        durations = []
        for step, following in zip(self.steps, (*self.steps[1:], None), strict=True):
            real = 0.0 if following is None else 1000 * self.step_s * (following - step)
            slow = _SLOWED if self.is_slow(step) and following is not None and self.is_slow(following) else 1
            hold_ms = _HOLD_MS if self.moment is not None and step == self.moment.step else 0
            durations.append(_PAUSE_MS if following is None else max(round(real * slow / 10) * 10, 20) + hold_ms)
        return durations


def animate(
    view: ScenarioView, folder: Path, report: ProgressReporter, moment: Moment | None = None
) -> tuple[RenderedImage, RenderedImage]:
    """Draw a scenario or its runs from the first to the last step, as a GIF in real time and as a strip.

    Around the given moment the GIF is four times slower, and the frames say so; the strip includes that moment.
    """
    steps = _frame_steps(view, moment)
    pace = _Pace(tuple(steps), view.content.step_s, moment)
    frames, shown = _draw_frames(view, pace, report)
    path, strip_path = folder / "animation.gif", folder / "strip.png"
    _write_gif(frames, path, pace.durations_ms())
    chosen = _strip_places(steps, moment)
    strip = _strip([frames[place] for place in chosen])
    strip.save(strip_path, optimize=True)
    report(1.0, "animation written")
    begin, end = steps[0] * view.content.step_s, steps[-1] * view.content.step_s
    text = f"Animation of {view.content.scenario_id} from {begin:.1f} to {end:.1f} s"
    runs = "; ".join(run.label for run in view.paths)
    kinds = f"; road users: {', '.join(shown.kinds)}" if shown.kinds else ""
    slow = ""
    if moment is not None:
        slow = f" Played at 1/{_SLOWED} speed around {moment.step * view.content.step_s:.1f} s ({moment.words})."
    times = ", ".join(f"{steps[place] * view.content.step_s:.1f}" for place in chosen)
    return (
        image_at(path, frames[0].size, f"{text}, {runs or 'recorded traffic'}{kinds}.{slow}"),
        image_at(strip_path, strip.size, f"Still frames at {times} s, row by row."),
    )


def _strip_places(steps: Sequence[int], moment: Moment | None) -> list[int]:
    """Return the frames of a strip, evenly spaced in time; the frame nearest to the moment is moved to it."""
    times = np.linspace(steps[0], steps[-1], min(_STRIP_FRAMES, len(steps)))
    if moment is not None:
        nearest = int(np.argmin(np.abs(times - moment.step)))
        times[nearest] = times[nearest] if nearest in (0, len(times) - 1) else moment.step
    return sorted({int(np.argmin(np.abs(np.array(steps) - time))) for time in times})


def _strip(frames: Sequence["Image"]) -> "Image":
    """Return the frames combined into a grid."""
    from PIL import Image

    columns = min(_STRIP_COLUMNS, len(frames))
    width = (_STRIP_WIDTH_PX - _STRIP_GAP_PX * (_STRIP_COLUMNS - 1)) // _STRIP_COLUMNS
    height = round(frames[0].height * width / frames[0].width)
    rows = -(-len(frames) // columns)
    size = (columns * (width + _STRIP_GAP_PX) - _STRIP_GAP_PX, rows * (height + _STRIP_GAP_PX) - _STRIP_GAP_PX)
    strip = Image.new("RGB", size, "white")
    for place, frame in enumerate(frames):
        row, column = divmod(place, columns)
        small = frame.resize((width, height), Image.Resampling.LANCZOS)
        strip.paste(small, (column * (width + _STRIP_GAP_PX), row * (height + _STRIP_GAP_PX)))
    return strip


def _frame_steps(view: ScenarioView, moment: Moment | None) -> list[int]:
    """Return the time steps of at most 56 frames, evenly spaced but denser around the moment, with the last step."""
    first = min((path.first_step for path in view.paths), default=view.content.ego_step)
    last = max((path.last_step for path in view.paths), default=view.content.last_step)
    last = max(last, first)
    stride = max(int(np.ceil((last - first) / (_MOST_FRAMES - 1))), 1)
    steps = {*range(first, last + 1, stride), last}
    if moment is not None:
        around = round(_AROUND_S / view.content.step_s)
        dense = max(int(np.ceil(2 * around / _MOST_SLOW_FRAMES)), 1)
        slow = range(moment.step - around // dense * dense, moment.step + around + 1, dense)
        steps |= {step for step in slow if first <= step <= last}
    return sorted(steps)


def _draw_frames(view: ScenarioView, pace: _Pace, report: ProgressReporter) -> tuple[list["Image"], Inventory]:
    from PIL import Image

    steps = pace.steps
    viewport = Viewport.of(view.content, view.paths, steps[0])
    width, plot_width = _WIDTH_PX, _WIDTH_PX - 2 * SIDE_PX
    plot_height = min(plot_width * viewport.height_m / viewport.width_m, _TALLEST_PLOT_PX)
    viewport = viewport.fitted(plot_width / plot_height)
    shown = Inventory.of([view], [viewport], steps)
    height = figure_height(plot_height, shown)
    figure = new_figure(width, height)
    bottom = height - HEADER_PX - plot_height
    axes = figure.add_axes((SIDE_PX / width, bottom / height, plot_width / width, plot_height / height))
    draw_background(axes, view, viewport)
    write_title(figure, view.content.scenario_id, "", x=SIDE_PX / width + 0.002)
    draw_legend(figure, shown)
    canvas: Any = figure.canvas
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)
    frames = []
    for number, step in enumerate(steps):
        canvas.restore_region(background)
        artists = _moving_artists(axes, dataclasses.replace(view, step=step), viewport, pace)
        for artist in sorted(artists, key=lambda artist: artist.get_zorder()):
            artist.draw(canvas.get_renderer())
            artist.remove()
        frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy(), "RGB"))
        report(0.9 * (number + 1) / len(steps), f"frame {number + 1} of {len(steps)}")
    return frames, shown


def _moving_artists(axes: "Axes", view: ScenarioView, viewport: Viewport, pace: _Pace) -> list[Any]:
    before = set(axes.get_children())
    draw_signals(axes, view.content, view.step, viewport)
    vehicles = view.content.vehicles_at(view.step)
    draw_vehicles(axes, vehicles, view.unseen)
    draw_egos(axes, view, start=False)
    draw_endings(axes, view.paths, view.step)
    _write_ids(axes, vehicles, viewport)
    _write_state(axes, view)
    if pace.moment is not None and pace.is_slow(view.step):
        _write_slowness(axes, view, pace.moment)
    return [artist for artist in axes.get_children() if artist not in before]


def _write_ids(axes: "Axes", vehicles: Sequence[VehicleShape], viewport: Viewport) -> None:
    """Write ids above their vehicles; the frames change too fast for a better placement."""
    if len(vehicles) > _MOST_LABELLED:
        return
    lift = viewport.height_m * 0.008
    for vehicle in vehicles:
        if viewport.contains(vehicle.center[None, :]):
            top = float(vehicle.corners[:, 1].max()) + lift
            axes.text(
                vehicle.center[0], top, str(vehicle.vehicle_id), ha="center", va="bottom", fontsize=SMALL_PT,
                clip_on=True, zorder=7,
            )  # fmt: skip


def _write_state(axes: "Axes", view: ScenarioView) -> None:
    alone = len(view.paths) == 1
    parts = [f"t = {view.time_s:4.1f} s", *(_speed(path, view.step, alone=alone) for path in view.paths)]
    axes.annotate(
        "   ".join(parts), (0, 1), xycoords="axes fraction", xytext=(2, 8), textcoords="offset points",
        fontsize=TEXT_PT, color=MUTED, zorder=8,
    )  # fmt: skip
    for number, path in enumerate(view.paths):
        if view.step >= path.last_step:
            axes.annotate(
                path.record.outcome.replace("_", " ") if alone else path.label,
                (1, 1), xycoords="axes fraction", xytext=(-10, -12 - 26 * number), textcoords="offset points",
                ha="right", va="top", fontsize=TEXT_PT, fontweight="bold", color=INK, zorder=8,
                bbox={"facecolor": "white", "edgecolor": series_style(path.series)[0], "linewidth": 1.5, "pad": 4},
            )  # fmt: skip


def _write_slowness(axes: "Axes", view: ScenarioView, moment: Moment) -> None:
    """Write on the frame that time runs slower, and the time until or since the moment."""
    away = (view.step - moment.step) * view.content.step_s
    when = "now" if view.step == moment.step else f"{abs(away):.1f} s {'before' if away < 0 else 'after'}"
    axes.annotate(
        f"{_SLOWED}× slower · {when}: {moment.words}", (0, 1), xycoords="axes fraction", xytext=(10, -12),
        textcoords="offset points", ha="left", va="top", fontsize=TEXT_PT, color=INK, zorder=8,
        fontweight="bold" if view.step == moment.step else "normal",
        bbox={"facecolor": "#F0E442", "edgecolor": INK, "linewidth": 1.0, "pad": 4},
    )  # fmt: skip


def _speed(path: DrivenPath, step: int, *, alone: bool) -> str:
    speed = f"{path.speeds_mps[path.index_at(step)]:4.1f} m/s"
    return f"ego {speed}" if alone else f"{path.name} {speed}"


def _write_gif(frames: Sequence["Image"], path: Path, durations_ms: Sequence[int]) -> None:
    """Write all frames with one palette, so that nothing flickers; use fewer colours if the file is too large."""
    from PIL import Image

    for colours in (128, 64, 32):
        palette = exact_palette([frames[0], frames[len(frames) // 2], frames[-1]], colours)
        flat = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
        flat[0].save(path, save_all=True, append_images=flat[1:], duration=list(durations_ms), loop=0, disposal=1)
        if path.stat().st_size <= _LARGEST_BYTES:
            return
