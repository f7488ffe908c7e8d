"""One tool call from a shell or script, made through a real client session in this process."""

import json
import re
import sys
from pathlib import Path

import anyio
from mcp import Client, MCPError
from mcp.types import CallToolResult, TextContent
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn

from ..resources.templates import SCHEME
from ..server.assembly import create_server
from ..server.settings import Settings
from ..server.tool_calls import answer_text
from ..workflows.rendering import FOLDER


def make_call(settings: Settings, tool: str, arguments: str, *, as_json: bool, to_the_end: bool = False) -> int:
    """Make the call, show its progress on stderr and its answer on stdout; return 0, or 1 if it was refused.

    Args:
        to_the_end: If the answer gives a running job, wait for its end and show that instead.
    """
    errors = Console(stderr=True)
    try:
        parsed = json.loads(arguments)
    except json.JSONDecodeError as error:
        errors.print(f"The arguments are not JSON: {error}", style="red", highlight=False)
        return 2
    if not isinstance(parsed, dict):
        errors.print("The arguments must be a JSON object, such as {}", style="red", highlight=False, markup=False)
        return 2
    result = anyio.run(_call, settings, tool, parsed, errors, to_the_end)
    if as_json and not result.is_error:
        sys.stdout.write(json.dumps(result.structured_content, indent=1, ensure_ascii=False) + "\n")
    else:
        text = _with_paths(answer_text(result), settings.workspace.expanduser().resolve() / FOLDER)
        (sys.stderr if result.is_error else sys.stdout).write(text + "\n")
    return 1 if result.is_error else 0


def _with_paths(text: str, pictures: Path) -> str:
    """Replace links to pictures, which a shell cannot open, with their paths."""
    return re.sub(rf"{re.escape(SCHEME)}picture/([\w.\-]+)", lambda link: str(pictures / link[1]), text)


async def _call(
    settings: Settings, tool: str, arguments: dict[str, object], console: Console, to_the_end: bool
) -> CallToolResult:
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn())
    with Progress(*columns, console=console, transient=True) as bars:
        bar = bars.add_task(tool, total=1.0)

        async def show(progress: float, total: float | None, message: str | None) -> None:
            bars.update(bar, completed=progress, total=total, description=message or tool)

        async with Client(create_server(settings)) as client:
            try:
                result = await client.call_tool(tool, arguments, progress_callback=show)
                while to_the_end and (job_id := _running_job(result)):
                    result = await client.call_tool("get_job", {"job_id": job_id, "wait_s": 50}, progress_callback=show)
            except MCPError as error:
                return CallToolResult(content=[TextContent(type="text", text=str(error))], is_error=True)
            else:
                return result


def _running_job(result: CallToolResult) -> str | None:
    answer = result.structured_content or {}
    return str(answer["job_id"]) if answer.get("state") == "running" and answer.get("job_id") else None
