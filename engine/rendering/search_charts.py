"""The chart of a search (its candidates, the best so far, the gain of each change) or of a sensitivity analysis."""

from typing import TYPE_CHECKING

from ...schemas.analysis.optimization import StudyRecord, TrialLine
from ...schemas.text import counted
from .canvas import INK, MUTED, PICTURE_WIDTH_PX, SMALL_PT, Drawing, new_figure, outcome_colour, series_style
from .furniture import write_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_HEIGHT_PX = 480
"""Height of the chart (chosen)."""


def study_chart(study: StudyRecord) -> Drawing:
    """Draw candidates in order and the gain of each change in the best configuration, or the effects."""
    figure = new_figure(PICTURE_WIDTH_PX, _HEIGHT_PX)
    if study.effects:
        return _effects(figure, study)
    candidates = figure.add_axes((0.06, 0.14, 0.5, 0.68))
    changes = figure.add_axes((0.76, 0.14, 0.22, 0.68))
    best = _draw_candidates(candidates, study)
    words = _draw_changes(changes, study)
    subtitle = (
        f"{study.method} for {' + '.join(study.objective)} from {study.base_name}: "
        f"{counted(len(study.trials), 'candidate')}"
    )
    write_title(figure, "Search", subtitle)
    return Drawing(figure, f"Search with {subtitle}; {best}. {words}")


def _score(trial: TrialLine) -> float:
    return sum(trial.values)


def _draw_candidates(axes: "Axes", study: StudyRecord) -> str:
    """Draw a mark per candidate, and the best so far as a line.

    A mark is hollow if the candidate was stopped early, and a cross if it breaks a constraint.
    """
    colour, given_up = series_style(0)[0], series_style(1)[0]
    best: list[float] = []
    for trial in study.trials:
        if trial.pruned:
            axes.plot(trial.number, _score(trial), "o", markerfacecolor="white", color=given_up, markersize=6)
        else:
            axes.plot(trial.number, _score(trial), "o" if trial.within else "x", color=colour, markersize=6)
        counts = trial.within and not trial.pruned
        best.append(max([*best[-1:], *([_score(trial)] if counts else [])], default=_score(trial)))
    axes.step([trial.number for trial in study.trials], best, where="post", color=INK, linewidth=1.6)
    axes.axhline(_score(study.trials[0]), color=MUTED, linewidth=1, linestyle=(0, (4, 3)))
    axes.set_xlabel("candidate; hollow: stopped early, ×: breaks a constraint, dashed: the base")
    axes.set_ylabel("training score")
    return f"the base has {_score(study.trials[0]):.3f}, the best {best[-1]:.3f}"


def _draw_changes(axes: "Axes", study: StudyRecord) -> str:
    shares = sorted(study.changes, key=lambda share: share.gain)
    if not shares:
        axes.set_axis_off()
        axes.text(0, 0.5, "Nothing better was found.", color=MUTED, transform=axes.transAxes)
        return "Nothing better was found in training."
    labels = [f"{one.change.name}\n{one.change.before:g} → {one.change.after:g}" for one in shares]
    gains = [one.gain for one in shares]
    axes.barh(range(len(shares)), gains, color=outcome_colour("goal_reached"), height=0.6)
    axes.set_yticks(range(len(shares)), labels, fontsize=SMALL_PT)
    axes.axvline(0, color=INK, linewidth=1)
    axes.set_xlabel("score lost without the change")
    parts = [
        f"{one.change.name} from {one.change.before:g} to {one.change.after:g} brings {one.gain:.3f}" for one in shares
    ]
    return f"{'; '.join(reversed(parts))}."


def _effects(figure: "Figure", study: StudyRecord) -> Drawing:
    """Draw the effects with their intervals, largest on top."""
    axes = figure.add_axes((0.24, 0.14, 0.72, 0.68))
    rows = list(reversed(study.effects))
    for row, one in enumerate(rows):
        colour = series_style(0)[0] if one.verdict == "matters" else MUTED
        axes.plot([max(one.effect - one.margin, 0), one.effect + one.margin], [row, row], color=INK, linewidth=1.6)
        axes.plot(one.effect, row, "o", color=colour, markersize=8)
    axes.set_yticks(range(len(rows)), [one.name for one in rows])
    axes.set_xlabel("μ*, with its 95% interval" if study.method == "morris" else "total index, with its 95% interval")
    subtitle = f"{study.method}, {' + '.join(study.objective)}, {study.training_scenarios} scenarios"
    write_title(figure, "Sensitivity", subtitle)
    effects = "; ".join(f"{one.name} {one.effect:.3g} ({one.verdict})" for one in study.effects)
    return Drawing(figure, f"Sensitivity: {subtitle}: {effects}")
