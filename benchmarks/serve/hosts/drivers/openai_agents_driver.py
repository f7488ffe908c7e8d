"""OpenAI's Agents SDK with an MCP server, as its page shows it; the model uses OpenAI's responses API."""

import asyncio
import json
import sys
from pathlib import Path

from agents import Agent, OpenAIResponsesModel, Runner, set_tracing_disabled
from agents.mcp import MCPServerStdio, MCPServerStreamableHttp
from openai import AsyncOpenAI

TASK = json.loads(Path(sys.argv[1]).read_text())


async def main() -> None:
    """Do the task."""
    set_tracing_disabled(True)
    if TASK["url"]:
        server = MCPServerStreamableHttp({"url": TASK["url"]}, name="plannerforge", client_session_timeout_seconds=60)
    else:
        started = {"command": TASK["command"], "args": TASK["arguments"], "env": TASK["env"]}
        server = MCPServerStdio(started, name="plannerforge", client_session_timeout_seconds=60)
    client = AsyncOpenAI(base_url=f"{TASK['model']}/v1", api_key="none")
    async with server:
        model = OpenAIResponsesModel(TASK["model_name"], client)
        agent = Agent(name="engineer", model=model, mcp_servers=[server])
        answer = await Runner.run(agent, TASK["request"], max_turns=30)
    Path(TASK["report"]).write_text(json.dumps({"said": str(answer.final_output)}))


asyncio.run(main())
