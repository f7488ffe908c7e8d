"""Claude Code without its window, as its manual shows it, with its API on loopback."""

import json
import os
import subprocess
import sys
from pathlib import Path

TASK = json.loads(Path(sys.argv[1]).read_text())
by_stdio = {"type": "stdio", "command": TASK.get("command"), "args": TASK.get("arguments"), "env": TASK.get("env")}
server = {"type": "http", "url": TASK["url"]} if TASK["url"] else by_stdio
Path("mcp.json").write_text(json.dumps({"mcpServers": {"plannerforge": server}}))
variables = {
    **os.environ,
    "ANTHROPIC_BASE_URL": TASK["model"],
    "ANTHROPIC_API_KEY": "none",
    "CLAUDE_CODE_DISABLE_NONESSENTIAL_TRAFFIC": "1",
    "DISABLE_AUTOUPDATER": "1",
    "ENABLE_TOOL_SEARCH": "false",  # all tools are listed: the story has no word for looking for one
}
command = ["claude", "--print", TASK["request"], "--output-format", "json", "--model", "claude-sonnet-4-5"]
command += ["--mcp-config", "mcp.json", "--strict-mcp-config", "--allowedTools", "mcp__plannerforge"]
done = subprocess.run(command, env=variables, stdin=subprocess.DEVNULL, capture_output=True, text=True)
print(done.stdout[-3000:], done.stderr[-3000:])
said = json.loads(done.stdout)["result"] if done.stdout.startswith("{") else done.stdout
Path(TASK["report"]).write_text(json.dumps({"said": said}))
sys.exit(done.returncode)
