"""The journal of calls: one JSON line per call, written behind the answer's back, rotated by size."""

import json
import logging
import logging.handlers
import queue
import re
import threading
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mcp.types import CallToolResult, TextContent

from plannerforge.server.tokens import count_tokens

KEPT_FILES = 5
MOST_IDS = 20

_ID = re.compile(
    r"\b(?:(?:cfg|run|batch|search|job)_[0-9a-f]{8,}(?:_\d+)?|map_\w+|(?:C-)?[A-Z]{3}_[A-Za-z]\w*-[\w\-]+)"
)


@dataclass(frozen=True)
class JournalEntry:
    """One call: when (UTC), by whom, what was asked, what came out and how long it took."""

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
        """Write what is waiting, at most for a second, and stop."""
        if self._thread is not None:
            self._waiting.put(None)
            self._thread.join(timeout=1.0)
            self._thread = None

    def _write(self) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        handler = logging.handlers.RotatingFileHandler(
            self._path, maxBytes=self._size_bytes, backupCount=KEPT_FILES, encoding="utf-8", delay=True
        )
        while (call := self._waiting.get()) is not None:
            line = json.dumps(asdict(_entry(call)), ensure_ascii=False)
            handler.emit(logging.LogRecord("journal", logging.INFO, "", 0, line, None, None))
        handler.close()


def _entry(call: dict[str, Any]) -> JournalEntry:
    said = json.dumps(call["structured"], ensure_ascii=False) if call["structured"] else call["text"]
    return JournalEntry(
        time=call["time"],
        client=call["client"],
        tool=call["tool"],
        arguments=call["arguments"],
        result_ids=() if call["failed"] else tuple(dict.fromkeys(_ID.findall(said)))[:MOST_IDS],
        duration_s=call["duration_s"],
        result_tokens=count_tokens(call["text"]),
        error=call["text"] if call["failed"] else "",
    )
