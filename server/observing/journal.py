"""The journal of calls: one JSON line per call, written in the background, rotated by size.

Only its owner may read it. Texts are cut, and apparent secrets are removed.
"""

import json
import logging
import logging.handlers
import os
import queue
import re
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path
from typing import Any

from mcp.types import CallToolResult

from ...engine.workspace import make_private
from ...schemas.errors import error_to_report
from ...schemas.text import LONGEST_TEXT, one_line, quoted
from ..tokens import count_tokens, has_tables
from ..tool_calls import answer_text
from .logs import Secrets

logger = logging.getLogger(__name__)
JOURNAL = "journal/calls.jsonl"
"""The journal's path in a workspace."""
KEPT_FILES = 5
_MOST_IDS = 20
MOST_ELEMENTS = 50
"""Maximum rotated files, ids of one answer per line, and elements of a list or object; chosen."""
_SEARCHED, _LONGEST_ERROR, _LARGEST_BITS = 5000, 2000, 128
"""Maximum characters of a text that are searched for secrets, and of a stored error; bits of a whole number; chosen."""
_CLOSE_TIMEOUT_S = 10.0
"""Loading the table for counting tokens takes 0.3 s, longer than many single calls."""
_SETTLED_S = 1.0
"""Delay between the first call and loading the tables; a server that ends earlier does so without them. Chosen: a
command with one call has ended by then, and hosts kill a server two seconds after they leave it.
"""
_ID = re.compile(
    r"\b(?:(?:cfg|run|batch|search|job)_[0-9a-f]{8,}(?:_\d+)?|map_\w+|(?:C-)?[A-Z]{3}_[A-Za-z]\w*-[\w\-]+)"
)


@dataclass(frozen=True)
class _JournalledCall:
    """One call: time (UTC), id in the log, client, arguments, duration and result."""

    time: str
    call_id: str
    client: str
    tool: str
    arguments: dict[str, Any]
    duration_s: float
    result: CallToolResult

    def entry(self, count: Callable[[str], int | None]) -> dict[str, Any]:
        """Return the journal's entry; ``count`` returns tokens, or None if they are not counted."""
        text, structured, failed = answer_text(self.result), self.result.structured_content, bool(self.result.is_error)
        answer = json.dumps(structured, ensure_ascii=False) if structured else text
        return {
            "time": self.time,
            "call_id": self.call_id,
            "client": self.client,
            "tool": self.tool,
            "arguments": self.arguments,
            "result_ids": [] if failed else list(dict.fromkeys(_ID.findall(answer)))[:_MOST_IDS],
            "duration_s": round(self.duration_s, 4),
            "result_tokens": count(text),
            "error": text if failed else "",
        }


class Journal:
    """Appends entries to a file from its own thread, so that no caller waits for the disk or the token count."""

    def __init__(self, path: Path, size_bytes: int, redact: Iterable[str] = ()) -> None:
        self._path, self._size_bytes = path, size_bytes
        self._secrets = Secrets(redact)
        self._waiting: queue.SimpleQueue[_JournalledCall | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()

    def add(
        self,
        *,
        time: str,
        call_id: str,
        client: str,
        tool: str,
        arguments: dict[str, Any],
        duration_s: float,
        result: CallToolResult,
    ) -> None:
        """Record a call."""
        if self._thread is None:
            self._closing.clear()
            thread = threading.Thread(target=self._write, name="journal", daemon=True)
            try:
                thread.start()
            except RuntimeError as error:  # the lines wait, and the next call tries again
                logger.warning("the journal waits: %s", error_to_report(error, "the journal").text)
            else:
                self._thread = thread
        self._waiting.put(_JournalledCall(time, call_id, client, tool, arguments, duration_s, result))

    def close(self) -> None:
        """Write waiting entries, and stop."""
        if self._thread is not None:
            self._closing.set()
            self._waiting.put(None)
            self._thread.join(timeout=_CLOSE_TIMEOUT_S)
            self._thread = None

    def _write(self) -> None:
        handler = _Appending(
            self._path,
            maxBytes=self._size_bytes,
            backupCount=KEPT_FILES,
            encoding="utf-8",
            errors="backslashreplace",
            delay=True,
        )
        while (call := self._waiting.get()) is not None:
            try:
                line = json.dumps(self._fit(call.entry(self._tokens_of)), ensure_ascii=False)
            except Exception:  # the journal continues: one call must not cost the lines of all others
                logger.exception("a call of %s could not be recorded", call.tool)
            else:
                handler.emit(logging.LogRecord("journal", logging.INFO, "", 0, line, None, None))
        handler.close()

    def _tokens_of(self, text: str) -> int | None:
        """Count the tokens of an answer; return None if the server ends before the tables are loaded, to end faster."""
        if not has_tables() and self._closing.wait(_SETTLED_S):
            return None
        return count_tokens(text)

    def _fit(self, value: Any, longest: int = LONGEST_TEXT) -> Any:
        """Return a value in the journal's format: a few elements, and texts on one line, cut and without secrets."""
        if isinstance(value, str):
            return one_line(self._secrets.left_out_of(value[:_SEARCHED]), longest)
        if isinstance(value, dict):
            kept = list(value.items())[:MOST_ELEMENTS]
            return {
                self._fit(key): self._fit(part, _LONGEST_ERROR if key == "error" else longest) for key, part in kept
            }
        if isinstance(value, list | tuple):
            return [self._fit(part) for part in value[:MOST_ELEMENTS]]
        return value if not isinstance(value, int) or value.bit_length() <= _LARGEST_BITS else quoted(value)


class _Appending(logging.handlers.RotatingFileHandler):
    """A rotating log file that creates its folder with the first line.

    A line that cannot be written is logged, and the call succeeds.
    """

    def _open(self) -> TextIOWrapper:
        path = Path(self.baseFilename)
        make_private(path.parent)
        handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, mode=0o600)
        return os.fdopen(handle, "a", encoding=self.encoding, errors=self.errors)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - the name is the standard library's
        del record
        logger.error("a call could not be recorded in %s", self.baseFilename, exc_info=True)
