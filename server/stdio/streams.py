"""Standard input and output, reserved for the protocol: nothing else reads or writes them.

The SDK's streams use a thread of a shared pool for each line. If no further thread can be started (memory, or the
process limit of a container), the server would end; with threads of their own, both continue.
"""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, cast

import anyio

from ...engine.execution import OwnThread
from .messages import LONGEST_MESSAGE


class BoundedLines(io.TextIOWrapper):
    """Text with a maximum line length: a longer line is cut, and is then unreadable."""

    def readline(self, size: int | None = -1, /) -> str:  # type: ignore[override]  # as its base class does
        """Return the next line."""
        most = LONGEST_MESSAGE if size is None or size < 0 else size
        line = super().readline(most)
        if len(line) == LONGEST_MESSAGE and not line.endswith("\n"):
            while (rest := super().readline(LONGEST_MESSAGE)) and not rest.endswith("\n"):
                pass
        return line


class _ThreadedFile:
    """The part of ``anyio.AsyncFile`` that the SDK uses, with one thread for all of it."""

    def __init__(self, file: IO[str]) -> None:
        self._file, self._thread = file, OwnThread()

    def __aiter__(self) -> "_ThreadedFile":
        return self

    async def __anext__(self) -> str:
        line = await self._thread.run(self._file.readline)
        if not line:
            raise StopAsyncIteration
        return line

    async def write(self, text: str) -> int:
        """Write text, and return how many characters it has."""
        return await self._thread.run(self._file.write, text)

    async def flush(self) -> None:
        """Flush what was written."""
        await self._thread.run(self._file.flush)

    def end(self) -> None:
        """End the thread; a thread that is still reading ends with the process."""
        self._thread.end()


@contextmanager
def standard_streams() -> Iterator["tuple[anyio.AsyncFile[str], anyio.AsyncFile[str]]"]:
    """Provide standard input, with limited lines, and standard output, within the block.

    Other readers of standard input during this time, such as a library or a child process, read nothing; other writers
    to standard output write to standard error.
    """
    sys.stdout.flush()
    wire_in, wire_out = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    # a thread may still wait on them at the end: they are not closed, so that their numbers are not reused
    lines = _ThreadedFile(BoundedLines(os.fdopen(wire_in, "rb", closefd=False), encoding="utf-8", errors="replace"))
    answers = _ThreadedFile(io.TextIOWrapper(os.fdopen(wire_out, "wb", closefd=False), encoding="utf-8", newline="\n"))
    try:
        yield cast("anyio.AsyncFile[str]", lines), cast("anyio.AsyncFile[str]", answers)
    finally:
        lines.end()
        answers.end()
        os.dup2(wire_in, 0)
        os.dup2(wire_out, 1)
