"""The limits of work: folders, processes, memory and time."""

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
"""Most folders in a path (chosen: missing folders are created recursively)."""
_SHOWN = 60
"""Shown characters of a deeper path."""


@dataclass(frozen=True)
class Limits:
    """The limits of every tool call.

    Args:
        roots: Folders with files that a call may read and write.
        worker_count: Worker processes for simulation and planning.
        worker_memory_bytes: Data memory of one worker process (enforced by the operating system on Linux).
        worker_idle_bytes: Largest memory of an idle worker; a larger worker is replaced.
        operation_timeout_s: Time limit of one operation of a worker.
        file_bytes: Largest size of a file to read.
        recordings: The folder for workers' cached recordings; None disables caching.
    """

    roots: tuple[Path, ...]
    worker_count: int = 2
    worker_memory_bytes: int = 4 * 1024**3
    worker_idle_bytes: int = 1024**3
    operation_timeout_s: float = 300.0
    file_bytes: int = 100_000_000
    recordings: Path | None = None

    def allowed_path(self, text: str) -> Path:
        """Return the path, absolute and with links resolved, if it is inside an allowed root.

        Raises:
            InvalidRequest: The path is missing or too deep.
            OutsideRoots: The path is outside; the error lists the roots and the setting that extends them.
        """
        if not text.strip():
            raise InvalidRequest("the path is empty", next_step="give a file or folder; . is the first root")
        path = self._resolved(text)
        if path is not None and len(path.parts) > DEEPEST_PATH:
            raise InvalidRequest(
                f"{quoted(text, _SHOWN)} is {len(path.parts):,} folders deep",
                valid=[f"at most {DEEPEST_PATH}"],
                next_step="give a folder nearer to its root",
            )
        if path is not None and any(path.is_relative_to(root.resolve()) for root in self.roots):
            return path
        raise OutsideRoots(
            f"{quoted(text)} is outside the allowed folders",
            valid=self.roots,
            next_step="use a path inside an allowed folder, or start the server with the folder in --roots or "
            "PLANNERFORGE_ROOTS",
        )

    def check_size(self, path: Path) -> None:
        """Refuse a file that is too large, before anything reads it.

        Raises:
            UnsafeInput: The file is too large; the error gives both sizes and the setting.
        """
        size = path.stat().st_size
        if size > self.file_bytes:
            raise UnsafeInput(
                f"{shown_name(path.name)} has {size:,} bytes; the limit is {self.file_bytes:,}",
                next_step="give a smaller file, or raise the file_mb setting",
            )

    def _resolved(self, text: str) -> Path | None:
        """Return the absolute path; None if it has a null byte, a loop of links, or an unknown user's home."""
        try:
            path = Path(text).expanduser()
            return (path if path.is_absolute() else self.roots[0] / path).resolve()
        except (ValueError, RuntimeError, OSError):
            return None


_DIE_WITH_PARENT = 1
"""PR_SET_PDEATHSIG of Linux's prctl."""


def end_with_parent(parent_pid: int | None = None) -> None:
    """Make the operating system kill this process when its parent is gone (on Linux).

    Args:
        parent_pid: The parent's id, if known; the parent may already be gone.
    """
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    if parent_pid is not None and os.getppid() != parent_pid:
        os.kill(os.getpid(), signal.SIGKILL)


def limit_memory(size_bytes: int) -> None:
    """Limit the data memory of this process (on Linux); 0 means no limit. Its child processes may have more."""
    if size_bytes and sys.platform == "linux":
        import resource

        _, most = resource.getrlimit(resource.RLIMIT_DATA)
        resource.setrlimit(resource.RLIMIT_DATA, (size_bytes, most))


_BETWEEN_TRIMS_S = 10.0
"""Chosen: returning memory takes 2 to 20 ms."""


class MemoryTrimmer:
    """Returns freed memory to the operating system (with glibc) after work, at most every few seconds.

    glibc does not return freed memory that lies below memory in use. A server would therefore keep the largest total
    that simultaneous calls ever used.

    Args:
        trim: Returns the memory; glibc's function by default.
        clock: A monotonic clock in seconds.
    """

    def __init__(self, trim: Callable[[], object] | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        of_glibc = _glibc_function("malloc_trim")
        self._trim, self._clock = trim or (of_glibc and partial(of_glibc, 0)), clock
        self._last_s = clock()

    def after_work(self) -> None:
        """Call this at the end of each piece of work."""
        now_s = self._clock()
        if self._trim is not None and now_s - self._last_s >= _BETWEEN_TRIMS_S:
            self._last_s = now_s
            self._trim()


def _glibc_function(name: str) -> Callable[..., object] | None:
    """Return a function of glibc, or None with another C library, such as musl, which has neither these functions nor
    heaps per thread.
    """
    if sys.platform != "linux":
        return None
    import ctypes

    return getattr(ctypes.CDLL(None), name, None)


_ARENA_MAX, _MOST_ARENAS = -8, 2
"""M_ARENA_MAX of glibc's mallopt, and the number of heaps that threads share (chosen: only one thread at a time runs
Python, so more heaps hardly reduce waiting).
"""


def share_heaps() -> None:
    """Make all threads of this process share a small number of heaps (with glibc); call it before they start.

    glibc gives each thread its own heap, up to eight per processor, and other threads cannot reuse what a call has
    freed there. A server's memory would grow until each thread has handled the largest call. A number of heaps that is
    set in the environment takes precedence.
    """
    chosen = "MALLOC_ARENA_MAX" in os.environ or "glibc.malloc.arena_max" in os.environ.get("GLIBC_TUNABLES", "")
    set_option = None if chosen else _glibc_function("mallopt")
    if set_option is not None:
        set_option(_ARENA_MAX, _MOST_ARENAS)
