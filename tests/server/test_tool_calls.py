"""Tool calls through a client session of both protocol eras: what is taken, what is refused, and with what words."""

import base64
import json
import logging
from typing import Any

import pytest
from mcp import MCPError
from mcp.types import INVALID_PARAMS, CallToolResult, ImageContent, ResourceLink, TextContent

from plannerforge.server.settings import Settings
from plannerforge.server.tool_calls import LONGEST_ANSWER

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("probe_tools")]


def text_of(result: CallToolResult) -> str:
    (block,) = result.content
    assert isinstance(block, TextContent)
    return block.text


async def echoed(connect: Any, **arguments: Any) -> dict[str, Any]:
    async with connect() as client:
        result = await client.call_tool("echo", arguments)
    assert not result.is_error, text_of(result)
    assert json.loads(text_of(result).splitlines()[0]) == result.structured_content["said"], (
        "both channels say the same"
    )
    said: dict[str, Any] = result.structured_content["said"]
    return said


async def refused(connect: Any, tool: str = "echo", **arguments: Any) -> str:
    async with connect() as client:
        result = await client.call_tool(tool, arguments)
    assert result.is_error
    assert result.structured_content is None
    text = text_of(result)
    assert "\n" not in text
    assert "pydantic" not in text
    return text


async def test_answer_is_text_and_structure_alike(connect: Any) -> None:
    assert await echoed(connect, text="hello", count=2) == {
        "text": "hello",
        "count": 2,
        "share": None,
        "density": "medium",
        "tags": [],
        "edits": [],
    }


async def test_unknown_argument_is_refused_with_the_closest(connect: Any) -> None:
    text = await refused(connect, text="x", cuont=2)
    assert text.startswith("[invalid_request] there is no argument 'cuont'. Valid: count, ")


async def test_unknown_field_of_an_object_in_a_list_is_refused_with_the_closest(connect: Any) -> None:
    text = await refused(connect, text="x", edits=[{"op": "remove"}, {"op": "remove", "vehcle_id": 3}])
    assert "there is no argument 'edits[1].vehcle_id'. Valid: vehicle_id, op" in text


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({}, "the required argument 'text' (text) is missing"),
        ({"text": {"a": 5}}, 'text cannot be {"a": 5}. Valid: text.'),
        ({"text": "x", "count": "many"}, "count cannot be 'many'. Valid: a whole number from 1 to 5 (how often)"),
        ({"text": "x", "count": 9}, "count cannot be 9"),
        ({"text": "x", "share": 1}, "cannot be 1. Valid: a number above 0 below 1"),
        ({"text": "x", "density": "hihg"}, "density cannot be 'hihg'. Valid: high, "),
        ({"text": "x", "tags": [[1]]}, "tags[0] cannot be [1]"),
        ({"text": "x", "edits": [7]}, "edits[0] cannot be 7"),
        ({"text": "x", "edits": [{"op": "rerout"}]}, "edits[0].op cannot be 'rerout'. Valid: reroute, remove"),
        ({"text": "x", "edits": [{}]}, "the required argument 'edits[0].op' is missing. Valid: remove, reroute."),
        ({"text": "x", "tags": "[broken"}, "tags cannot be '[broken'"),
        ({"count": 0, "density": "x"}, "'text' (text) is missing; count cannot be 0"),
    ],
)
async def test_a_wrong_argument_is_named_with_its_value_and_the_valid_values(
    connect: Any, arguments: dict[str, Any], expected: str
) -> None:
    assert expected in await refused(connect, **arguments)


@pytest.mark.parametrize(
    ("given", "taken"),
    [('["a", "b"]', ["a", "b"]), (' ["a"]', ["a"]), ("a", ["a"]), ("a, b", ["a, b"]), (["a"], ["a"]), ("[]", [])],
)
async def test_list_as_json_text_or_without_brackets_is_taken(connect: Any, given: Any, taken: list[str]) -> None:
    assert (await echoed(connect, text="x", tags=given))["tags"] == taken


@pytest.mark.parametrize(
    "given",
    [{"op": "remove", "vehicle_id": 3}, '{"op": "remove", "vehicle_id": 3}', '[{"op":"remove","vehicle_id":3}]'],
)
async def test_one_object_or_its_json_text_counts_as_a_list(connect: Any, given: Any) -> None:
    assert (await echoed(connect, text="x", edits=given))["edits"] == [{"op": "remove", "vehicle_id": 3}]


async def test_hostile_nesting_in_json_text_is_a_refusal(connect: Any) -> None:
    assert "tags cannot be " in await refused(connect, text="x", tags="[" * 40_000)


async def test_json_text_with_a_number_that_is_not_finite_is_refused(connect: Any) -> None:
    assert "vehicle_id" in await refused(connect, text="x", edits='[{"op": "remove", "vehicle_id": NaN}]')


async def test_answer_longer_than_any_reads_is_a_refusal_with_its_size(connect: Any) -> None:
    async with connect() as client:
        whole = await client.call_tool("say_much", {"text": str(LONGEST_ANSWER - 1000)})
        assert not whole.is_error
        refusal = text_of(await client.call_tool("say_much", {"text": str(LONGEST_ANSWER)}))
    assert refusal.startswith("[not_possible] the answer has 400,")
    assert len(refusal) < 1000


async def test_pictures_too_large_for_an_answer_are_linked_only(connect: Any) -> None:
    async with connect() as client:
        result = await client.call_tool("draw_much", {})
    text, *others = result.content
    assert [type(block) for block in others] == [ImageContent, ImageContent, ResourceLink]
    assert "1 image is too large to embed; open its link" in text.text


async def test_links_are_left_out_if_the_host_does_not_support_them(connect: Any, settings: Settings) -> None:
    async with connect(settings.model_copy(update={"links": False})) as client:
        drawn, job = await client.call_tool("draw", {}), await client.call_tool("start_job", {"text": "short"})
    assert [type(block) for block in drawn.content] == [TextContent, ImageContent]
    assert [type(block) for block in job.content] == [TextContent]


async def test_text_that_looks_like_a_list_stays_text_if_the_argument_is_text(connect: Any) -> None:
    assert (await echoed(connect, text='["a"]'))["text"] == '["a"]'


async def test_unknown_tool_is_a_protocol_error_with_the_closest(connect: Any) -> None:
    async with connect() as client:
        with pytest.raises(MCPError, match=r"no tool 'ech'. Valid: echo, ") as caught:
            await client.call_tool("ech", {})
    assert caught.value.error.code == INVALID_PARAMS


async def test_a_domain_error_has_code_message_valid_values_and_next_step(connect: Any) -> None:
    assert await refused(connect, "refuse") == (
        "[not_possible] the lane ends. Valid: lane 1, lane 2. Next: call describe_scenario."
    )


async def test_defect_is_an_incident_without_traceback_and_is_logged(
    connect: Any, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.ERROR):
        text = await refused(connect, "break_down")
    assert text.startswith("[unexpected] break_down failed because of a bug in the server (incident ")
    assert "secret" not in text
    assert "Traceback" not in text
    incident = text.partition("incident ")[2].partition(")")[0]
    assert f"incident {incident}" in caplog.text
    assert "KeyError: 'secret'" in caplog.text


async def test_control_and_invisible_characters_are_removed_from_both_channels(connect: Any) -> None:
    smuggled = "a\x00b\x1b[31mc\u200bd\u202ee\ufeff\U000e0041f\r\n\tg"
    async with connect() as client:
        result = await client.call_tool("echo", {"text": smuggled, "tags": [smuggled]})
        for character in "\x00\x08\x1b\r\x7f\u200b\u202e\ufeff":
            alone = await client.call_tool("echo", {"text": f"a{character}b"})
            assert alone.structured_content["said"]["text"] == "ab", repr(character)
    assert result.structured_content["said"]["text"] == "ab[31mcdef\n\tg"
    assert result.structured_content["said"]["tags"] == ["ab[31mcdef\n\tg"]
    async with connect() as client:
        picture = await client.call_tool("draw", {})
        refusal = await client.call_tool("echo", {"text": "x", "a\u200bb": 1})
    assert picture.content[0].text == "a picture"
    assert "'ab'" in text_of(refusal)


async def test_picture_comes_without_structure_and_with_a_link(connect: Any) -> None:
    async with connect() as client:
        result = await client.call_tool("draw", {})
        (tool,) = [tool for tool in (await client.list_tools()).tools if tool.name == "draw"]
    assert tool.output_schema is None
    assert result.structured_content is None
    text, image, link = result.content
    assert isinstance(text, TextContent)
    assert isinstance(image, ImageContent)
    assert isinstance(link, ResourceLink)
    assert base64.b64decode(image.data).startswith(b"\x89PNG")
    assert (image.mime_type, link.name, str(link.uri)) == ("image/png", "p.png", "plannerforge://picture/p.png")


async def test_progress_rises_and_ends_at_one(connect: Any) -> None:
    told: list[tuple[float, float | None, str | None]] = []

    async def note(progress: float, total: float | None, message: str | None) -> None:
        told.append((progress, total, message))

    async with connect() as client:
        await client.call_tool("tell_progress", {}, progress_callback=note)
        assert not (await client.call_tool("tell_progress", {})).is_error, "nobody listens"
    assert told[-1] == (1.0, 1.0, "at 1.0")
    assert [share for share, _, _ in told] == sorted({share for share, _, _ in told})


async def test_tools_are_listed_in_the_order_of_the_registry_with_true_hints(
    connect: Any, probe_tools: tuple[Any, ...]
) -> None:
    async with connect() as client:
        tools = (await client.list_tools()).tools
    assert [tool.name for tool in tools] == [spec.name for spec in probe_tools]
    for tool, spec in zip(tools, probe_tools, strict=True):
        assert tool.annotations.read_only_hint == (spec.read_only and not spec.making)
        assert (tool.annotations.destructive_hint, tool.annotations.open_world_hint) == (False, False)


async def test_job_is_waited_for_listed_and_cancelled(connect: Any) -> None:
    async with connect() as client:
        started = await client.call_tool("start_job", {"text": "endless"})
        job_id = started.structured_content["said"]["text"]
        running = await client.call_tool("get_job", {"job_id": job_id, "wait_s": 0.05})
        cancelled = await client.call_tool("cancel_job", {"job_id": job_id})
        await client.call_tool("start_job", {"text": "short"})
        done = await client.call_tool("get_job", {"wait_s": 50})
        listed = await client.call_tool("list_artifacts", {"kind": "job"})
    assert running.structured_content["state"] == "running"
    assert cancelled.structured_content["state"] == "cancelled"
    assert cancelled.structured_content["results"] == ["run_0123456789ab"]
    assert done.structured_content["state"] == "done"
    assert "(batch): done." in text_of(done)
    assert [job["name"] for job in listed.structured_content["artifacts"]] == ["done, 100%", "cancelled, 50%"]
