"""An HTTP server on a free port of this machine, in the test's own event loop, and its clients."""

import json
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio
import httpx
import httpx2
from mcp import Client
from mcp.client.streamable_http import streamable_http_client

from plannerforge.server.assembly import create_server
from plannerforge.server.http.pages.application import Pages
from plannerforge.server.http.serving import HttpServer, bound
from plannerforge.server.settings import Settings

PATIENCE_S = 60.0
WRITER, READER = "w" * 32, "r" * 32
"""Two tokens, as clients send them."""


@dataclass(frozen=True)
class Served:
    """A running server and its address."""

    server: HttpServer
    address: str

    @property
    def url(self) -> str:
        """The address of MCP."""
        return f"{self.address}/mcp"

    @asynccontextmanager
    async def client(self, mode: str, token: str = "", source: str = "", **options: object) -> AsyncIterator[Client]:
        """Return a client of the protocol; ``source`` is its own address."""
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        sender = httpx2.AsyncHTTPTransport(local_address=source or None)
        async with httpx2.AsyncClient(headers=headers, timeout=httpx2.Timeout(PATIENCE_S), transport=sender) as http:
            transport = streamable_http_client(self.url, http_client=http)
            async with Client(transport, mode=mode, **options) as client:  # type: ignore[arg-type]
                yield client


@asynccontextmanager
async def served(settings: Settings, folder: Path, pages: Pages | None = None) -> AsyncIterator[Served]:
    """Run a server until the block ends, with pages if given."""
    http = HttpServer(create_server(settings, start_folder=folder), settings, pages)
    with bound("127.0.0.1", 0) as listener:
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(http.serve, listener)
            address = f"http://127.0.0.1:{listener.getsockname()[1]}"
            await _until_it_answers(address)
            try:
                yield Served(http, address)
            finally:
                http.stop()


Serve = Callable[..., AbstractAsyncContextManager[Served]]
"""Starts a server of the test's settings with some of them changed."""


async def _until_it_answers(address: str) -> None:
    with anyio.fail_after(PATIENCE_S):
        async with httpx.AsyncClient() as client:
            while True:
                try:
                    await client.get(f"{address}/health")
                except httpx.HTTPError:
                    await anyio.sleep(0.02)
                else:
                    return


async def post(server: Served, body: Any, headers: dict[str, str], **more: str) -> httpx.Response:
    """Return the answer to a request with additional headers."""
    async with httpx.AsyncClient(timeout=PATIENCE_S) as client:
        content = body if isinstance(body, bytes) else json.dumps(body).encode()
        return await client.post(server.url, content=content, headers={**headers, **more})


def called(tool: str, **arguments: object) -> tuple[dict[str, object], dict[str, str]]:
    """Return body and headers of a tool call in the stateless revision."""
    meta = {
        "io.modelcontextprotocol/protocolVersion": "2026-07-28",
        "io.modelcontextprotocol/clientInfo": {"name": "raw", "version": "1"},
        "io.modelcontextprotocol/clientCapabilities": {},
    }
    body: dict[str, object] = {
        "jsonrpc": "2.0",
        "id": 1,
        "method": "tools/call",
        "params": {"name": tool, "arguments": arguments, "_meta": meta},
    }
    headers = {
        "Content-Type": "application/json",
        "Accept": "application/json, text/event-stream",
        "MCP-Protocol-Version": "2026-07-28",
        "Mcp-Method": "tools/call",
        "Mcp-Name": tool,
    }
    return body, headers
