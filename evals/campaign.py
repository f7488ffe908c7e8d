"""An evaluation: requests through an agent and a server, scored one by one, several at a time; it can be broken off.

What is there of an earlier run with the same settings is kept: only requests without a row are carried out.
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
    """A session whose server's workspace can be looked at."""

    @property
    def workspace(self) -> Path:
        """The folder in which what was made is stored."""


Scorer = Callable[[EvalRequest, Attempt, Path], Score]
"""Scores an attempt at a request; the path is the workspace of the server that the agent used."""
OpenSession = Callable[[int, EvalRequest], AbstractAsyncContextManager[WorkspaceSession]]
"""A session with the server of a worker, by its number from 0 and its first request; no two workers share one."""
OnRow = Callable[[Row, int, int], None]
"""Is told of every row, of how many are there, and of how many there will be."""


@dataclass(frozen=True)
class Evaluation:
    """What is evaluated: an agent under a condition, the scorer, and the seed of what the agent draws.

    ``fresh``: every request gets a session of its own, so that nothing is left of the request before; agents that name
    every id themselves need none and have one for each corpus.
    """

    agent: EvaluatedAgent
    condition: Condition
    score: Scorer
    seed: int = 0
    fresh: bool = False

    def is_fresh(self, request: EvalRequest) -> bool:
        """Whether a request gets a session of its own: conversations do in any case, which say "the last one"."""
        return self.fresh or bool(request.turns)


def rows_path(folder: Path, corpus: str) -> Path:
    """The file of a corpus' rows in the folder of an evaluation."""
    return folder / f"{corpus}.rows.jsonl"


def settle(folder: Path, evaluation: Evaluation, corpora: Sequence[Path]) -> None:
    """Note in the folder what is evaluated there, or see that it is the same as what was noted.

    Raises:
        InvalidRequest: the folder holds an evaluation with other settings; it names them.
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
            f"{folder} holds an evaluation with another {', '.join(differing)}",
            next_step="name another --out folder, or delete this one",
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
    """Carry out the requests that have no row yet; the rows of all of them, in the order of the requests.

    Raises:
        ResourceFailure: another evaluation writes to the folder.
        ToolServerGone: a server cannot be started.
        ModelFailure: the model of the agent is gone.
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
    """Take requests until none is left."""
    request = next(waiting, None)
    while request is not None:
        async with open_session(number, request) as session:
            first = request
            while request is not None and (request is first or _goes_on(first, request, evaluation)):
                keep(await _carried_out(request, evaluation, session))
                request = next(waiting, None)


def _goes_on(first: EvalRequest, request: EvalRequest, evaluation: Evaluation) -> bool:
    """Whether a request may use the session that was opened for another one."""
    return request.corpus == first.corpus and not evaluation.is_fresh(request)


async def _carried_out(request: EvalRequest, evaluation: Evaluation, session: WorkspaceSession) -> Row:
    try:
        attempt = await evaluation.agent.attempt(request, session)
    except AgentError:  # its model is gone: what is left would be failures of the model server's alone
        raise
    except Exception as error:  # noqa: BLE001 - the boundary of an agent: it costs its row and not the evaluation
        attempt = Attempt(request.request_id, (), (), "failed", failure=f"{AGENT_FAILED}: {error!r}")
    score = await anyio.to_thread.run_sync(_scored, evaluation.score, request, attempt, session.workspace)
    return row_of(request, attempt, score, evaluation.agent.name, evaluation.condition)


def _scored(score: Scorer, request: EvalRequest, attempt: Attempt, workspace: Path) -> Score:
    """The score; where the judge itself fails, the request counts as not done, and the row says why."""
    try:
        return score(request, attempt, workspace)
    except Exception as error:  # noqa: BLE001 - the boundary of a judge: hours of other rows must not be lost to it
        return Score(request.request_id, done=False, columns={}, misses=(f"{JUDGE_FAILED}: {error!r}",))
