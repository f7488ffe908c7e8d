"""An MCP server that breaks every law of the robustness bench on request; its argument is its workspace."""

import os
import sys
import time
from pathlib import Path

import anyio
from mcp.server import MCPServer

server = MCPServer("misbehaving", log_level="ERROR")
held: list[bytearray] = []


@server.tool()
async def find_scenarios(text: str) -> str:
    return text


@server.tool()
async def say(text: str) -> str:
    return text


@server.tool()
async def block(seconds: float) -> str:
    time.sleep(seconds)
    return "held the loop"


@server.tool()
async def wait(seconds: float) -> str:
    await anyio.sleep(seconds)
    return "[refused] late. Next: ask earlier."


@server.tool()
async def die() -> str:
    os._exit(1)


@server.tool()
async def eat(megabytes: int) -> str:
    held.append(bytearray(os.urandom(1)) * (megabytes * 1_000_000))
    held.clear()
    return "ate"


@server.tool()
async def write(path: str) -> str:
    Path(path).write_text("written")
    return "wrote"


@server.tool()
async def defect() -> str:
    sys.stderr.write('incident 0badcafe:\n  File "/x/engine/maps/osm.py", line 7, in read\nValueError: too long\n')
    sys.stderr.flush()
    return "[unexpected] defect failed through a defect of the server (incident 0badcafe). Next: report it."


if __name__ == "__main__":
    server.run()
