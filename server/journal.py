"""The journal of calls: one JSON line per call, written behind the answer's back, rotated by size."""

import json
import logging
import logging.handlers
import queue
import re
import threading
from dataclasses import asdict, dataclass
from io import TextIOWrapper
from pathlib import Path
from typing import Any

from mcp.types import CallToolResult, TextContent

from .tokens import count_tokens

logger = logging.getLogger(__name__)
KEPT_FILES = 5
_MOST_IDS = 20
"""Rotated files that are kept, and ids that a line holds of one answer; chosen."""
_CLOSE_TIMEOUT_S = 10.0
"""Reading the tables of the token count takes about a second, which is longer than many a single call."""
_ID = re.compile(
    r"\b(?:(?:cfg|run|batch|search|job)_[0-9a-f]{8,}(?:_\d+)?|map_\w+|(?:C-)?[A-Z]{3}_[A-Za-z]\w*-[\w\-]+)"
)


@dataclass(frozen=True)
class _JournalEntry:
    """One call: when (UTC), by which client, what was asked, what came out and how long it took."""

    time: str
    client: str
    tool: str
    arguments: dict[str, Any]
    result_ids: tuple[str, ...]
    duration_s: float
    result_tokens: int
    error: str


class Journal:
    """Appends entries to a file from a thread of its own, so that no caller waits for the disk or the token count."""

    def __init__(self, path: Path, size_bytes: int) -> None:
        self._path, self._size_bytes = path, size_bytes
        self._waiting: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def add(
        self, *, time: str, client: str, tool: str, arguments: dict[str, Any], duration_s: float, result: CallToolResult
    ) -> None:
        """Write down a call."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._write, name="journal", daemon=True)
            self._thread.start()
        texts = [block.text for block in result.content if isinstance(block, TextContent)]
        self._waiting.put(
            {
                "time": time,
                "client": client,
                "tool": tool,
                "arguments": arguments,
                "duration_s": round(duration_s, 4),
                "text": "\n".join(texts),
                "structured": result.structured_content,
                "failed": bool(result.is_error),
            }
        )

    def close(self) -> None:
        """Write what is waiting, and stop."""
        if self._thread is not None:
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
            line = json.dumps(asdict(_entry(call)), ensure_ascii=False)
            handler.emit(logging.LogRecord("journal", logging.INFO, "", 0, line, None, None))
        handler.close()


class _Appending(logging.handlers.RotatingFileHandler):
    """Makes its folder when the first line is written; a line that cannot be written costs no call, but is logged."""

    def _open(self) -> TextIOWrapper:
        Path(self.baseFilename).parent.mkdir(parents=True, exist_ok=True)
        return super()._open()

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - the name is the standard library's
        del record
        logger.error("a call could not be written down in %s", self.baseFilename, exc_info=True)


def _entry(call: dict[str, Any]) -> _JournalEntry:
    said = json.dumps(call["structured"], ensure_ascii=False) if call["structured"] else call["text"]
    return _JournalEntry(
        time=call["time"],
        client=call["client"],
        tool=call["tool"],
        arguments=call["arguments"],
        result_ids=() if call["failed"] else tuple(dict.fromkeys(_ID.findall(said)))[:_MOST_IDS],
        duration_s=call["duration_s"],
        result_tokens=count_tokens(call["text"]),
        error=call["text"] if call["failed"] else "",
    )
