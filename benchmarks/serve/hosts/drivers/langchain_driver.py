"""LangChain's agent with the tools of langchain-mcp-adapters, as their page shows it."""

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

from langchain.agents import create_agent
from langchain_mcp_adapters.callbacks import Callbacks
from langchain_mcp_adapters.client import MultiServerMCPClient
from langchain_mcp_adapters.tools import load_mcp_tools
from langchain_openai import ChatOpenAI

TASK = json.loads(Path(sys.argv[1]).read_text())


async def main() -> None:
    """Do the task in one session: get_tools() of the client alone starts a server for each call."""
    notes: list[str | None] = []

    async def on_progress(progress: float, total: float | None, message: str | None, context: Any) -> None:
        notes.append(message)

    by_stdio = {"transport": "stdio", "command": TASK.get("command"), "args": TASK.get("arguments")}
    by_stdio["env"] = TASK.get("env")
    server = {"transport": "streamable_http", "url": TASK["url"]} if TASK["url"] else by_stdio
    client = MultiServerMCPClient({"plannerforge": server})
    model = ChatOpenAI(model=TASK["model_name"], base_url=f"{TASK['model']}/v1", api_key="none")
    async with client.session("plannerforge") as session:
        tools = await load_mcp_tools(session, callbacks=Callbacks(on_progress=on_progress), server_name="plannerforge")
        agent = create_agent(model, tools)
        answer = await agent.ainvoke({"messages": [("user", TASK["request"])]}, {"recursion_limit": 60})
    said = answer["messages"][-1].text
    Path(TASK["report"]).write_text(json.dumps({"said": said, "progress": len(notes)}))


asyncio.run(main())
