"""The number of tokens that tools and prompts use before a model's first request: names, descriptions, schemas and
texts.
"""

import json

from rich.console import Console
from rich.table import Table

from ..engine.maps import built_in_maps
from ..prompts.composition import CONDITIONS, TASKS, WorkspaceFacts, system_prompt
from ..server.assembly import offered_tools
from ..server.settings import Settings
from ..server.tokens import count_tokens
from ..server.tool_schema import described_tool
from ..tools.registry import ToolSpec


def tool_cost(spec: ToolSpec) -> int:
    """Return the number of o200k_base tokens of one tool, as a host passes it to a model."""
    tool = described_tool(spec)
    shown = {"name": tool.name, "description": tool.description, "inputSchema": tool.input_schema}
    return count_tokens(json.dumps(shown, separators=(",", ":"), ensure_ascii=False))


def print_costs(settings: Settings) -> None:
    """Print a table of the offered tools."""
    table = Table("tool", "tokens", "reads only", "what it does", title="Tools")
    costs = []
    for spec in offered_tools(settings):
        costs.append(tool_cost(spec))
        description = (described_tool(spec).description or "").split(". ")[0].rstrip(".")
        table.add_row(spec.name, str(costs[-1]), "yes" if spec.read_only else "", description)
    table.add_section()
    table.add_row("all", str(sum(costs)), "", "")
    Console().print(table)


def prompt_costs() -> dict[str, tuple[int, ...]]:
    """Return the number of o200k_base tokens of each task's prompt by condition, in a new workspace."""
    facts = WorkspaceFacts(tuple(entry.facts.place for entry in built_in_maps()), ("ZAM",))
    return {
        task: tuple(count_tokens(system_prompt(task, condition, facts)) for condition in CONDITIONS) for task in TASKS
    }


def print_prompt_costs() -> None:
    """Print a table of the tasks with the tokens of their prompts under each condition."""
    table = Table("task", *CONDITIONS, title="Tokens of the prompts")
    for task, costs in prompt_costs().items():
        table.add_row(task, *map(str, costs))
    Console().print(table)
