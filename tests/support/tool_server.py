"""A small MCP server with the manners that an agent meets: it works, fails, tells much, draws, ends itself."""

import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import anyio
import uvicorn
from mcp.server import MCPServer
from mcp.server.mcpserver import Context
from mcp.types import CallToolResult, ImageContent, TextContent
from pydantic import BaseModel, Field

PICTURE = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
"""A PNG of one pixel, in base64."""


class MadeScenario(BaseModel):
    """What ``make_scenario`` answers."""

    scenario_id: str
    vehicles: int


class JobState(BaseModel):
    """What ``look_at_job`` answers."""

    job_id: str
    state: str


def tool_server(started: anyio.Event | None = None) -> MCPServer:
    """The server; ``started`` is set when ``wait_for_ever`` has begun."""
    server = MCPServer("made", instructions="Scenarios are made by make_scenario.")
    looks: list[str] = []

    @server.tool()
    async def make_scenario(
        vehicles: Annotated[int, Field(ge=1, le=50, description="How many")] = 3,
        place: Annotated[str | None, Field(description="Where")] = None,
        context: Context[Any] | None = None,
    ) -> MadeScenario:
        """Make a scenario."""
        if context is not None:
            await context.report_progress(1, 2, "placing vehicles")
        return MadeScenario(scenario_id=f"TST_{place or 'Town'}-{vehicles}_1_T-1", vehicles=vehicles)

    @server.tool()
    def refuse_all() -> str:
        """Refuse."""
        raise ValueError("there is no road here. Next: ask for another place")

    @server.tool()
    def tell_much() -> str:
        """Tell much."""
        return "a line of an answer that is much too long\n" * 5000

    @server.tool()
    def draw() -> CallToolResult:
        """Draw a picture."""
        picture = ImageContent(type="image", data=PICTURE, mime_type="image/png")
        return CallToolResult(content=[TextContent(type="text", text="A picture of it."), picture])

    @server.tool()
    def look_at_job() -> JobState:
        """Look at a job; it is done at the fifth look."""
        looks.append("")
        return JobState(job_id="job_1", state="done" if len(looks) > 4 else "running")

    @server.tool()
    async def wait_for_ever() -> str:
        """Work without an end."""
        if started is not None:
            started.set()
        await anyio.sleep_forever()
        return ""

    @server.tool()
    def end_the_server() -> str:
        """End the process of the server, as a crash does."""
        os._exit(3)

    return server


@contextmanager
def served_tools() -> Iterator[str]:
    """Provide the server's address; it runs in a thread, so that no program has to import the protocol again."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        server = uvicorn.Server(uvicorn.Config(tool_server().streamable_http_app(), log_level="error"))
        thread = threading.Thread(target=server.run, args=([listening],))
        thread.start()
        try:
            yield f"http://127.0.0.1:{listening.getsockname()[1]}/mcp"
        finally:
            server.should_exit = True
            thread.join()


if __name__ == "__main__":
    tool_server().run("stdio")
