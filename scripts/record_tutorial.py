"""Record the answers and pictures of ``docs/tutorial.md``: ``make tutorial-page``.

The page contains the text and the commands. This script makes each call of its ``console`` blocks in order, in a new
workspace, and writes the answers below them. As in a shell, every call has its own server.
"""

import base64
import io
import json
import os
import re
import shlex
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio
from mcp import Client
from mcp.types import CallToolResult, ImageContent, TextContent
from PIL import Image, ImageOps

from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings
from plannerforge.server.tool_calls import answer_text

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGE = DOCS / "tutorial.md"
SHOWN_WORKSPACE = "~/.local/share/plannerforge"
PICTURES: Mapping[str, Mapping[str, Any]] = {
    "crossing": {"ids": ["latest"]},
    "collision": {"ids": ["latest_run"]},
    "timeline": {"ids": ["previous_run", "latest_run"], "kind": "profile"},
}
"""The arguments of ``render`` for each picture, applied at its place in the page."""
WIDTH = 960
_BLOCK = re.compile(r"^```console\n(.*?)^```\n|^!\[[^\]]*\]\(tutorial/(\w+)\.webp\)\n", re.DOTALL | re.MULTILINE)


@dataclass
class Recording:
    """A page with new answers, and its pictures by name."""

    page: str
    pictures: dict[str, Image.Image] = field(default_factory=dict)


async def recorded(page: str, settings: Settings) -> Recording:
    """Return the page with the answers that its commands get in these settings' workspace."""
    made = Recording("")
    end = 0
    for block in _BLOCK.finditer(page):
        made.page += page[end : block.start()]
        end = block.end()
        if block[2]:
            made.pictures[block[2]] = await _picture(PICTURES[block[2]], settings)
            made.page += block[0]
        else:
            made.page += f"```console\n{await _answers(block[1], settings)}```\n"
    made.page += page[end:]
    return made


async def _answers(block: str, settings: Settings) -> str:
    parts = []
    for command in re.findall(r"^\$ (.*)\n", block, re.MULTILINE):
        program, verb, tool, arguments = shlex.split(command)
        if (program, verb) != ("plannerforge", "call"):
            raise ValueError(f"a console block of the tutorial makes calls only, not: {command}")
        result = await _call(settings, tool, json.loads(arguments))
        parts.append(f"$ {command}\n{_stable(answer_text(result), settings)}\n")
    return "\n".join(parts)


async def _call(settings: Settings, tool: str, arguments: Mapping[str, Any]) -> CallToolResult:
    """Return the answer to a call; if it became a job on a slow machine, the answer that it would have without one."""
    async with Client(create_server(settings)) as client:
        result = await client.call_tool(tool, dict(arguments))
        first = result.structured_content or {}
        while (result.structured_content or {}).get("state") == "running":
            await client.call_tool("get_job", {"job_id": first["job_id"], "wait_s": 50})
            result = await client.call_tool(tool, dict(arguments))
        if result.is_error:
            raise ValueError(f"{tool} {arguments} was refused: {answer_text(result)}")
        if first.get("state") == "running" and isinstance(result.content[0], TextContent):
            was = f", {first['reused']} stored before" if first["reused"] else ""
            text = re.sub(r", \d+ stored before", was, result.content[0].text)
            return CallToolResult(content=[TextContent(type="text", text=text)])
        return result


async def _picture(arguments: Mapping[str, Any], settings: Settings) -> Image.Image:
    """Return the picture that ``render`` draws, as wide as the page shows it."""
    result = await _call(settings, "render", arguments)
    (drawn,) = [block for block in result.content if isinstance(block, ImageContent)]
    image = Image.open(io.BytesIO(base64.b64decode(drawn.data))).convert("RGB")
    return ImageOps.contain(image, (WIDTH, WIDTH))


def _stable(text: str, settings: Settings) -> str:
    """Return the text with the usual workspace and without digests in picture names."""
    text = text.replace("plannerforge://picture/", f"{SHOWN_WORKSPACE}/pictures/")
    text = text.replace(str(settings.workspace), SHOWN_WORKSPACE)
    return re.sub(r"_[0-9a-f]{12}\.png", "_….png", text)


def main() -> None:
    """Write the page and its pictures again."""
    os.environ["PLANNERFORGE_MAPS_ONLINE"] = "offline"
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(workspace=Path(folder) / "workspace", roots=(Path(folder),), warm_up=False)
        made = anyio.run(recorded, PAGE.read_text(encoding="utf-8"), settings)
    PAGE.write_text(made.page, encoding="utf-8")
    for name, picture in made.pictures.items():
        picture.save(DOCS / "tutorial" / f"{name}.webp", lossless=True, method=6)


if __name__ == "__main__":
    main()
