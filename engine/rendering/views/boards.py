"""The data of views: the operation that writes them, and boards, which give an overview of the runs of batches."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ....schemas.errors import NotPossible
from ....schemas.measures import metric_words
from ....schemas.rendering import ViewRequest, ViewWritten
from ....schemas.results import Rate
from ....schemas.reviews import Contact
from ....schemas.runs import RunRecord, RunSource, ScenarioSource, ending
from ....schemas.text import counted, one_line
from ...analysis import METRICS, RunSet, known_contacts
from ...execution import ProgressReporter
from ...workspace import write_whole
from ..content import driven_path
from .data import BoardColumn, BoardMetric, BoardRow, BoardRun, BoardView, DriveView, SceneView
from .scenes import LONGEST_SENTENCE, drive_view, player_view, read_content, scene_view

_MOST_BYTES = 16 * 1024**2
"""Largest size of a view's data, which are read as one resource (chosen)."""
_MOST_INCLUDED_BYTES, _MOST_INCLUDED_SCENES = 12 * 1024**2, 80
"""Limits of the data that a board includes for its player, for all runs together (chosen: small enough for
an email).
"""


def write_view(request: ViewRequest, report: ProgressReporter) -> ViewWritten:
    """Write the data of a view as JSON; the same request gives the same bytes.

    Raises:
        UnsafeInput: The file of a scenario cannot be read.
        ResourceFailure: The steps of a run cannot be read, or the file cannot be written.
        NotPossible: The view is larger than 16 MiB.
    """
    view = player_view(request) if request.kind == "player" else board_view(request, report)
    report(0.95, "read")
    content = view.model_dump_json().encode()
    if len(content) > _MOST_BYTES:
        raise NotPossible(
            f"the view of {request.title} has {len(content):,} bytes; the limit is {_MOST_BYTES:,}",
            next_step="pass one scenario or run, or smaller batches",
        )
    write_whole(Path(request.path), lambda partial: partial.write_bytes(content))
    report(1.0, "view written")
    return ViewWritten(kind=view.kind, path=request.path, size_bytes=len(content), notes=view.notes)


@dataclass(frozen=True)
class _Side:
    """The properties that define a board's column; ``batch_id`` is empty for runs that were given one by one."""

    batch_id: str
    config_id: str
    prediction: str
    traffic: str
    seed: int
    world: str


def board_view(request: ViewRequest, report: ProgressReporter) -> BoardView:
    """Return the data of a board: rows are problems, columns configurations in the given order.

    Raises:
        UnsafeInput: The file of a scenario cannot be read.
        ResourceFailure: The steps of a run cannot be read.
    """
    placed = list(_placed(request))
    sides = list(dict.fromkeys(side for side, _ in placed))
    problems = list(dict.fromkeys((run.record.scenario_id, run.record.problem_id) for _, run in placed))
    known = {one.scenario_id: one for one in request.scenarios}
    several = Counter(scenario_id for scenario_id, _ in problems)
    contacts = known_contacts(RunSet(request.runs, scenarios=request.scenarios))
    first = {_problem(run.record): run.record for side, run in placed if side == sides[0]}
    runs = tuple(
        _board_run(run.record, problems, sides.index(side), first, contacts.get(run.record.run_id))
        for side, run in placed
    )
    included = _included_data(request, runs, report) if request.whole else _IncludedData((), {}, ())
    lost = (f"{cell.scenario_id} under {cell.config_id}: {cell.error}" for one in request.batches for cell in one.lost)
    return BoardView(
        title=one_line(request.title),
        columns=tuple(
            _column(side, sides, RunSet(tuple(run for at, run in placed if at == side), lineage=request.lineage))
            for side in sides
        ),
        rows=tuple(_row(key, problem, known[key], alone=several[key] == 1) for key, problem in problems),
        metrics=tuple(BoardMetric(words=metric_words(one.name), unit=one.unit, better=one.better) for one in METRICS),
        runs=runs,
        lost=tuple(one_line(text, LONGEST_SENTENCE) for text in lost),
        scenes=included.scenes,
        drives=included.drives,
        notes=included.notes,
    )


def _placed(request: ViewRequest) -> Iterable[tuple[_Side, RunSource]]:
    """Yield each run with its column, in column order: batches in the given order, then runs outside batches."""
    sources = {source.record.run_id: source for source in request.runs}
    named = [(one.batch_id, [sources[run_id] for run_id in one.runs]) for one in request.batches]
    of_batches = {run_id for one in request.batches for run_id in one.runs}
    rest = [source for source in request.runs if source.record.run_id not in of_batches]
    for batch_id, runs in [*named, ("", rest)]:
        by_side: dict[_Side, list[RunSource]] = {}
        for run in runs:
            record = run.record
            modes = (record.prediction, record.traffic, record.seed, record.world.in_words())
            side = _Side(batch_id, record.config_id, *modes)
            by_side.setdefault(side, []).append(run)
        for side, members in by_side.items():
            yield from ((side, run) for run in members)


def _problem(record: RunRecord) -> tuple[str, int]:
    return record.scenario_id, record.problem_id


def _column(side: _Side, sides: Sequence[_Side], runs: RunSet) -> BoardColumn:
    """Return a column; its title is the configuration and what distinguishes it from the other columns."""
    parts = [runs.records[0].config_name]
    for name, words in (
        ("prediction", side.prediction.replace("_", " ")),
        ("traffic", f"{side.traffic} traffic"),
        ("seed", f"seed {side.seed}"),
        ("world", f"{side.world} world"),
        ("batch_id", side.batch_id),
    ):
        if len({getattr(one, name) for one in sides}) > 1:
            parts.append(words)
    counts = Counter(record.outcome for record in runs.records)
    return BoardColumn(
        title=one_line(", ".join(filter(None, parts))),
        success=_rate_words(runs.rate(runs.valid)),
        outcomes=dict(sorted(counts.items(), key=lambda item: (-item[1], item[0]))),
    )


def _rate_words(rate: Rate) -> str:
    if rate.share is None or rate.low is None or rate.high is None:
        return "no run was possible"
    interval = f"95% interval {100 * rate.low:.0f} to {100 * rate.high:.0f}%"
    return f"{rate.count} of {rate.of} valid runs reached the goal: {100 * rate.share:.0f}% ({interval})"


def _row(scenario_id: str, problem_id: int, source: ScenarioSource, *, alone: bool) -> BoardRow:
    users = ", ".join(counted(count, kind) for kind, count in (source.obstacles or {}).items())
    limit = "" if source.limit_kmh is None else f"{source.limit_kmh:g} km/h"
    return BoardRow(
        title=one_line(scenario_id if alone else f"{scenario_id}#{problem_id}"),
        scenario_id=one_line(scenario_id),
        about=one_line("; ".join(filter(None, (source.road, limit, users)))),
    )


def _board_run(
    record: RunRecord,
    problems: Sequence[tuple[str, int]],
    column: int,
    first: Mapping[tuple[str, int], RunRecord],
    contact: Contact | None,
) -> BoardRun:
    before = first.get(_problem(record)) if column else None
    reached = record.outcome == "goal_reached"
    flip = None
    if before is not None and "invalid" not in (before.outcome, record.outcome):
        flipped = reached != (before.outcome == "goal_reached")
        flip = ("to_success" if reached else "to_failure") if flipped else None
    return BoardRun(
        run_id=record.run_id,
        row=problems.index(_problem(record)),
        column=column,
        outcome=record.outcome,
        ending=one_line(ending(record.outcome, record.reason, contact=contact), LONGEST_SENTENCE),
        flip=flip,
        values=tuple(_rounded(metric.value(record)) for metric in METRICS),
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")


@dataclass(frozen=True)
class _IncludedData:
    """The data that a board includes for its player, and notes on what did not fit."""

    scenes: tuple[SceneView, ...]
    drives: dict[str, DriveView]
    notes: tuple[str, ...]


def _included_data(request: ViewRequest, runs: Sequence[BoardRun], report: ProgressReporter) -> _IncludedData:
    """Return the scenes and runs that fit; scenarios with flips or failures come first."""
    sources = {source.record.run_id: source for source in request.runs}
    known = {one.scenario_id: one for one in request.scenarios}
    of_scenario: dict[str, list[BoardRun]] = {}
    for run in runs:
        of_scenario.setdefault(sources[run.run_id].record.scenario_id, []).append(run)
    telling = sorted(of_scenario, key=lambda key: min(_interest(run) for run in of_scenario[key]))
    scenes, drives, size = list[SceneView](), dict[str, DriveView](), 0
    for number, key in enumerate(telling[:_MOST_INCLUDED_SCENES]):
        content = read_content(known[key])
        driven = {run.run_id: driven_path(sources[run.run_id]) for run in of_scenario[key]}
        paths = {run_id: path for run_id, path in driven.items() if path is not None}
        made = {run_id: drive_view(sources[run_id], path, known[key], content.origin) for run_id, path in paths.items()}
        scene, _ = scene_view(content, tuple(paths.values()))
        size += sum(len(one.model_dump_json()) for one in (scene, *made.values()))
        if size > _MOST_INCLUDED_BYTES:
            break
        scenes.append(scene)
        drives |= made
        report(0.9 * (number + 1) / len(telling), key)
    left_out = len(telling) - len(scenes)
    note = f"this file lacks the runs on {counted(left_out, 'scenario')}; plannerforge view RUN shows one"
    return _IncludedData(tuple(scenes), drives, (note,) if left_out else ())


def _interest(run: BoardRun) -> int:
    """Return the rank of a run for readers: flips, then failures, then the rest."""
    if run.flip is not None:
        return 0
    return 1 if run.outcome not in ("goal_reached", "invalid") else 2
