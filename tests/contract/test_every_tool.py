"""Every tool, through a real client session, in both protocol eras."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import jsonschema
import pytest
from mcp import Client, MCPError
from mcp.types import ImageContent
from pydantic import SecretStr
from support.contract import CASES, Bad, Prepared, filled
from support.http_serving import READER, WRITER, served
from support.loop_watch import watched_loop
from support.server import ERA_NAMES, ERAS, KeptWorkers

from plannerforge.engine.execution import WorkerPool
from plannerforge.server.assembly import create_server
from plannerforge.server.tokens import count_tokens
from plannerforge.tools.registry import TOOLS, ToolSpec

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("warm_workers")]

MOST_TOKENS_OF_AN_ANSWER = 1500
BAD_CALLS = [
    pytest.param(era, tool, bad, id=f"{name}-{tool}-{number}")
    for era, name in zip(ERAS, ERA_NAMES, strict=True)
    for tool, case in CASES.items()
    for number, bad in enumerate(case.bad if era == ERAS[0] else case.bad[:1])
]
"""All in one era; in the other, one of each tool, because only the way of an answer differs."""


@asynccontextmanager
async def session(prepared: Prepared, era: str) -> AsyncIterator[Client]:
    async with Client(create_server(prepared.settings, prepared.folder), mode=era) as client:  # type: ignore[arg-type]
        yield client


@pytest.fixture(scope="module")
async def shared_client(
    request: pytest.FixtureRequest, anyio_backend: str, prepared: Prepared, kept_workers: KeptWorkers
) -> AsyncIterator[Client]:
    """One server for all calls that are refused: it stays as it is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(WorkerPool, "open", kept_workers.lent)
        async with session(prepared, request.param) as client:
            yield client


def test_every_tool_has_its_cases() -> None:
    assert set(CASES) == {spec.name for spec in TOOLS}
    assert all(len(case.bad) >= 3 for case in CASES.values())


@pytest.mark.parametrize("spec", TOOLS, ids=lambda spec: spec.name)
async def test_a_good_call_is_answered(spec: ToolSpec, prepared: Prepared, era: str) -> None:
    async with session(prepared, era) as client:
        offered = {tool.name: tool for tool in (await client.list_tools()).tools}[spec.name]
        with watched_loop():
            result = await client.call_tool(spec.name, filled(CASES[spec.name].good, prepared))
    text = result.content[0].text  # type: ignore[union-attr]
    assert not result.is_error, text
    assert text.strip()
    assert count_tokens(text) <= MOST_TOKENS_OF_AN_ANSWER
    if offered.output_schema is None:
        assert result.structured_content is None
        assert any(isinstance(block, ImageContent) for block in result.content)
    else:
        jsonschema.validate(result.structured_content, offered.output_schema)


@pytest.mark.parametrize(("shared_client", "tool", "bad"), BAD_CALLS, indirect=["shared_client"])
async def test_a_bad_call_is_refused_with_the_valid_values(
    tool: str, bad: Bad, prepared: Prepared, shared_client: Client
) -> None:
    before = await _artifacts(shared_client)
    with watched_loop():
        result = await shared_client.call_tool(tool, filled(bad.arguments, prepared))
    after = await _artifacts(shared_client)
    text = result.content[0].text  # type: ignore[union-attr]
    assert result.is_error, text
    assert text.startswith("[")
    assert ". Next: " in text
    for word in bad.names:
        assert filled(word, prepared) in text
    assert after == before


async def test_a_reading_token_calls_exactly_the_tools_that_create_no_artifacts(prepared: Prepared, era: str) -> None:
    tokens = (SecretStr(f"maker {WRITER}"), SecretStr(f"reader {READER} read-only"))
    own = prepared.settings.model_copy(update={"http_tokens": tokens})
    async with served(own, prepared.folder) as server, server.client(era, READER) as client:
        before, offered = await _artifacts(client), {tool.name for tool in (await client.list_tools()).tools}
        for spec in TOOLS:
            good = filled(CASES[spec.name].good, prepared)
            if not spec.read_only:
                with pytest.raises(MCPError, match=f"no tool '{spec.name}' for a read-only token"):
                    await client.call_tool(spec.name, good)
                continue
            assert not (await client.call_tool(spec.name, good)).is_error, spec.name
            for argument in spec.making:
                refused = await client.call_tool(spec.name, {**good, argument: True})
                assert refused.is_error
                assert f"read-only, but {argument} creates data" in refused.content[0].text  # type: ignore[union-attr]
        assert await _artifacts(client) == before
    assert offered == {spec.name for spec in TOOLS if spec.read_only}
    assert any(spec.making for spec in TOOLS)


async def test_the_list_of_tools_is_the_same_on_every_connection(prepared: Prepared, era: str) -> None:
    lists = []
    for _ in range(2):
        async with session(prepared, era) as client:
            lists.append([tool.model_dump() for tool in (await client.list_tools()).tools])
    assert lists[0] == lists[1]


async def test_long_work_reports_rising_progress(prepared: Prepared, era: str) -> None:
    shares: list[float] = []

    async def note(progress: float, total: float | None, message: str | None) -> None:
        shares.append(progress)

    async with session(prepared, era) as client:
        arguments = {"density": "medium", "seed": len(era)}  # what is stored already makes no progress
        await client.call_tool("generate_scenarios", arguments, progress_callback=note)
    assert shares
    assert shares == sorted(set(shares))


async def test_every_link_of_an_answer_leads_somewhere(prepared: Prepared, era: str) -> None:
    async with session(prepared, era) as client:
        drawn = await client.call_tool("render", {"ids": [prepared.scenario_id]})
        listed = await client.call_tool("list_artifacts", {"limit": 50})
        pictures = [block for block in drawn.content if block.type == "resource_link"]
        assert all(one.mime_type == "image/png" and one.title and one.size for one in pictures)
        links = [one.uri for one in pictures]
        records = [item["uri"] for item in (listed.structured_content or {})["artifacts"]]
        assert links
        assert records
        for uri in [*links, *records, f"plannerforge://scenario/{prepared.scenario_id}/xml"]:
            assert (await client.read_resource(uri)).contents


async def _artifacts(client: Client) -> list[dict[str, Any]]:
    """The newest artifacts, which come first."""
    listed = await client.call_tool("list_artifacts", {"limit": 5})
    assert listed.structured_content is not None
    found: list[dict[str, Any]] = listed.structured_content["artifacts"]
    return found
