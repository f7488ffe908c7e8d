"""A program that answers requests, a line of JSON each, within limits of time, memory, output and disk.

What it does wrong is a :class:`PlannerFailure` whose ``reason`` names it; after one, the program and all that it
started in its process group are gone.
"""

import os
import selectors
import shutil
import signal
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep

from ....schemas.errors import PlannerFailure
from ....schemas.planning import CommandPlanner
from ....schemas.text import one_line, printable

_HALF_LOG_BYTES = 32_768
"""What is kept of standard error: so much of its beginning, where what went wrong may stand, and of its end."""
_TOLD_LOG = 300
"""Characters of it that an error repeats."""
_LOOK_S = 0.05
"""How often the folder is looked at, and an exit waited for."""
_MIB = 1024**2
_LEAST_FILE_BYTES = 4096
"""Every file counts as at least this: a million empty ones fill a disk, too."""
_PASSED_ON = ("PATH", "HOME", "LANG", "LC_ALL", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables that a program gets; others of the server may be secrets."""


class PlannerProcess:
    """A running program with a temporary working folder.

    Raises:
        PlannerFailure: it cannot be started.
    """

    def __init__(self, name: str, declared: CommandPlanner) -> None:
        self._name, self._declared = name, declared
        program = declared.command[0]
        if os.name != "posix" or shutil.which(program) is None:
            why = f"there is no program {program}" if os.name == "posix" else "this system has no process groups"
            raise PlannerFailure(
                f"planner {name} cannot be started: {why}",
                next_step=f"mend command of [planners.{name}] in the settings",
                reason="cannot_start",
            )
        self._folder = tempfile.TemporaryDirectory(prefix="plannerforge-", ignore_cleanup_errors=True)
        self.folder = Path(self._folder.name).resolve()
        self._log, self._end_of_log = bytearray(), bytearray()
        self._given_bytes = 0
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-I", "-S", str(Path(__file__).with_name("guard.py"))),
                *(str(os.getpid()), str(declared.memory_mb * _MIB), str(declared.folder_mb * _MIB)),
                *declared.command,
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            cwd=self.folder,
            env=self._environment(),
            start_new_session=True,
            bufsize=0,
        )
        self._selector = selectors.DefaultSelector()
        for name_of, stream in (("answer", self._process.stdout), ("log", self._process.stderr)):
            if stream is not None:
                os.set_blocking(stream.fileno(), False)
                self._selector.register(stream, selectors.EVENT_READ, name_of)

    def _environment(self) -> dict[str, str]:
        passed = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
        return {**passed, "TMPDIR": str(self.folder), **self._declared.environment}

    @property
    def log(self) -> str:
        """What is kept of what it wrote to standard error in this run, printable."""
        kept = self._log + (b"\n[...]\n" if len(self._end_of_log) == _HALF_LOG_BYTES else b"") + self._end_of_log
        return printable(kept.decode("utf-8", "replace"))

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return self._exited() is None

    def fresh_folder(self, given: Path) -> Path:
        """An empty folder for one run, with a copy of a file that is given, which does not count as its own."""
        folder = self.folder / "run"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        copy = folder / "scenario.xml"
        shutil.copyfile(given, copy)
        self._given_bytes = copy.stat().st_size
        return folder

    def ask(self, request: bytes) -> bytes:
        """Its answer to a request of one line: a line where it stays, else all that it wrote until it ended.

        Raises:
            PlannerFailure: it broke a limit, ended with an error, or ended without an answer.
        """
        self._log.clear()
        self._end_of_log.clear()
        try:
            return self._answer(request)
        except PlannerFailure:
            self.close()
            raise

    def close(self) -> None:
        """End the program with all that it started, and remove its folder."""
        if self._process.returncode is not None:
            return
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)  # not reaped yet: the id is still its own
        self._process.wait()
        self._selector.close()
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            if stream is not None:
                with suppress(OSError):
                    stream.close()
        self._folder.cleanup()

    def _answer(self, request: bytes) -> bytes:
        stays, answer, ends = self._declared.stays, bytearray(), monotonic() + self._declared.time_s
        self._send(request)
        open_streams = {"answer", "log"}
        while "answer" in open_streams:
            self._check_limits(answer, ends)
            for key, _ in self._selector.select(_LOOK_S):
                chunk = os.read(key.fd, 65_536)
                if not chunk:
                    self._selector.unregister(key.fileobj)
                    open_streams.discard(key.data)
                elif key.data == "answer":
                    answer += chunk
                else:
                    room = _HALF_LOG_BYTES - len(self._log)
                    self._log += chunk[:room]
                    self._end_of_log = (self._end_of_log + chunk[room:])[-_HALF_LOG_BYTES:]
            if stays and b"\n" in answer:
                self._check_limits(answer, ends)
                return bytes(answer)
        status = self._awaited(ends)
        self._check_limits(answer, ends)
        if status or stays:
            raise self._ended(status)
        return bytes(answer)

    def _send(self, request: bytes) -> None:
        """A request is far shorter than what a pipe holds, so that a program that reads nothing blocks nothing."""
        if self._process.stdin is None:
            return
        with suppress(BrokenPipeError):  # it ended: its exit says why
            self._process.stdin.write(request + b"\n")
            if not self._declared.stays:
                self._process.stdin.close()

    def _check_limits(self, answer: bytearray, ends: float) -> None:
        declared = self._declared
        if len(answer) > declared.output_mb * _MIB:
            raise self._failure("flooded_output", f"writes more than {declared.output_mb} MB to standard output")
        if self._folder_bytes() - self._given_bytes >= declared.folder_mb * _MIB:
            raise self._failure("wrote_too_much", f"writes more than {declared.folder_mb} MB to its folder")
        if monotonic() > ends:
            raise self._failure("timed_out", f"gives no answer within {declared.time_s:g} s and was ended")

    def _folder_bytes(self) -> int:
        total = 0
        for folder, _, names in os.walk(self.folder):
            for name in names:
                with suppress(OSError):  # it removes its own files meanwhile
                    total += max(Path(folder, name).lstat().st_size, _LEAST_FILE_BYTES)
        return total

    def _exited(self) -> int | None:
        """Its exit status, without reaping it: until then its group's id belongs to nobody else."""
        if self._process.returncode is not None:
            return self._process.returncode
        try:
            state = os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        except ChildProcessError:
            return 0
        return None if state is None else int(state.si_status)

    def _awaited(self, ends: float) -> int:
        while (status := self._exited()) is None:
            self._check_limits(bytearray(), ends)
            sleep(_LOOK_S / 5)
        return status

    def _ended(self, status: int) -> PlannerFailure:
        if status == 128 + signal.SIGXFSZ:
            return self._failure("wrote_too_much", f"writes a file of more than {self._declared.folder_mb} MB")
        if status > 128:
            return self._failure("died", f"was ended by signal {status - 128}")
        without = "" if status else " without an answer"
        return self._failure("exit_status", f"ended with exit status {status}{without}")

    def _failure(self, reason: str, what: str) -> PlannerFailure:
        told = _told(self.log)
        return PlannerFailure(f"planner {self._name} {what}{told}", reason=reason)


def _told(log: str) -> str:
    """What an error repeats of standard error: the exception of a Python program, which noise of its libraries follows,
    else the end; a traceback that was broken off says nothing.
    """
    before, traceback, block = log.rpartition("Traceback (most recent call last):")
    raised = next((line for line in block.splitlines()[1:] if line and not line.startswith(" ")), "")
    if traceback and raised:
        return f"; it raised {one_line(raised, _TOLD_LOG)}"
    end = (before if traceback else log).strip()[-_TOLD_LOG:]
    return f"; standard error ends: {one_line(end, _TOLD_LOG)}" if end else ""
