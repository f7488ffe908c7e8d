"""An MCP server that breaks every law of the robustness bench on request; its argument is its workspace.

With ``--http`` it listens on a free port and prints its address, as the real one does.
"""

import os
import socket
import sys
import time
from pathlib import Path

import anyio
import uvicorn
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
    """Close every connection and exit shortly after, so that clients notice before the system does."""
    os.close(1)
    os.closerange(3, 1024)
    time.sleep(0.5)
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
    return "[unexpected] defect failed because of a bug in the server (incident 0badcafe). Next: report it."


def serve_http() -> None:
    listener = socket.create_server(("127.0.0.1", 0))
    sys.stderr.write(f"PlannerForge: MCP at http://127.0.0.1:{listener.getsockname()[1]}/mcp\n")
    sys.stderr.flush()
    uvicorn.Server(uvicorn.Config(server.streamable_http_app(), log_level="error")).run(sockets=[listener])


if __name__ == "__main__":
    if "--http" in sys.argv:
        serve_http()
    else:
        server.run()
