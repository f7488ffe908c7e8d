"""Servers over HTTP and in both protocol eras, with small probe tools next to the real ones."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from support.http_serving import Serve, Served, served
from support.probes import EchoArguments, probe_tools
from support.server import ERA_NAMES, ERAS

from plannerforge.schemas.base import Arguments
from plannerforge.server.settings import Settings

__all__ = ["probe_tools"]


@pytest.fixture(params=ERAS, ids=ERA_NAMES)
def era(request: pytest.FixtureRequest) -> str:
    """Both protocol eras of the server."""
    return str(request.param)


@pytest.fixture
def echo_arguments() -> type[Arguments]:
    """Arguments of every shape that tools have."""
    return EchoArguments


@pytest.fixture
def serve(settings: Settings, tmp_path: Path) -> Serve:
    """Starts servers over HTTP on the test's workspace."""

    @asynccontextmanager
    async def started(**changes: Any) -> AsyncIterator[Served]:
        async with served(settings.model_copy(update=changes), tmp_path) as one:
            yield one

    return started
