"""``serve --http``: who is let in, what each client sees as its own, what bounds hold, and how it stops."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import anyio
import httpx
import pytest
from mcp import MCPError
from pydantic import SecretStr
from support.http_serving import PATIENCE_S, READER, WRITER, Serve, called, post

from plannerforge.schemas.errors import InvalidRequest, OutsideRoots
from plannerforge.server.assembly import create_server
from plannerforge.server.http.access import new_token, read_tokens, tokens_of
from plannerforge.server.http.serving import HttpServer, bound
from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("probe_tools", "warm_workers")]
TOKENS = (SecretStr(f"maker {WRITER}"), SecretStr(f"reader {READER} read-only"))


async def test_client_lists_calls_and_is_refused_by_http_in_both_eras(serve: Serve, era: str) -> None:
    async with serve() as server, server.client(era) as client:
        tools = (await client.list_tools()).tools
        said = await client.call_tool("echo", {"text": "hello"})
        refused = await client.call_tool("echo", {"txt": "hello"})
        with pytest.raises(MCPError, match="there is no tool"):
            await client.call_tool("eccho", {})
    assert "echo" in {tool.name for tool in tools}
    assert said.structured_content is not None
    assert said.structured_content["said"]["text"] == "hello"
    assert refused.is_error


async def test_progress_of_a_call_arrives_by_http(serve: Serve, era: str) -> None:
    told: list[float] = []

    async def note(progress: float, total: float | None, message: str | None) -> None:
        told.append(progress)

    async with serve() as server, server.client(era) as client:
        await client.call_tool("tell_progress", {}, progress_callback=note)
        with anyio.fail_after(PATIENCE_S):
            while 1.0 not in told:
                await anyio.sleep(0.01)
    assert told == sorted(told)


async def test_health_and_ready_are_reported_without_a_token(serve: Serve) -> None:
    async with serve(http_tokens=TOKENS) as server, httpx.AsyncClient() as client:
        health = await client.get(f"{server.address}/health")
        ready = await client.get(f"{server.address}/ready")
    assert (health.status_code, health.json()) == (200, {"status": "ok"})
    assert (ready.status_code, ready.json()) == (200, {"status": "ready"})


async def test_request_without_its_token_is_refused(serve: Serve) -> None:
    body, headers = called("echo", text="x")
    async with serve(http_tokens=TOKENS) as server:
        nobody = await post(server, body, headers)
        wrong = await post(server, body, headers, Authorization=f"Bearer {WRITER}x")
        let_in = await post(server, body, headers, Authorization=f"Bearer {WRITER}")
    assert [nobody.status_code, wrong.status_code, let_in.status_code] == [401, 401, 200]
    assert nobody.headers["www-authenticate"].startswith("Bearer ")
    assert let_in.json()["result"]["structuredContent"]["said"]["text"] == "x"


async def test_a_reading_token_sees_and_calls_only_tools_that_create_no_artifacts(serve: Serve, era: str) -> None:
    async with serve(http_tokens=TOKENS) as server, server.client(era, READER) as client:
        tools = (await client.list_tools()).tools
        listed = await client.call_tool("list_artifacts", {})
        with pytest.raises(MCPError, match="for a read-only token"):
            await client.call_tool("cancel_job", {"job_id": "latest"})
    assert not listed.is_error
    assert all(tool.annotations is not None and tool.annotations.read_only_hint for tool in tools)
    assert {"cancel_job", "export_artifacts"}.isdisjoint(tool.name for tool in tools)


@pytest.mark.parametrize(
    ("header", "value", "status", "setting"),
    [
        ("Host", "evil.example:80", 421, "http_hosts"),
        ("Origin", "http://evil.example", 403, "http_origins"),
        ("Origin", "http://127.0.0.1.evil.example", 403, "http_origins"),
        ("Origin", "null", 403, "http_origins"),
    ],
)
async def test_foreign_host_and_origin_are_refused_and_the_setting_named(
    serve: Serve, header: str, value: str, status: int, setting: str
) -> None:
    body, headers = called("echo", text="x")
    async with serve() as server:
        modern = await post(server, body, headers, **{header: value})
        older = {name: headers[name] for name in ("Content-Type", "Accept")}
        legacy = await post(server, {"jsonrpc": "2.0", "id": 1, "method": "ping"}, older, **{header: value})
    assert [modern.status_code, legacy.status_code] == [status, status]
    assert setting in modern.json()["error"]["message"]
    assert setting in legacy.json()["error"]["message"]


async def test_listed_hosts_and_origins_are_allowed(serve: Serve) -> None:
    body, headers = called("echo", text="x")
    async with serve(http_hosts=("forge.example",), http_origins=("https://page.example",)) as server:
        let_in = await post(server, body, headers, Host="forge.example", Origin="https://page.example")
    assert let_in.status_code == 200


async def test_a_body_that_is_too_large_is_refused_with_or_without_its_length(serve: Serve) -> None:
    _, headers = called("echo", text="x")

    async def parts() -> AsyncIterator[bytes]:
        for _ in range(20):
            yield b"x" * 100_000

    async with serve(http_body_mb=1) as server, httpx.AsyncClient(timeout=PATIENCE_S) as client:
        declared = await post(server, b"x" * 2_000_000, headers)
        streamed = await client.post(server.url, content=parts(), headers=headers)
    for refused in (declared, streamed):
        assert refused.status_code == 413
        assert "1,048,576 bytes" in refused.json()["error"]["message"]


@pytest.mark.parametrize("body", [b"{", b"[" * 100_000, b'{"a":' + b"9" * 100_000 + b"}", b"\xff\xfe", b"[]", b"7"])
async def test_an_invalid_request_is_answered_as_invalid(serve: Serve, body: bytes) -> None:
    _, headers = called("echo", text="x")
    older = {name: headers[name] for name in ("Content-Type", "Accept")}
    async with serve() as server:
        answers = [await post(server, body, headers), await post(server, body, older)]
        good = await post(server, *called("echo", text="still there"))
    assert all(400 <= answer.status_code < 500 for answer in answers), [answer.text for answer in answers]
    assert good.status_code == 200


async def test_a_client_that_is_too_fast_learns_when_to_retry(serve: Serve) -> None:
    body, headers = called("echo", text="x")
    answers: list[httpx.Response] = []
    async with serve(http_rate=1.0, http_calls=256, http_tokens=TOKENS) as server:

        async def ask() -> None:
            answers.append(await post(server, body, headers, Authorization=f"Bearer {WRITER}"))

        async with anyio.create_task_group() as tasks:
            for _ in range(40):
                tasks.start_soon(ask)
        other = await post(server, body, headers, Authorization=f"Bearer {READER}")
    late = [answer for answer in answers if answer.status_code == 429]
    assert late
    assert int(late[0].headers["retry-after"]) >= 1
    assert "http_rate" in late[0].json()["error"]["message"]
    assert other.status_code == 200


async def test_a_client_with_too_many_calls_in_progress_is_informed_and_others_do_not_wait(serve: Serve) -> None:
    """What is padded is no cancellation, for which there is always room."""
    padding = "x" * 2_000
    waiting, short = called("get_job", job_id="latest", wait_s=50), called("echo", text="x")
    mine = {"Authorization": f"Bearer {WRITER}"}
    async with serve(http_calls=1, http_tokens=TOKENS) as server, server.client("legacy", WRITER) as client:
        await client.call_tool("start_job", {"text": "endless"})

        async def occupy() -> None:
            while (await post(server, waiting[0], waiting[1], **mine)).status_code == 429:
                pass

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(occupy)
            with anyio.fail_after(PATIENCE_S):
                answer = await post(server, {**short[0], "padding": padding}, short[1], **mine)
                while answer.status_code != 429:
                    await anyio.sleep(0.05)
                    answer = await post(server, {**short[0], "padding": padding}, short[1], **mine)
            cancellation = await post(server, *short, **mine)
            other = await post(server, *short, Authorization=f"Bearer {READER}")
            tasks.cancel_scope.cancel()
    assert "http_calls" in answer.json()["error"]["message"]
    assert (cancellation.status_code, other.status_code) == (200, 200)


async def test_each_client_has_its_own_latest(serve: Serve, era: str) -> None:
    """By its session, and since 2026-07-28 by its token."""
    async with (
        serve(http_tokens=(SecretStr(f"one {WRITER}"), SecretStr(f"two {READER}"))) as server,
        server.client(era, WRITER) as one,
        server.client(era, READER) as two,
    ):
        mine = (await one.call_tool("start_job", {"text": "mine"})).structured_content
        theirs = (await two.call_tool("start_job", {"text": "theirs"})).structured_content
        last = (await one.call_tool("get_job", {"job_id": "latest", "wait_s": 5})).structured_content
        other = (await two.call_tool("get_job", {"job_id": "latest", "wait_s": 5})).structured_content
    assert mine is not None
    assert theirs is not None
    assert (last or {})["job_id"] == mine["said"]["text"]
    assert (other or {})["job_id"] == theirs["said"]["text"]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has several loopback addresses")
async def test_clients_without_tokens_and_with_one_name_are_told_apart_by_their_address(serve: Serve, era: str) -> None:
    async with (
        serve() as server,
        server.client(era, source="127.0.0.1") as one,
        server.client(era, source="127.0.0.2") as two,
    ):
        first, second = [
            (await client.call_tool("make_long", {"text": text})).structured_content["note"]  # type: ignore[index]
            for client, text in ((one, "one"), (two, "two"))
        ]
        latest = [
            (await client.call_tool("cancel_job", {"job_id": "latest"})).structured_content["job_id"]  # type: ignore[index]
            for client in (one, two)
        ]
    assert latest == [first, second]


async def test_journal_names_the_client_and_its_token(serve: Serve, era: str, settings: Settings) -> None:
    async with serve(http_tokens=TOKENS) as server, server.client(era, READER) as client:
        await client.call_tool("list_artifacts", {})
    (line,) = (settings.workspace / "journal" / "calls.jsonl").read_text().splitlines()
    assert re.fullmatch(r"mcp \S+ \(reader\)", json.loads(line)["client"])
    assert READER not in line


async def test_stop_lets_a_call_end_and_turns_new_ones_away(serve: Serve) -> None:
    answers: list[int] = []
    async with serve(http_stop_s=30.0) as server:
        async with server.client("legacy") as client:
            job = (await client.call_tool("start_job", {"text": "endless"})).structured_content

        async def wait_for_job() -> None:
            body, headers = called("get_job", job_id=(job or {})["said"]["text"], wait_s=1)
            answers.append((await post(server, body, headers)).status_code)

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(wait_for_job)
            await anyio.sleep(0.3)
            server.server.stop()
            ready = 200
            async with httpx.AsyncClient() as raw:
                while ready == 200:
                    ready = (await raw.get(f"{server.address}/ready")).status_code
            turned_away = await post(server, *called("echo", text="x"))
    assert ready == 503
    assert turned_away.status_code == 503
    assert "stopping" in turned_away.json()["error"]["message"]
    assert answers == [200]


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.7", "::", "example.org"])
async def test_other_addresses_need_a_token(settings: Settings, host: str) -> None:
    server = create_server(settings)
    with pytest.raises(InvalidRequest, match="tokens are not required"):
        HttpServer(server, settings.model_copy(update={"http_host": host}))


async def test_every_address_needs_a_name_that_clients_call(settings: Settings) -> None:
    open_to_all = {"http_host": "0.0.0.0", "http_tokens": TOKENS}
    with pytest.raises(InvalidRequest, match="settings give no name"):
        HttpServer(create_server(settings), settings.model_copy(update=open_to_all))
    HttpServer(create_server(settings), settings.model_copy(update={**open_to_all, "http_hosts": ("forge.example",)}))


async def test_a_port_in_use_is_reported() -> None:
    with bound("127.0.0.1", 0) as taken, pytest.raises(InvalidRequest, match="cannot be bound"):
        bound("127.0.0.1", taken.getsockname()[1])


@pytest.mark.parametrize(
    "line", ["name", "na me token-that-is-long-enough-x", f"name {'x' * 23}", f"name {WRITER} readonly", f"-x {WRITER}"]
)
async def test_an_invalid_token_is_refused_without_being_repeated(line: str) -> None:
    with pytest.raises(InvalidRequest, match=r"entry 1 of the list") as caught:
        read_tokens([line], "the list")
    assert "xxx" not in caught.value.text


async def test_tokens_of_a_file_are_kept_from_others_unless_they_are_digests(tmp_path: Path) -> None:
    file = tmp_path / "tokens"
    text, line = new_token("ci", reads_only=True)
    file.write_text(f"# made today\n\n{line}\n")
    file.chmod(0o644)
    (token,) = tokens_of((), file)
    assert (token.name, token.reads_only) == ("ci", True)
    assert text not in line
    file.write_text(f"ci {WRITER}\n")
    with pytest.raises(OutsideRoots, match="others on this machine"):
        tokens_of((), file)
    file.chmod(0o600)
    assert tokens_of((), file)[0].digest
    with pytest.raises(InvalidRequest, match="two tokens have the name ci"):
        tokens_of((SecretStr(line),), file)
    with pytest.raises(OutsideRoots, match="cannot be read"):
        tokens_of((), tmp_path / "missing")


def test_secrets_of_a_variable_are_read_and_never_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PLANNERFORGE_HTTP_TOKENS", f"ci {WRITER} read-only, app {READER}")
    settings = Settings()
    assert [token.name for token in tokens_of(settings.http_tokens, None)] == ["ci", "app"]
    assert WRITER not in repr(settings)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_program_serves_until_a_signal_and_ends_well(tmp_path: Path, number: signal.Signals) -> None:
    environment = {**os.environ, "PLANNERFORGE_WORKSPACE": str(tmp_path / "workspace"), "PLANNERFORGE_WARM_UP": "false"}
    command = [sys.executable, "-m", "plannerforge", "serve", "--http", "--port", "0", "--workers", "1"]
    process = subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        address = next(word for line in process.stderr for word in line.split() if word.startswith("http://"))
        assert httpx.post(address, content=b"{}", timeout=PATIENCE_S).status_code == 400
        process.send_signal(number)
        assert process.wait(timeout=PATIENCE_S) == 0
    finally:
        process.kill()
        process.communicate()


def test_the_program_gives_its_reason_for_not_serving_in_one_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "plannerforge", "serve", "--http", "--host", "0.0.0.0"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("[invalid_request] http_host 0.0.0.0 lets other machines in")
    assert done.stderr.count("\n") == 1


async def test_pictures_that_are_too_large_for_an_event_are_linked_by_http(serve: Serve, era: str) -> None:
    async with serve() as server, server.client(era) as client:
        answer = await client.call_tool("draw_much", {})
    kinds = [block.type for block in answer.content]
    assert kinds == ["text", "resource_link"]
    assert "too large" in str(answer.content[0])
