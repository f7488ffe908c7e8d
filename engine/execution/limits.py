"""What work may use: folders, processes, memory and time."""

import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ...schemas.errors import InvalidRequest, OutsideRoots, UnsafeInput
from ...schemas.text import quoted, shown_name

DEEPEST_PATH = 100
"""Folders in a path that is read or written; chosen: missing ones are made by recursion."""
_SHOWN = 60
"""Characters that are shown of a path that leads deeper."""


@dataclass(frozen=True)
class Limits:
    """The bounds that every tool call works within.

    Args:
        roots: folders that files may be read from and written to.
        worker_count: worker processes for simulation and planning.
        worker_memory_bytes: data memory of one worker process (enforced by the operating system on Linux).
        worker_idle_bytes: a worker that holds more between two operations is ended, and a fresh one takes its place.
        operation_timeout_s: time after which one operation of a worker is ended.
        file_bytes: largest file that is read.
        recordings: where workers keep what they read; None: nowhere.
    """

    roots: tuple[Path, ...]
    worker_count: int = 2
    worker_memory_bytes: int = 4 * 1024**3
    worker_idle_bytes: int = 1024**3
    operation_timeout_s: float = 300.0
    file_bytes: int = 100_000_000
    recordings: Path | None = None

    def allowed_path(self, text: str) -> Path:
        """The path, made absolute and with links resolved, if it lies inside an allowed root.

        Raises:
            InvalidRequest: no path is given, or it leads too deep.
            OutsideRoots: naming the roots and the setting that extends them.
        """
        if not text.strip():
            raise InvalidRequest("an empty path names nothing", next_step="name a file or folder; . is the first root")
        path = self._resolved(text)
        if path is not None and len(path.parts) > DEEPEST_PATH:
            raise InvalidRequest(
                f"{quoted(text, _SHOWN)} leads {len(path.parts):,} folders deep",
                valid=[f"at most {DEEPEST_PATH}"],
                next_step="name a folder nearer to its root",
            )
        if path is not None and any(path.is_relative_to(root.resolve()) for root in self.roots):
            return path
        raise OutsideRoots(
            f"{quoted(text)} lies outside the folders that may be used",
            valid=self.roots,
            next_step="use a path inside them, or name the folder in --roots or PLANNERFORGE_ROOTS at the start",
        )

    def check_size(self, path: Path) -> None:
        """Refuse a file that is larger than what is read, before anything looks into it.

        Raises:
            UnsafeInput: naming both sizes and the setting.
        """
        size = path.stat().st_size
        if size > self.file_bytes:
            raise UnsafeInput(
                f"{shown_name(path.name)} has {size:,} bytes; at most {self.file_bytes:,} are read",
                next_step="name a smaller file, or raise the file_mb setting",
            )

    def _resolved(self, text: str) -> Path | None:
        """The absolute path; None for what cannot be one: a null byte, a loop of links, the home of no user."""
        try:
            path = Path(text).expanduser()
            return (path if path.is_absolute() else self.roots[0] / path).resolve()
        except (ValueError, RuntimeError, OSError):
            return None


_DIE_WITH_PARENT = 1
"""PR_SET_PDEATHSIG of Linux's prctl."""


def end_with_parent(parent_pid: int | None = None) -> None:
    """Have the operating system kill this process when the one that started it is gone (on Linux).

    Args:
        parent_pid: the one that started it, where this one can tell: it may have gone before it could be watched.
    """
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    if parent_pid is not None and os.getppid() != parent_pid:
        os.kill(os.getpid(), signal.SIGKILL)


def limit_memory(size_bytes: int) -> None:
    """Bound the data memory of this process (on Linux); 0 is no bound. Processes that it starts may have more."""
    if size_bytes and sys.platform == "linux":
        import resource

        _, most = resource.getrlimit(resource.RLIMIT_DATA)
        resource.setrlimit(resource.RLIMIT_DATA, (size_bytes, most))


_BETWEEN_TRIMS_S = 10.0
"""Chosen: giving back takes 2 to 20 ms."""


class HeapsGivenBack:
    """Gives freed memory back to the operating system (with glibc) after work, at most every some seconds.

    glibc keeps what lies under memory in use: a server would keep the most that calls at once have ever held.

    Args:
        trim: what gives it back; glibc's by default.
        clock: seconds that only go up.
    """

    def __init__(self, trim: Callable[[], object] | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        of_glibc = _of_glibc("malloc_trim")
        self._trim, self._clock = trim or (of_glibc and partial(of_glibc, 0)), clock
        self._last_s = clock()

    def after_work(self) -> None:
        """Call it whenever a piece of work has ended."""
        now_s = self._clock()
        if self._trim is not None and now_s - self._last_s >= _BETWEEN_TRIMS_S:
            self._last_s = now_s
            self._trim()


def _of_glibc(name: str) -> Callable[..., object] | None:
    """A function of glibc; None elsewhere: other C libraries, such as musl, have neither these nor the heaps."""
    if sys.platform != "linux":
        return None
    import ctypes

    return getattr(ctypes.CDLL(None), name, None)


_ARENA_MAX, _MOST_ARENAS = -8, 2
"""M_ARENA_MAX of glibc's mallopt, and how many heaps the threads of a process share; chosen: one thread at a time runs
Python, so that more heaps save hardly any waiting."""


def share_heaps() -> None:
    """Have all threads of this process take their memory from few heaps (with glibc); call it before they are started.

    glibc gives each thread a heap of its own, eight for each processor, and what a call has freed there is of no use to
    another thread: a server's memory grows until each of them has held the largest call. Whoever has set the
    number of heaps in the environment has chosen otherwise.
    """
    chosen = "MALLOC_ARENA_MAX" in os.environ or "glibc.malloc.arena_max" in os.environ.get("GLIBC_TUNABLES", "")
    set_option = None if chosen else _of_glibc("mallopt")
    if set_option is not None:
        set_option(_ARENA_MAX, _MOST_ARENAS)
