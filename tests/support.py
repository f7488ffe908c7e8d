"""Types that tests share; importable because pytest's ``pythonpath`` holds this folder."""

from contextlib import AbstractAsyncContextManager
from typing import Protocol

from mcp import Client

from plannerforge.server.settings import Settings


class Connect(Protocol):
    """Opens a client session with a server."""

    def __call__(self, settings: Settings | None = None) -> AbstractAsyncContextManager[Client]: ...
