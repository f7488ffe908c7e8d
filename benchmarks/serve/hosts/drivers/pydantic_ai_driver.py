"""Pydantic AI's agent with an MCP toolset, as its page shows it."""

import asyncio
import json
import sys
from pathlib import Path

from fastmcp.client.transports import StdioTransport
from pydantic_ai import Agent
from pydantic_ai.mcp import MCPToolset
from pydantic_ai.models.openai import OpenAIChatModel
from pydantic_ai.providers.openai import OpenAIProvider

TASK = json.loads(Path(sys.argv[1]).read_text())


async def main() -> None:
    """Do the task."""
    notes: list[str | None] = []

    async def on_progress(progress: float, total: float | None, message: str | None) -> None:
        notes.append(message)

    server = TASK["url"] or StdioTransport(TASK["command"], TASK["arguments"], env=TASK["env"])
    helping = {"tool_error_behavior": "failed"} if TASK["helped"] else {}
    tools = MCPToolset(server, progress_handler=on_progress, init_timeout=120, **helping)
    provider = OpenAIProvider(base_url=f"{TASK['model']}/v1", api_key="none")
    agent = Agent(OpenAIChatModel(TASK["model_name"], provider=provider), toolsets=[tools])
    async with agent:
        answer = await agent.run(TASK["request"])
    Path(TASK["report"]).write_text(json.dumps({"said": answer.output, "progress": len(notes)}))


asyncio.run(main())
