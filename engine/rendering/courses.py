"""Charts of runs over time: speeds of several runs, cost terms of one run, timeline of one run with its moments."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ...schemas.errors import NotPossible
from ...schemas.reviews import Contact, RunReview
from ...schemas.runs import ReviewRequest, RunRecord, RunSeries, RunSteps, ending
from ...schemas.text import measured
from ..analysis import Course, RunSet, course_of, read_series, review_runs
from ..execution import silent
from ..geometry import Values
from .canvas import HATCHES, INK, MUTED, PICTURE_WIDTH_PX, SMALL_PT, Drawing, new_figure, series_style
from .furniture import shortened, write_legend, write_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_PROFILES = 6
"""Most runs of a profile: the number of line styles."""


def profile(runs: RunSet) -> Drawing:
    """Draw speed and acceleration over time, one line per run (at most six), with marks for the outcomes.

    Raises:
        NotPossible: No run has recorded steps.
    """
    driven = [(record, runs.steps[record.run_id]) for record in runs.records if record.run_id in runs.steps]
    driven = [(record, steps) for record, steps in driven if steps.speed_mps]
    if not driven:
        raise NotPossible("these runs have no recorded steps", next_step="run them again with run_planner")
    shown = driven[:_MOST_PROFILES]
    scenarios = list(dict.fromkeys(record.scenario_id for record, _ in shown))
    rows = (len(shown) + 1) // 2
    height = 640 + 22 * rows
    figure = new_figure(PICTURE_WIDTH_PX, height)
    low = (64 + 22 * rows) / height
    panel = (height - 64 - 22 * rows - 92) / height / 2
    acceleration = figure.add_axes((0.07, low, 0.9, panel))
    speed = figure.add_axes((0.07, low + panel + 18 / height, 0.9, panel), sharex=acceleration)
    texts = []
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
        slowest, fastest = f"{min(steps.speed_mps):.1f}", f"{max(steps.speed_mps):.1f}"
        speeds = f"{slowest if slowest == fastest else f'{slowest} to {fastest}'} m/s over {times[-1]:.1f} s"
        texts.append(f"{name} ({record.outcome.replace('_', ' ')}): {speeds}")
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
    write_legend(figure, 0.06, 2)
    write_title(
        figure,
        f"Speed and acceleration on {scenarios[0] if len(scenarios) == 1 else f'{len(scenarios)} scenarios'}",
        "the ego's motion; a disc marks a run that reached its goal, a cross one that did not",
    )
    more = len(driven) - len(shown)
    notes = (f"runs not shown: {more}",) if more else ()
    return Drawing(figure, f"Speed and acceleration of the ego. {'; '.join(texts)}.", notes)


_MOST_TERMS = 6
"""Terms of a run with their own band, one per colour; the rest share one (chosen)."""


def terms(runs: RunSet) -> Drawing:
    """Draw the weighted cost terms of one run over time: sums above, shares below, with marked moments.

    Raises:
        NotPossible: No run has recorded cost terms.
    """
    candidates = [record for record in _failures_first(runs) if record.run_id in runs.steps]
    priced = [record for record in candidates if runs.steps[record.run_id].costs]
    if not priced:
        raise NotPossible("no cost terms were recorded", next_step="render kind=profile")
    record = priced[0]
    steps = runs.steps[record.run_id]
    names, values = _stacked(steps)
    planned = (np.array(steps.plan_steps[: values.shape[1]]) - steps.first_step) * record.step_s
    end_s = max(float(planned[-1]), _end_s(record, steps), record.step_s)
    times, values = (
        np.append(planned, end_s),
        np.column_stack([values, values[:, -1]]),
    )  # a plan applies until the next one
    marks = _marks(record, _review_of(runs, record))
    legend_px = 24 * (-(-len(names) // 3)) + 10
    height = 78 + 2 * 240 + 24 + 62 + 22 * len(marks) + legend_px
    figure = new_figure(PICTURE_WIDTH_PX, height)
    panel, bottom = 240, height - 78 - 2 * 240 - 24
    share = figure.add_axes((0.08, bottom / height, 0.89, panel / height))
    cost = figure.add_axes((0.08, (bottom + panel + 24) / height, 0.89, panel / height), sharex=share)
    totals = values.sum(axis=0)
    parts = np.divide(100 * values, totals, out=np.zeros_like(values), where=totals > 0)
    for axes, stacked in ((cost, values), (share, parts)):
        lower = np.zeros(len(times))
        for number, (name, row) in enumerate(zip(names, stacked, strict=True)):
            axes.fill_between(
                times, lower, lower + row, step="post", facecolor=_term_colour(number), hatch=_term_hatch(number),
                edgecolor="white", linewidth=0.3, label=name if axes is cost else None,
            )  # fmt: skip
            lower = lower + row
        axes.set_xlim(0, _MARGIN * end_s)
    cost.set_ylabel("weighted cost [1]")
    cost.tick_params(labelbottom=False)
    share.set_ylabel("share [%]")
    share.set_ylim(0, 100)
    share.set_xlabel("time since the start [s]")
    figure.align_ylabels([cost, share])
    _draw_marks(figure, (cost, share), marks, first_px=legend_px)
    write_legend(figure, 0.07, 3)
    write_title(
        figure,
        f"Cost terms over time: {shortened(record.config_name, 30)} on {record.scenario_id}",
        f"chosen candidate of each planning step, raw cost × weight; {record.run_id}",
    )
    mean = {name: float(row[:-1].mean()) for name, row in zip(names, parts, strict=True)}
    shares = ", ".join(f"{name} {value:.0f}%" for name, value in sorted(mean.items(), key=lambda one: -one[1])[:4])
    headline = f"Cost terms of {record.run_id} over {times[-1]:.1f} s; mean shares: {shares}"
    text = f"{headline}. Marked: {_describe_marks(marks)}."
    return Drawing(figure, text, _others_left_out(len(priced)))


def _stacked(steps: RunSteps) -> tuple[list[str], Values]:
    """Return the terms by mean, largest first and small terms combined, and their values (terms, steps)."""
    count = min([len(steps.plan_steps), *(len(values) for values in steps.costs.values())])
    series = {name: np.maximum(np.array(values[:count]), 0.0) for name, values in steps.costs.items()}
    order = sorted((name for name in series if series[name].any()), key=lambda name: (-series[name].mean(), name))
    shown, rest = order[:_MOST_TERMS], order[_MOST_TERMS:]
    rows = [series[name] for name in shown] or [np.zeros(count)]
    names = shown or ["no cost"]
    if rest:
        rows.append(np.sum([series[name] for name in rest], axis=0))
        names.append(f"{len(rest)} smaller terms" if len(rest) > 1 else rest[0])
    return names, np.array(rows)


def _term_colour(number: int) -> str:
    return "#BDBDBD" if number >= _MOST_TERMS else series_style(number)[0]


def _term_hatch(number: int) -> str:
    return HATCHES[number % len(HATCHES)]


def timeline(runs: RunSet) -> Drawing:
    """Draw a run over time: speed, accelerations, gap, time to collision, and its position on the route if recorded.

    Its decisive moments are marked. If there are several runs, the first that failed is drawn.

    Raises:
        NotPossible: No run has recorded steps.
    """
    courses = ((record, course) for record in _failures_first(runs) if (course := course_of(runs, record)) is not None)
    record, course = next(courses, (None, None))
    if record is None or course is None:
        raise NotPossible("these runs have no recorded steps", next_step="run them again with run_planner")
    source = next(source for source in runs.sources if source.record.run_id == record.run_id)
    review, series = _review_of(runs, record), read_series(source)
    on_route = series if series is not None and len(series.lateral_offset_m) == len(course.time_s) else None
    marks = _marks(record, review)
    count = 3 if on_route is None else 4
    height = 78 + count * 172 + (count - 1) * 16 + 62 + 22 * len(marks) + 8
    figure = new_figure(PICTURE_WIDTH_PX, height)
    panels: list[Axes] = []
    for number in range(count):
        bottom = height - 78 - (number + 1) * 172 - number * 16
        first = panels[0] if panels else None
        panels.append(figure.add_axes((0.08, bottom / height, 0.84, 172 / height), sharex=first))
    speed, motion, near, *place = panels
    blue, red, green, purple = (series_style(number) for number in range(4))
    speed.plot(course.time_s, course.speed_mps, color=blue[0], linewidth=2.2, label="driven")
    if on_route is not None:
        _draw_desired_speed(speed, runs.steps[record.run_id], on_route, record.step_s, green)
        _draw_place(place[0], course, on_route, (blue, red))
    speed.set_ylabel("speed [m/s]")
    speed.set_ylim(bottom=min(0.0, speed.get_ylim()[0]))
    motion.plot(course.time_s, course.acceleration_mps2, color=blue[0], linewidth=2.2, label="longitudinal")
    motion.plot(course.time_s, course.lateral_mps2, color=green[0], linestyle=green[1], linewidth=2.2, label="lateral")
    motion.axhline(0, color="#9A9A9A", linewidth=0.9)
    motion.set_ylabel("acceleration\n[m/s²]")
    _draw_key(motion)
    _draw_nearness(near, course, (red, purple))
    for axes in panels:
        axes.grid(color="#E2E2E2", linewidth=0.8)
        axes.set_axisbelow(True)
        axes.tick_params(labelbottom=axes is panels[-1])
    near.set_xlim(0, _MARGIN * max(float(course.time_s[-1]), record.step_s))
    panels[-1].set_xlabel("time since the start [s]")
    figure.align_ylabels(panels)
    _draw_marks(figure, panels, marks, first_px=8)
    end = ending(record.outcome, record.reason, review)
    write_title(
        figure,
        f"Timeline: {shortened(record.config_name, 30)} on {record.scenario_id}",
        shortened(f"{record.run_id}: {end}", 145),
    )
    text = f"Timeline of {record.run_id} over {course.time_s[-1]:.1f} s: {end}. Marked: {_describe_marks(marks)}."
    return Drawing(figure, text, _others_left_out(sum(record.run_id in runs.steps for record in runs.records)))


_MARGIN = 1.01
"""Factor between the time axis and the drawn time, so that a mark at the end is fully visible."""
_SHOWN_GAP_M, _SHOWN_TTC_S = 20.0, 6.0
"""Upper ends of the gap and time-to-collision axes; larger values decide nothing (chosen)."""


def _draw_nearness(axes: "Axes", course: Course, styles: Sequence[tuple[str, object]]) -> None:
    """Draw the gap to the nearest road user on the left axis, and the time to collision on the right axis."""
    (gap_colour, _), (time_colour, time_dashes) = styles
    axes.plot(course.time_s, course.gap_m, color=gap_colour, linewidth=2.2)
    axes.set_ylim(0, _SHOWN_GAP_M)
    axes.set_ylabel(f"gap to the nearest\n[m], up to {_SHOWN_GAP_M:g}", color=gap_colour)
    if bool(np.isnan(course.gap_m).all()):
        axes.text(0.5, 0.5, "no other within 60 m", transform=axes.transAxes, ha="center", color=MUTED)
    if not bool((course.time_to_collision_s <= _SHOWN_TTC_S).any()):
        words = f"no time to collision up to {_SHOWN_TTC_S:g} s"
        axes.text(0.995, 0.9, words, transform=axes.transAxes, ha="right", va="top", color=MUTED, fontsize=SMALL_PT)
        return
    other = axes.twinx()
    other.plot(
        course.time_s, course.time_to_collision_s, color=time_colour, linestyle=time_dashes,
        linewidth=2.0, marker=".", markersize=4,
    )  # fmt: skip
    other.set_ylim(0, _SHOWN_TTC_S)
    other.set_ylabel("time to collision [s]\n(dash-dotted)", color=time_colour)
    other.spines["right"].set_visible(True)
    other.tick_params(labelbottom=False)


def _draw_desired_speed(
    axes: "Axes", steps: RunSteps, series: RunSeries, step_s: float, style: tuple[str, object]
) -> None:
    """Draw the speed that the built-in planners would aim at, which applies until the next planning step."""
    count = min(len(steps.plan_steps), len(series.desired_speed_mps))
    times = (np.array(steps.plan_steps[:count]) - steps.first_step) * step_s
    axes.step(
        times, series.desired_speed_mps[:count], where="post", color=style[0], linestyle=style[1],
        linewidth=1.8, label="desired",
    )  # fmt: skip
    _draw_key(axes, "lower left")  # the numbers of the moments are at the top of this panel


def _draw_key(axes: "Axes", place: Literal["upper left", "lower left"] = "upper left") -> None:
    """Draw the legend of a panel above the lines of the moments."""
    key = axes.legend(loc=place, ncols=2, frameon=True, framealpha=0.9, edgecolor="none", fontsize=SMALL_PT)
    key.set_zorder(7)


def _draw_place(axes: "Axes", course: Course, series: RunSeries, styles: Sequence[tuple[str, object]]) -> None:
    """Draw the offset from the path on the left axis, and heading error and steering on the right axis."""
    (offset_colour, _), (angle_colour, dashes) = styles
    axes.plot(course.time_s, series.lateral_offset_m, color=offset_colour, linewidth=2.2)
    axes.axhline(0, color="#9A9A9A", linewidth=0.9)
    axes.set_ylabel("offset from the\nroute [m]", color=offset_colour)
    other = axes.twinx()
    degrees = {"heading error": (series.heading_error_rad, "-"), "steering": (series.steering_rad, dashes)}
    for name, (values, line) in degrees.items():
        if len(values) == len(course.time_s):
            other.plot(course.time_s, np.degrees(values), color=angle_colour, linestyle=line, linewidth=1.6, label=name)
    other.set_ylabel("heading error,\nsteering [°]", color=angle_colour)
    other.spines["right"].set_visible(True)
    _draw_key(other)


@dataclass(frozen=True)
class _Mark:
    """A moment of a run and its description; ``decisive``: True if it ended the run."""

    time_s: float
    words: str
    decisive: bool = False


def _review_of(runs: RunSet, record: RunRecord) -> RunReview:
    source = next(source for source in runs.sources if source.record.run_id == record.run_id)
    return review_runs(ReviewRequest(runs=(source,), scenarios=runs.scenarios), silent).reviews[0]


def _marks(record: RunRecord, review: RunReview) -> list[_Mark]:
    """Return the moments of a run in order of time, and by weight at equal times."""
    marks = list(_contact_marks(review.contact)) if review.contact is not None else []
    if review.contact is None:
        near, urgent = review.closest, review.most_urgent
        if near is not None:
            marks.append(_Mark(near.time_s, f"closest: {near.gap_m:.2f} m to {near.other} {near.place}"))
        if urgent is not None:
            least = measured(urgent.time_to_collision_s, 2)
            words = f"shortest time to collision: {least} s with {urgent.other} {urgent.place}"
            marks.append(_Mark(urgent.time_s, words))
        if record.metrics is not None:
            marks.append(_Mark(record.metrics.duration_s, record.outcome.replace("_", " "), decisive=True))
    marks += [
        _Mark(one.time_s, f"largest {one.name}: {measured(one.value)} {one.unit}")
        for one in review.largest
        if one.name in ("braking", "lateral acceleration")
    ]
    return sorted(marks, key=lambda mark: mark.time_s)


def _contact_marks(contact: Contact) -> Iterable[_Mark]:
    yield _Mark(
        contact.time_s, re.sub(r" at [\d.]+ s(?=,|$)", "", contact.in_words().partition(" (")[0]), decisive=True
    )
    if contact.came_in_s is not None:
        yield _Mark(contact.came_in_s, f"{contact.obstacle_class} {contact.obstacle_id} and the ego enter one path")
    if contact.braked_since_s is not None:
        yield _Mark(contact.braked_since_s, "the ego starts to brake")
    if contact.ego_stood_since_s is not None:
        yield _Mark(contact.ego_stood_since_s, "the ego has stopped")
    prevention = contact.prevention
    if prevention is not None and prevention.by_braking_until_s is not None:
        yield _Mark(prevention.by_braking_until_s, "last moment at which full braking prevents the collision")


_CLOSE_SHARE = 0.018
"""Share of the axis below which two numbers would overlap."""


def _draw_marks(figure: "Figure", panels: Sequence["Axes"], marks: Sequence[_Mark], *, first_px: int) -> None:
    """Draw a numbered line through all panels for each moment; a key at the bottom explains the numbers."""
    height = figure.get_figheight() * figure.dpi
    low, high = panels[0].get_xlim()
    last, level = -np.inf, 0
    for number, mark in enumerate(marks, start=1):
        for axes in panels:
            axes.axvline(
                mark.time_s, color=INK, linewidth=2.2 if mark.decisive else 1.0, linestyle=(0, (4, 3)), zorder=6
            )
        level = (level + 1) % 3 if (mark.time_s - last) / (high - low) < _CLOSE_SHARE else 0
        last = mark.time_s
        panels[0].annotate(
            str(number), (mark.time_s, 1), xycoords=("data", "axes fraction"), xytext=(0, -2 - 15 * level),
            textcoords="offset points", ha="center", va="top", fontsize=SMALL_PT, fontweight="bold", zorder=8,
            bbox={"boxstyle": "circle,pad=0.18", "facecolor": "white", "edgecolor": INK, "linewidth": 1.0},
        )  # fmt: skip
        bottom = first_px + 22 * (len(marks) - number)
        weight = "bold" if mark.decisive else "normal"
        words = f"{number}  {mark.time_s:.1f} s: {shortened(mark.words, 135)}"
        figure.text(0.08, bottom / height, words, fontsize=SMALL_PT + 0.5, fontweight=weight, va="bottom")


def _describe_marks(marks: Sequence[_Mark]) -> str:
    return "; ".join(f"{mark.words} at {mark.time_s:.1f} s" for mark in marks) or "nothing"


def _failures_first(runs: RunSet) -> list[RunRecord]:
    return [*runs.failures, *runs.successes]


def _others_left_out(count: int) -> tuple[str, ...]:
    return (f"shows one of {count} runs, the first that failed; give an id to see another",) if count > 1 else ()


def _end_s(record: RunRecord, steps: RunSteps) -> float:
    return (len(steps.x_m) - 1) * record.step_s
