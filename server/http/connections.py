"""The connections of MCP over HTTP: limits on the data outside of bodies, and on its duration.

A client authenticates itself in the head of a request. Until the head is complete, it is a stranger, so a head is
cheap: its bytes, lines and time are limited, and so is everything between and after the parts of a body (sizes of
chunks, their extensions, trailers). Uvicorn's protocol on httptools has none of these limits.

Descriptors are limited too. If they run short, the connection that has waited longest for its next request is closed,
so that an idle client gives way to an active client.
"""

import asyncio
import logging
import math
import sys
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from uvicorn.config import Config
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol
from uvicorn.server import ServerState

from . import access

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ConnectionLimits:
    """Limits of a connection's data outside of bodies, in bytes, lines and seconds, and of the number of connections.

    Args:
        head_bytes: request line and headers together. Uvicorn's limit for its other protocol, h11.
        head_lines: lines of headers, or of trailers. Apache's ``LimitRequestFields``.
        head_s: time for a whole head, from its first byte or from the start of the connection. Apache's
            ``RequestReadTimeout header=20``.
        framing_bytes: bytes of a chunked body that are not content, more than twelve for each byte of content.
        linger_s: time for which the rest of a body is read after its answer, so that the client can read the answer.
            nginx's ``lingering_timeout``.
        connections: maximum simultaneous connections.
    """

    head_bytes: int = 65_536
    head_lines: int = 100
    head_s: float = 20.0
    framing_bytes: int = 65_536
    linger_s: float = 5.0
    connections: int = 1_024

    @classmethod
    def for_descriptors(cls) -> "ConnectionLimits":
        """Return limits for the connections that leave a quarter of this process's descriptors to files and workers."""
        return cls(connections=max(16, min(cls.connections, 3 * _most_descriptors() // 4)))


_CHUNK_BYTES = 12
"""Framing bytes for each byte of content: a chunk of one byte has five, and sizes may have leading zeros."""


def _most_descriptors() -> int:
    if sys.platform == "win32":
        return 512  # limit of the C runtime
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return sys.maxsize if soft == resource.RLIM_INFINITY else soft


class Connections:
    """The open connections of one server; creates the protocol of each.

    Args:
        limits: the limits of each connection, and of their number.
    """

    def __init__(self, limits: ConnectionLimits) -> None:
        self._limits = limits
        self._open: set[BoundedProtocol] = set()
        self._waiting: OrderedDict[BoundedProtocol, None] = OrderedDict()

    def protocol(
        self,
        config: Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> "BoundedProtocol":
        """Return the protocol of a new connection; uvicorn calls this like a protocol's class."""
        return BoundedProtocol(config, server_state, app_state, _loop, limits=self._limits, connections=self)

    def opened(self, connection: "BoundedProtocol") -> None:
        """Count a connection; if there are too many, close the one that has waited longest for a request."""
        self._open.add(connection)
        if len(self._open) > self._limits.connections:
            oldest = next(iter(self._waiting), connection)
            logger.warning("%d connections are open: the one that was idle longest is closed", len(self._open))
            oldest.abandon()
        if connection in self._open:
            self.waits(connection)

    def waits(self, connection: "BoundedProtocol") -> None:
        """Record that a connection has no request in progress."""
        if connection in self._open:
            self._waiting[connection] = None
            self._waiting.move_to_end(connection)

    def works(self, connection: "BoundedProtocol") -> None:
        """Record that a connection has a request in progress."""
        self._waiting.pop(connection, None)

    def closed(self, connection: "BoundedProtocol") -> None:
        """Remove a connection."""
        self._open.discard(connection)
        self._waiting.pop(connection, None)


class BoundedProtocol(HttpToolsProtocol):
    """Uvicorn's protocol with limits; a client that exceeds one gets 400, 408 or 431, and the connection closes."""

    def __init__(
        self,
        config: Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
        *,
        limits: ConnectionLimits,
        connections: Connections,
    ) -> None:
        super().__init__(config, server_state, app_state, _loop)
        self._limits, self._all = limits, connections
        self._in_head = self._is_complete = True
        self._head_bytes = self._lines = self._framing_bytes = 0
        self._deadline: asyncio.TimerHandle | None = None
        self._linger: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start to wait for the first head."""
        super().connection_made(transport)
        self._await_head()
        self._all.opened(self)

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection and its timers."""
        self._all.closed(self)
        self._stop_timers()
        super().connection_lost(exc)

    def abandon(self) -> None:
        """Close the connection immediately."""
        self._all.closed(self)
        self._stop_timers()
        self.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Parse the received data, unless it exceeds a limit."""
        if self.transport.is_closing():
            return
        if self._in_head:
            self._head_bytes += len(data)
            self._await_head()
        else:
            self._framing_bytes += len(data)
        super().data_received(data)
        if self.transport.is_closing():
            return
        if self._in_head and self._head_bytes > self._limits.head_bytes:
            self._refuse(431, f"the head of the request has more than {self._limits.head_bytes:,} bytes")
        elif self._lines > self._limits.head_lines:
            self._refuse(431, f"the request has more than {self._limits.head_lines} lines of headers")
        elif not self._in_head and self._framing_bytes > self._limits.framing_bytes:
            self._refuse(400, f"the body has more than {self._limits.framing_bytes:,} bytes that are not content")
        elif len(self.pipeline) > 1:
            self._refuse(400, "the client sends requests without waiting for answers")

    def on_message_begin(self) -> None:
        """Start a head."""
        super().on_message_begin()
        self._in_head, self._is_complete = True, False
        self._lines = 0

    def on_header(self, name: bytes, value: bytes) -> None:
        """Accept a header; trailers, which come after a body, are counted and dropped."""
        self._lines += 1
        if self._in_head and self._lines <= self._limits.head_lines:
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """Start the request, if its head is within the limits."""
        self._in_head = False
        self._head_bytes = self._framing_bytes = 0
        self._stop_timers()
        if self._lines <= self._limits.head_lines:
            self._all.works(self)
            super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Accept a part of a body; after the answer, drop it."""
        self._framing_bytes -= (1 + _CHUNK_BYTES) * len(body)
        if self.cycle is not None:
            super().on_body(body)

    def on_message_complete(self) -> None:
        """End the request's part of the exchange."""
        self._in_head = self._is_complete = True
        if self.cycle is not None:
            super().on_message_complete()

    def on_response_complete(self) -> None:
        """Wait for the next request; if the body of this request is still arriving, only for a while."""
        super().on_response_complete()
        if self.transport.is_closing() or self.pipeline:
            return
        if self._is_complete:
            self._all.waits(self)
        elif self._linger is None:
            self._linger = self.loop.call_later(self._limits.linger_s, self.abandon)

    def _await_head(self) -> None:
        if self._deadline is None:
            self._deadline = self.loop.call_later(self._limits.head_s, self._late)

    def _late(self) -> None:
        self._deadline = None
        if self.cycle is not None and not self.cycle.response_complete:
            self._await_head()  # the previous answer is sent first
        elif self._head_bytes:
            self._refuse(408, f"the head of the request did not arrive within {self._limits.head_s:g} s")
        else:
            self.abandon()

    def _stop_timers(self) -> None:
        for timer in (self._deadline, self._linger):
            if timer is not None:
                timer.cancel()
        self._deadline = self._linger = None

    def _refuse(self, status: int, text: str) -> None:
        """Answer, unless an answer is already being sent on this connection, and close."""
        self._stop_timers()
        if self.transport.is_closing():
            return
        if self.cycle is None or self.cycle.response_complete:
            body = f"{text}\n".encode()
            reason = {400: "Bad Request", 408: "Request Timeout", 431: "Request Header Fields Too Large"}[status]
            lines = (
                f"HTTP/1.1 {status} {reason}",
                "content-type: text/plain; charset=utf-8",
                f"content-length: {len(body)}",
                "connection: close",
            )
            self.transport.write("\r\n".join((*lines, "", "")).encode() + body)
        self.transport.close()


class _OncePerSecond(logging.Filter):
    """Limits each log statement to one record per second; its next record states how many were dropped.

    Strangers choose the content of messages (a Host, the id of a key), so the position in the code identifies a
    statement.

    Args:
        clock: returns seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._at: dict[tuple[str, int], float] = {}
        self._left_out: dict[tuple[str, int], int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether the record is written."""
        key, now = (record.pathname, record.lineno), self._clock()
        if now - self._at.get(key, -math.inf) < 1.0:
            self._left_out[key] = self._left_out.get(key, 0) + 1
            return False
        self._at[key] = now
        left_out = self._left_out.pop(key, 0)
        if left_out:
            record.msg, record.args = f"{record.getMessage()} ({left_out} similar ones dropped)", None
        return True


_NOISY = (
    *("asyncio", "uvicorn.error", __name__, access.__name__),
    *("mcp.server.transport_security", "mcp.server.streamable_http_manager", "mcp.server.auth.middleware.bearer_auth"),
)
"""Loggers through which a stranger can cause any number of records."""


@contextmanager
def calm_logs(clock: Callable[[], float] = time.monotonic) -> Iterator[None]:
    """Limit each message that a stranger can cause to one per second, within the block."""
    once = _OncePerSecond(clock)
    loggers = [logging.getLogger(name) for name in _NOISY]
    for each in loggers:
        each.addFilter(once)
    try:
        yield
    finally:
        for each in loggers:
            each.removeFilter(once)
