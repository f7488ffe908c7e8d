"""The frame of all benchmarks: the form of their output, their files, their server and its client.

Each benchmark prints a table for people and ends with one JSON object for comparison. A benchmark of several parts is a
package; each of its modules has a function ``measure(bench) -> Figures`` and explains its keys (:class:`Parts`).
"""

import hashlib
import json
import os
import queue
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Generic, Self, TextIO, TypeVar, cast

from mcp import Client
from rich.console import Console
from rich.table import Table

from plannerforge.engine.execution import Operation, Request, Response, no_progress, silent
from plannerforge.engine.execution.pool import PRELOAD
from plannerforge.engine.execution.worker import warm_up
from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.base import Model
from plannerforge.schemas.runs import BatchRecord, RunRecord
from plannerforge.server.settings import Settings
from plannerforge.workflows.context import Services, WorkflowContext

Content = TypeVar("Content", bound=Model)
Bench = TypeVar("Bench")
"""The input of the parts of a benchmark."""
_POLL_S = 50
"""Requested waiting time for a job: the most that the server accepts."""
Figures = Mapping[str, float | int | str]
"""A benchmark's measurements, by the keys that its module explains."""


def print_figures(
    title: str,
    figures: Figures,
    rows: Iterable[tuple[str, str]] | None = None,
    more_rows: Iterable[tuple[str, str]] = (),
) -> None:
    """Print a table of ``(what, figure)`` rows (default: the figures), and the figures as the last line."""
    table = Table("figure", "value", title=title)
    for what, value in (*(figures.items() if rows is None else rows), *more_rows):
        table.add_row(what, str(value))
    Console(width=110).print(table)
    sys.stdout.write(json.dumps(dict(figures)) + "\n")


def as_measured(figures: Mapping[str, float | int | str | None]) -> Figures:
    """Return the measured figures without missing ones; the caller then names a missing key that a part owes."""
    return {key: value for key, value in figures.items() if value is not None}


def spread(values: Sequence[float], unit: str, digits: int = 2) -> str:
    """Return the median with minimum and maximum as text."""
    middle = statistics.median(values)
    return f"{middle:.{digits}f} {unit} (min {min(values):.{digits}f}, max {max(values):.{digits}f}, n {len(values)})"


def share(values: Iterable[object]) -> float:
    """Return the share of true values, rounded to four digits; 0 without any value."""
    verdicts = [bool(value) for value in values]
    return round(sum(verdicts) / len(verdicts), 4) if verdicts else 0.0


def percentile_95(values: Iterable[float]) -> float:
    """Return the smallest of the values that 95 of 100 do not exceed."""
    ordered = sorted(values)
    return ordered[int(0.95 * len(ordered))]


def shared_folder() -> Path:
    """Return the folder of public scenarios, maps and corpora: ``PLANNERFORGE_SHARED``, or ``../shared``."""
    beside = Path(__file__).resolve().parent.parent.parent / "shared"
    return Path(os.environ.get("PLANNERFORGE_SHARED", beside))


def shared_scenarios() -> Path:
    """Return the folder of public CommonRoad scenarios in the shared folder."""
    return shared_folder() / "data" / "commonroad"


def existing(folder: Path) -> Path:
    """Return a folder that a benchmark needs; if it is missing, exit with a hint how to set it."""
    if not folder.is_dir():
        sys.exit(f"the folder {folder} does not exist; give it by an option (see --help), or set PLANNERFORGE_SHARED")
    return folder.resolve()


def scenario_arguments(
    text: str | None, option: str = "--limit", default: int | None = None
) -> tuple[Path, int | None]:
    """Read the command line of a benchmark over a folder of scenarios: the folder and the number of its files."""
    parser = ArgumentParser(description=text, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=shared_scenarios())
    parser.add_argument(option, dest="limit", type=int, default=default, help="only a sample of this many files")
    arguments = parser.parse_args()
    return existing(arguments.folder), arguments.limit


def drawn(names: Iterable[str], limit: int | None) -> list[str]:
    """Return at most ``limit`` of the names, always the same ones in the same order; all without a limit."""
    return sorted(names, key=lambda name: hashlib.sha256(name.encode()).hexdigest())[:limit]


def scenario_files(folder: Path, limit: int | None) -> list[Path]:
    """Return the scenario files of a folder; with a limit, always the same sample."""
    files = {path.name: path for path in sorted(folder.rglob("*.xml")) if not path.name.endswith(".net.xml")}
    return [files[name] for name in (sorted(files) if limit is None else drawn(files, limit))]


@dataclass(frozen=True)
class Spent:
    """Seconds: on the clock, and of the processors in a process and in its children (netconvert)."""

    wall_s: float = 0.0
    processor_s: float = 0.0

    @classmethod
    def now(cls) -> "Spent":
        """Return the time that this process has spent so far; only differences are meaningful."""
        times = os.times()
        processor_s = times.user + times.system + times.children_user + times.children_system
        return cls(time.perf_counter(), processor_s)

    def __add__(self, other: "Spent") -> "Spent":
        return Spent(self.wall_s + other.wall_s, self.processor_s + other.processor_s)

    def __sub__(self, other: "Spent") -> "Spent":
        return Spent(self.wall_s - other.wall_s, self.processor_s - other.processor_s)


def process_pool(workers: int) -> ProcessPoolExecutor:
    """Return spawned processes with the imports of a warm worker."""
    spawn, modules = get_context("spawn"), PRELOAD["compute"]
    return ProcessPoolExecutor(workers, mp_context=spawn, initializer=warm_up, initargs=(modules,))


def settings_for(workspace: Path, folder: Path, workers: int) -> Settings:
    """Return settings for a server on the benchmark's workspace."""
    return Settings(
        workspace=workspace,
        roots=(folder,),
        workers=workers,
        starter=False,
        warm_up=False,
        maps_online="offline",
        journal=False,
    )


async def call_ms(client: Client, tool: str, **arguments: Any) -> float:
    """Return the milliseconds from a tool call to its answer at the client."""
    started = time.perf_counter()
    await client.call_tool(tool, arguments)
    return (time.perf_counter() - started) * 1000


async def ask(client: Client, tool: str, **arguments: Any) -> Any:
    """Return the structured answer of a tool.

    Raises:
        RuntimeError: the tool refused.
    """
    result = await client.call_tool(tool, arguments)
    if result.is_error or result.structured_content is None:
        raise RuntimeError(f"{tool}: {result.content}")
    return result.structured_content


async def ask_to_the_end(client: Client, tool: str, **arguments: Any) -> Any:
    """Return the structured answer of a tool, or the finished job if the call becomes one.

    Raises:
        RuntimeError: the tool refused, or the job failed.
    """
    answer = await ask(client, tool, **arguments)
    while answer["state"] == "running":
        answer = await ask(client, "get_job", job_id=answer["job_id"], wait_s=_POLL_S)
        sys.stderr.write(f"{answer['message']}\n")
    if answer["state"] != "done":
        raise RuntimeError(f"{tool} ended as {answer['state']}: {answer}")
    return answer


async def import_scenarios(client: Client, files: Sequence[Path]) -> None:
    """Import files; one that is refused is named and left out."""
    for path in files:
        result = await client.call_tool("import_files", {"path": str(path)})
        if result.is_error:
            sys.stderr.write(f"{path.name} is left out: {result.content}\n")


async def finished_batch(client: Client, **arguments: Any) -> str:
    """Run a grid to its end and give the id of the batch.

    Raises:
        RuntimeError: the grid could not be run to its end.
    """
    answer = await ask_to_the_end(client, "run_planner", wait_s=0, **arguments)
    return str(answer.get("batch_id") or answer["results"][-1])


def attempted_runs(folder: Path, batch_id: str) -> list[RunRecord]:
    """Return the runs of a batch in the workspace of a folder, without those that could not be attempted."""
    workspace = Workspace(folder)
    batch = workspace.get(batch_id, "batch").read(BatchRecord)
    records = [workspace.get(run_id, "run").read(RunRecord) for run_id in batch.runs]
    workspace.close()
    return [record for record in records if record.outcome != "invalid"]


def read_run_file(workspace: Workspace, run_id: str, name: str, model: type[Content]) -> Content:
    """Return a file stored with a run, such as ``steps.json``."""
    return model.model_validate_json(workspace.file("run", run_id, name).read_bytes())


class _InProcess:
    """An executor that carries operations out in this process, one at a time and without a time limit."""

    capacity = 1
    notice = ""

    async def run(self, operation: Operation[Request, Response], request: Request, **options: object) -> Response:
        """Return the operation's response."""
        del options
        return operation.load()(request, silent)


def call_in_process(workspace: Workspace | None = None) -> WorkflowContext:
    """Return a tool's call without server and workers: it can run operations, and store artifacts given a workspace."""
    nothing = cast("Any", None)
    services = Services(workspace or nothing, _InProcess(), nothing, nothing, nothing, with_starter=False)
    return WorkflowContext(services, no_progress)


class LeftOut(Exception):
    """A requirement of a part is not available on this machine; the message names it."""


def made_environment(name: str, title: str, requirements: Path) -> Path:
    """Return the folder of an environment for another program, creating it if necessary.

    The folder is the one in ``PLANNERFORGE_NAME``, or a temporary one; its completion marker carries the requirements'
    digest.

    Raises:
        LeftOut: it cannot be created here.
    """
    digest = hashlib.sha256(requirements.read_bytes()).hexdigest()[:12]
    default = Path(tempfile.gettempdir()) / f"plannerforge-{name}-{digest}"
    folder = Path(os.environ.get(f"PLANNERFORGE_{name.upper()}", default))
    return installed_environment(folder, title, digest, ["--requirement", str(requirements)])


def installed_environment(folder: Path, title: str, digest: str, wanted: Sequence[str]) -> Path:
    """Do the same in a given folder with a list for pip; ``digest`` identifies the requirements.

    Raises:
        LeftOut: it cannot be created here.
    """
    whole = folder / f"{digest}.whole"
    if whole.exists():
        return folder
    sys.stderr.write(f"making {title}'s environment in {folder} …\n")
    commands = (
        [sys.executable, "-m", "venv", str(folder)],
        [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", *wanted],
    )
    for command in commands:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no reason"])[-1]
            raise LeftOut(f"{title}'s environment cannot be created here: {last}")
    whole.touch()
    return folder


class NoAnswer(Exception):
    """A process took too long or ended instead of answering; the message says which."""


class LineProcess:
    """A program of another environment that answers each line of JSON with one, using a thread for each direction.

    It starts at the first request, and again after it ended. Its standard error goes to the log.
    """

    def __init__(
        self, command: Sequence[str], log: TextIO, limit_s: float, environment: Mapping[str, str] | None = None
    ) -> None:
        self._command, self._log, self._limit_s = list(command), log, limit_s
        threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self._environment = {**os.environ, **threads, "PYTHONPATH": "", **(environment or {})}
        self._process: subprocess.Popen[str] | None = None
        self._listener: threading.Thread | None = None
        self._answers: queue.Queue[str] = queue.Queue()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *problem: object) -> None:
        self._end()

    def answer(self, asked: Mapping[str, object]) -> Any:
        """Return the process's answer.

        Raises:
            NoAnswer: the process did not answer in time, or ended; the next request starts a new process.
        """
        process = self._running()
        assert process.stdin is not None  # noqa: S101 - it was opened with a pipe
        with suppress(BrokenPipeError):  # then its listener tells that it ended
            process.stdin.write(json.dumps(asked) + "\n")
            process.stdin.flush()
        try:
            line = self._answers.get(timeout=self._limit_s)
        except queue.Empty:
            self._end()
            raise NoAnswer(f"not done in {self._limit_s:g} s") from None
        if not line:
            raise NoAnswer(f"its process ended with {self._end()}")
        return json.loads(line)

    def _running(self) -> "subprocess.Popen[str]":
        if self._process is None:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._log,
                text=True,
                env=self._environment,
            )
            self._answers = queue.Queue()
            self._listener = threading.Thread(target=_listen, args=(self._process, self._answers), daemon=True)
            self._listener.start()
        return self._process

    def _end(self) -> int | None:
        """End the process if one runs, and return its status."""
        if self._process is None or self._listener is None:
            return None
        process, self._process = self._process, None
        with suppress(subprocess.TimeoutExpired):
            process.wait(0.0 if self._listener.is_alive() else None)
        process.kill()
        self._listener.join()
        with suppress(BrokenPipeError), process:
            process.wait()
        return process.returncode


def _listen(process: "subprocess.Popen[str]", answers: "queue.Queue[str]") -> None:
    """Forward the lines of a process, and an empty line when it has ended."""
    assert process.stdout is not None  # noqa: S101 - it was opened with a pipe
    for line in process.stdout:
        answers.put(line)
    process.wait()
    answers.put("")


@dataclass(frozen=True)
class Parts(Generic[Bench]):
    """The parts of a benchmark in the order of measurement, with the keys that each owes.

    ``package``: the package of their modules.
    """

    package: str
    keys: Mapping[str, tuple[str, ...]]

    def chosen(self, only: Sequence[str]) -> tuple[str, ...]:
        """Return the parts that measure the given keys or have the given names; all by default.

        Raises:
            ValueError: a word is neither a part nor a key.
        """
        known = {*self.keys, *(key for keys in self.keys.values() for key in keys)}
        if unknown := sorted(set(only) - known):
            raise ValueError(f"unknown: {', '.join(unknown)}; valid are {', '.join(sorted(known))}")
        return tuple(part for part, keys in self.keys.items() if not only or {part, *keys} & set(only))

    def find(self, part: str) -> Callable[[Bench], Figures] | None:
        """Return the function of a part, or None if its module is missing."""
        if find_spec(f"{self.package}.{part}") is None:
            return None
        measure: Callable[[Bench], Figures] = import_module(f"{self.package}.{part}").measure
        return measure

    def measured(
        self, parts: Sequence[str], bench: Bench, find: Callable[[str], Callable[[Bench], Figures] | None] | None = None
    ) -> tuple[dict[str, float | int | str], list[str]]:
        """Return the figures of some parts, and the problems: a part is missing, failed, or owes a key."""
        figures: dict[str, float | int | str] = {}
        faults: list[str] = []
        for part in parts:
            measure = (find or self.find)(part)
            if measure is None:
                faults.append(f"{part}: left out, it is not there yet")
                continue
            sys.stderr.write(f"{part} …\n")
            try:
                found = measure(bench)
            except LeftOut as reason:
                faults.append(f"{part}: left out: {reason}")
                continue
            except Exception as error:  # noqa: BLE001 - the boundary of a part: the others are measured all the same
                sys.stderr.write(traceback.format_exc())
                faults.append(f"{part}: failed: {error}")
                continue
            figures |= found
            faults += [f"{part}: {key} was not measured" for key in self.keys.get(part, ()) if key not in found]
        return figures, faults

    def run(
        self,
        title: str,
        parser: ArgumentParser,
        make: Callable[[Namespace, Path], Bench],
        broken: Callable[[Figures], Sequence[str]] | None = None,
    ) -> int:
        """Read the command line, measure the chosen parts, print the figures, and return the exit status.

        ``make`` returns the parts' input, from the options and an empty scratch folder. ``broken`` describes figures
        that must not occur. The status is 1 if a part is missing or failed, or if anything is broken.
        """
        parser.add_argument("--only", nargs="+", default=[], metavar="KEY", help="only these parts or keys")
        parser.add_argument("--json", action="store_true", help="print only the figures as JSON")
        given = parser.parse_args()
        try:
            parts = self.chosen(given.only)
        except ValueError as error:
            parser.error(str(error))
        with tempfile.TemporaryDirectory() as scratch:
            figures, faults = self.measured(parts, make(given, Path(scratch)))
        faults += broken(figures) if broken else ()
        for fault in faults:
            sys.stderr.write(f"{fault}\n")
        if given.json:
            sys.stdout.write(json.dumps(dict(figures)) + "\n")
        else:
            print_figures(title, figures, more_rows=[("!", fault) for fault in faults])
        return 1 if faults else 0


def part_options(text: str | None) -> ArgumentParser:
    """Return a parser of the command line that shows a module's docstring as it is written."""
    return ArgumentParser(description=text, formatter_class=RawDescriptionHelpFormatter)


@dataclass(frozen=True)
class SeededBench:
    """The input of the parts of a benchmark that draw their cases or take them from the shared folder.

    ``shared``: the folder that contains ``data``; ``scratch``: an empty folder that is deleted afterwards; ``seed``: of
    all draws (19 for development, 20 for reports); ``limit``: the number of cases per part, or None for all of them.
    """

    shared: Path
    scratch: Path
    seed: int = 20
    limit: int | None = None

    def folder(self, name: str) -> Path:
        """Create a folder in the scratch folder and return it."""
        folder = self.scratch / name
        folder.mkdir()
        return folder

    @classmethod
    def options(cls, text: str | None) -> ArgumentParser:
        """Return a parser with the options of these fields."""
        parser = part_options(text)
        parser.add_argument("--shared", type=Path, default=shared_folder(), help="folder that contains data/commonroad")
        parser.add_argument("--seed", type=int, default=20, help="seed of all draws (default: 20)")
        parser.add_argument("--limit", type=int, default=None, help="number of cases per part (a sample)")
        return parser

    @classmethod
    def of(cls, given: Namespace, scratch: Path) -> Self:
        """Return the parts' input, from the command line and a scratch folder."""
        return cls(existing(given.shared), scratch, given.seed, given.limit)
