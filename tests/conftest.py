"""Fixtures that every part of the test suite uses."""

import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from mcp import Client
from support.server import Connect

from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings

CHECKOUT = Path(__file__).resolve().parent.parent


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


@pytest.fixture(autouse=True)
def _no_settings_of_the_machine(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in [name for name in os.environ if name.startswith("PLANNERFORGE_") and name != "PLANNERFORGE_SHARED"]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """Settings with a workspace of the test's own."""
    return Settings(workspace=tmp_path / "workspace", roots=(tmp_path,), workers=1, warm_up=False)


@pytest.fixture(params=["auto", "legacy"], ids=["2026-07-28", "initialize"])
def era(request: pytest.FixtureRequest) -> str:
    """Both protocol eras: the stateless revision and those that begin with ``initialize``."""
    return str(request.param)


@pytest.fixture
def connect(settings: Settings, era: str, tmp_path: Path) -> Connect:
    """A real client session with a server of these settings, in memory."""

    @asynccontextmanager
    async def session(other: Settings | None = None) -> AsyncIterator[Client]:
        server = create_server(other or settings, start_folder=tmp_path)
        async with Client(server, mode=era) as client:  # type: ignore[arg-type]
            yield client

    return session


@pytest.fixture
def importable_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets worker processes import ``support.worker_operations``, the operations that only tests have."""
    folders = [str(CHECKOUT / "tests"), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, folders)))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-snapshots", action="store_true", help="write the schema snapshots anew")
