"""A watchdog over the server's event loop: what its thread does while calls are carried out.

It counts instead of timing, so that a loaded machine changes nothing: which of our modules ran in the thread of the
loop, which files and databases were opened there, and how many functions were called between two looks at what is
ready (50 ms are about 100,000 of them on a slow machine).
"""

import selectors
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

MOST_CALLS = 25_000
"""Function calls at a stretch; those of client and server together, which share the loop in tests."""
_OFF_THE_LOOP = (
    "plannerforge.tools.",
    "plannerforge.resources.",
    "plannerforge.engine.",
    "plannerforge.server.argument_errors",
    "plannerforge.server.tool_calls",
    "plannerforge.server.tokens",
)
_OF_THE_LOOP = ("plannerforge.engine.execution.", "plannerforge.tools.call", "plannerforge.tools.registry")
"""What must not run in the loop's thread, and what of it may: the hand-over itself."""
_BLOCKING = {
    "open",
    "os.listdir",
    "os.scandir",
    "os.mkdir",
    "os.remove",
    "os.rename",
    "shutil.rmtree",
    "sqlite3.connect",
}
_OPENED_FOR_WORKERS = "workers.log"


class LoopWatch:
    """What the thread that made it did until now."""

    def __init__(self) -> None:
        self.held: set[str] = set()
        self.longest = 0
        self._stretch, self._thread = 0, threading.get_ident()
        self._waits = {selectors.DefaultSelector.select.__code__}

    def note(self, frame: FrameType, event: str, argument: Any) -> None:
        """Count a call; listens to ``sys.setprofile``."""
        del argument
        if event == "call":
            if frame.f_code in self._waits:
                self._stretch = 0
            name = f"{frame.f_globals.get('__name__', '')}.{frame.f_code.co_name}"
            if name.startswith(_OFF_THE_LOOP) and not name.startswith(_OF_THE_LOOP):
                self.held.add(name)
        if event in ("call", "c_call"):
            self._stretch += 1
            self.longest = max(self.longest, self._stretch)

    def note_blocking(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Note what waits for a disk; listens to ``sys.addaudithook``."""
        if event in _BLOCKING and threading.get_ident() == self._thread:
            if not str(arguments[0]).endswith(_OPENED_FOR_WORKERS):
                self.held.add(f"{event} {arguments[0]}")


_watches: list[LoopWatch] = []


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    for watch in _watches:
        watch.note_blocking(event, arguments)


sys.addaudithook(_audit)


@contextmanager
def watched_loop() -> Iterator[LoopWatch]:
    """Watch the calling thread during the block, and fail where it was held."""
    watch = LoopWatch()
    _watches.append(watch)
    sys.setprofile(watch.note)
    try:
        yield watch
    finally:
        sys.setprofile(None)
        _watches.remove(watch)
    assert not watch.held, f"the event loop's thread ran {sorted(watch.held)}"
    assert watch.longest <= MOST_CALLS
