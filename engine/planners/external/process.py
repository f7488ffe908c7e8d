"""A program that answers requests, one line of JSON each, within limits of time, memory, output and disk.

A one-shot program answers once per run (:meth:`PlannerProcess.ask`), a stepwise one repeatedly
(:meth:`PlannerProcess.exchange`). The same code reads, limits and ends the two kinds.

A violation raises a :class:`PlannerFailure` with a ``reason``; after that, the program and its process group are gone.
"""

import os
import selectors
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from time import monotonic, sleep

from ....schemas.errors import PlannerFailure
from ....schemas.planning import CommandPlanner
from ....schemas.text import cited, printable

_HALF_LOG_BYTES = 32_768
"""Bytes kept from the start of standard error, where the cause may be, and from its end."""
_QUOTED_LOG = 300
"""Characters of standard error that an error quotes."""
_LOOK_S = 0.05
"""Interval for checking the folder and waiting for an exit."""
_LEAVE_S = 0.5
"""Time that a stepwise program has to end after its input is closed, and to write its last log."""
_CHUNK_BYTES = 65_536
"""Size of one read: the capacity of a Linux pipe."""
_MIB = 1024**2
_LEAST_FILE_BYTES = 4096
"""Smallest size that a file counts as, since a million empty files also fill a disk."""
_PASSED_ON = ("PATH", "HOME", "LANG", "LC_ALL", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables that a program receives; the server's other variables may be secrets."""


class PlannerProcess:
    """A running program with a temporary working folder.

    Raises:
        PlannerFailure: The program cannot be started.
    """

    def __init__(self, name: str, declared: CommandPlanner) -> None:
        self._name, self._declared = name, declared
        program = declared.command[0]
        if os.name != "posix" or shutil.which(program) is None:
            why = f"there is no program {program}" if os.name == "posix" else "this system has no process groups"
            raise PlannerFailure(
                f"planner {name} cannot be started: {why}",
                next_step=f"correct command of [planners.{name}] in the settings",
                reason="cannot_start",
            )
        self._folder = tempfile.TemporaryDirectory(prefix="plannerforge-", ignore_cleanup_errors=True)
        self.folder = Path(self._folder.name).resolve()
        self._log, self._end_of_log = bytearray(), bytearray()
        self._given_bytes = 0
        self._unread, self._open = bytearray(), {"answer", "log"}
        self._unsent, self._unheard = memoryview(b""), False
        self._log_bytes, self._is_stepwise = 0, declared.protocol == "stepwise"
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
        if self._process.stdin is not None:
            os.set_blocking(self._process.stdin.fileno(), False)

    def _environment(self) -> dict[str, str]:
        passed = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
        return {**passed, "TMPDIR": str(self.folder), **self._declared.environment}

    @property
    def log(self) -> str:
        """The kept part of the program's standard error in this run, as printable text."""
        kept = self._log + (b"\n[...]\n" if len(self._end_of_log) == _HALF_LOG_BYTES else b"") + self._end_of_log
        return printable(kept.decode("utf-8", "replace"))

    @property
    def alive(self) -> bool:
        """True while the program runs."""
        return self._exited() is None

    def fresh_folder(self, given: Path) -> Path:
        """Return a new folder with a copy of a file, for one run; the copy does not count towards the disk limit."""
        folder = self.folder / "run"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        copy = folder / "scenario.xml"
        shutil.copyfile(given, copy)
        self._given_bytes = copy.stat().st_size
        return folder

    def begin_run(self) -> None:
        """Start a new log for a new run."""
        self._log.clear()
        self._end_of_log.clear()
        self._log_bytes = 0

    def ask(self, request: bytes) -> bytes:
        """Send a one-line request; return one line, or the whole output of a program that is not long-lived.

        Raises:
            PlannerFailure: The program broke a limit, ended with an error, or ended without an answer.
        """
        self.begin_run()
        stays = self._declared.stays
        with self._closed_on_failure():
            self._exchange_lines(request, self._declared.time_s, until_line=stays, close_input=not stays)
            answer, self._unread = bytes(self._unread), bytearray()
            return answer

    def exchange(self, message: bytes, limit_s: float) -> bytes:
        """Send a one-line message and return the next line of output; further output is kept for the next call.

        Raises:
            PlannerFailure: The program broke a limit, ended, or closed its input or output.
        """
        with self._closed_on_failure():
            self._exchange_lines(message, limit_s, until_line=True, close_input=False)
            line, _, self._unread = self._unread.partition(b"\n")
            return bytes(line)

    def finish(self) -> None:
        """Close the input, wait briefly for the program to end and to write its last log, and end it."""
        if self._process.returncode is None:
            self._close_input()
            ends = monotonic() + _LEAVE_S
            while self._exited() is None and monotonic() < ends:
                self._read(_LOOK_S / 5)
                self._unread.clear()
            self._read(0.0)
        self.close()

    def close(self) -> None:
        """End the program and everything that it started, and remove its folder."""
        if self._process.returncode is not None:
            return
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)  # not reaped yet, so the id still belongs to it
        self._process.wait()
        self._selector.close()
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            if stream is not None:
                with suppress(OSError):
                    stream.close()
        self._folder.cleanup()

    @contextmanager
    def _closed_on_failure(self) -> Iterator[None]:
        try:
            yield
        except PlannerFailure:
            self.close()
            raise

    def _exchange_lines(self, request: bytes, limit_s: float, *, until_line: bool, close_input: bool) -> None:
        """Send a line and read into ``_unread`` until it has a line, or until the output ends with exit status 0."""
        ends = monotonic() + limit_s
        self._unsent, self._unheard = memoryview(request + b"\n"), False
        self._send(close_input=close_input)
        while "answer" in self._open and not (until_line and b"\n" in self._unread and not self._unsent):
            self._check_limits(ends, limit_s)
            if self._read(_LOOK_S):
                self._send(close_input=close_input)
            if until_line and self._exited() is not None:  # a child process may keep its output open
                self._read(0.0)
                break
        if until_line and b"\n" in self._unread:
            if self._unheard:
                raise self._failure("closed_input", "answered although it had closed its standard input")
            self._check_limits(ends, limit_s)
            return
        status = self._wait_for_exit(ends, limit_s)
        self._check_limits(ends, limit_s)
        if status or until_line:
            raise self._exit_failure(status)

    def _send(self, *, close_input: bool) -> None:
        """Write as much of the message as the input accepts, so that a program that reads nothing does not block the
        worker.
        """
        stdin = self._process.stdin
        if stdin is None or not self._unsent:
            return
        try:
            self._unsent = self._unsent[os.write(stdin.fileno(), self._unsent) :]
        except BlockingIOError:
            pass
        except BrokenPipeError:  # it closed its input or ended; its exit status tells which
            self._unsent, self._unheard = self._unsent[:0], True
        if self._unsent and stdin not in self._selector.get_map():
            self._selector.register(stdin, selectors.EVENT_WRITE, "input")
        elif not self._unsent and stdin in self._selector.get_map():
            self._selector.unregister(stdin)
        if close_input and not self._unsent:
            self._close_input()

    def _close_input(self) -> None:
        stdin = self._process.stdin
        if stdin is None or stdin.closed:
            return
        if stdin in self._selector.get_map():
            self._selector.unregister(stdin)
        with suppress(OSError):
            stdin.close()

    def _read(self, wait_s: float) -> bool:
        """Read output for at most a given time; return True if the input takes more."""
        writable = False
        for key, _ in self._selector.select(wait_s):
            if key.data == "input":
                writable = True
                continue
            chunk = os.read(key.fd, _CHUNK_BYTES)
            if not chunk:
                self._selector.unregister(key.fileobj)
                self._open.discard(key.data)
            elif key.data == "answer":
                self._unread += chunk
            else:
                room = max(_HALF_LOG_BYTES - len(self._log), 0)
                self._log_bytes += len(chunk)
                self._log += chunk[:room]
                self._end_of_log = (self._end_of_log + chunk[room:])[-_HALF_LOG_BYTES:]
        return writable

    def _check_limits(self, ends: float, limit_s: float) -> None:
        declared = self._declared
        if len(self._unread) > declared.output_mb * _MIB:
            raise self._failure("flooded_output", f"wrote more than {declared.output_mb} MB to standard output")
        if self._is_stepwise and self._log_bytes > declared.output_mb * _MIB:
            raise self._failure("flooded_log", f"wrote more than {declared.output_mb} MB to standard error")
        if self._folder_bytes() - self._given_bytes >= declared.folder_mb * _MIB:
            raise self._failure("wrote_too_much", f"wrote more than {declared.folder_mb} MB to its folder")
        if monotonic() > ends:
            if self._is_stepwise and self._unheard:
                raise self._failure("closed_input", "closed its standard input and was stopped")
            raise self._failure("timed_out", f"gave no answer within {limit_s:g} s and was stopped")

    def _folder_bytes(self) -> int:
        total = 0
        for folder, _, names in os.walk(self.folder):
            for name in names:
                with suppress(OSError):  # the program may remove its own files meanwhile
                    total += max(Path(folder, name).lstat().st_size, _LEAST_FILE_BYTES)
        return total

    def _exited(self) -> int | None:
        """Return the exit status without reaping the process, so that its group's id stays reserved."""
        if self._process.returncode is not None:
            return self._process.returncode
        try:
            state = os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        except ChildProcessError:
            return 0
        return None if state is None else int(state.si_status)

    def _wait_for_exit(self, ends: float, limit_s: float) -> int:
        """Wait until the program ends, and return its exit status."""
        while (status := self._exited()) is None:
            if self._is_stepwise and monotonic() > ends:
                raise self._failure("closed_output", "closed its standard output and was stopped")
            self._check_limits(ends, limit_s)
            sleep(_LOOK_S / 5)
        return status

    def _exit_failure(self, status: int) -> PlannerFailure:
        if status == 128 + signal.SIGXFSZ:
            return self._failure("wrote_too_much", f"wrote a file of more than {self._declared.folder_mb} MB")
        if status > 128:
            return self._failure("died", f"was ended by signal {status - 128}")
        without = "" if status else " without an answer"
        return self._failure("exit_status", f"ended with exit status {status}{without}")

    def _failure(self, reason: str, what: str) -> PlannerFailure:
        quoted_log = _quote_log(self.log)
        return PlannerFailure(f"planner {self._name} {what}{quoted_log}", reason=reason)


def _quote_log(log: str) -> str:
    """Return the part of the log that an error quotes: a Python exception, otherwise the end of the log.

    Libraries may log after an exception, and a truncated traceback is useless.
    """
    before, traceback, block = log.rpartition("Traceback (most recent call last):")
    raised = next((line for line in block.splitlines()[1:] if line and not line.startswith(" ")), "")
    if traceback and raised:
        return f"; it raised {cited(raised, _QUOTED_LOG)}"
    end = (before if traceback else log).strip()[-_QUOTED_LOG:]
    return f"; standard error ends: {cited(end, _QUOTED_LOG)}" if end else ""
