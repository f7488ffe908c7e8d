"""FastMCP's client: a program that calls tools itself and takes its next call from the plain story."""

import asyncio
import json
import sys
import urllib.request
from pathlib import Path
from typing import Any

from fastmcp import Client
from fastmcp.client.transports import StdioTransport
from fastmcp.exceptions import ToolError

TASK = json.loads(Path(sys.argv[1]).read_text())


def next_move(tools: list[str], shown: list[Any]) -> Any:
    """Return the story's next step after what was shown."""
    body = json.dumps({"tools": tools, "shown": shown}).encode()
    request = urllib.request.Request(f"{TASK['model']}/story", body, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


async def main() -> None:
    """Do the task."""
    notes: list[str | None] = []

    async def on_progress(progress: float, total: float | None, message: str | None) -> None:
        notes.append(message)

    server = TASK["url"] or StdioTransport(TASK["command"], TASK["arguments"], env=TASK["env"])
    async with Client(server, progress_handler=on_progress) as client:
        tools = [tool.name for tool in await client.list_tools()]
        shown: list[Any] = []
        while (move := next_move(tools, shown))["tool"]:
            try:
                result = await client.call_tool(move["tool"], move["arguments"])
            except ToolError as refusal:
                content = [str(refusal)]
            else:
                content = [block.model_dump(mode="json") for block in result.content] + [result.structured_content]
            shown.append({"tool": move["tool"], "content": content})
    Path(TASK["report"]).write_text(json.dumps({"said": move["text"], "progress": len(notes)}))


asyncio.run(main())
