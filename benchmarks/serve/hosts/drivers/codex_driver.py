"""Codex without its window, as its manual shows it, with its API on loopback."""

import json
import os
import subprocess
import sys
from pathlib import Path

TASK = json.loads(Path(sys.argv[1]).read_text())
quoted = json.dumps
if TASK["url"]:
    server = f"url = {quoted(TASK['url'])}\n"
else:
    environment = ", ".join(f"{name} = {quoted(value)}" for name, value in TASK["env"].items())
    server = f"command = {quoted(TASK['command'])}\nargs = {quoted(TASK['arguments'])}\nenv = {{ {environment} }}\n"
home = Path("codex-home").resolve()
home.mkdir()
(home / "config.toml").write_text(
    f"""
model = {quoted(TASK["model_name"])}
model_provider = "loopback"
approval_policy = "never"
[model_providers.loopback]
name = "loopback"
base_url = {quoted(TASK["model"] + "/v1")}
wire_api = "responses"
[mcp_servers.plannerforge]
required = true
startup_timeout_sec = 120
tool_timeout_sec = 120
{server}"""
)
command = ["codex", "exec", "--skip-git-repo-check", "--sandbox", "read-only", "--output-last-message", "last.txt"]
variables = {**os.environ, "CODEX_HOME": str(home)}
done = subprocess.run(
    [*command, TASK["request"]], env=variables, stdin=subprocess.DEVNULL, capture_output=True, text=True
)
print(done.stdout[-6000:], done.stderr[-6000:])
last = Path("last.txt")
Path(TASK["report"]).write_text(json.dumps({"said": last.read_text() if last.is_file() else ""}))
sys.exit(done.returncode)
