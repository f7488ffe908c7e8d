"""Prompts: text with the arguments filled in; what is missing or unknown is a protocol error in both eras."""

from typing import Any

import pytest
from mcp import MCPError
from mcp.types import INVALID_PARAMS, PromptReference, TextContent

from plannerforge.prompts.composition import CONDITIONS, TASKS

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("probe_tools")]


async def test_prompts_are_listed_with_their_arguments(connect: Any) -> None:
    async with connect() as client:
        prompts = (await client.list_prompts()).prompts
    assert {
        prompt.name: {argument.name: bool(argument.required) for argument in prompt.arguments} for prompt in prompts
    } == {
        **{task: {"condition": False, "request": False} for task in TASKS},
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
        ("generation", {}, ["generate_scenarios", "Maps here: “Fahrhausen”", "Demonstrations:", "Reasoning:"]),
        ("tuning", {"condition": "cp", "request": "more {comfort}"}, ["velocity_offset", "Request: more {comfort}"]),
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
    assert "{" not in message.content.text.replace("{now}", "").replace("{comfort}", "") or name in TASKS


@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("compare_presets", {}, "needs scenarios. Valid: scenarios, preset_a, preset_b"),
        ("compare_presets", {"scenarios": ""}, "needs scenarios"),
        ("explain_a_run", {"rum": "run_1"}, "has no argument 'rum'. Valid: run"),
        (
            "tuning",
            {"condition": "icl"},
            "there is no condition 'icl'. Valid: baseline, cp, cp_cot, cp_icl, cp_icl_cot",
        ),
        ("tuning", {"conditions": "cp"}, "has no argument 'conditions'. Valid: condition, request"),
        ("explain_run", {}, "there is no prompt 'explain_run'. Valid: explain_a_run"),
    ],
)
async def test_a_wrong_request_is_a_protocol_error_with_the_valid_values(
    connect: Any, name: str, arguments: dict[str, str], expected: str
) -> None:
    async with connect() as client:
        with pytest.raises(MCPError) as caught:
            await client.get_prompt(name, arguments)
    assert caught.value.error.code == INVALID_PARAMS
    assert expected in caught.value.error.message


@pytest.mark.parametrize(
    ("prompt", "argument", "typed", "expected"),
    [
        ("selection", "condition", "", list(CONDITIONS)),
        ("selection", "condition", "CP_I", ["cp_icl", "cp_icl_cot"]),
        ("selection", "condition", "x", []),
        ("selection", "request", "f", []),
        ("compare_presets", "preset_b", "saf", ["Safety-Conservative"]),
        ("find_the_weak_spot", "config", "idm:C", ["idm:Cautious"]),
    ],
)
async def test_enumerations_are_completed(
    connect: Any, prompt: str, argument: str, typed: str, expected: list[str]
) -> None:
    async with connect() as client:
        reference = PromptReference(type="ref/prompt", name=prompt)
        completion = (await client.complete(reference, {"name": argument, "value": typed})).completion
    assert (completion.values, completion.total, completion.has_more) == (expected, len(expected), False)


@pytest.mark.usefixtures("starter_ready")
async def test_ids_of_scenarios_are_completed(connect: Any) -> None:
    async with connect() as client:
        reference = PromptReference(type="ref/prompt", name="find_the_weak_spot")
        completion = (await client.complete(reference, {"name": "scenario", "value": "zam_fahr"})).completion
    assert "ZAM_Fahrhausen-4_1_T-1" in completion.values
    assert all(value.startswith("ZAM_Fahrhausen") for value in completion.values)


async def test_completion_of_an_unknown_argument_is_refused(connect: Any) -> None:
    async with connect() as client:
        with pytest.raises(MCPError, match="has no argument 'condition'"):
            await client.complete(
                PromptReference(type="ref/prompt", name="compare_presets"), {"name": "condition", "value": ""}
            )
