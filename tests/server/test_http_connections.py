"""What a client may send around a body, and how long it may take: a plain application behind the bounded protocol."""

import logging
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

import anyio
import pytest
import uvicorn
from anyio.abc import ByteStream
from starlette.types import Receive, Scope, Send

from plannerforge.server.http.connections import ConnectionLimits, Connections, calm_logs

pytestmark = pytest.mark.anyio
PATIENCE_S = 30.0
HEAD = b"POST /echo HTTP/1.1\r\nHost: 127.0.0.1\r\n"


async def echo(scope: Scope, receive: Receive, send: Send) -> None:
    """Answer with the body, or at once if the path says so; headers are counted."""
    body = b""
    if scope["path"] != "/at-once":
        while True:
            message = await receive()
            body += message.get("body", b"")
            if not message.get("more_body", False):
                break
    headers = [(b"content-length", str(len(body)).encode()), (b"x-lines", str(len(scope["headers"])).encode())]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": body})


@dataclass(frozen=True)
class Listening:
    """A server that runs, and its port."""

    port: int

    @asynccontextmanager
    async def connected(self) -> AsyncIterator[ByteStream]:
        async with await anyio.connect_tcp("127.0.0.1", self.port) as stream:
            yield stream

    async def answer(self, sent: bytes) -> bytes:
        """All that comes back until the server closes the connection."""
        async with self.connected() as stream:
            return await exchanged(stream, sent)


async def exchanged(stream: ByteStream, sent: bytes) -> bytes:
    """What comes back until the server closes; a server that closes early takes only a part of what is sent."""
    taken = b""
    with anyio.fail_after(PATIENCE_S):
        try:
            await stream.send(sent)
            while True:
                taken += await stream.receive()
        except (anyio.EndOfStream, anyio.BrokenResourceError):
            return taken


async def received(stream: ByteStream, end: bytes) -> bytes:
    """What comes back until it ends so."""
    taken = b""
    with anyio.fail_after(PATIENCE_S):
        while not taken.endswith(end):
            taken += await stream.receive()
    return taken


@asynccontextmanager
async def listening(limits: ConnectionLimits) -> AsyncIterator[Listening]:
    """The application behind these limits, on a free port."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        config = uvicorn.Config(
            echo,
            lifespan="off",
            ws="none",
            log_config=None,
            http=Connections(limits).protocol,  # type: ignore[arg-type]
            timeout_graceful_shutdown=1,
        )
        server = uvicorn.Server(config)
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(server._serve, [listener])
            try:
                yield Listening(listener.getsockname()[1])
            finally:
                server.should_exit = True


async def test_request_within_the_limits_is_answered_and_its_connection_kept() -> None:
    async with listening(ConnectionLimits()) as server, server.connected() as stream:
        for _ in range(2):
            await stream.send(HEAD + b"Content-Length: 3\r\n\r\nabc")
            await received(stream, b"abc")


@pytest.mark.parametrize(
    ("sent", "status"),
    [
        (HEAD + b"X-A: " + b"a" * 90_000, b"431"),
        (b"GET /" + b"a" * 90_000, b"431"),
        (HEAD + b"".join(b"X-%d: 1\r\n" % number for number in range(101)) + b"\r\n", b"431"),
        (HEAD + b"".join(b"X-%d: 1\r\n" % number for number in range(5_000)), b"431"),
    ],
    ids=["one long header", "a long address", "a complete head of many lines", "many lines without an end"],
)
async def test_head_beyond_a_limit_is_refused_and_its_connection_closed(sent: bytes, status: bytes) -> None:
    async with listening(ConnectionLimits()) as server:
        answer = await server.answer(sent)
        assert answer.split(b" ")[1] == status
        assert b"connection: close" in answer


@pytest.mark.parametrize(
    "piece", [b"3;" + b"x" * 900 + b"\r\nabc\r\n", b"0" * 900 + b"3\r\nabc\r\n"], ids=["extension", "size"]
)
async def test_chunks_that_are_mostly_framing_are_refused(piece: bytes) -> None:
    async with listening(ConnectionLimits(framing_bytes=8_192)) as server:
        answer = await server.answer(HEAD + b"Transfer-Encoding: chunked\r\n\r\n" + piece * 400)
        assert answer.split(b" ")[:2] != [b"HTTP/1.1", b"200"]


async def test_chunks_of_one_byte_are_taken() -> None:
    async with listening(ConnectionLimits(framing_bytes=1_024)) as server, server.connected() as stream:
        await stream.send(HEAD + b"Transfer-Encoding: chunked\r\n\r\n" + b"1\r\nx\r\n" * 3_000 + b"0\r\n\r\n")
        await received(stream, b"x" * 3_000)


async def test_trailers_are_not_headers_and_too_many_are_refused() -> None:
    body = HEAD + b"Transfer-Encoding: chunked\r\n\r\n0\r\n"
    async with listening(ConnectionLimits()) as server:
        async with server.connected() as stream:
            await stream.send(body + b"Authorization: x\r\n\r\n")
            assert b"x-lines: 2" in await received(stream, b"\r\n\r\n")
        answer = await server.answer(body + b"".join(b"X-%d: 1\r\n" % number for number in range(5_000)))
    assert not answer.startswith(b"HTTP/1.1 200")


@pytest.mark.parametrize(("sent", "status"), [(HEAD, b"408"), (b"", b"")], ids=["half a head", "nothing"])
async def test_head_that_does_not_arrive_in_time_ends_its_connection(sent: bytes, status: bytes) -> None:
    async with listening(ConnectionLimits(head_s=0.2)) as server:
        answer = await server.answer(sent)
        assert answer[9:12] == status


async def test_half_a_head_after_an_answer_ends_too() -> None:
    async with listening(ConnectionLimits(head_s=0.2)) as server, server.connected() as stream:
        await stream.send(HEAD + b"Content-Length: 0\r\n\r\n")
        await received(stream, b"\r\n\r\n")
        assert (await exchanged(stream, HEAD))[9:12] == b"408"


async def test_a_body_that_continues_after_its_answer_is_dropped_and_its_connection_closed() -> None:
    async with listening(ConnectionLimits(linger_s=0.3)) as server, server.connected() as stream:
        await stream.send(b"POST /at-once HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000000\r\n\r\nabc")
        assert (await exchanged(stream, b"abc")).startswith(b"HTTP/1.1 200")


async def test_the_longest_idle_connection_is_closed_for_a_new_one() -> None:
    async with listening(ConnectionLimits(connections=3)) as server:
        held = [await anyio.connect_tcp("127.0.0.1", server.port) for _ in range(3)]
        for stream in held:
            await stream.send(HEAD)
        await anyio.sleep(0.1)  # a connection is counted when the server has taken it
        async with server.connected() as late:
            await late.send(HEAD + b"Content-Length: 2\r\n\r\nok")
            await received(late, b"ok")
        assert await exchanged(held[0], b"") == b""
        for stream in held:
            await stream.aclose()


async def test_many_requests_at_once_without_waiting_are_refused() -> None:
    async with listening(ConnectionLimits()) as server:
        answer = await server.answer((HEAD + b"Content-Length: 0\r\n\r\n") * 2_000)
        assert answer.count(b"HTTP/1.1 200") < 10


@pytest.mark.parametrize(
    "name", ["uvicorn.error", "plannerforge.server.http.access", "mcp.server.auth.middleware.bearer_auth"]
)
def test_message_of_a_stranger_is_logged_once_a_second(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stranger chooses part of what it says."""
    now, written = [0.0], list[str]()
    handler, logger = logging.Handler(), logging.getLogger(name)
    monkeypatch.setattr(handler, "emit", lambda record: written.append(record.getMessage()))
    monkeypatch.setattr(logger, "handlers", [handler])
    monkeypatch.setattr(logger, "level", logging.WARNING)
    monkeypatch.setattr(logger, "disabled", False)
    logger.manager._clear_cache()  # type: ignore[attr-defined]
    with calm_logs(lambda: now[0]):
        for number in range(51):
            now[0] = 1.5 * (number == 50)
            logger.warning(f"request {number} is none")  # as the SDK logs
        logger.warning("another")
    assert len(written) == 3
    assert "49 similar" in written[1]
