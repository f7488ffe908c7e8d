"""Handles messages on standard input that the SDK cannot read: limits their length, and answers them.

The SDK's parser silently drops a number with thousands of digits, nested lists or half a message. A client that waits
for an answer would wait forever.
"""

import json
import logging
import re
from contextlib import suppress
from types import TracebackType
from typing import Any, Protocol

import anyio
from mcp.shared.message import SessionMessage
from mcp.types import INVALID_REQUEST, PARSE_ERROR, ErrorData, JSONRPCError
from pydantic import ValidationError

from ...schemas.text import one_line

logger = logging.getLogger(__name__)
LONGEST_MESSAGE = 4 * 1024**2
"""Maximum characters of a message; chosen: the longest arguments that tools accept have half as many."""
_SEARCHED = 1_000_000
"""Characters in which the id of a request is searched; chosen: parameters rarely come before it."""
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*+"?|[{}\[\]]', re.DOTALL)
_ID = re.compile(r'"id"\s*:\s*("(?:[^"\\]|\\.){0,200}+"|-?\d{1,18}(?=\s*[,}]))')
_METHOD = re.compile(r'"method"\s*:')


class Incoming(Protocol):
    """A stream of messages, with an exception in place of an unreadable message."""

    async def receive(self) -> SessionMessage | Exception:
        """Return the next message or exception."""

    async def aclose(self) -> None:
        """Close the stream."""


class Outgoing(Protocol):
    """A stream of messages to the client."""

    async def send(self, item: SessionMessage, /) -> None:
        """Send a message."""


class ReadableMessages:
    """The readable messages of a stream; the sender of any other message gets an error.

    An error needs the id of the request. If there is no id, or if it was not a request, a line is logged.
    """

    def __init__(self, incoming: Incoming, outgoing: Outgoing) -> None:
        self._incoming, self._outgoing = incoming, outgoing

    async def receive(self) -> SessionMessage | Exception:
        """Return the next message.

        Raises:
            anyio.EndOfStream: there are no more.
        """
        while isinstance(item := await self._incoming.receive(), Exception):
            await self._report_unreadable(item)
        return item

    async def aclose(self) -> None:
        """Close the stream."""
        await self._incoming.aclose()

    @property
    def last_context(self) -> Any:
        """The context of the last message's sender, which the SDK needs."""
        return getattr(self._incoming, "last_context", None)

    def __aiter__(self) -> "ReadableMessages":
        return self

    async def __anext__(self) -> SessionMessage | Exception:
        try:
            return await self.receive()
        except anyio.EndOfStream:
            raise StopAsyncIteration from None

    async def __aenter__(self) -> "ReadableMessages":
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.aclose()

    async def _report_unreadable(self, raised: Exception) -> None:
        error = await anyio.to_thread.run_sync(unreadable, raised)
        if error is None:
            logger.warning("a message could not be read: %s", one_line(str(raised)))
            return
        with suppress(anyio.ClosedResourceError, anyio.BrokenResourceError):
            await self._outgoing.send(SessionMessage(error))


def unreadable(raised: Exception) -> JSONRPCError | None:
    """Return the answer to an unreadable request, or None if no request can be found."""
    if not isinstance(raised, ValidationError):
        return None
    (problem, *_) = raised.errors(include_url=False)
    given = problem["input"]
    if isinstance(given, str) and problem["type"] == "json_invalid":
        request_id, code = _request_id(given), PARSE_ERROR
        cause = f"more than {LONGEST_MESSAGE:,} characters" if len(given) >= LONGEST_MESSAGE else problem["msg"]
    else:
        request_id = given.get("id") if isinstance(given, dict) and "method" in given else None
        code, cause = INVALID_REQUEST, "not a JSON-RPC 2.0 request"
    if isinstance(request_id, bool) or not isinstance(request_id, int | str):
        return None
    valid = f"JSON-RPC 2.0 of at most {LONGEST_MESSAGE:,} characters, not nested deeply"
    message = f"the message cannot be read: {one_line(cause)}. Valid: {valid}. Next: shorten it, or split it."
    return JSONRPCError(jsonrpc="2.0", id=request_id, error=ErrorData(code=code, message=message))


def _request_id(line: str) -> int | str | None:
    """Return the id at the top level of a request that is not JSON, or is JSON beyond a parser's limits."""
    line, depth = line[:_SEARCHED], 0
    found: int | str | None = None
    is_request = False
    for token in _TOKEN.finditer(line):
        if token[0] in "{[":
            depth += 1
        elif token[0] in "}]":
            depth -= 1
        elif depth == 1 and (match := _ID.match(line, token.start())):
            found = _value(match[1])
        elif depth == 1:
            is_request = is_request or _METHOD.match(line, token.start()) is not None
        if is_request and found is not None:
            return found
    return None


def _value(text: str) -> int | str | None:
    try:
        value: int | str = json.loads(text)
    except ValueError:  # an invalid escape
        return None
    return value
