"""The tools as clients see them, read from files instead of computed, so that the first answer comes fast.

The files are the reviewed contract: ``pytest tests/contract --update-snapshots`` writes them from the models
(``tool_schema.py``), and the contract tests fail where the two differ.
"""

from importlib.resources import files

from mcp.types import Tool

from ..tools.registry import ToolSpec


def described_tool(spec: ToolSpec) -> Tool:
    """The tool with its description, schemas and annotations, without importing its models.

    A tool that has no file yet, because it is being developed, is described from its models.
    """
    file = files("plannerforge.server").joinpath("descriptions", f"{spec.name}.json")
    if file.is_file():
        return Tool.model_validate_json(file.read_text(encoding="utf-8"))
    from .tool_schema import tool_description

    return tool_description(spec)
