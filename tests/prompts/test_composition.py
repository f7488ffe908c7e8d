"""Prompts of tasks: their conditions contain one another, their words exist, and their demonstrations hold."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Any

import jsonschema
import pytest
from mcp.types import TextContent

from plannerforge.cli.tool_costs import prompt_costs
from plannerforge.prompts import composition
from plannerforge.prompts.composition import CONDITIONS, TASKS, WorkspaceFacts, system_prompt, task_parts
from plannerforge.schemas.errors import UnknownName
from plannerforge.schemas.vocabulary import TAGS
from plannerforge.server.tool_schema import described_tool
from plannerforge.tools.registry import TOOLS

MOST_TOKENS = {"baseline": 150, "cp": 700, "cp_cot": 1000, "cp_icl": 1400, "cp_icl_cot": 1700}
PAGE = Path(__file__).resolve().parents[2] / "docs" / "prompts.md"
SCHEMAS = {spec.name: described_tool(spec).input_schema for spec in TOOLS}


@dataclass(frozen=True)
class Step:
    """A call of a demonstration, and the code of its refusal (empty: it succeeds)."""

    tool: str
    arguments: dict[str, Any]
    refused: str


def demonstrated(text: str) -> Iterator[Step]:
    """The calls of a part's demonstrations in their order."""
    for tool, arguments, refused in re.findall(r"^Call: (\w+) (.*)$(?:\nRefused: (\w+))?", text, re.MULTILINE):
        yield Step(tool, json.loads(arguments), refused)


@pytest.mark.parametrize("task", TASKS)
def test_conditions_contain_one_another(task: str) -> None:
    paragraphs = {condition: set(system_prompt(task, condition).split("\n\n")) for condition in CONDITIONS}
    assert paragraphs["baseline"] < paragraphs["cp"] < paragraphs["cp_icl"] < paragraphs["cp_icl_cot"]
    assert paragraphs["cp"] < paragraphs["cp_cot"] < paragraphs["cp_icl_cot"]
    assert paragraphs["cp_icl"] | paragraphs["cp_cot"] == paragraphs["cp_icl_cot"]


def test_every_file_of_parts_is_a_task_with_all_parts() -> None:
    folder = Path(composition.__file__).parent / "parts"
    assert {path.stem for path in folder.iterdir()} == set(TASKS)
    for task in TASKS:
        assert list(task_parts(task)) == list(CONDITIONS["cp_icl_cot"])
        assert all(task_parts(task).values())


@pytest.mark.parametrize("task", TASKS)
def test_every_word_of_the_vocabulary_is_filled_in(task: str) -> None:
    parts = task_parts(task)
    assert "$" not in system_prompt(task, "cp_icl_cot")
    assert not any("$" in body for heading, body in parts.items() if heading != "Context")


def test_prompt_of_selection_names_all_tags() -> None:
    assert ", ".join(TAGS) in system_prompt("selection", "cp")
    assert TAGS.keys() >= {"intersection"}


def test_every_word_of_the_vocabulary_is_used() -> None:
    used = {name for task in TASKS for name in Template(task_parts(task)["Context"]).get_identifiers()}
    assert used == {
        *("behaviours", "countries", "densities", "edit_ops", "features", "map_places", "measures", "obstacle_types"),
        *("planners", "presets", "road_net", "scenario_types", "tags", "vehicle_classes", "weights"),
    }


def test_places_of_a_workspace_are_named_up_to_a_bound_and_in_one_line() -> None:
    text = system_prompt("generation", "cp", WorkspaceFacts(("Ham\nburg", *(f"P{n}" for n in range(30)))))
    assert "Maps here: “Ham burg”, “P0”" in text
    assert "“P10” and more (describe_catalog)" in text
    assert "P11" not in text


@pytest.mark.parametrize(("task", "condition"), [("cooking", "cp"), ("tuning", "icl")])
def test_unknown_task_or_condition_is_refused(task: str, condition: str) -> None:
    with pytest.raises(UnknownName, match=r"there is no (task 'cooking'|condition 'icl')"):
        system_prompt(task, condition)


@pytest.mark.parametrize("task", TASKS)
def test_tools_and_arguments_named_in_a_prompt_exist(task: str) -> None:
    text = "\n".join(task_parts(task).values())
    verbs = "|".join(sorted({name.split("_")[0] for name in SCHEMAS}))
    named = set(re.findall(rf"\b(?:{verbs})_[a-z]+\b", text))
    ops = set(SCHEMAS["modify_scenario"]["properties"]["edits"]["items"]["properties"]["op"]["enum"])
    assert named <= SCHEMAS.keys() | ops
    for step in demonstrated(text):
        jsonschema.validate(step.arguments, SCHEMAS[step.tool] | {"additionalProperties": False})


@pytest.mark.parametrize("task", [task for task in TASKS if task != "routing"])
def test_lines_of_the_context_begin_with_tools_and_arguments_that_exist(task: str) -> None:
    edit = SCHEMAS["modify_scenario"]["properties"]["edits"]["items"]["properties"]
    arguments = {name for schema in SCHEMAS.values() for name in schema["properties"]}
    first = re.findall(r"^- (\w+)", task_parts(task)["Context"], re.MULTILINE)
    known = SCHEMAS.keys() | arguments | edit.keys() | set(edit["op"]["enum"])
    assert [word for word in first if word not in known] == []


@pytest.mark.parametrize("task", TASKS)
def test_demonstrations_show_calls_and_a_refusal(task: str) -> None:
    steps = list(demonstrated(task_parts(task)["Demonstrations"]))
    assert any(step.refused for step in steps)
    assert sum(not step.refused for step in steps) >= 2


@pytest.mark.anyio
@pytest.mark.usefixtures("starter_ready")
@pytest.mark.parametrize("task", TASKS)
async def test_demonstrations_give_the_stated_results(connect: Any, task: str) -> None:
    async with connect() as client:
        for step in demonstrated(task_parts(task)["Demonstrations"]):
            result = await client.call_tool(step.tool, step.arguments)
            text = "".join(part.text for part in result.content if isinstance(part, TextContent))
            code = text[1:].partition("]")[0] if result.is_error else ""
            assert code == step.refused, (step, text)
            while not result.is_error and "job_id" in text.rpartition("Next:")[2]:
                result = await client.call_tool("get_job", {"wait_s": 30})
                text = "".join(part.text for part in result.content if isinstance(part, TextContent))


def test_prompts_cost_few_tokens() -> None:
    above = {
        (task, condition): cost
        for task, costs in prompt_costs().items()
        for condition, cost in zip(CONDITIONS, costs, strict=True)
        if cost > MOST_TOKENS[condition]
    }
    assert above == {}


def test_the_page_states_what_each_prompt_costs() -> None:
    rows = [f"| {task} | {' | '.join(map(str, costs))} |" for task, costs in prompt_costs().items()]
    page = PAGE.read_text(encoding="utf-8")
    assert [row for row in rows if row not in page] == []
