"""Runs an evaluation: sends requests through an agent and a server, and scores each; several at a time, resumable.

Results of an earlier run with the same settings are kept: only requests without a row run.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

import anyio

from .. import __version__
from ..agent.errors import AgentError
from ..schemas.errors import InvalidRequest
from .attempts import Attempt, Condition, EvalRequest, EvaluatedAgent, Score, ToolSession
from .results.rows import AGENT_FAILED, JUDGE_FAILED, Row, RowFile, row_of


class WorkspaceSession(ToolSession, Protocol):
    """A session with access to the server's workspace."""

    @property
    def workspace(self) -> Path:
        """The folder of the server's artifacts."""


Scorer = Callable[[EvalRequest, Attempt, Path], Score]
"""Scores an attempt at a request; the path is the workspace of the agent's server."""
OpenSession = Callable[[int, EvalRequest], AbstractAsyncContextManager[WorkspaceSession]]
"""Opens a session with the server of a worker, by its number from 0 and its first request; workers share no session."""
OnRow = Callable[[Row, int, int], None]
"""Receives each row, the number of finished rows, and the total."""


@dataclass(frozen=True)
class Evaluation:
    """The subject of an evaluation: an agent under a condition, the scorer, and the seed of the agent.

    ``fresh``: every request gets its own session, so that nothing remains of the previous request. Agents that state
    every id themselves do not need this, and have one session per corpus.
    """

    agent: EvaluatedAgent
    condition: Condition
    score: Scorer
    seed: int = 0
    fresh: bool = False

    def is_fresh(self, request: EvalRequest) -> bool:
        """Return whether a request gets its own session; conversations do, because they refer to "the last one"."""
        return self.fresh or bool(request.turns)


def rows_path(folder: Path, corpus: str) -> Path:
    """Return the file of a corpus's rows in the folder of an evaluation."""
    return folder / f"{corpus}.rows.jsonl"


def settle(folder: Path, evaluation: Evaluation, corpora: Sequence[Path]) -> None:
    """Record the evaluation's settings in the folder, or check that they equal the recorded settings.

    Raises:
        InvalidRequest: the folder has an evaluation with other settings; the error lists them.
    """
    digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in corpora}
    wanted = _Settings(evaluation.agent.name, evaluation.condition, evaluation.seed, __version__)
    note = folder / "evaluation.json"
    noted: dict[str, object] = json.loads(note.read_text(encoding="utf-8")) if note.is_file() else {}
    known = noted.pop("corpora", {})
    differing = [name for name, value in asdict(wanted).items() if noted and noted.get(name) != value]
    differing += [
        name for name, digest in digests.items() if isinstance(known, dict) and known.get(name, digest) != digest
    ]
    if differing:
        raise InvalidRequest(
            f"{folder} has an evaluation with another {', '.join(differing)}",
            next_step="use another --out folder, or delete this one",
        )
    merged = {**(known if isinstance(known, dict) else {}), **digests}
    folder.mkdir(parents=True, exist_ok=True)
    note.write_text(json.dumps({**asdict(wanted), "corpora": merged}, indent=1) + "\n", encoding="utf-8")


@dataclass(frozen=True)
class _Settings:
    agent: str
    condition: Condition
    seed: int
    version: str


async def evaluate(
    requests: Sequence[EvalRequest],
    evaluation: Evaluation,
    folder: Path,
    open_session: OpenSession,
    *,
    workers: int = 1,
    on_row: OnRow | None = None,
) -> list[Row]:
    """Run the requests that have no row yet; return the rows of all of them, in the order of the requests.

    Raises:
        ResourceFailure: another evaluation is writing to the folder.
        ToolServerGone: a server cannot be started.
        ModelFailure: the agent's model is gone.
    """
    with ExitStack() as stack:
        corpora = dict.fromkeys(request.corpus for request in requests)
        files = {name: stack.enter_context(RowFile.open(rows_path(folder, name))) for name in corpora}
        there = _by_id(files)
        todo = [request for request in requests if request.request_id not in there]
        waiting, done = iter(todo), len(requests) - len(todo)

        def keep(row: Row) -> None:
            nonlocal done
            files[row.request.corpus].append(row)
            done += 1
            if on_row is not None:
                on_row(row, done, len(requests))

        try:
            async with anyio.create_task_group() as tasks:
                for number in range(min(workers, len(todo))):
                    tasks.start_soon(_work, number, waiting, evaluation, open_session, keep)
        except ExceptionGroup as group:
            raise _first(group) from group
        rows = _by_id(files)
    return [rows[request.request_id] for request in requests]


def _first(error: Exception) -> Exception:
    while isinstance(error, ExceptionGroup):
        error = error.exceptions[0]
    return error


def _by_id(files: Mapping[str, RowFile]) -> dict[str, Row]:
    return {row.request_id: row for file in files.values() for row in file.rows}


async def _work(
    number: int,
    waiting: Iterator[EvalRequest],
    evaluation: Evaluation,
    open_session: OpenSession,
    keep: Callable[[Row], None],
) -> None:
    """Take requests until there are no more."""
    request = next(waiting, None)
    while request is not None:
        async with open_session(number, request) as session:
            first = request
            while request is not None and (request is first or _may_share_session(first, request, evaluation)):
                keep(await _carried_out(request, evaluation, session))
                request = next(waiting, None)


def _may_share_session(first: EvalRequest, request: EvalRequest, evaluation: Evaluation) -> bool:
    """Return whether a request may use the session that was opened for another request."""
    return request.corpus == first.corpus and not evaluation.is_fresh(request)


async def _carried_out(request: EvalRequest, evaluation: Evaluation, session: WorkspaceSession) -> Row:
    try:
        attempt = await evaluation.agent.attempt(request, session)
    except AgentError:  # the model is gone: all further failures would be the model server's
        raise
    except Exception as error:  # noqa: BLE001 - the boundary of an agent: an error costs its row, not the evaluation
        attempt = Attempt(request.request_id, (), (), "failed", failure=f"{AGENT_FAILED}: {error!r}")
    score = await anyio.to_thread.run_sync(_scored, evaluation.score, request, attempt, session.workspace)
    return row_of(request, attempt, score, evaluation.agent.name, evaluation.condition)


def _scored(score: Scorer, request: EvalRequest, attempt: Attempt, workspace: Path) -> Score:
    """Return the score; if the judge itself fails, the request counts as not done, and the row states the reason."""
    try:
        return score(request, attempt, workspace)
    except Exception as error:  # noqa: BLE001 - the boundary of a judge: an error must not lose hours of other rows
        return Score(request.request_id, done=False, columns={}, misses=(f"{JUDGE_FAILED}: {error!r}",))
