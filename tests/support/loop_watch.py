"""A watchdog over the server's event loop: what its thread does during calls.

It examines what runs there instead of durations, so that a loaded machine changes nothing. Code of tools and of the
engine, and everything that waits for a disk, belongs in the threads of the calls.
"""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import jsonschema

jsonschema.validate({}, {})  # the client does so in the same thread in tests: what it loads is there before
_OFF_THE_LOOP = (
    "plannerforge.tools.",
    "plannerforge.resources.",
    "plannerforge.engine.",
    "plannerforge.server.arguments.checking",
    "plannerforge.server.tool_calls",
    "plannerforge.server.tokens",
)
_OF_THE_LOOP = ("plannerforge.engine.execution.", "plannerforge.tools.call", "plannerforge.tools.registry")
"""What must not run in the loop's thread, and what of it may: the hand-over itself."""
_DISK = {"open", "os.listdir", "os.scandir", "os.mkdir", "os.remove", "os.rename", "shutil.rmtree", "sqlite3.connect"}


class LoopWatch:
    """The actions of the creating thread so far that may block a loop."""

    def __init__(self) -> None:
        self.held: set[str] = set()
        self._thread = threading.get_ident()

    def note(self, frame: FrameType, event: str, argument: Any) -> None:
        """Examine a function call; a listener of ``sys.settrace`` that does not ask for lines."""
        del event, argument
        module = frame.f_globals.get("__name__", "")
        if module.startswith("plannerforge."):
            name = f"{module}.{frame.f_code.co_name}"
            if name.startswith(_OFF_THE_LOOP) and not name.startswith(_OF_THE_LOOP):
                self.held.add(name)

    def note_disk(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Examine a disk access; a listener of ``sys.addaudithook``. A pipe to a worker is a number, not a file."""
        is_ours = event in _DISK and threading.get_ident() == self._thread
        if is_ours and not isinstance(arguments[0], int):
            self.held.add(f"{event} {arguments[0]}")


_watches: list[LoopWatch] = []


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    for watch in _watches:
        watch.note_disk(event, arguments)


sys.addaudithook(_audit)


@contextmanager
def watched_loop() -> Iterator[LoopWatch]:
    """Watch the calling thread during the block, and fail if it was blocked."""
    watch = LoopWatch()
    _watches.append(watch)
    before = sys.gettrace()
    sys.settrace(watch.note)
    try:
        yield watch
    finally:
        sys.settrace(before)
        _watches.remove(watch)
    assert not watch.held, f"the event loop's thread ran {sorted(watch.held)}"
