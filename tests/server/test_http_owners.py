"""Over HTTP a job belongs to the token that started it: all may look at it, that one alone may stop it."""

from typing import Any

import pytest
from mcp import Client
from mcp.types import Implementation
from pydantic import SecretStr
from support.http_serving import READER, WRITER, Serve

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("probe_tools", "warm_workers")]
TWO = (SecretStr(f"one {WRITER}"), SecretStr(f"two {READER}"))


async def asked(client: Client, tool: str, **arguments: Any) -> str:
    """What the answer says, a refusal too."""
    return str((await client.call_tool(tool, arguments)).content[0].text)  # type: ignore[union-attr]


async def begun(client: Client, text: str) -> str:
    """The id of a job that goes on for long."""
    answer = (await client.call_tool("make_long", {"text": text})).structured_content
    return str((answer or {})["note"])


async def test_job_is_cancelled_with_the_token_that_began_it_alone(serve: Serve, era: str) -> None:
    async with serve(http_tokens=TWO) as server:
        async with server.client(era, WRITER) as one, server.client(era, READER) as two:
            mine = await begun(one, "for ever")
            refused = await asked(two, "cancel_job", job_id=mine)
            assert await begun(two, "for ever") == mine, "it joins the job"
            joined = [await asked(two, "cancel_job", job_id=word) for word in (mine, "latest")]
            looked_at = await asked(two, "get_job", job_id=mine, wait_s=0)
        async with server.client(era, WRITER) as later:
            stopped = await asked(later, "cancel_job", job_id=mine)
    assert "was not started with this token" in refused
    assert "cancel it with the token that started it" in refused
    assert joined == [refused, refused]
    assert f"{mine} (batch): running" in looked_at
    assert f"{mine} (batch): cancelled" in stopped


async def test_latest_job_to_cancel_is_never_that_of_another_token(serve: Serve, era: str) -> None:
    async with serve(http_tokens=TWO) as server, server.client(era, WRITER) as one:
        async with server.client(era, READER) as two:
            mine = await begun(one, "mine")
            nothing = await asked(two, "cancel_job", job_id="latest")
            told = await asked(two, "get_job", job_id="latest", wait_s=0)
            theirs = await begun(two, "theirs")
            last = await begun(one, "last")
        async with server.client(era, READER, client_info=Implementation(name="another", version="1")) as later:
            looked_at = await asked(later, "get_job", job_id="latest", wait_s=0)
            stopped = await asked(later, "cancel_job", job_id="latest")
            refused = await asked(later, "cancel_job", job_id=last)
        running = [await asked(one, "get_job", job_id=each, wait_s=0) for each in (mine, last)]
        assert f"{last} (batch): cancelled" in await asked(one, "cancel_job", job_id="latest")
    assert "no job was started with this token" in nothing
    assert f"the workspace's newest one, {mine}, is used" in told
    assert f"this token's newest one, {theirs}, is used" in looked_at
    assert f"{theirs} (batch): cancelled" in stopped
    assert "Valid" not in refused, "its own has ended"
    assert all(": running" in each for each in running)


async def test_refusal_to_cancel_names_the_token_s_own_jobs_that_run(serve: Serve) -> None:
    async with (
        serve(http_tokens=TWO) as server,
        server.client("auto", WRITER) as one,
        server.client("auto", READER) as two,
    ):
        theirs, mine = await begun(two, "theirs"), await begun(one, "mine")
        refused = await asked(two, "cancel_job", job_id=mine)
    assert f"Valid: {theirs}." in refused


async def test_job_is_its_token_s_own_after_a_restart_too(serve: Serve, era: str) -> None:
    async with serve(http_tokens=TWO) as server, server.client(era, WRITER) as client:
        job_id = await begun(client, "mine")
    async with serve(http_tokens=TWO) as server, server.client(era, WRITER) as one, server.client(era, READER) as two:
        own = await asked(one, "cancel_job", job_id="latest")
        other = await asked(two, "cancel_job", job_id=job_id)
    assert f"{job_id} (batch): interrupted" in own
    assert "was not started with this token" in other


async def test_without_tokens_every_client_may_cancel_every_job(serve: Serve, era: str) -> None:
    async with serve() as server, server.client(era) as one, server.client(era) as two:
        first, second = await begun(one, "one"), await begun(one, "two")
        by_id = await asked(two, "cancel_job", job_id=first)
        latest = await asked(two, "cancel_job", job_id="latest")
    assert f"{first} (batch): cancelled" in by_id
    assert f"{second} (batch): cancelled" in latest
