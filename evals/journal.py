"""``journal:JOURNAL@MARKS``: scores any other MCP client, from the journal of the server that it used.

Marks state when the client got each request and when it had answered. The journal has calls and refusals but no
answers, so successful calls run again on the server under evaluation: the same call gives the same result.
"""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, TypeVar, cast, get_args

from pydantic import AwareDatetime, TypeAdapter, ValidationError

from ..schemas.errors import InvalidRequest
from ..schemas.text import LONGEST_TEXT
from ..server.observing.journal import KEPT_FILES, MOST_ELEMENTS
from ..server.observing.logs import REDACTED
from .attempts import Attempt, EvalRequest, MadeCall, ToolSession

ClientReply = Literal["answered", "asked", "refused"]
"""The client's last message, which no call shows."""
_FORM = "journal:JOURNAL@MARKS"
_WAITING = "get_job"
"""The tool that only waits. Its calls are not repeated, because every repeated call waits for its job."""
_ROUNDING_S = 0.001
"""Times of the journal are cut to milliseconds."""
_QUESTION = "Enter when the client has answered; 'asked' or 'refused' before it if it asked back or refused: "


@dataclass(frozen=True)
class Mark:
    """When a client got a turn of a request and when it had answered, in seconds since 1970; turns from 0."""

    request_id: str
    began_s: float
    ended_s: float
    turn: int = 0
    ending: ClientReply = "answered"


@dataclass(frozen=True)
class _JournalledCall:
    """A line of the server's journal; other fields are not read. ``error`` is empty if the call succeeded."""

    time: AwareDatetime
    tool: str
    arguments: dict[str, Any]
    error: str = ""

    @property
    def began_s(self) -> float:
        """The start of the call, in seconds since 1970."""
        return datetime.timestamp(self.time)


@dataclass(frozen=True)
class JournalAgent:
    """An ``EvaluatedAgent`` that makes the calls of a journal, each within the marks of its request."""

    name: str
    marks: Sequence[Mark]
    calls: Sequence[_JournalledCall] = field(repr=False)

    async def attempt(self, request: EvalRequest, tools: ToolSession) -> Attempt:
        """Repeat the calls of a request, except refused calls; stop if a call cannot be repeated."""
        began = time.perf_counter()
        marks = sorted((mark for mark in self.marks if mark.request_id == request.request_id), key=_by_turn)
        made: list[MadeCall] = []
        failure = "" if marks else "the marks do not contain this request"
        for mark in marks:
            for call in self._within(mark):
                failure = failure or _difference(call)
                if failure:
                    break
                made.append(await _repeated(call, mark.turn, tools))
                if made[-1].is_error and not call.error:
                    failure = f"{call.tool} succeeded then and is refused now: {made[-1].text}"
        texts = tuple("\n".join(call.text for call in made if call.turn == mark.turn) for mark in marks)
        ending = "failed" if failure else marks[-1].ending
        spent_s = time.perf_counter() - began
        return Attempt(request.request_id, tuple(made), texts, ending, failure=failure, duration_s=spent_s)

    def _within(self, mark: Mark) -> Iterator[_JournalledCall]:
        for call in self.calls:
            if mark.began_s - _ROUNDING_S <= call.began_s <= mark.ended_s and call.tool != _WAITING:
                yield call


def open_journal(name: str, argument: str) -> JournalAgent:
    """Return the agent of a journal, including its older files, and a file of marks.

    Raises:
        InvalidRequest: a file is missing, or a line of it cannot be read; the error gives it.
    """
    journal, _, marks = argument.rpartition("@")
    if not journal or not marks:
        raise InvalidRequest(
            f"'{name}' is not a journal and marks",
            valid=[_FORM],
            next_step="`plannerforge eval requests TASK --marks MARKS` writes marks",
        )
    rotated = [Path(f"{journal}.{number}") for number in range(KEPT_FILES, 0, -1)]
    files = [path for path in rotated if path.is_file()] + [Path(journal)]
    calls = [call for path in files for call in _lines(path, _JournalledCall)]
    found = _lines(Path(marks), Mark)
    return JournalAgent(name, tuple(found), tuple(sorted(calls, key=_by_time)))


def ask_one_by_one(
    requests: Sequence[tuple[EvalRequest, dict[str, Any]]],
    marks: Path,
    show: Callable[[str], None],
    wait: Callable[[str], object],
) -> None:
    """Show requests to another client, turn by turn, wait for each, and record a mark.

    Requests with a mark are left out. ``wait`` returns how the client's answer ended, or an empty string if it just
    answered; any other text repeats the question.
    """
    marks.parent.mkdir(parents=True, exist_ok=True)
    done = {(mark.request_id, mark.turn) for mark in _lines(marks, Mark)} if marks.exists() else set()
    for number, (request, shown) in enumerate(requests, start=1):
        for turn, text in enumerate([each.text for each in request.turns] or [""]):
            if (request.request_id, turn) in done:
                continue
            show(f"[{number}/{len(requests)}] {request.request_id}" + (f", turn {turn + 1}" if text else ""))
            show(text or json.dumps(shown, ensure_ascii=False, indent=1))
            began_s = time.time()
            ending = _ask_for_ending(wait)
            mark = Mark(request.request_id, began_s, time.time(), turn, ending)
            with marks.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(mark)) + "\n")


def _ask_for_ending(wait: Callable[[str], object]) -> ClientReply:
    while True:
        word = str(wait(_QUESTION) or "answered").strip().lower()
        if word in get_args(ClientReply):
            return cast("ClientReply", word)


async def _repeated(call: _JournalledCall, turn: int, tools: ToolSession) -> MadeCall:
    """Return the call with its answer; a refusal is taken from the journal, because it created nothing."""
    if call.error:
        return MadeCall(call.tool, call.arguments, call.error, {}, is_error=True, duration_s=0.0, turn=turn)
    return await tools.call(call.tool, call.arguments, turn)


def _difference(call: _JournalledCall) -> str:
    """Return why a call cannot be repeated exactly: the journal cuts long texts and omits secrets."""
    if call.error:
        return ""
    texts = list(_texts(call.arguments))
    if any(REDACTED in text for text in texts):
        return f"the journal omitted an apparent secret in a call of {call.tool}"
    if any(text.endswith("…") and len(text) >= LONGEST_TEXT // 2 for text in texts):
        return f"the journal cut a long text in a call of {call.tool}"
    if any(len(value) >= MOST_ELEMENTS for value in _collections(call.arguments)):
        return f"the journal may have cut a long list in a call of {call.tool}"
    return ""


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for part in (*value, *value.values()) if isinstance(value, dict) else value:
            yield from _texts(part)


def _collections(value: object) -> Iterator[dict[str, Any] | list[Any]]:
    if isinstance(value, dict | list):
        yield value
        for part in value.values() if isinstance(value, dict) else value:
            yield from _collections(part)


_Line = TypeVar("_Line")


def _lines(path: Path, kind: type[_Line]) -> list[_Line]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidRequest(f"{path} cannot be read: {error}", next_step=f"give files as in {_FORM}") from error
    reader = TypeAdapter(kind)
    return [_line(reader, line, f"line {number} of {path}") for number, line in enumerate(lines, start=1)]


def _line(reader: TypeAdapter[_Line], line: str, place: str) -> _Line:
    try:
        return reader.validate_json(line)
    except ValidationError as error:
        raise InvalidRequest(
            f"{place} is invalid: {error.errors()[0]['msg']}", next_step=f"give files as in {_FORM}"
        ) from error


def _by_turn(mark: Mark) -> int:
    return mark.turn


def _by_time(call: _JournalledCall) -> float:
    return call.began_s
