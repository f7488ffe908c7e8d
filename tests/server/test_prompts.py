"""Prompts: text with the arguments filled in; what is missing or unknown is a protocol error in both eras."""

from typing import Any

import pytest
from mcp import MCPError
from mcp.types import INVALID_PARAMS, TextContent

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("probe_tools")]


async def test_prompts_are_listed_with_their_arguments(connect: Any) -> None:
    async with connect() as client:
        prompts = (await client.list_prompts()).prompts
    assert {prompt.name: {argument.name: argument.required for argument in prompt.arguments} for prompt in prompts} == {
        "compare_presets": {"scenarios": True, "preset_a": False, "preset_b": False},
        "find_the_weak_spot": {"scenario": True, "config": False},
        "explain_a_run": {"run": False},
    }
    assert all(prompt.description and prompt.title for prompt in prompts)


@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("compare_presets", {"scenarios": "rain {now}"}, ["rain {now}", "preset Default", "Safety-Conservative"]),
        ("compare_presets", {"scenarios": "s", "preset_b": "Comfort"}, ["preset Comfort"]),
        ("find_the_weak_spot", {"scenario": "DEU_A-1_1_T-1"}, ["DEU_A-1_1_T-1", "frenetix:Default"]),
        ("explain_a_run", {"run": "run_1"}, ["Explain the run run_1"]),
        ("explain_a_run", {}, ["latest_run"]),
    ],
)
async def test_prompt_is_one_text_with_its_arguments(
    connect: Any, name: str, arguments: dict[str, str], expected: list[str]
) -> None:
    async with connect() as client:
        (message,) = (await client.get_prompt(name, arguments)).messages
    assert message.role == "user"
    assert isinstance(message.content, TextContent)
    for words in expected:
        assert words in message.content.text
    assert "{" not in message.content.text.replace("{now}", "")


@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("compare_presets", {}, "needs scenarios. Valid: scenarios, preset_a, preset_b"),
        ("compare_presets", {"scenarios": ""}, "needs scenarios"),
        ("explain_a_run", {"rum": "run_1"}, "has no argument 'rum'. Valid: run"),
        ("explain_run", {}, "there is no prompt 'explain_run'. Valid: explain_a_run"),
    ],
)
async def test_wrong_request_is_a_protocol_error_that_says_what_is_valid(
    connect: Any, name: str, arguments: dict[str, str], expected: str
) -> None:
    async with connect() as client:
        with pytest.raises(MCPError) as caught:
            await client.get_prompt(name, arguments)
    assert caught.value.error.code == INVALID_PARAMS
    assert expected in caught.value.error.message
