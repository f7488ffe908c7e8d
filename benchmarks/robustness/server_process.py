"""A server for hostile inputs: a process over stdio with a real client, in watched folders."""

import contextlib
import os
import shutil
import statistics
import sys
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import anyio
import psutil
from mcp import Client, StdioServerParameters, stdio_client

from ..faults.http_process import http_client, listening
from .judges import CANARY_TEXT, memory_mb, peak_memory_mb

_MOST_MEMORY_MB = 1500.0
"""Memory limit of the server, because the machine is shared (chosen)."""
_MEMORY_EVERY_S = 0.02
_PING_EVERY_S = 0.03
"""Intervals between memory samples and between two cheap calls (chosen)."""
_ENDS_WITHIN_S = 3.0
"""Time within which a process must end after its connection closed (chosen)."""
_HTTP_RATE = 10_000
"""Allowed HTTP requests per second, high enough that this limit is not under test (chosen)."""
_SILENT_S = 15.0
"""A server that does not answer a cheap call for this long hangs and is killed (chosen)."""


@dataclass(frozen=True)
class Folders:
    """The folders of a bench's server: what it may use, what it keeps, and what must not be touched."""

    base: Path

    @property
    def root(self) -> Path:
        """The folder that it may read and write."""
        return self.base / "root"

    @property
    def workspace(self) -> Path:
        """The folder that it keeps."""
        return self.base / "workspace"

    @property
    def outside(self) -> Path:
        """A folder next to the ones that it may use."""
        return self.base / "outside"

    @property
    def home(self) -> Path:
        """The home folder that it is given."""
        return self.base / "home"

    def make(self, template: "Folders | None" = None) -> "Folders":
        """Make them, with a copy of another one's workspace and root."""
        for folder in (self.outside / "deep", self.home):
            folder.mkdir(parents=True)
        for path in (self.outside / "secret.xml", self.outside / "deep" / "secret.yaml", self.home / "secret.txt"):
            path.write_text(f"<a>{CANARY_TEXT}</a>")
        for name in ("root", "workspace"):
            if template is not None:
                shutil.copytree(template.base / name, self.base / name, symlinks=True)
            else:
                (self.base / name).mkdir()
        return self


@dataclass(frozen=True)
class Program:
    """A server, and how clients speak to it.

    Args:
        arguments: those after the interpreter that start it in its folders; one of them names the workspace.
        by_http: it takes ``--http`` too, and tells its address on standard error; else standard input and output.
    """

    arguments: Callable[[Folders], Sequence[str]]
    by_http: bool = False


def plannerforge_server(*, by_http: bool = False) -> Program:
    """Return the server under test."""
    serve = ("-m", "plannerforge", "serve")
    return Program(
        lambda folders: [*serve, "--workspace", str(folders.workspace), "--roots", str(folders.root)], by_http
    )


@dataclass(frozen=True)
class Ping:
    """A cheap call: when it was sent and answered on the monotonic clock, and how much of it was not the server's.

    ``queued_s``: while it was under way, the server's main thread stood ready without getting a core, or this client
    did or was busy itself.
    """

    sent: float
    answered: float
    queued_s: float

    @property
    def wait_s(self) -> float:
        """The waiting time of the ping."""
        return max(0.0, self.answered - self.sent - self.queued_s)


class Session:
    """A running server and its client, which keeps asking it cheap things."""

    def __init__(self, client: Client, process: psutil.Process) -> None:
        self.client, self.process = client, process
        self._pings: list[Ping] = []
        self._sent: tuple[float, float] | None = None
        self.peak_mb = 0.0
        self.death = ""
        self.is_closed = False

    @property
    def is_alive(self) -> bool:
        """True if the process runs."""
        try:
            return not self.death and self.process.is_running() and self.process.status() != psutil.STATUS_ZOMBIE
        except psutil.NoSuchProcess:
            return False

    async def has_ended(self) -> bool:
        """Return True if the server has ended; kill a process that outlives its closed connection."""
        if self.is_closed:
            with anyio.move_on_after(_ENDS_WITHIN_S):
                while self.is_alive:
                    await anyio.sleep(0.02)
            if self.is_alive:
                self.kill("it closed the connection")
        return not self.is_alive

    def kill(self, why: str) -> None:
        """End the server."""
        self.death = self.death or why
        try:
            self.process.kill()
        except psutil.NoSuchProcess:
            return

    def forget_peak(self) -> None:
        """Measure the most memory from now on."""
        with contextlib.suppress(OSError):
            Path(f"/proc/{self.process.pid}/clear_refs").write_text("5")
        self.peak_mb = 0.0

    async def ping(self) -> None:
        """Send one cheap call and keep how long it took, however it ended.

        Raises:
            TimeoutError: the server hangs; it was ended.
        """
        self._sent = time.monotonic(), _queued_s(self.process.pid)
        try:
            with anyio.fail_after(_SILENT_S):
                await self.client.list_resource_templates()
        except TimeoutError:
            self.kill(f"it answered nothing for {_SILENT_S:g} s")
            raise
        finally:
            self._pings.append(self._until_now(*self._sent))
            self._sent = None

    def blocked_ms(self, begin: float) -> float:
        """Return the longest wait for a cheap call since a time, including one still in progress."""
        pings = [ping for ping in self._pings if ping.answered >= begin]
        if self._sent is not None:
            pings.append(self._until_now(*self._sent))
        return 1000 * max((ping.wait_s for ping in pings), default=0.0)

    def idle_ms(self) -> float:
        """Return the median wait for a cheap call so far, and forget the earlier ones."""
        waits = [ping.wait_s for ping in self._pings]
        self._pings = []
        return 1000 * statistics.median(waits or [0.0])

    def _until_now(self, sent: float, queued_s: float) -> Ping:
        return Ping(sent, time.monotonic(), max(0.0, _queued_s(self.process.pid) - queued_s))


@asynccontextmanager
async def session(folders: Folders, log: Path, program: Program) -> AsyncIterator[Session]:
    """Start a server and keep asking it cheap things and watching its memory until the block ends."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PLANNERFORGE_")}
    environment |= {"HOME": str(folders.home), "XDG_CONFIG_HOME": str(folders.home), "PLANNERFORGE_WARM_UP": "true"}
    environment |= {"PLANNERFORGE_MAPS_ONLINE": "offline", "PLANNERFORGE_HTTP_RATE": str(_HTTP_RATE)}
    connect = _by_http if program.by_http else _by_stdio
    async with connect(folders, log, program, environment) as (client, process):
        running = Session(client, process)
        with _memory_watched(running):
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(_keep_pinging, running)
                await client.call_tool("find_scenarios", {"text": "merge"})  # its model takes seconds to load
                running.idle_ms()
                yield running
                tasks.cancel_scope.cancel()


@asynccontextmanager
async def _by_stdio(
    folders: Folders, log: Path, program: Program, environment: dict[str, str]
) -> AsyncIterator[tuple[Client, psutil.Process]]:
    arguments = list(program.arguments(folders))
    server = StdioServerParameters(command=sys.executable, args=arguments, env=environment, cwd=str(folders.root))
    with log.open("a") as errors:
        async with Client(stdio_client(server, errlog=errors), cache=None) as client:
            yield client, _server_process(folders.workspace)


@asynccontextmanager
async def _by_http(
    folders: Folders, log: Path, program: Program, environment: dict[str, str]
) -> AsyncIterator[tuple[Client, psutil.Process]]:
    arguments = (*program.arguments(folders), "--http")
    with listening(arguments, folders.root, environment, log) as server:
        async with http_client(server.url) as client:
            yield client, server.process


def _server_process(workspace: Path) -> psutil.Process:
    for child in psutil.Process().children():
        if str(workspace) in child.cmdline():
            return child
    raise RuntimeError("the server ended at its start")


async def _keep_pinging(running: Session) -> None:
    while running.is_alive:
        try:
            await running.ping()
        except Exception:  # noqa: BLE001 - however a connection ends, the process is looked at
            await anyio.sleep(0.2)
        await anyio.sleep(_PING_EVERY_S)


def _queued_s(pid: int) -> float:
    """Return how long a process's main thread was ready without a core, and how long this one has or has run."""
    try:
        server, own = (Path(f"/proc/{each}/task/{each}/schedstat").read_text().split() for each in (pid, os.getpid()))
    except OSError:
        return 0.0
    return (int(server[1]) + int(own[0]) + int(own[1])) / 1e9


@contextmanager
def _memory_watched(running: Session) -> Iterator[None]:
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(_MEMORY_EVERY_S):
            running.peak_mb = max(running.peak_mb, peak_memory_mb(running.process.pid))
            held = memory_mb(running.process.pid)
            if held > _MOST_MEMORY_MB:
                running.kill(f"it held {held:,.0f} MB and was ended")

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
