"""The log on standard error, as lines of text or JSON: every call, and other events with the call they belong to.

The lines contain no arguments, no results (the journal has those) and nothing that looks like a secret.
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
"""Maximum logged characters of a message or a traceback; chosen: the longest observed traceback has 6,000."""
_calls = logging.getLogger("plannerforge.calls")
_CALL: ContextVar["CallNames | None"] = ContextVar("plannerforge call", default=None)


class Secrets:
    """Patterns of keys, tokens and passwords, and of other content to remove from texts."""

    def __init__(self, patterns: Iterable[str] = ()) -> None:
        self._patterns = [re.compile(pattern) for pattern in (*_SECRETS, *patterns)]

    def left_out_of(self, text: str) -> str:
        """Return the text with each match replaced by a mark."""
        for pattern in self._patterns:
            text = pattern.sub(REDACTED, text)
        return text


@dataclass(frozen=True)
class CallNames:
    """A call in progress: its id, the tool, and the name that the client gives itself."""

    call_id: str
    tool: str
    client: str


@dataclass(frozen=True)
class EndedCall:
    """A call that has ended.

    Args:
        outcome: ``ok``, the code of the error, ``asks`` (the client must answer a question first), ``protocol`` (the
            call violated the protocol) or ``cancelled``.
        duration_s: measured from the start of the call's turn.
    """

    names: CallNames
    outcome: str
    duration_s: float


@contextmanager
def named_call(tool: str, client: str) -> Iterator[CallNames]:
    """Name a call; log records in the block, and in threads and jobs that it starts, carry the names."""
    names = CallNames(uuid.uuid4().hex[:16], tool, client)
    token = _CALL.set(names)
    try:
        yield names
    finally:
        _CALL.reset(token)


def outcome_of(result: CallToolResult) -> str:
    """Return ``ok``, or the code at the beginning of an error's text."""
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
    """Write all log records at this level or above to standard error, unless logging is already set up."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter((JsonLines if form == "json" else TextLines)(Secrets(redact)))
    logging.basicConfig(level=level, handlers=[handler])


class TextLines(logging.Formatter):
    """``LEVEL name: message``, followed by the call."""

    def __init__(self, secrets: Secrets) -> None:
        super().__init__("%(levelname)s %(name)s: %(message)s")
        self._secrets = secrets

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as text on one line, except for tracebacks."""
        text = super().format(record)
        names = _CALL.get()
        if names is not None:
            text += f" (call {names.call_id} of {names.tool} by {one_line(names.client)})"
        return self._secrets.left_out_of(text[:_LONGEST])


class JsonLines(logging.Formatter):
    """One JSON object per line: ``time`` (UTC), ``level``, ``logger``, ``event``; in a call also ``call_id``, ``tool``,
    ``client``; at its end also ``duration_s`` and ``outcome``; with telemetry ``trace_id``.
    """

    def __init__(self, secrets: Secrets) -> None:
        super().__init__()
        self._secrets = secrets

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as JSON."""
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
    """Return the call's trace id in telemetry, in the usual form."""
    from opentelemetry.trace import format_trace_id, get_current_span

    context = get_current_span().get_span_context()
    return format_trace_id(context.trace_id) if context.is_valid else None
