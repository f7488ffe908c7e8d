"""MCP servers that an agent works with: by command, in this process, by address; their tools as models see them."""

import json
import sys
from pathlib import Path
from typing import Any

import ollama
import pytest
from mcp import StdioServerParameters
from support.tool_server import served_tools, tool_server

from plannerforge.agent.connection import Picture, Server, ToolAnswer, ToolConnection, own_server, shown_to_model
from plannerforge.agent.errors import ToolServerGone
from plannerforge.agent.tool_schemas import flattened
from plannerforge.server.tool_schema import described_tool
from plannerforge.tools.registry import TOOLS, ToolSpec

pytestmark = pytest.mark.anyio


def unseen(share: float | None, message: str) -> None: ...


async def test_a_server_behind_an_address_is_spoken_to_as_any_other() -> None:
    with served_tools() as url:
        async with ToolConnection.open(url) as connection:
            answer = await connection.call("make_scenario", {"vehicles": 2}, unseen)
    assert answer.structured == {"scenario_id": "TST_Town-2_1_T-1", "vehicles": 2}


@pytest.mark.parametrize("server", ["http://127.0.0.1:9/mcp", StdioServerParameters(command="/no/such/program")])
async def test_a_missing_server_is_reported(server: Server) -> None:
    with pytest.raises(ToolServerGone, match=r"cannot be reached: .*Next: check that its command or address is right"):
        async with ToolConnection.open(server):
            pass


async def test_standard_error_of_a_program_is_kept_in_the_log(tmp_path: Path) -> None:
    log = tmp_path / "logs" / "server.log"
    program = StdioServerParameters(command=sys.executable, args=["-c", "import sys; sys.exit('no licence')"])
    with pytest.raises(ToolServerGone, match=r"check that .*, and the log .*server\.log"):
        async with ToolConnection.open(program, log):
            pass
    assert log.read_text(encoding="utf-8") == "no licence\n"


async def test_an_error_of_the_block_is_raised_as_it_is() -> None:
    with pytest.raises(LookupError, match="of the block"):
        async with ToolConnection.open(tool_server()):
            raise LookupError("of the block")


async def test_the_own_server_starts_with_the_settings_of_this_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PLANNERFORGE_STARTER", "false")
    monkeypatch.setenv("PLANNERFORGE_WARM_UP", "false")
    async with ToolConnection.open(own_server(workspace=str(tmp_path / "workspace"), tools="essential")) as connection:
        names = {tool.name for tool in connection.tools}
        answer = await connection.call("list_artifacts", {}, unseen)
        empty = await connection.call("describe_catalog", {}, unseen)
    assert "generate_scenarios" in names
    assert len(names) < len(TOOLS)
    assert answer.is_error
    assert empty.structured["scenarios"] == 0


async def test_an_answer_without_text_is_its_structure_or_called_empty() -> None:
    assert shown_to_model(ToolAnswer("", {}, is_error=False), 100) == "(an empty answer)"
    pictures = (Picture(b"", "image/png"),) * 2
    assert shown_to_model(ToolAnswer("Two.", {}, False, pictures), 100) == "Two.\n[2 pictures shown to the user]"


@pytest.mark.parametrize("spec", TOOLS, ids=lambda spec: spec.name)
async def test_a_schema_is_flat_and_passes_the_client_of_ollama_whole(spec: ToolSpec) -> None:
    flat = flattened(described_tool(spec).input_schema)
    written = json.dumps(flat)
    assert "$ref" not in written
    assert "anyOf" not in written
    function = {"name": spec.name, "description": "", "parameters": flat}
    kept = ollama.Tool.model_validate({"type": "function", "function": function}).model_dump(exclude_none=True)
    assert kept["function"]["parameters"]["properties"] == {
        name: {key: value for key, value in part.items() if key in ("type", "items", "description", "enum")}
        for name, part in flat["properties"].items()
    }


@pytest.mark.parametrize(
    ("schema", "flat"),
    [
        (
            {"type": "integer", "minimum": 1, "maximum": 9},
            {"type": "integer", "description": "(at least 1, at most 9)"},
        ),
        (
            {"type": "string", "description": "Where.", "default": "here"},
            {"type": "string", "description": "Where (default here)"},
        ),
        ({"anyOf": [{"type": "number"}, {"type": "null"}], "default": None}, {"type": "number"}),
        ({"type": ["number", "null"]}, {"type": "number"}),
        ({"anyOf": [{"type": "number"}, {"type": "string"}]}, {"type": ["number", "string"]}),
        ({"$ref": "#/$defs/Kind"}, {"type": "string", "enum": ["car", "truck"]}),
        (
            {"type": "array", "items": {"$ref": "#/$defs/Kind"}},
            {"type": "array", "items": {"type": "string", "enum": ["car", "truck"]}},
        ),
        ({"const": "car"}, {"enum": ["car"]}),
        ({"anyOf": [{"const": "car"}, {"enum": ["bus"]}]}, {"enum": ["car", "bus"]}),
    ],
)
async def test_a_part_of_a_schema_states_in_words_what_is_lost(schema: dict[str, Any], flat: dict[str, Any]) -> None:
    kind = {"type": "string", "enum": ["car", "truck"], "title": "Kind"}
    whole = {"type": "object", "properties": {"part": schema}, "$defs": {"Kind": kind}}
    assert flattened(whole)["properties"]["part"] == flat


async def test_a_schema_that_refers_to_itself_ends() -> None:
    node = {"type": "object", "properties": {"next": {"$ref": "#/$defs/Node"}}}
    assert "$ref" not in json.dumps(flattened({"$ref": "#/$defs/Node", "$defs": {"Node": node}}))
