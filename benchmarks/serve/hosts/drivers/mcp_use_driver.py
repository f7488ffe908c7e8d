"""mcp-use's agent, as its page shows it."""

import asyncio
import json
import os
import sys
from pathlib import Path

os.environ["MCP_USE_ANONYMIZED_TELEMETRY"] = "false"

from langchain_openai import ChatOpenAI
from mcp_use import MCPAgent, MCPClient

TASK = json.loads(Path(sys.argv[1]).read_text())


async def main() -> None:
    """Do the task."""
    by_stdio = {"command": TASK.get("command"), "args": TASK.get("arguments"), "env": TASK.get("env")}
    server = {"url": TASK["url"]} if TASK["url"] else by_stdio
    client = MCPClient.from_dict({"mcpServers": {"plannerforge": server}})
    model = ChatOpenAI(model=TASK["model_name"], base_url=f"{TASK['model']}/v1", api_key="none")
    agent = MCPAgent(llm=model, client=client, max_steps=30)
    said = await agent.run(TASK["request"])
    await client.close_all_sessions()
    Path(TASK["report"]).write_text(json.dumps({"said": str(said)}))


asyncio.run(main())
