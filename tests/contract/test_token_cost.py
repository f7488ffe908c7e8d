"""What a model reads before it asks anything stays small."""

import pytest

from plannerforge.cli.tool_costs import tool_cost
from plannerforge.server.application import INSTRUCTIONS
from plannerforge.server.assembly import offered_tools
from plannerforge.server.settings import Settings
from plannerforge.server.tool_schema import described_tool
from plannerforge.tools.registry import TOOLS, ToolSpec

MOST_TOKENS_ALL, MOST_TOKENS_ESSENTIAL, MOST_TOKENS_A_TOOL, MOST_TOKENS_MODIFY = 5200, 3000, 500, 950
MOST_WORDS_OF_INSTRUCTIONS = 150


@pytest.mark.parametrize("spec", TOOLS, ids=lambda spec: spec.name)
def test_a_tool_costs_few_tokens(spec: ToolSpec) -> None:
    most = MOST_TOKENS_MODIFY if spec.name == "modify_scenario" else MOST_TOKENS_A_TOOL
    assert tool_cost(spec) <= most


def test_all_tools_together_cost_few_tokens() -> None:
    assert sum(tool_cost(spec) for spec in TOOLS) <= MOST_TOKENS_ALL


def test_the_set_for_small_models_costs_fewer() -> None:
    assert sum(tool_cost(spec) for spec in offered_tools(Settings(tools="essential"))) <= MOST_TOKENS_ESSENTIAL


def test_the_set_for_small_models_lists_no_seldom_argument_that_the_whole_set_lists() -> None:
    whole, small = (
        {spec.name: described_tool(spec).input_schema["properties"] for spec in offered_tools(Settings(tools=tools))}
        for tools in ("all", "essential")
    )
    seldom = {spec.name: set(spec.seldom) for spec in TOOLS}
    assert seldom["generate_scenarios"]
    assert {name: set(whole[name]) - set(small[name]) for name in small} == {name: seldom[name] for name in small}


def test_the_instructions_are_short() -> None:
    assert len(INSTRUCTIONS.split()) <= MOST_WORDS_OF_INSTRUCTIONS


def test_tool_names_leave_room_for_the_prefix_of_a_host() -> None:
    assert all(len(spec.name) <= 40 for spec in TOOLS)
