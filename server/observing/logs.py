"""The log on standard error, as lines of text or of JSON: each call, and what else happened, with the call it was in.

No line holds arguments or results, which the journal has, nor what looks like a secret.
"""

import json
import logging
import re
import sys
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from mcp.types import CallToolResult

from ...schemas.text import one_line
from ..settings import LogFormat

REDACTED = "[redacted]"
_SECRETS = (
    r"(?i)\b(?:bearer|basic)\s+[\w.~+/=-]{8,}",
    r"(?i)\b\w*(?:password|passwd|secret|token|api[_-]?key)\s*[=:]\s*\S+",
    r"\b(?:sk|pk|rk|ghp|gho|ghs|glpat|xox[abprs]|AKIA)[-_A-Za-z0-9]{12,}",
    r"\beyJ[\w-]{8,}\.[\w-]{8,}\.[\w-]*",
    r"(?<=://)[^/\s:@]+:[^/\s@]+(?=@)",
    r"-----BEGIN [A-Z ]+-----",
)
"""Forms of keys, tokens and passwords; the setting ``journal_redact`` adds others."""
_LONGEST = 20_000
"""Characters of a message or a traceback that are logged; chosen: the longest traceback seen has 6,000."""
_calls = logging.getLogger("plannerforge.calls")
_CALL: ContextVar["CallNames | None"] = ContextVar("plannerforge call", default=None)


class Secrets:
    """What looks like a key, token or password, and what else is to be left out of texts."""

    def __init__(self, patterns: Iterable[str] = ()) -> None:
        self._patterns = [re.compile(pattern) for pattern in (*_SECRETS, *patterns)]

    def left_out_of(self, text: str) -> str:
        """The text with a mark in place of each."""
        for pattern in self._patterns:
            text = pattern.sub(REDACTED, text)
        return text


@dataclass(frozen=True)
class CallNames:
    """A call that is under way: an id of its own, the tool, and the name that the client gives itself."""

    call_id: str
    tool: str
    client: str


@dataclass(frozen=True)
class EndedCall:
    """A call that has ended.

    Args:
        outcome: ``ok``, the code of the error, ``asks`` (the client is asked something first), ``protocol`` (the call
            broke the protocol) or ``cancelled``.
        duration_s: from when it was its turn.
    """

    names: CallNames
    outcome: str
    duration_s: float


@contextmanager
def named_call(tool: str, client: str) -> Iterator[CallNames]:
    """Names for a call; what is logged in the block, and in threads and jobs that it starts, bears them."""
    names = CallNames(uuid.uuid4().hex[:16], tool, client)
    token = _CALL.set(names)
    try:
        yield names
    finally:
        _CALL.reset(token)


def outcome_of(result: CallToolResult) -> str:
    """``ok``, or the code that the text of an error begins with."""
    if not result.is_error:
        return "ok"
    text = next((block.text for block in result.content if block.type == "text"), "")
    code = re.match(r"\[(\w+)\]", text)
    return code[1] if code else "error"


def log_call(call: EndedCall) -> None:
    """Write the line of a call that has ended."""
    if _calls.isEnabledFor(logging.INFO):
        fields = {"duration_s": round(call.duration_s, 4), "outcome": call.outcome}
        _calls.info("%s: %s in %.3f s", call.names.tool, call.outcome, call.duration_s, extra={"fields": fields})


def log_to_stderr(level: str, form: LogFormat = "text", redact: Iterable[str] = ()) -> None:
    """Have everything that is logged from this level on written to standard error; a log that is set up stays."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter((JsonLines if form == "json" else TextLines)(Secrets(redact)))
    logging.basicConfig(level=level, handlers=[handler])


class TextLines(logging.Formatter):
    """``LEVEL name: message``, then the call it was in."""

    def __init__(self, secrets: Secrets) -> None:
        super().__init__("%(levelname)s %(name)s: %(message)s")
        self._secrets = secrets

    def format(self, record: logging.LogRecord) -> str:
        """The record as text; its lines are one, but for tracebacks."""
        text = super().format(record)
        names = _CALL.get()
        if names is not None:
            text += f" (call {names.call_id} of {names.tool} by {one_line(names.client)})"
        return self._secrets.left_out_of(text[:_LONGEST])


class JsonLines(logging.Formatter):
    """One JSON object a line: ``time`` (UTC), ``level``, ``logger``, ``event``, and of a call ``call_id``, ``tool``,
    ``client``; at its end also ``duration_s`` and ``outcome``; with telemetry ``trace_id``.
    """

    def __init__(self, secrets: Secrets) -> None:
        super().__init__()
        self._secrets = secrets

    def format(self, record: logging.LogRecord) -> str:
        """The record as JSON."""
        entry: dict[str, Any] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname,
            "logger": record.name,
            "event": self._secrets.left_out_of(record.getMessage()[:_LONGEST]),
        }
        names = _CALL.get()
        if names is not None:
            entry |= {"call_id": names.call_id, "tool": names.tool, "client": self._secrets.left_out_of(names.client)}
        fields = getattr(record, "fields", None)
        if isinstance(fields, Mapping):
            entry |= fields
        if (trace_id := _trace_id()) is not None:
            entry["trace_id"] = trace_id
        if record.exc_info:
            entry["traceback"] = self._secrets.left_out_of(self.formatException(record.exc_info)[:_LONGEST])
        return json.dumps(entry, ensure_ascii=False)


def _trace_id() -> str | None:
    """The trace that telemetry puts the call into, as it is written everywhere else."""
    from opentelemetry.trace import format_trace_id, get_current_span

    context = get_current_span().get_span_context()
    return format_trace_id(context.trace_id) if context.is_valid else None
