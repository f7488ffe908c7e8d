"""The gate before MCP over HTTP: limits the size of requests, and their number and rate per client.

A client is a token here, or an address if tokens are not required. Each limit has its own answer that states the limit
and the setting that changes it; nothing is dropped silently.
"""

import json
import math
import time
from collections import OrderedDict
from dataclasses import dataclass

import anyio
from mcp.server.transport_security import TransportSecurityMiddleware, TransportSecuritySettings
from mcp.types import INTERNAL_ERROR, INVALID_REQUEST
from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ..clients import principal_of

_MOST_CLIENTS = 10_000
"""Clients with a remembered rate; chosen."""
_MOST_STREAMS = 16
"""Maximum open news streams of a client; chosen: a host needs one or two."""
BODY_TIMEOUT_S = 30.0
"""Time limit for the arrival of a body; chosen: a slower client would keep its place forever."""
_SHORT_BYTES, _MORE_SHORT = 1_000, 4
"""Maximum size of a body that may be a cancellation, and how many of them are accepted beyond the limit, so that a
client with all of its calls in progress can cancel one. Chosen.
"""
_LISTENING = {"subscriptions/listen"}
"""Requests that stay open and wait for news, like a GET in earlier revisions."""
_UNDECLARED = math.inf
_REFUSAL_TEXTS = {
    403: "this Origin is not allowed; if it is yours, add it to http_origins",
    421: "this Host is not allowed; if it is yours, add it to http_hosts",
}
"""Answers to a refusal by header: the SDK's own texts do not mention the settings."""


@dataclass(frozen=True)
class HttpLimits:
    """Limits on incoming requests.

    Args:
        body_bytes: largest request.
        calls: requests that one client may have in progress.
        per_s: requests of one client per second; twice as many at once.
    """

    body_bytes: int
    calls: int
    per_s: float


@dataclass
class _Client:
    """A client's requests in progress, and its remaining rate."""

    tokens: float
    filled_at: float
    calls: int = 0
    streams: int = 0


class Gate:
    """Passes requests to an ASGI application within limits; counts those in progress.

    Args:
        application: answers the accepted requests.
        limits: the limits.
        let_in: the accepted Host and Origin headers.
    """

    def __init__(self, application: ASGIApp, limits: HttpLimits, let_in: TransportSecuritySettings) -> None:
        self._application, self._limits = application, limits
        self._headers = TransportSecurityMiddleware(let_in)
        self._clients: OrderedDict[str, _Client] = OrderedDict()
        self._is_closing = False
        self._streams: set[anyio.CancelScope] = set()
        self._calls: set[anyio.CancelScope] = set()

    @property
    def is_open(self) -> bool:
        """Whether new requests are accepted."""
        return not self._is_closing

    async def close(self, patience_s: float) -> None:
        """Stop accepting requests, wait for the calls in progress, then end them and the news streams."""
        self._is_closing = True
        with anyio.move_on_after(patience_s):
            while self._calls:
                await anyio.sleep(0.05)
        for scope in (*self._calls, *self._streams):
            scope.cancel()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on."""
        if scope["type"] != "http":
            await self._application(scope, receive, send)
            return
        scope["headers"] = [(name, value.strip(b" \t")) for name, value in scope["headers"]]  # RFC 9110, 5.5
        headers = Headers(scope=scope)
        if refused := await self._refused_headers(scope):
            await refused.send(send)
            return
        is_stream = scope["method"] == "GET" or headers.get("mcp-method") in _LISTENING
        client = self._client(scope)
        refusal = self._refusal(client, is_stream=is_stream, is_short=_declared_bytes(headers) < _SHORT_BYTES)
        if refusal is not None:
            await refusal.send(send)
            return
        under_way, own = self._streams if is_stream else self._calls, anyio.CancelScope()
        under_way.add(own)
        self._count(client, 1, is_stream=is_stream)
        answer = _Answer(send)
        try:
            with own:
                body = await self._body(receive)
                if isinstance(body, _Refusal):
                    await body.send(send)
                    return
                await self._application(scope, _replayed(body, receive), answer.send)
            if own.cancelled_caught and not answer.has_begun:
                await _STOPPING.send(send)
        finally:
            under_way.discard(own)
            self._count(client, -1, is_stream=is_stream)

    async def _refused_headers(self, scope: Scope) -> "_Refusal | None":
        """Return why a request is refused for its Host, Origin or length, which are known before its body is read."""
        refused = await self._headers.validate_request(Request(scope))
        if refused is not None:
            return _Refusal(refused.status_code, _REFUSAL_TEXTS[refused.status_code])
        most = self._limits.body_bytes
        return _too_long(most) if _UNDECLARED > _declared_bytes(Headers(scope=scope)) > most else None

    def _client(self, scope: Scope) -> _Client:
        address = scope.get("client")
        key = principal_of(scope) or f"address {address[0] if address else ''}"
        now = time.monotonic()
        client = self._clients.setdefault(key, _Client(2 * self._limits.per_s, now))
        self._clients.move_to_end(key)
        if len(self._clients) > _MOST_CLIENTS:
            self._clients.popitem(last=False)
        client.tokens = min(2 * self._limits.per_s, client.tokens + (now - client.filled_at) * self._limits.per_s)
        client.filled_at = now
        return client

    def _refusal(self, client: _Client, *, is_stream: bool, is_short: bool) -> "_Refusal | None":
        if not self.is_open:
            return _STOPPING
        if client.tokens < 1.0:
            wait_s = max(1, round((1.0 - client.tokens) / self._limits.per_s))
            reason = f"more than {self._limits.per_s:g} requests per second; the setting http_rate changes the limit"
            return _Refusal(429, reason, wait_s)
        if is_stream and client.streams >= _MOST_STREAMS:
            return _Refusal(429, f"{_MOST_STREAMS} news streams are already open; close one first", 1)
        if not is_stream and client.calls >= self._limits.calls + (_MORE_SHORT if is_short else 0):
            reason = f"{self._limits.calls} requests are already in progress; the setting http_calls changes the limit"
            return _Refusal(429, reason, 1)
        client.tokens -= 1.0
        return None

    def _count(self, client: _Client, change: int, *, is_stream: bool) -> None:
        if is_stream:
            client.streams += change
        else:
            client.calls += change

    async def _body(self, receive: Receive) -> "bytes | _Refusal":
        """Return the whole body, or the reason why it is rejected."""
        most = self._limits.body_bytes
        body = bytearray()
        with anyio.move_on_after(BODY_TIMEOUT_S):
            while True:
                message = await receive()
                body += message.get("body", b"")
                if len(body) > most:
                    return _too_long(most)
                if message["type"] != "http.request" or not message.get("more_body", False):
                    return bytes(body)
        return _Refusal(408, f"the body did not arrive within {BODY_TIMEOUT_S:g} s; send it without pauses")


@dataclass(frozen=True)
class _Refusal:
    """The refusal of a request, as JSON-RPC, so that a client shows it like any other error."""

    status: int
    reason: str
    wait_s: int | None = None

    async def send(self, send: Send) -> None:
        code = INVALID_REQUEST if self.status < 500 else INTERNAL_ERROR
        error = {"code": code, "message": f"[http_{self.status}] {self.reason}."}
        body = json.dumps({"jsonrpc": "2.0", "id": None, "error": error}).encode()
        headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
        if self.wait_s is not None:
            headers.append((b"retry-after", str(self.wait_s).encode()))
        await send({"type": "http.response.start", "status": self.status, "headers": headers})
        await send({"type": "http.response.body", "body": body})


_STOPPING = _Refusal(503, "the server is stopping; jobs are kept, and continue when the same call is made again", 5)


def _too_long(most: int) -> _Refusal:
    return _Refusal(413, f"the request has more than {most:,} bytes; split it, or raise the setting http_body_mb")


@dataclass
class _Answer:
    """The answer of an application on its way to the client."""

    to_client: Send
    has_begun: bool = False

    async def send(self, message: Message) -> None:
        """Pass a message on, and record that an answer has started."""
        self.has_begun = self.has_begun or message["type"] == "http.response.start"
        await self.to_client(message)


def _declared_bytes(headers: Headers) -> float:
    """Return the declared length of a body; infinite if it is not declared."""
    declared = headers.get("content-length", "")
    return int(declared[:18]) if declared.isdecimal() else _UNDECLARED


def _replayed(body: bytes, receive: Receive) -> Receive:
    """Return a channel that first yields a body that was already received, and then everything after it."""
    waiting = [body]

    async def receive_again() -> Message:
        if waiting:
            return {"type": "http.request", "body": waiting.pop(), "more_body": False}
        return await receive()

    return receive_again
