"""Fixtures that every part of the test suite uses."""

import gc
import inspect
import json
import os
import re
import shutil
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import asynccontextmanager
from itertools import count
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import psutil
import pytest
import sniffio
from hypothesis import HealthCheck
from hypothesis import settings as hypothesis_settings
from jsonschema import Draft202012Validator
from mcp import Client
from support.server import Connect, KeptWorkers, worker_processes

from plannerforge.engine.catalog import open_catalogue
from plannerforge.engine.execution import WorkerPool, pool
from plannerforge.engine.workspace import Workspace
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

CHECKOUT = Path(__file__).resolve().parent.parent
sys.dont_write_bytecode = False  # without bytecode every process compiles every test and the package anew:
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # half of what collecting costs, and .3 s for each program of a test
os.environ["PLANNERFORGE_MAPS_ONLINE"] = "offline"  # no test asks the net; those of online maps name loopback services
hypothesis_settings.register_profile(
    "any machine", max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
hypothesis_settings.load_profile("any machine")  # no test depends on how fast or busy the machine is


@pytest.fixture(scope="session")
def anyio_backend() -> str:
    return "asyncio"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real scenarios and maps, which is not part of the package."""
    folder = Path(os.environ.get("PLANNERFORGE_SHARED", CHECKOUT.parent / "shared"))
    if not (folder / "data").is_dir():
        pytest.skip("the real scenarios and maps are not here")
    return folder


@pytest.fixture(scope="session", autouse=True)
def _workers_import_what_they_need() -> None:
    """Let workers load a library only when an order needs it, because a test needs few of them."""
    pool.PRELOAD.update(dict.fromkeys(pool.PRELOAD, ()))


@pytest.fixture(scope="session", autouse=True)
def _each_schema_is_checked_once() -> Iterator[None]:
    """Let clients check an output schema once: every session checks those of its tools, which takes 60 ms each."""
    check, checked = Draft202012Validator.check_schema, set[str]()

    def check_once(schema: Any, **options: Any) -> None:
        if (text := json.dumps(schema, sort_keys=True)) not in checked:
            check(schema, **options)
            checked.add(text)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Draft202012Validator, "check_schema", staticmethod(check_once))
        yield


@pytest.fixture(scope="session")
def _folder_numbers() -> Iterator[int]:
    return count()


@pytest.fixture
def tmp_path(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, _folder_numbers: Iterator[int]
) -> Path:
    """A new folder; pytest's own finds a free number by reading the names of all before it, which are thousands."""
    name = re.sub(r"\W", "_", request.node.name)[:30]
    folder = tmp_path_factory.getbasetemp() / f"{name}_{next(_folder_numbers)}"
    folder.mkdir(mode=0o700)
    return folder


@pytest.fixture(autouse=True)
def _no_settings_of_the_machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in [name for name in os.environ if name.startswith("PLANNERFORGE_") and name != "PLANNERFORGE_SHARED"]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("PLANNERFORGE_MAPS_ONLINE", "offline")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


@pytest.fixture(autouse=True)
def _not_inside_a_loop(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let a synchronous test start an event loop although fixtures of a module keep one of theirs."""
    if inspect.iscoroutinefunction(getattr(request.node, "function", None)):
        yield
        return
    mark = sniffio.current_async_library_cvar.set(None)
    yield
    sniffio.current_async_library_cvar.reset(mark)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """Settings with a workspace for this test."""
    return Settings(workspace=tmp_path / "workspace", roots=(tmp_path,), workers=1, warm_up=False)


@pytest.fixture
def era() -> str:
    """The newer protocol era; tests of what differs between the eras are marked ``both_eras``."""
    return "auto"


@pytest.fixture(scope="session")
def kept_workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[KeptWorkers]:
    """Worker processes for the servers of all tests that examine answers, not processes."""
    with KeptWorkers.until_left(tmp_path_factory.mktemp("workers") / "workers.log") as kept:
        yield kept


@pytest.fixture
def warm_workers(kept_workers: KeptWorkers, monkeypatch: pytest.MonkeyPatch) -> None:
    """Warm workers for servers, which leave them warm; a module that counts or ends workers overrides this."""
    monkeypatch.setattr(WorkerPool, "open", kept_workers.lent)


@pytest.fixture
def connect(warm_workers: None, settings: Settings, era: str, tmp_path: Path) -> Connect:
    """A real client session in memory with a server of these settings."""

    @asynccontextmanager
    async def session(other: Settings | None = None, **options: Any) -> AsyncIterator[Client]:
        server = create_server(other or settings, start_folder=tmp_path)
        async with Client(server, mode=era, **options) as client:  # type: ignore[arg-type]
            yield client

    return session


@pytest.fixture
def own_workers() -> Callable[[], set[psutil.Process]]:
    """Returns the running workers of this process that did not run before the test."""
    before = worker_processes()
    return lambda: worker_processes() - before


@pytest.fixture(scope="session")
def starter_workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A read-only workspace with only the starter catalogue."""
    workspace = Workspace(tmp_path_factory.mktemp("starter") / "workspace")
    open_catalogue(workspace)
    workspace.close()
    return workspace.root


@pytest.fixture
def starter_ready(starter_workspace: Path, settings: Settings) -> None:
    """The starter catalogue in the test's workspace, linked, because artifacts are never rewritten."""

    def linked(source: str, target: str) -> str:
        if Path(source).parent == starter_workspace:  # the database
            shutil.copyfile(source, target)
        else:
            os.link(source, target)
        return target

    shutil.copytree(starter_workspace, settings.workspace, copy_function=linked)


@pytest.fixture(scope="session")
def other_process() -> Iterator[Executor]:
    """A process with another hash seed, for what may depend neither on the process nor on the order of sets."""
    with ProcessPoolExecutor(1, get_context("spawn")) as executor:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("PYTHONHASHSEED", "4242")
            assert executor.submit(hash, "word").result() != hash("word")
        yield executor


@pytest.fixture
def importable_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets worker processes import ``support.worker_operations``, the operations for tests only."""
    folders = [str(CHECKOUT / "tests"), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, folders)))


def pytest_collection_finish(session: pytest.Session) -> None:
    """Exclude imported objects from garbage collection and collect less often, which saves a fifth of the processor
    time.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 10, 10)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-snapshots", action="store_true", help="write the schema snapshots anew")
