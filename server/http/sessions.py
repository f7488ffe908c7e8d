"""Sessions of the protocol revisions that have them, limited per token.

A client of these revisions begins with ``initialize`` and gets a session, which it rarely ends. Each token has its own
limit, so that no token uses up the sessions of another. If a client exceeds the limit, its session that has been idle
longest ends. If all of them have requests in progress, the client must try again later.
"""

import time
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from mcp.server.streamable_http import MCP_SESSION_ID_HEADER
from mcp.shared.inbound import MCP_PROTOCOL_VERSION_HEADER
from mcp.types import INTERNAL_ERROR
from starlette.datastructures import Headers
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..asking import STATELESS_SINCE
from ..clients import principal_of

MOST_SESSIONS = 64
"""Maximum sessions of one token; a host has one per window. A session costs some 30 kB and a task."""
_WAIT_S = 1


@dataclass
class _Session:
    """A session: the time of its last use, and how many of its requests are in progress."""

    used_at: float
    under_way: int = 0


class BoundedSessions:
    """Passes requests to the SDK's endpoint, and ends sessions of a token that has too many.

    Args:
        endpoint: serves MCP over HTTP, with sessions.
        most: sessions of one token.
    """

    def __init__(self, endpoint: ASGIApp, most: int = MOST_SESSIONS) -> None:
        self._endpoint, self._most = endpoint, most
        self._by_owner: dict[str, OrderedDict[str, _Session]] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request."""
        headers, owner = Headers(scope=scope), principal_of(scope)
        session_id = headers.get(MCP_SESSION_ID_HEADER)
        if session_id is None and _begins_session(scope, headers) and not await self._has_room(owner, scope):
            reason = f"{self._most} sessions of this token have requests in progress; end one of them, or wait"
            error = {"code": INTERNAL_ERROR, "message": f"[http_503] {reason}."}
            body = {"jsonrpc": "2.0", "id": None, "error": error}
            await JSONResponse(body, 503, {"retry-after": str(_WAIT_S)})(scope, receive, send)
            return
        with self._used(owner, session_id):
            await self._endpoint(scope, receive, self._noting(owner, send, session_id))

    @contextmanager
    def _used(self, owner: str, session_id: str | None) -> Iterator[None]:
        session = self._by_owner.get(owner, OrderedDict()).get(session_id or "")
        if session is None:
            yield
            return
        session.under_way += 1
        try:
            yield
        finally:
            session.under_way -= 1
            session.used_at = time.monotonic()

    def _noting(self, owner: str, send: Send, session_id: str | None) -> Send:
        """Return a channel that records the session if a response starts one, and forgets it if a response says it is
        gone.
        """

        async def noting(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = Headers(raw=list(message.get("headers", []))).get(MCP_SESSION_ID_HEADER)
                if session_id is None and given is not None and message["status"] < 300:
                    self._by_owner.setdefault(owner, OrderedDict())[given] = _Session(time.monotonic())
                elif session_id is not None and message["status"] == 404:
                    self._forget(owner, session_id)
            await send(message)

        return noting

    async def _has_room(self, owner: str, scope: Scope) -> bool:
        """Return whether this token may begin a session; end the one that has been idle longest if necessary."""
        own = self._by_owner.get(owner, OrderedDict())
        while len(own) >= self._most:
            idle = [(session.used_at, session_id) for session_id, session in own.items() if not session.under_way]
            if not idle:
                return False
            _, oldest = min(idle)
            self._forget(owner, oldest)
            await self._end(oldest, scope)
        return True

    def _forget(self, owner: str, session_id: str) -> None:
        own = self._by_owner.get(owner)
        if own is not None:
            own.pop(session_id, None)
            if not own:
                del self._by_owner[owner]

    async def _end(self, session_id: str, scope: Scope) -> None:
        """End a session as its client would: with a DELETE and the same token."""
        replaced = (MCP_SESSION_ID_HEADER.encode(), b"content-length", b"transfer-encoding")
        kept = [(name, value) for name, value in scope["headers"] if name not in replaced]
        ended = {**scope, "method": "DELETE", "headers": [*kept, (MCP_SESSION_ID_HEADER.encode(), session_id.encode())]}

        async def nothing() -> Message:
            return {"type": "http.request", "body": b"", "more_body": False}

        async def ignore(message: Message) -> None:
            del message

        await self._endpoint(ended, nothing, ignore)


def _begins_session(scope: Scope, headers: Headers) -> bool:
    """Return whether a request without a session gets one: in protocol revisions with sessions, all of them do."""
    version = headers.get(MCP_PROTOCOL_VERSION_HEADER)
    return scope["method"] == "POST" and (version is None or version < STATELESS_SINCE)
