"""The work of the evaluation commands: run, resume, print and write; errors become a line and an exit code."""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractAsyncContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, get_args

import anyio
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ..agent.errors import AgentError
from ..schemas.errors import InvalidRequest, PlannerForgeError, UnknownName
from ..schemas.text import printable
from .attempts import Condition, EvalRequest, Task
from .campaign import Evaluation, evaluate, rows_path, settle
from .connection import ServerSession, ServerSetup, copied, open_session, prepare
from .corpora import TASKS, corpus_files, packaged_corpora, read_corpus
from .journal import ask_one_by_one
from .results.comparison import compare_rows
from .results.report import write_results
from .results.rows import Row, read_rows
from .results.tables import tables_of
from .roster import open_agent
from .scoring.scores import score_attempt

_INTERRUPTED, _WRONG, _FAILED = 130, 2, 1


@dataclass(frozen=True)
class EvaluationOrder:
    """An evaluation as requested on the command line; paths that are None take their default."""

    task: str
    agent: str
    condition: str
    corpus: Path | None = None
    out: Path | None = None
    limit: int | None = None
    workers: int = 1
    seed: int = 0
    scenarios: Path | None = None
    maps: Path | None = None
    workspace: Path | None = None
    conversations: int | None = None

    @property
    def folder(self) -> Path:
        """The folder for rows, tables and the report."""
        word = "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in self.agent)
        return self.out or Path("evaluations") / f"{word}-{self.condition}"


def run_evaluation(order: EvaluationOrder, console: Console | None = None) -> int:
    """Evaluate, print the tables and write the results; return 130 if interrupted, with all rows kept."""
    shown = console or Console(highlight=False)
    with _reporting_errors() as errors:
        paths = _corpora(order)
        requests = [request for path in paths for request in read_corpus(path)[: order.limit]]
        agent, fresh = open_agent(order.agent, _condition(order.condition), order.seed)
        evaluation = Evaluation(agent, _condition(order.condition), score_attempt, order.seed, fresh)
        settle(order.folder, evaluation, paths)
        try:
            rows = anyio.run(_evaluated, requests, evaluation, order, shown)
        except KeyboardInterrupt:
            shown.print(f"Interrupted; finished rows are in {order.folder}, and the same command continues.")
            return _INTERRUPTED
        _show(rows, order.folder, shown)
        errors.done()
    return errors.code


def print_results(folder: Path, console: Console | None = None) -> int:
    """Print the tables of the rows in a folder, and write tables and report again."""
    shown = console or Console(highlight=False)
    with _reporting_errors() as errors:
        _show(rows_of(folder), folder, shown)
        errors.done()
    return errors.code


def print_comparison(first: Path, second: Path, console: Console | None = None) -> int:
    """Print the comparison of two evaluations, paired by request."""
    shown = console or Console(highlight=False)
    with _reporting_errors() as errors:
        shown.print(compare_rows(rows_of(first), rows_of(second)).to_text(str(first), str(second)), markup=False)
        errors.done()
    return errors.code


def print_requests(
    task: str,
    corpus: Path | None,
    *,
    limit: int | None,
    marks: Path | None,
    console: Console | None = None,
    wait: Callable[[str], object] = input,
) -> int:
    """Print requests as JSON lines without their truth; with ``marks``, one by one, and record their times."""
    shown = console or Console(highlight=False)
    with _reporting_errors() as errors:
        paths = corpus_files(corpus or packaged_corpora(), task)
        requests = [request for path in paths for request in read_corpus(path)[:limit]]
        if marks is None:
            for request in requests:
                shown.print(json.dumps(public_view(request), ensure_ascii=False), markup=False, soft_wrap=True)
        else:
            chosen = [(request, public_view(request)) for request in requests]
            ask_one_by_one(chosen, marks, lambda text: shown.print(text, markup=False, soft_wrap=True), wait)
        errors.done()
    return errors.code


def make_own_corpora(workspace: Path, out: Path, *, tasks: Sequence[str], count: int, seed: int, whole: bool) -> int:
    """Make corpora from a workspace, and print their paths."""
    from .making.corpus import make_corpora, write_corpora
    from .making.materials import read_materials

    shown = Console(highlight=False)
    with _reporting_errors() as errors:
        wrong = [name for name in tasks if name not in TASKS]
        if wrong:
            raise UnknownName(f"there is no task '{wrong[0]}'", valid=TASKS)
        chosen = cast("Sequence[Task]", tasks or TASKS)
        corpora = make_corpora(
            read_materials(workspace), chosen, count, seed, lambda name: shown.print(f"making {name} …", style="dim")
        )
        for path in write_corpora(corpora, out, whole=whole):
            shown.print(f"{path}: {len(path.read_text(encoding='utf-8').splitlines())} requests", markup=False)
        errors.done()
    return errors.code


def public_view(request: EvalRequest) -> dict[str, Any]:
    """Return a request as another client may see it, without the expected result, as fields of JSON."""
    given = {
        "id": request.request_id,
        "task": request.task,
        "text": request.text,
        "scenario": request.scenario,
        "history": [{"role": role, "text": text} for role, text in request.history],
        "context": dict(request.context),
        "turns": [turn.text for turn in request.turns],
    }
    return {name: value for name, value in given.items() if value}


async def _evaluated(
    requests: Sequence[EvalRequest], evaluation: Evaluation, order: EvaluationOrder, shown: Console
) -> list[Row]:
    first = ServerSetup(order.folder / "workspaces" / "prepared", order.workspace, order.scenarios, order.maps)
    there = {row.request_id for row in rows_of(order.folder, may_be_empty=True)}
    if any(request.request_id not in there for request in requests):
        shown.print("Preparing the server's workspace …", style="dim")
        await prepare(first)

    def session(number: int, request: EvalRequest) -> AbstractAsyncContextManager[ServerSession]:
        del request
        return open_session(copied(first, order.folder / "workspaces" / str(number)))

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=shown, transient=True) as progress:
        bar = progress.add_task(f"{order.agent}, {order.condition}", total=len(requests))

        def advanced(row: Row, done: int, of: int) -> None:
            progress.update(bar, completed=done, total=of)
            if not row.score.done:
                progress.console.print(f"missed {row.request_id}: {'; '.join(row.score.misses)}"[:300], markup=False)

        return await evaluate(requests, evaluation, order.folder, session, workers=order.workers, on_row=advanced)


def _corpora(order: EvaluationOrder) -> list[Path]:
    """Return the files of the requests; new conversations are made first, once per folder."""
    if order.conversations is None:
        return corpus_files(order.corpus or packaged_corpora(), order.task)
    from .making.corpus import make_corpora, write_corpora
    from .making.materials import read_materials

    if order.task != "e2e":
        raise InvalidRequest("--conversations is for e2e only", next_step="call `plannerforge eval e2e`")
    path = order.folder / "e2e.jsonl"
    if not path.exists():
        materials = read_materials(order.workspace or order.folder / "workspaces" / "materials")
        write_corpora(make_corpora(materials, ("e2e",), order.conversations, order.seed), order.folder, whole=True)
    return [path]


def _show(rows: Sequence[Row], folder: Path, shown: Console) -> None:
    for table in tables_of(rows):
        shown.print(table.to_terminal())
    for path in write_results(rows, folder):
        shown.print(f"written: {path}", markup=False)


def rows_of(place: Path, *, may_be_empty: bool = False) -> list[Row]:
    """Return the rows of a file, or of all files of an evaluation's folder, by corpus in the order of tasks."""
    if place.is_file():
        return read_rows(place)
    names = [name for task in TASKS for name in _corpora_of(task)]
    found = [rows_path(place, name) for name in names]
    rows = [row for path in found if path.is_file() for row in sorted(read_rows(path), key=lambda row: row.request_id)]
    if not rows and not may_be_empty:
        raise InvalidRequest(f"{place} has no rows", next_step="use the folder of an evaluation, see --out")
    return rows


def _corpora_of(task: Task) -> tuple[str, ...]:
    from .corpora import CORPORA

    return CORPORA[task]


def _condition(name: str) -> Condition:
    if name not in get_args(Condition):
        raise UnknownName(f"there is no condition '{name}'", valid=get_args(Condition))
    return cast("Condition", name)


class _Outcome:
    """The exit code of a command: a failure until ``done`` is called."""

    code = _FAILED

    def done(self) -> None:
        self.code = 0


@contextmanager
def _reporting_errors() -> Iterator[_Outcome]:
    """Print errors raised in the block, one line each; the yielded outcome has the exit code afterwards."""
    outcome = _Outcome()
    try:
        yield outcome
    except (PlannerForgeError, AgentError) as error:
        outcome.code = _WRONG if isinstance(error, InvalidRequest) else _FAILED
        print(f"plannerforge: {printable(error.text)}", file=sys.stderr)  # noqa: T201 - what a command says
