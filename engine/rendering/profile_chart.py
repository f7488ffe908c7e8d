"""Speed and acceleration over time."""

from collections.abc import Sequence
from pathlib import Path

from plannerforge.engine.rendering.canvas import PICTURE_WIDTH_PX, SMALL_PT, new_figure, pixels, save_png, shortened
from plannerforge.engine.rendering.furniture import write_title
from plannerforge.engine.rendering.palette import series_style
from plannerforge.schemas.runs import RunRecord, RunSteps

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
