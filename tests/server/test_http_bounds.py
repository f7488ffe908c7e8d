"""Bounds that hold whatever a client by HTTP does: slow bodies, streams, idle connections, a stop, ``/ready``."""

from contextlib import AsyncExitStack, suppress

import anyio
import httpx
import pytest
from anyio.abc import ByteStream
from mcp import MCPError
from pydantic import SecretStr
from support.http_serving import PATIENCE_S, READER, WRITER, Serve, Served, called, post

from plannerforge.server.application import PlannerForgeServer
from plannerforge.server.http import gate, serving
from plannerforge.server.http.serving import KEEP_ALIVE_S

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("probe_tools", "warm_workers")]
TWO = (SecretStr(f"one {WRITER}"), SecretStr(f"two {READER}"))


async def connected(server: Served) -> ByteStream:
    """A connection without a client behind it."""
    return await anyio.connect_tcp("127.0.0.1", int(server.address.rpartition(":")[2]))


async def test_an_idle_connection_survives_a_client_s_pause_and_delays_no_stop(serve: Serve) -> None:
    """Clients and proxies close theirs after 5 to 60 s: where the server is first, a request may meet the close."""
    assert KEEP_ALIVE_S > 60
    async with serve(http_stop_s=60.0) as server, httpx.AsyncClient(timeout=PATIENCE_S) as client:
        stream = await connected(server)
        await stream.send(b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert b"200 OK" in await stream.receive()
        await client.get(f"{server.address}/health")
        begun_at = anyio.current_time()
    took_s = anyio.current_time() - begun_at
    with pytest.raises(anyio.EndOfStream):
        await stream.receive()
    await stream.aclose()
    assert took_s < 10


async def test_a_connection_is_kept_for_the_announced_time(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serving, "KEEP_ALIVE_S", 1)
    async with serve() as server, await connected(server) as stream:
        await stream.send(b"GET /health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert b"200 OK" in await stream.receive()
        with pytest.raises(anyio.EndOfStream), anyio.fail_after(PATIENCE_S):
            await stream.receive()


async def test_slow_body_is_refused_and_its_place_is_free_again(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate, "BODY_TIMEOUT_S", 0.5)
    body, headers = called("echo", text="x", tags=["x" * 2_000])  # what is short is let in beyond the bound
    head = "".join(f"{name}: {value}\r\n" for name, value in headers.items())
    async with serve(http_calls=1) as server:
        async with await connected(server) as stream:
            request = f"POST /mcp HTTP/1.1\r\nHost: 127.0.0.1\r\n{head}Content-Length: 9000\r\n\r\n{{"
            await stream.send(request.encode())
            answer = await received(stream)
        good = await post(server, body, headers)
    assert answer.startswith(b"HTTP/1.1 408 ")
    assert b"did not arrive within 0.5 s" in answer
    assert good.status_code == 200


@pytest.mark.parametrize(
    ("head", "status"),
    [
        (f"Host: 127.0.0.1\r\nAuthorization: Bearer {READER}x\r\n", b"401"),
        (f"Host: elsewhere.example\r\nAuthorization: Bearer {WRITER}\r\n", b"421"),
    ],
    ids=["unknown token", "foreign host"],
)
async def test_stranger_is_refused_before_any_of_its_body_is_read(serve: Serve, head: str, status: bytes) -> None:
    async with serve(http_calls=1, http_tokens=TWO) as server, await connected(server) as stream:
        start = f"POST /mcp HTTP/1.1\r\n{head}Content-Type: application/json\r\nContent-Length: 4000000\r\n\r\n"
        await stream.send(start.encode())
        assert (await received(stream))[9:12] == status


async def received(stream: ByteStream) -> bytes:
    """All that a connection gives until it ends or an object of JSON is whole."""
    found = b""
    with anyio.fail_after(PATIENCE_S), suppress(anyio.EndOfStream):
        while not found.endswith(b"}"):
            found += await stream.receive()
    return found


async def test_seventeenth_stream_of_news_is_refused_until_one_is_closed(serve: Serve) -> None:
    async with serve(http_tokens=TWO) as server, AsyncExitStack() as stack:
        one = await stack.enter_async_context(server.client("auto", WRITER))
        two = await stack.enter_async_context(server.client("auto", READER))
        for _ in range(15):
            await stack.enter_async_context(one.listen(tools_list_changed=True))
        async with one.listen(tools_list_changed=True):
            with pytest.raises(MCPError, match="16 news streams are already open"):
                async with one.listen(tools_list_changed=True):
                    pass
            async with two.listen(tools_list_changed=True):
                said = await one.call_tool("echo", {"text": "calls go on"})
        with anyio.fail_after(PATIENCE_S):  # the server is told of the close in its own time
            while True:
                with suppress(MCPError):
                    async with one.listen(tools_list_changed=True):
                        break
                await anyio.sleep(0.05)
    assert not said.is_error


@pytest.mark.parametrize(
    ("proxies", "forwarded", "is_another"),
    [
        (("127.0.0.1",), "198.51.100.7", True),
        (("127.0.0.1",), "203.0.113.1", False),
        (("127.0.0.1",), "198.51.100.7, 203.0.113.1", False),
        (("192.0.2.1",), "198.51.100.7", False),
        ((), "198.51.100.7", False),
    ],
    ids=["another", "same", "forged before the proxy's", "from no proxy", "no proxy named"],
)
async def test_forwarded_address_is_believed_from_a_named_proxy_alone(
    serve: Serve, proxies: tuple[str, ...], forwarded: str, is_another: bool
) -> None:
    """A client with another address has bounds of its own; what is padded is no cancellation."""
    first = {"X-Forwarded-For": "203.0.113.1"}
    async with serve(http_calls=1, http_proxies=proxies) as server, anyio.create_task_group() as tasks:
        job_id = (await post(server, *called("start_job", text="endless"), **first)).json()
        waiting = called("get_job", job_id=job_id["result"]["structuredContent"]["said"]["text"], wait_s=50)
        padded, headers = called("echo", text="x", tags=["x" * 2_000])

        async def occupy() -> None:
            while (await post(server, *waiting, **first)).status_code == 429:
                pass

        tasks.start_soon(occupy)
        with anyio.fail_after(PATIENCE_S):
            while (await post(server, padded, headers, **first)).status_code != 429:
                await anyio.sleep(0.05)
        other = await post(server, padded, headers, **{"X-Forwarded-For": forwarded})
        tasks.cancel_scope.cancel()
    assert other.status_code == (200 if is_another else 429)


async def test_a_call_that_outlasts_a_stop_is_informed_and_its_job_is_kept(serve: Serve) -> None:
    answers: list[httpx.Response] = []
    async with serve(http_stop_s=0.3) as server, anyio.create_task_group() as tasks:
        begun_job = (await post(server, *called("start_job", text="endless"))).json()
        job_id = begun_job["result"]["structuredContent"]["said"]["text"]

        async def wait_for_job() -> None:
            answers.append(await post(server, *called("get_job", job_id=job_id, wait_s=50)))

        tasks.start_soon(wait_for_job)
        await anyio.sleep(0.3)
        server.server.stop()
    (answer,) = answers
    assert answer.status_code == 503
    assert answer.headers["retry-after"]
    assert "jobs are kept" in answer.json()["error"]["message"]
    async with serve() as server:
        kept = await post(server, *called("get_job", job_id=job_id, wait_s=0))
        again = await post(server, *called("start_job", text="endless"))
    told = kept.json()["result"]["structuredContent"]
    assert (told["state"], told["results"]) == ("interrupted", ["run_0123456789ab"])
    assert again.json()["result"]["structuredContent"]["said"]["text"] == f"{job_id}_2"


async def test_ready_checks_the_workspace_once_for_any_number_of_requests(
    serve: Serve, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked, can_read = [], [True]

    async def is_ready(server: PlannerForgeServer) -> bool:
        looked.append(server)
        await anyio.sleep(0.05)
        return can_read[0]

    monkeypatch.setattr(PlannerForgeServer, "is_ready", is_ready)
    monkeypatch.setattr(serving, "READY_KEPT_S", PATIENCE_S)
    codes: list[int] = []
    async with serve() as server, httpx.AsyncClient(timeout=PATIENCE_S) as client:

        async def ask() -> None:
            codes.append((await client.get(f"{server.address}/ready")).status_code)

        async with anyio.create_task_group() as tasks:
            for _ in range(50):
                tasks.start_soon(ask)
        assert (len(looked), set(codes)) == (1, {200})
        can_read[0] = False
        await ask()
        monkeypatch.setattr(serving, "READY_KEPT_S", 0.0)
        await ask()
    assert (len(looked), codes[-2:]) == (2, [200, 503])
