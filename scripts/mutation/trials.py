"""Runs tests: once with a record of which of them reach which line, then on mutants.

``python trials.py record`` and ``python trials.py serve`` are started by the program beside it. A server imports what
is not mutated once; each mutant is tried in a fork of it, which costs little more than its tests.
"""

import contextlib
import dataclasses
import gc
import importlib
import importlib.machinery
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import types
from collections.abc import Iterable
from pathlib import Path

import pytest
from coverage import Coverage

_MEMORY_BYTES = 8 << 30
"""What a mutant's tests may hold: a loop without an end fails for it sooner than by time."""
_CLOCK_PER_PROCESSOR_S = 10
"""A mutant that waits is ended after so many times its processor time, however busy the machine."""
_QUIET = ("-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", "-W", "ignore::pytest.PytestAssertRewriteWarning")


@dataclasses.dataclass(frozen=True, slots=True)
class Record:
    """What the tests do where nothing is mutated.

    Attributes:
        seconds: the processor time of each test that passes.
        reached: the tests that run each line, by file and line; of tests that pass.
        failing: the tests that fail.
        modules: all modules that were imported, but for tests.
    """

    seconds: dict[str, float]
    reached: dict[str, dict[int, list[str]]]
    failing: list[str]
    modules: list[str]


@dataclasses.dataclass(frozen=True, slots=True)
class Trial:
    """A mutant to try.

    Attributes:
        module: the name of the mutated module.
        source: its mutated text.
        tests: the tests to run, in their order.
        limit_s: the processor time after which they are ended.
    """

    module: str
    source: str
    tests: tuple[str, ...]
    limit_s: int


class _Recorder:
    """A pytest plugin that notes each test's processor time and gives its name to the lines it runs."""

    def __init__(self, coverage: Coverage) -> None:
        self.seconds: dict[str, float] = {}
        self.failing: set[str] = set()
        self._coverage = coverage

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterable[None]:
        started = time.process_time()
        self._coverage.switch_context(item.nodeid)
        result = yield
        self.seconds[item.nodeid] = round(time.process_time() - started, 3)
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if not report.passed:
            self.failing.add(report.nodeid)


def record(checkout: Path, files: list[str], tests: list[str]) -> Record:
    """Run the tests with nothing mutated.

    Raises:
        RuntimeError: none could be run.
    """
    coverage = Coverage(data_file=None, config_file=False, include=[str(checkout / file) for file in files])
    recorder = _Recorder(coverage)
    coverage.start()
    pytest.main([*tests, *_QUIET, "--maxfail=1000"], plugins=[recorder])
    coverage.stop()
    passing = {test: seconds for test, seconds in recorder.seconds.items() if test not in recorder.failing}
    if not passing:
        raise RuntimeError(f"no test of {', '.join(tests)} passes where nothing is mutated: mend them first")
    data, reached = coverage.get_data(), {}
    for file in files:
        by_line = data.contexts_by_lineno(str((checkout / file).resolve()))
        reached[file] = {line: sorted(passing.keys() & set(names)) for line, names in by_line.items()}
    of_tests = {"tests", *(path.stem for path in (checkout / "tests").iterdir())}
    modules = sorted(name for name in sys.modules if name.partition(".")[0] not in of_tests)
    return Record(passing, reached, sorted(recorder.failing), modules)


def preload(modules: Iterable[str], mutated: Iterable[str]) -> None:
    """Import all that mutants share: whatever is neither a test nor above or beside a mutated module.

    Modules that begin with an underscore come with those that they belong to: ``_asyncio`` before ``asyncio`` leaves
    Python with two kinds of tasks.

    Raises:
        RuntimeError: a module that is to be mutated would be shared.
    """
    for name in (name for name in modules if not name.startswith("_")):
        if name.partition(".")[0] != "plannerforge" or name.startswith(_SHARED):
            with contextlib.suppress(Exception):  # a few can be imported by their packages alone
                importlib.import_module(name)
    if shared := sys.modules.keys() & set(mutated):
        raise RuntimeError(f"{sorted(shared)} would be shared by all mutants: leave what imports it out of _SHARED")
    gc.collect()
    gc.freeze()


_SHARED = (
    "plannerforge.schemas",
    *(
        f"plannerforge.engine.{package}"
        for package in ("commonroad", "geometry", "network", "scene", "traffic", "maps", "vehicles", "workspace")
    ),
)
"""The packages of the house that are below all mutated ones."""


def try_mutant(trial: Trial) -> tuple[str, float]:
    """``killed``, ``survived`` or ``timed_out``, and the seconds it took.

    Raises:
        RuntimeError: pytest found none of the tests.
    """
    started = time.monotonic()
    scratch = tempfile.mkdtemp(prefix="mutant-")
    child = os.fork()
    if child == 0:
        with contextlib.suppress(BaseException):
            os._exit(_run(trial, scratch))
        os._exit(1)
    try:
        status = _ended(child, started + _CLOCK_PER_PROCESSOR_S * trial.limit_s)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    seconds = time.monotonic() - started
    if status is None or (os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL)):
        return "timed_out", seconds
    code = os.waitstatus_to_exitcode(status)
    if code == pytest.ExitCode.NO_TESTS_COLLECTED:
        raise RuntimeError(f"pytest finds none of {trial.tests}: record anew")
    return "survived" if code == pytest.ExitCode.OK else "killed", seconds


def _ended(child: int, until: float) -> int | None:
    """How a process ended; None when it was ended. Programs that it started are ended with it."""
    status = None
    while status is None and time.monotonic() < until:
        found, code = os.waitpid(child, os.WNOHANG)
        if found:
            status = code
        else:
            time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    if status is None:
        os.waitpid(child, 0)
    return status


def _run(trial: Trial, scratch: str) -> int:
    os.setpgid(0, 0)
    resource.setrlimit(resource.RLIMIT_CPU, (trial.limit_s, trial.limit_s + 5))
    resource.setrlimit(resource.RLIMIT_DATA, (_MEMORY_BYTES, _MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.environ |= {"TMPDIR": scratch, "HYPOTHESIS_STORAGE_DIRECTORY": f"{scratch}/hypothesis"}
    tempfile.tempdir = scratch
    _import_mutated(trial.module, trial.source)
    return int(pytest.main([*trial.tests, *_QUIET, "-p", "no:cov", f"--basetemp={scratch}/tests"]))


def _import_mutated(module: str, source: str) -> None:
    usual = importlib.machinery.SourceFileLoader.get_code

    def get_code(self: importlib.machinery.SourceFileLoader, name: str) -> types.CodeType | None:
        return compile(source, self.path, "exec") if name == module else usual(self, name)

    importlib.machinery.SourceFileLoader.get_code = get_code  # type: ignore[assignment, method-assign]


def _serve() -> None:
    """Answer each line, a trial, by a line with its verdict; the first line names what to import."""
    problems, nowhere = os.dup(2), os.open(os.devnull, os.O_RDWR)
    trials, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
    for standard in range(3):  # of tests and of what they start
        os.dup2(nowhere, standard)
    try:
        first = json.loads(trials.readline())
        preload(first["modules"], first["mutated"])
        for line in trials:
            answers.write(json.dumps(try_mutant(Trial(**json.loads(line)))) + "\n")
            answers.flush()
    except Exception as error:
        os.write(problems, f"{error}\n".encode())
        raise


def _record() -> None:
    """Answer one line, the files and the tests, by a line with their record."""
    request = json.loads(sys.stdin.readline())
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    found = record(Path.cwd(), request["files"], request["tests"])
    answers.write(json.dumps(dataclasses.asdict(found)) + "\n")
    answers.flush()


if __name__ == "__main__":
    {"serve": _serve, "record": _record}[sys.argv[1]]()
