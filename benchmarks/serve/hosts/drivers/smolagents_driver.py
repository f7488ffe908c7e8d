"""smolagents' tools of an MCP server, called as a code agent's program calls them.

It takes its next call from the plain story.
"""

import json
import sys
import urllib.request
from pathlib import Path
from typing import Any

from mcp import StdioServerParameters
from smolagents import MCPClient

TASK = json.loads(Path(sys.argv[1]).read_text())


def next_move(tools: list[str], shown: list[Any]) -> Any:
    """Return the story's next step after what was shown."""
    body = json.dumps({"tools": tools, "shown": shown}).encode()
    request = urllib.request.Request(f"{TASK['model']}/story", body, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


def as_content(value: object) -> object:
    """Return what the calling program holds: a text, a structure, or a picture."""
    return {"type": "image"} if type(value).__module__.startswith(("PIL.", "smolagents.")) else value


server: Any
if TASK["url"]:
    server = {"url": TASK["url"], "transport": "streamable-http"}
else:
    server = StdioServerParameters(command=TASK["command"], args=TASK["arguments"], env=TASK["env"])
with MCPClient(server, structured_output=True) as found:
    tools = {tool.name: tool for tool in found}
    shown: list[Any] = []
    while (move := next_move(list(tools), shown))["tool"]:
        try:
            content = as_content(tools[move["tool"]](**move["arguments"]))
        except Exception as refusal:  # noqa: BLE001 - whatever a tool raises is what the program sees
            content = str(refusal)
        shown.append({"tool": move["tool"], "content": [content]})
Path(TASK["report"]).write_text(json.dumps({"said": move["text"]}))
