"""ollmcp in its own terminal: the driver types a user's input and reads the screen."""

import json
import os
import pty
import re
import select
import sys
import time
from pathlib import Path

TASK = json.loads(Path(sys.argv[1]).read_text())
STEPS = re.compile(r"\x1b(?:\[[0-?]*[ -/]*[@-~]|\][^\x07]*\x07|.)|[│╭╮╰╯─]")
by_stdio = {"command": TASK.get("command"), "args": TASK.get("arguments"), "env": TASK.get("env")}
server = {"type": "streamable_http", "url": TASK["url"]} if TASK["url"] else by_stdio
Path("servers.json").write_text(json.dumps({"mcpServers": {"plannerforge": server}}))
program = str(Path(sys.executable).parent / "ollmcp")
command = [program, "--servers-json", "servers.json", "--host", TASK["model"], "--model", TASK["model_name"]]
child, terminal = pty.fork()
if child == 0:
    os.execv(program, command)


def read_until(words: str, seconds: float) -> str:
    """Return the screen's text until it shows some words, or the time is over."""
    shown, end = "", time.monotonic() + seconds
    while time.monotonic() < end:
        if select.select([terminal], [], [], 1.0)[0]:
            try:
                part = os.read(terminal, 65536).decode("utf-8", "replace")
            except OSError:
                break
            sys.stdout.write(part)
            if "\x1b[6n" in part:  # it queries the cursor's position, which a terminal knows
                os.write(terminal, b"\x1b[1;1R")
            shown += part
            if re.search(words, " ".join(STEPS.sub(" ", shown).split())):
                break
    return " ".join(STEPS.sub(" ", shown).split())


def type_line(text: str) -> None:
    """Type a line."""
    os.write(terminal, text.encode() + b"\r")


said = read_until("❯", 120)
type_line("/human-in-the-loop")
said = read_until("❯", 30)
type_line(TASK["request"])
said = read_until("the picture is drawn|Run another", 300)
if "Run another" in said:  # it asks after every seven calls
    type_line("c")
    said = read_until("the picture is drawn", 300)
type_line("/quit")
read_until("nothing", 10)
Path(TASK["report"]).write_text(json.dumps({"said": said}))
