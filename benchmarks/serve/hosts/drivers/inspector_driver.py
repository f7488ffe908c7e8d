"""The MCP Inspector's command line, a process for each call. It takes its next call from the plain story."""

import json
import subprocess
import sys
import urllib.request
from pathlib import Path
from typing import Any

TASK = json.loads(Path(sys.argv[1]).read_text())
CONFIG = Path("mcp.json")


def next_move(tools: list[str], shown: list[Any]) -> Any:
    """Return the story's next step after what was shown."""
    body = json.dumps({"tools": tools, "shown": shown}).encode()
    request = urllib.request.Request(f"{TASK['model']}/story", body, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


def inspect(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the inspector once."""
    command = ["mcp-inspector", "--cli", "--config", str(CONFIG), "--server", "plannerforge", "--format", "json"]
    return subprocess.run([*command, *arguments], capture_output=True, text=True, stdin=subprocess.DEVNULL)


by_stdio = {"type": "stdio", "command": TASK.get("command"), "args": TASK.get("arguments"), "env": TASK.get("env")}
server = {"type": "streamable-http", "url": TASK["url"]} if TASK["url"] else by_stdio
CONFIG.write_text(json.dumps({"mcpServers": {"plannerforge": {**server, "protocolEra": "auto"}}}))
listed = inspect("--method", "tools/list")
print(listed.stdout[:300], listed.stderr[:2000])
tools = [tool["name"] for tool in json.loads(listed.stdout)["result"]["tools"]]
shown: list[Any] = []
while (move := next_move(tools, shown))["tool"]:
    done = inspect(
        "--method", "tools/call", "--tool-name", move["tool"], "--tool-args-json", json.dumps(move["arguments"])
    )
    print(done.returncode, done.stdout[:300], done.stderr[:1000])
    try:
        result = json.loads(done.stdout)["result"]
        content = [*result["content"], *([result["structuredContent"]] if "structuredContent" in result else [])]
    except (ValueError, KeyError):
        content = [done.stdout + done.stderr]
    shown.append({"tool": move["tool"], "content": content})
Path(TASK["report"]).write_text(json.dumps({"said": move["text"]}))
