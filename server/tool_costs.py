"""What the tools cost a model before it has asked anything: tokens of names, descriptions and input schemas."""

import json

from rich.console import Console
from rich.table import Table

from ..tools.registry import ToolSpec
from .assembly import offered_tools
from .settings import Settings
from .tokens import count_tokens
from .tool_schema import described_tool


def tool_cost(spec: ToolSpec) -> int:
    """o200k_base tokens of one tool as a host hands it to a model."""
    tool = described_tool(spec)
    shown = {"name": tool.name, "description": tool.description, "inputSchema": tool.input_schema}
    return count_tokens(json.dumps(shown, separators=(",", ":"), ensure_ascii=False))


def print_costs(settings: Settings) -> None:
    """A table of the tools on offer."""
    table = Table("tool", "tokens", "reads only", "what it does", title="Tools")
    costs = []
    for spec in offered_tools(settings):
        costs.append(tool_cost(spec))
        description = (described_tool(spec).description or "").split(". ")[0].rstrip(".")
        table.add_row(spec.name, str(costs[-1]), "yes" if spec.read_only else "", description)
    table.add_section()
    table.add_row("all", str(sum(costs)), "", "")
    Console().print(table)
