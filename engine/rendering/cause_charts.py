"""Charts of failure causes: who hit whom, whether the ego could have prevented it, and success by kind of scenario."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from ...schemas.errors import NotPossible
from ...schemas.results import Rate
from ...schemas.reviews import Contact, kind_in_words
from ...schemas.runs import RunRecord
from ...schemas.text import REFERENCE_DRIVERS_DO, counted
from ..analysis import RunSet, known_contacts
from .canvas import INK, MUTED, PICTURE_WIDTH_PX, SMALL_PT, Drawing, new_figure, outcome_colour, series_style
from .content import short_names
from .furniture import shortened, write_legend, write_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_Fault = Literal["preventable", "the ego's own", "not preventable", "not judged"]
_FAULTS: dict[_Fault, tuple[str, str, str]] = {
    "preventable": (outcome_colour("collision"), "", "a reference driver prevents it"),
    "the ego's own": (outcome_colour("infeasible"), "..", "the ego caused it"),
    "not preventable": (outcome_colour("goal_early"), "//", "no reference driver prevents it"),
    "not judged": ("#BDBDBD", "..", "not judged"),
}
"""Colour, hatch and label of each."""
_MOST_KINDS = 24
"""Most rows of a chart, as many as a screen shows (chosen)."""


def causes(runs: RunSet) -> Drawing:
    """Draw collisions by kind and preventability, and below them success with and without unpreventable collisions.

    Raises:
        NotPossible: There is no collision with a known course.
    """
    from matplotlib.ticker import MaxNLocator

    hits = [record for record in runs.valid if record.outcome == "collision"]
    contacts = known_contacts(runs)
    if not contacts:
        raise NotPossible(
            "the course of these collisions is unknown" if hits else "no run ended in a collision",
            next_step="render kind=outcomes",
        )
    names = short_names(runs.records)
    groups = runs.by_config(runs.valid)
    counts = _counts(groups, contacts)
    listed = list(counts)[:_MOST_KINDS]
    top, rates_height = 76, 34 * len(groups) + 20
    kinds_height = 30 * len(listed) + 20
    height = top + kinds_height + 70 + rates_height + 100
    figure = new_figure(PICTURE_WIDTH_PX, height)
    upper = figure.add_axes((0.27, 1 - (top + kinds_height) / height, 0.7, kinds_height / height))
    lower = figure.add_axes((0.27, 100 / height, 0.7, rates_height / height))
    for row, key in enumerate(listed):
        _draw_kind(upper, row, counts[key])
    numbers = {config: number for number, config in enumerate(groups, start=1)}
    labels = [kind if len(groups) == 1 else f"{kind} · {numbers[config]}" for kind, config in listed]
    upper.set_yticks(range(len(listed)), labels)
    upper.invert_yaxis()
    upper.set_xlabel("collisions")
    upper.xaxis.set_major_locator(MaxNLocator(integer=True))
    not_preventable = {run_id for run_id, contact in contacts.items() if _fault(contact) == "not preventable"}
    for row, records in enumerate(groups.values()):
        without = runs.rate(record for record in records if record.run_id not in not_preventable)
        _draw_rate(lower, row - 0.16, runs.rate(records), filled=True)
        _draw_rate(lower, row + 0.2, without, filled=False)
    lower.set_yticks(range(len(groups)), [f"{numbers[config]}. {shortened(names[config], 28)}" for config in groups])
    lower.set_ylim(len(groups) - 0.4, -0.6)
    _label_rates(lower)
    _fault_legend(write_legend, figure)
    judged = sum(contact.prevention is not None for contact in contacts.values())
    none = f"{len(not_preventable)} of {judged} judged collisions not preventable by any reference driver"
    write_title(figure, "Who hit whom, and could it be prevented", f"{counted(len(hits), 'collision')}; {none}")
    kinds = "; ".join(
        f"{sum(by_fault.values())} {kind} under {names[config]} ({_describe_faults(by_fault)})"
        for (kind, config), by_fault in ((key, counts[key]) for key in listed)
    )
    notes = [f"the reference drivers: {REFERENCE_DRIVERS_DO}"]
    notes += [f"kinds not shown: {len(counts) - len(listed)}"] if len(counts) > len(listed) else []
    if len(contacts) < len(hits):
        notes.append(f"the chart shows a random {len(contacts)} of {len(hits)} collisions; the others were not judged")
    return Drawing(figure, f"Collisions by kind: {kinds}. Together: {none}.", tuple(notes))


def _fault(contact: Contact) -> _Fault:
    if contact.laid_to == "ego":
        return "the ego's own"
    if contact.prevention is None:
        return "not judged"
    return "preventable" if contact.prevention.possible else "not preventable"


def _counts(
    groups: dict[str, list[RunRecord]], contacts: dict[str, Contact]
) -> dict[tuple[str, str], dict[_Fault, int]]:
    """Return collisions by kind and configuration, most frequent kind first, and by preventability."""
    counts: dict[tuple[str, str], dict[_Fault, int]] = {}
    totals: dict[str, int] = {}
    for config_id, records in groups.items():
        for contact in (contacts[record.run_id] for record in records if record.run_id in contacts):
            kind = kind_in_words(contact.kind)
            by_fault = counts.setdefault((kind, config_id), dict.fromkeys(_FAULTS, 0))
            by_fault[_fault(contact)] += 1
            totals[kind] = totals.get(kind, 0) + 1
    order = list(groups)
    return dict(sorted(counts.items(), key=lambda item: (-totals[item[0][0]], item[0][0], order.index(item[0][1]))))


def _describe_faults(by_fault: dict[_Fault, int]) -> str:
    return ", ".join(f"{count} {fault}" for fault, count in by_fault.items() if count)


def _draw_kind(axes: "Axes", row: int, by_fault: dict[_Fault, int]) -> None:
    left = 0
    for fault, count in by_fault.items():
        if count:
            colour, hatch, _ = _FAULTS[fault]
            axes.barh(row, count, left=left, height=0.66, color=colour, hatch=hatch, edgecolor="white", linewidth=0.5)
            box = {"facecolor": "white", "edgecolor": "none", "pad": 1.2, "alpha": 0.85}
            axes.text(left + count / 2, row, str(count), ha="center", va="center", fontsize=SMALL_PT, bbox=box)
            left += count


def _draw_rate(axes: "Axes", y: float, rate: Rate, *, filled: bool, colour: str | None = None) -> None:
    """Draw a share with its interval and its counts."""
    if rate.share is None or rate.low is None or rate.high is None:
        return
    shown = colour or outcome_colour("goal_reached")
    axes.plot([100 * rate.low, 100 * rate.high], [y, y], color=INK, linewidth=1.6, solid_capstyle="butt")
    face = shown if filled else "white"
    axes.plot(100 * rate.share, y, "o", color=shown, markerfacecolor=face, markersize=9, markeredgewidth=2, zorder=3)
    words = f"{100 * rate.share:.0f}% ({rate.count}/{rate.of})"
    axes.text(104, y, words, va="center", fontsize=SMALL_PT, color=INK if filled else MUTED, clip_on=False)


def _label_rates(axes: "Axes") -> None:
    axes.set_xlim(-2, 118)
    axes.set_xticks(range(0, 101, 20))
    axes.set_xlabel("goal reached [%] with 95% interval and number of runs")
    axes.grid(axis="x", color="#DDDDDD", linewidth=0.8)
    axes.set_axisbelow(True)


def _fault_legend(write: Callable[..., None], figure: object) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Patch | Line2D] = [
        Patch(facecolor=colour, hatch=hatch, edgecolor="white", label=words)
        for colour, hatch, words in _FAULTS.values()
    ]
    blue = outcome_colour("goal_reached")
    for face, words in ((blue, "all valid runs"), ("white", "without collisions that no reference driver prevents")):
        style = {"marker": "o", "linestyle": "none", "markersize": 9, "markeredgewidth": 2}
        handles.append(Line2D([], [], color=blue, markerfacecolor=face, label=words, **style))  # type: ignore[arg-type]
    write(figure, 0.01, 3, handles=handles)


@dataclass(frozen=True)
class _Stratum:
    """Runs with a common property: the factor, its level, and the runs by configuration."""

    factor: str
    level: str
    records: tuple[RunRecord, ...]


_UNKNOWN = "unknown"
_DENSITIES = ((0.0, "0 vehicles/km"), (1e-9, "under 20/km"), (20.0, "20 to 50/km"), (50.0, "50/km and more"))
"""Lower bounds of the recorded vehicles per kilometre of lanelets (chosen)."""
_MOST_STRATA = 24
_FEW = 5
"""Fewest scenarios for a meaningful share (chosen); rows with fewer are marked."""


def strata(runs: RunSet) -> Drawing:
    """Draw success with its interval by prediction and traffic, road and density, with a dot for each configuration.

    Raises:
        NotPossible: There is no valid run, or all runs are alike in every factor.
    """
    names = short_names(runs.records)
    configs = list(runs.by_config(runs.valid))
    rows = [stratum for factor in _FACTORS for stratum in _strata_of(runs, *factor)][:_MOST_STRATA]
    if not rows:
        raise NotPossible(
            "these runs do not differ in prediction, traffic, road or density", next_step="render kind=outcomes"
        )
    shown = configs[:_MOST_CONFIGS]
    each = 16 + 20 * len(shown)
    legend_rows = (len(shown) + 2) // 3
    height = 76 + each * len(rows) + 76 + 24 * legend_rows
    figure = new_figure(PICTURE_WIDTH_PX, height)
    low = (62 + 24 * legend_rows) / height
    axes = figure.add_axes((0.27, low, 0.7, each * len(rows) / height))
    texts = []
    full = {record.config_id: record.config_name for record in runs.records}
    for row, stratum in enumerate(rows):
        reached = list[str]()
        for number, config in enumerate(shown):
            rate = runs.rate(record for record in stratum.records if record.config_id == config)
            offset = (number - (len(shown) - 1) / 2) * 0.8 / len(shown)
            _draw_rate(axes, row + offset, rate, filled=True, colour=series_style(number)[0])
            if rate.share is not None:
                reached.append(f"{full[config]} {rate.count} of {rate.of}")
        texts += [f"{stratum.level}: {', '.join(reached)}"] if reached else []
        if row and rows[row - 1].factor != stratum.factor:
            axes.axhline(row - 0.5, color="#9A9A9A", linewidth=0.9)
    axes.set_yticks(range(len(rows)), [_stratum_label(stratum) for stratum in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    _label_rates(axes)
    _configuration_legend(figure, [names[config] for config in shown])
    write_title(
        figure,
        "Success by conditions and scenarios",
        "the interval counts scenarios, not runs; configurations from top to bottom as in the legend",
    )
    more = len(configs) - len(shown)
    notes = (f"configurations not shown: {more}",) if more else ()
    return Drawing(figure, f"Goal reached, by condition: {'; '.join(texts)}.", notes)


_MOST_CONFIGS = 4
"""Most dots per row, since more would be indistinguishable (chosen)."""


def _configuration_legend(figure: object, names: Sequence[str]) -> None:
    from matplotlib.lines import Line2D

    style = {"marker": "o", "linestyle": "none", "markersize": 9}
    handles = [
        Line2D([], [], color=series_style(number)[0], label=f"{number + 1}. {shortened(name, 40)}", **style)  # type: ignore[arg-type]
        for number, name in enumerate(names)
    ]
    write_legend(figure, 0.26, 3, handles=handles)  # type: ignore[arg-type]


def _stratum_label(stratum: _Stratum) -> str:
    scenarios = len({record.scenario_id for record in stratum.records})
    few = ", few" if scenarios < _FEW else ""
    return f"{shortened(stratum.level, 34)}\n{scenarios} scenario{'' if scenarios == 1 else 's'}{few}"


def _strata_of(runs: RunSet, factor: str, level_of: Callable[[RunSet, RunRecord], str]) -> Iterable[_Stratum]:
    """Yield the strata of one factor, by level, unless all runs have the same level."""
    levels: dict[str, list[RunRecord]] = {}
    for record in runs.valid:
        levels.setdefault(level_of(runs, record), []).append(record)
    if len(levels) > 1:
        order = [words for _, words in _DENSITIES]
        for level in sorted(
            levels, key=lambda level: (level.endswith(_UNKNOWN), order.index(level) if level in order else -1, level)
        ):
            yield _Stratum(factor, level, tuple(levels[level]))


def _conditions(_: RunSet, record: RunRecord) -> str:
    world = "" if record.world.is_perfect else f", {record.world.in_words()}"
    return f"{record.prediction.replace('_', ' ')}, {record.traffic}{world}"


def _road(runs: RunSet, record: RunRecord) -> str:
    known = runs.scenario(record)
    return (known.road if known is not None else "") or f"road {_UNKNOWN}"


def _density(runs: RunSet, record: RunRecord) -> str:
    known = runs.scenario(record)
    if known is None or known.density_per_km is None:
        return f"density {_UNKNOWN}"
    density = known.density_per_km
    return next(words for least, words in reversed(_DENSITIES) if density >= least)


_FACTORS: tuple[tuple[str, Callable[[RunSet, RunRecord], str]], ...] = (
    ("conditions", _conditions),
    ("road", _road),
    ("density", _density),
)
"""The factors of the strata, in the order of the chart."""
