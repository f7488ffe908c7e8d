"""How many sessions a token may hold, with the SDK's own session manager behind the bound."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import anyio
import httpx
import pytest
from mcp.server.auth.middleware.bearer_auth import AuthenticatedUser
from mcp.server.auth.provider import AccessToken
from mcp.server.lowlevel import Server
from mcp.server.streamable_http_manager import StreamableHTTPASGIApp, StreamableHTTPSessionManager
from starlette.types import Receive, Scope, Send

from plannerforge.server.http.sessions import BoundedSessions

pytestmark = pytest.mark.anyio
HEADERS = {"Content-Type": "application/json", "Accept": "application/json, text/event-stream"}
BEGIN = {
    "jsonrpc": "2.0",
    "id": 1,
    "method": "initialize",
    "params": {"protocolVersion": "2025-11-25", "capabilities": {}, "clientInfo": {"name": "raw", "version": "1"}},
}
PING = {"jsonrpc": "2.0", "id": 2, "method": "ping"}


@asynccontextmanager
async def client_of_two_sessions() -> AsyncIterator[httpx.AsyncClient]:
    """A client whose header ``X-Owner`` stands for its token; each token may hold two sessions."""
    manager = StreamableHTTPSessionManager(Server("probe"), json_response=True, max_sessions=None)
    bounded = BoundedSessions(StreamableHTTPASGIApp(manager), most=2)

    async def with_user(scope: Scope, receive: Receive, send: Send) -> None:
        owner = dict(scope["headers"]).get(b"x-owner", b"").decode()
        token = AccessToken(token="", client_id=owner, scopes=[])
        await bounded({**scope, "user": AuthenticatedUser(token)}, receive, send)

    async with manager.run():
        transport = httpx.ASGITransport(app=with_user)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1/mcp", headers=HEADERS) as client:
            yield client


async def begun(client: httpx.AsyncClient, owner: str) -> str:
    """The id of a new session; empty if there is none."""
    response = await client.post("", json=BEGIN, headers={"X-Owner": owner})
    return str(response.headers.get("mcp-session-id", "")) if response.status_code == 200 else ""


async def status_of(client: httpx.AsyncClient, owner: str, session: str) -> int:
    return (await client.post("", json=PING, headers={"X-Owner": owner, "Mcp-Session-Id": session})).status_code


async def test_new_session_ends_the_one_of_the_same_token_that_was_idle_longest() -> None:
    async with client_of_two_sessions() as client:
        first, second = await begun(client, "a"), await begun(client, "a")
        assert await status_of(client, "a", first) == 200
        third = await begun(client, "a")
        states = [await status_of(client, "a", session) for session in (first, second, third)]
    assert states == [200, 404, 200]


async def test_tokens_take_no_sessions_from_each_other() -> None:
    async with client_of_two_sessions() as client:
        own = await begun(client, "owner")
        for _ in range(10):
            assert await begun(client, "reader")
        assert await status_of(client, "owner", own) == 200


async def test_ended_session_makes_room() -> None:
    async with client_of_two_sessions() as client:
        first, second = await begun(client, "a"), await begun(client, "a")
        await client.delete("", headers={"X-Owner": "a", "Mcp-Session-Id": second})
        assert await status_of(client, "a", second) == 404
        assert await begun(client, "a")
        assert await status_of(client, "a", first) == 200


async def test_a_token_with_only_busy_sessions_learns_when_to_retry() -> None:
    bounded = BoundedSessions(slow_endpoint, most=1)
    statuses: list[tuple[int, bool]] = []

    async def send(message: dict[str, object]) -> None:
        if message["type"] == "http.response.start":
            names = [name for name, _ in message["headers"]]  # type: ignore[attr-defined]
            statuses.append((int(message["status"]), b"retry-after" in names))  # type: ignore[call-overload]

    async def request(*headers: tuple[bytes, bytes]) -> None:
        await bounded({"type": "http", "method": "POST", "headers": list(headers)}, nothing, send)  # type: ignore[arg-type]

    await request()
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(request, (b"mcp-session-id", b"one"))
        await anyio.sleep(0)
        await request()
        tasks.cancel_scope.cancel()
    assert statuses == [(200, False), (503, True)]


async def slow_endpoint(scope: Scope, receive: Receive, send: Send) -> None:
    """Give a session to a request without one; never end a request of a session."""
    del receive
    if any(name == b"mcp-session-id" for name, _ in scope["headers"]):
        await anyio.sleep_forever()
    await send({"type": "http.response.start", "status": 200, "headers": [(b"mcp-session-id", b"one")]})


async def nothing() -> dict[str, object]:
    return {"type": "http.request", "body": b"", "more_body": False}
