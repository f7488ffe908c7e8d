"""Rows: an agent's attempt at each request and its score, one JSON object per line.

A line is written whole, as soon as its request is scored. After a killed run, the file is read up to its last whole
line.
"""

import fcntl
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from ...schemas.errors import InvalidRequest, ResourceFailure
from ...server.tokens import count_tokens
from ..attempts import Attempt, Condition, EvalRequest, MadeCall, Score

AGENT_FAILED, JUDGE_FAILED = "the agent raised", "the judge failed"
"""The first words of a failure caused by the agent's code, and of a miss that is not the agent's fault."""
_KEPT_CHARACTERS = 4000
"""Characters of each answer that a row keeps; chosen to keep a report of a hundred misses readable."""


@dataclass(frozen=True)
class Row:
    """A request, the agent's attempt, and the score.

    Of each call's answer, the row keeps the text, cut if it is long, but not the structured content. ``answer_tokens``
    is the cost of all answers of the server together (o200k_base tokens).
    """

    request: EvalRequest
    attempt: Attempt
    score: Score
    agent: str
    condition: Condition
    answer_tokens: int = 0

    @property
    def request_id(self) -> str:
        """The request's id."""
        return self.request.request_id

    @property
    def tokens(self) -> int:
        """The tokens of prompts and completions, as the model's server counted them; 0 for an agent without a model."""
        return self.attempt.prompt_tokens + self.attempt.completion_tokens


def row_of(request: EvalRequest, attempt: Attempt, score: Score, agent: str, condition: Condition) -> Row:
    """Return the row of a scored attempt."""
    tokens = sum(count_tokens(call.text) for call in attempt.calls)
    kept = replace(attempt, calls=tuple(_cut(call) for call in attempt.calls))
    return Row(request, kept, score, agent, condition, tokens)


def _cut(call: MadeCall) -> MadeCall:
    more = len(call.text) - _KEPT_CHARACTERS
    text = f"{call.text[:_KEPT_CHARACTERS]} [{more} more characters]" if more > 0 else call.text
    return replace(call, text=text, structured={})


class RowFile:
    """The file of an evaluation's rows (``open``)."""

    def __init__(self, descriptor: int, rows: Sequence[Row]) -> None:
        self._descriptor = descriptor
        self.rows = list(rows)

    @classmethod
    @contextmanager
    def open(cls, path: Path) -> Iterator["RowFile"]:
        """Open the file with its existing rows; anything after the last whole line is removed.

        Raises:
            ResourceFailure: another evaluation is writing to it, or it cannot be written.
        """
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise ResourceFailure(f"{path} cannot be written: {error}", next_step="use another --out folder") from error
        try:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise ResourceFailure(
                    f"another evaluation writes to {path}", next_step="wait for its end, or use another --out folder"
                ) from error
            content = path.read_bytes()
            whole = content[: content.rfind(b"\n") + 1]
            os.ftruncate(descriptor, len(whole))
            os.lseek(descriptor, 0, os.SEEK_END)
            yield cls(descriptor, _parsed(whole, path))
        finally:
            os.close(descriptor)

    def append(self, row: Row) -> None:
        """Write a row; it is on the disk when this returns."""
        line = _ROW.dump_json(row) + b"\n"
        while line:
            line = line[os.write(self._descriptor, line) :]
        os.fsync(self._descriptor)
        self.rows.append(row)


def read_rows(path: Path) -> list[Row]:
    """Return the whole rows of a file, in writing order.

    Raises:
        InvalidRequest: there is no such file, or a line is not a row; the error gives it.
    """
    if not path.is_file():
        raise InvalidRequest(f"there is no file {path}", next_step="use a rows file that `plannerforge eval` wrote")
    content = path.read_bytes()
    return _parsed(content[: content.rfind(b"\n") + 1], path)


def _parsed(content: bytes, path: Path) -> list[Row]:
    found = []
    for number, line in enumerate(content.splitlines(), start=1):
        try:
            found.append(_ROW.validate_json(line))
        except ValidationError as error:
            raise InvalidRequest(
                f"line {number} of {path} is not a row: {error.errors(include_url=False)[0]['msg']}",
                next_step="remove the line to evaluate the request again",
            ) from error
    return found


_ROW: TypeAdapter[Row] = TypeAdapter(Row)
