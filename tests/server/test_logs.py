"""The log: one line of each call, as text or JSON, with the call that a line belongs to, and never a secret."""

import io
import json
import logging
import os
import sys
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client
from support.server import Connect

from plannerforge.engine.execution import CallThreads
from plannerforge.server.observing.logs import REDACTED, EndedCall, JsonLines, Secrets, TextLines, log_call, named_call

SECRET = "ghp_" + "a1B2" * 8


@pytest.fixture
def lines(request: pytest.FixtureRequest) -> Iterator[io.StringIO]:
    """What the root logger writes at INFO, formatted as the test says."""
    written = io.StringIO()
    handler = logging.StreamHandler(written)
    handler.setFormatter(request.param(Secrets(["forge-[0-9]+"])))
    root, level = logging.getLogger(), logging.getLogger().level
    root.addHandler(handler)
    root.setLevel("INFO")
    yield written
    root.removeHandler(handler)
    root.setLevel(level)


as_json = pytest.mark.parametrize("lines", [JsonLines], indirect=True)
as_text = pytest.mark.parametrize("lines", [TextLines], indirect=True)


def entries(written: io.StringIO, logger: str = "plannerforge") -> list[dict[str, Any]]:
    every = [json.loads(line) for line in written.getvalue().splitlines()]
    return [entry for entry in every if entry["logger"].startswith(logger)]


@pytest.mark.anyio
@pytest.mark.usefixtures("probe_tools")
@as_json
async def test_each_call_is_one_line_with_client_tool_and_duration(lines: io.StringIO, connect: Connect) -> None:
    async with connect() as client:
        await client.call_tool("echo", {"text": "hello " + SECRET})
        await client.call_tool("refuse", {})
    done, refused = entries(lines, "plannerforge.calls")
    assert set(done) == {"time", "level", "logger", "event", "call_id", "tool", "client", "duration_s", "outcome"}
    assert datetime.fromisoformat(done["time"]).utcoffset() is not None
    assert (done["level"], done["tool"], done["outcome"]) == ("INFO", "echo", "ok")
    assert done["client"].startswith("mcp ")
    assert done["duration_s"] >= 0
    assert (refused["tool"], refused["outcome"]) == ("refuse", "not_possible")
    assert refused["call_id"] != done["call_id"]
    assert "hello" not in lines.getvalue()


@pytest.mark.anyio
@pytest.mark.usefixtures("probe_tools")
@as_json
async def test_errors_in_a_call_carry_its_id_also_in_the_journal(
    lines: io.StringIO, connect: Connect, tmp_path: Path
) -> None:
    async with connect() as client:
        await client.call_tool("break_down", {})
    (incident,) = [entry for entry in entries(lines) if entry["level"] == "ERROR"]
    (call,) = entries(lines, "plannerforge.calls")
    journalled = json.loads((tmp_path / "workspace" / "journal" / "calls.jsonl").read_text())
    assert incident["call_id"] == call["call_id"] == journalled["call_id"]
    assert (incident["tool"], call["outcome"]) == ("break_down", "unexpected")
    assert "Traceback" in incident["event"]


@pytest.mark.anyio
@as_json
async def test_threads_and_tasks_of_a_call_carry_its_id_and_others_do_not(lines: io.StringIO) -> None:
    threads, logger = CallThreads(), logging.getLogger("plannerforge.test")

    async def say(word: str) -> None:
        await anyio.sleep(0.01)
        logger.info(word)

    with named_call("first", "one") as first:
        await threads.run(say, "in a thread")
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(say, "in a task")
    await threads.run(say, "outside")
    threads.close()
    told = {entry["event"]: entry.get("call_id") for entry in entries(lines, "plannerforge.test")}
    assert told == {"in a thread": first.call_id, "in a task": first.call_id, "outside": None}


@pytest.mark.parametrize("lines", [JsonLines, TextLines], indirect=True)
def test_no_line_contains_a_secret_or_a_line_break(lines: io.StringIO) -> None:
    logger = logging.getLogger("plannerforge.test")
    with named_call("echo", f"client {SECRET}\nINFO forged: line"):
        logger.warning("asked with %s, Authorization: Bearer %s and forge-123", "password=hunter22", "x" * 30)
        try:
            raise ValueError(f"token={SECRET}")
        except ValueError:
            logger.exception("it failed")
    text = lines.getvalue()
    assert SECRET not in text
    assert "hunter22" not in text
    assert "x" * 30 not in text
    assert "forge-123" not in text
    assert text.count(REDACTED) >= 4
    assert "\nINFO forged" not in text


@as_text
def test_text_is_level_name_message_and_call(lines: io.StringIO) -> None:
    with named_call("echo", "host 1.0") as names:
        log_call(EndedCall(names, "ok", 0.25))
    expected = f"INFO plannerforge.calls: echo: ok in 0.250 s (call {names.call_id} of echo by host 1.0)\n"
    assert lines.getvalue() == expected


@pytest.mark.anyio
async def test_a_server_s_log_is_json_on_stderr_and_only_the_protocol_is_on_stdout(tmp_path: Path) -> None:
    serve = ["-m", "plannerforge", "serve", "--log-level", "INFO", "--log-format", "json", "--no-warm-up"]
    arguments = [*serve, "--workspace", str(tmp_path / "workspace"), "--roots", str(tmp_path / "away")]
    with (tmp_path / "stderr").open("w") as stderr:
        server = StdioServerParameters(command=sys.executable, args=arguments, env=dict(os.environ))
        async with Client(stdio_client(server, errlog=stderr)) as client:
            answer = await client.call_tool("list_artifacts", {})
    assert not answer.is_error
    told = [json.loads(line) for line in (tmp_path / "stderr").read_text().splitlines()]
    assert [entry["tool"] for entry in told if entry["logger"] == "plannerforge.calls"] == ["list_artifacts"]
    assert any("does not exist (yet)" in entry["event"] and entry["level"] == "WARNING" for entry in told)
