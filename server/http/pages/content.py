"""The content of the pages: answers of tools, which are called like by any other client, and the journal of calls."""

import base64
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from mcp import Client, MCPError
from mcp.types import CallToolResult, ImageContent, ResourceLink, TextResourceContents

from ....engine.rendering import filled_page
from ....resources.templates import SCHEME
from ....schemas.artifacts import ListArtifactsResult
from ....schemas.base import Result
from ....schemas.catalog import FindScenariosResult
from ....schemas.rendering import ViewKind
from ....schemas.scenarios import DescribeScenarioResult
from ...tool_calls import answer_text

PAGE_SIZE = 24
"""Scenarios and batches per page."""
JOURNAL_LINES = 200
_JOURNAL_BYTES = 4 * 1024**2
"""Bytes at the journal's end that are read for a page."""
_VIEWED: dict[str, ViewKind] = {"scenario": "player", "run": "player", "batch": "board"}
_Answer = TypeVar("_Answer", bound=Result)


class Refused(Exception):
    """A tool or resource refused a page's request; the text is the server's."""


@dataclass(frozen=True)
class Facts:
    """The conditions of the catalogue's form, each as typed."""

    text: str = ""
    obstacles: str = ""
    features: str = ""
    road_net: str = ""
    ego_speed: str = ""
    origin: str = ""
    offset: int = 0

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of the call; lists are typed with commas."""
        lists = {name: _listed(getattr(self, name)) for name in ("obstacles", "features", "road_net")}
        words = {name: getattr(self, name).strip() for name in ("text", "ego_speed", "origin")}
        given = {name: value for name, value in (lists | words).items() if value}
        return {**given, "limit": PAGE_SIZE, "offset": self.offset, "fallback": "none"}


@dataclass(frozen=True)
class ToolText:
    """The answer of a tool, and whether it is a refusal."""

    text: str
    failed: bool = False


@dataclass(frozen=True)
class JournalLine:
    """One call of the journal."""

    time: str
    client: str
    tool: str
    arguments: str
    duration_s: float
    result_ids: Sequence[str]
    error: str


class Content:
    """Reads for the pages through one client.

    Args:
        client: a client of the server with the displayed workspace.
        journal: the file that the server writes its calls to.
    """

    def __init__(self, client: Client, journal: Path) -> None:
        self._client, self._journal = client, journal

    async def scenarios(self, facts: Facts) -> FindScenariosResult:
        """Return scenarios of the catalogue that match the conditions.

        Raises:
            Refused: a condition is invalid.
        """
        return await self._answer(FindScenariosResult, "find_scenarios", facts.arguments())

    async def scenario(self, scenario_id: str) -> tuple[DescribeScenarioResult, str]:
        """Return a scenario with all its vehicles, and the tool's text about it.

        Raises:
            Refused: there is no such scenario.
        """
        result = await self._call("describe_scenario", {"scenario_id": scenario_id, "detail": "vehicles"})
        return DescribeScenarioResult.model_validate(result.structured_content), answer_text(result)

    async def artifacts(self, kind: str, offset: int) -> ListArtifactsResult:
        """Return artifacts of a kind, newest first.

        Raises:
            Refused: there is no such kind.
        """
        arguments = {"kind": kind, "limit": PAGE_SIZE, "offset": offset}
        return await self._answer(ListArtifactsResult, "list_artifacts", arguments)

    async def analysis(self, batch_id: str) -> ToolText:
        """Return the analysis of a batch.

        Raises:
            Refused: there is no such batch.
        """
        return ToolText(answer_text(await self._call("analyze_results", {"results": [batch_id]})))

    async def comparison(self, results: Sequence[str]) -> ToolText:
        """Return the comparison of results, or the reason why they cannot be compared."""
        try:
            return ToolText(answer_text(await self._call("compare_results", {"results": list(results)})))
        except Refused as refusal:
            return ToolText(str(refusal), failed=True)

    async def picture(self, artifact_id: str) -> bytes:
        """Return a picture of a scenario or run from above, as PNG.

        Raises:
            Refused: there is nothing to draw.
        """
        result = await self._call("render", {"ids": [artifact_id], "kind": "picture"})
        for block in result.content:
            if isinstance(block, ImageContent):
                return base64.b64decode(block.data)
        links = ", ".join(str(block.uri) for block in result.content if isinstance(block, ResourceLink))
        raise Refused(f"the picture of {artifact_id} is too large for an answer: {links}")

    async def view(self, kind: str, ids: Sequence[str]) -> str:
        """Return a complete HTML page with the player or the board for the given artifacts.

        Raises:
            Refused: there is nothing to show.
        """
        if kind not in _VIEWED:
            raise Refused(f"there is no view of a {kind}; there are views of: {', '.join(_VIEWED)}")
        uri = f"{SCHEME}view/{'+'.join(ids)}"
        try:
            read = await self._client.read_resource(uri)
        except MCPError as error:
            raise Refused(str(error)) from error
        (data,) = read.contents
        if not isinstance(data, TextResourceContents):
            raise Refused(f"{uri} is not text")
        return filled_page(_VIEWED[kind], f"{', '.join(ids)} · PlannerForge", data.text)

    def calls(self, *, failed_only: bool = False) -> list[JournalLine]:
        """Return the newest calls of the journal, newest first; empty if there is no journal."""
        lines = []
        for line in _last_lines(self._journal):
            call = _journal_line(line)
            if call is not None and (call.error or not failed_only):
                lines.append(call)
            if len(lines) == JOURNAL_LINES:
                break
        return lines

    async def _answer(self, shape: type[_Answer], tool: str, arguments: dict[str, Any]) -> _Answer:
        return shape.model_validate((await self._call(tool, arguments)).structured_content)

    async def _call(self, tool: str, arguments: dict[str, Any]) -> CallToolResult:
        try:
            result = await self._client.call_tool(tool, arguments)
        except MCPError as error:
            raise Refused(str(error)) from error
        if result.is_error:
            raise Refused(answer_text(result))
        return result


def _listed(written: str) -> list[str]:
    return [part.strip() for part in written.split(",") if part.strip()]


def _last_lines(path: Path) -> Iterator[str]:
    """Yield the last lines of a file in reverse order, without a first line that may be incomplete."""
    if not path.is_file():
        return
    with path.open("rb") as file:
        size = file.seek(0, 2)
        begin = max(0, size - _JOURNAL_BYTES)
        file.seek(begin)
        lines = file.read().decode("utf-8", errors="replace").splitlines()
    yield from reversed(lines[1:] if begin else lines)


def _journal_line(line: str) -> JournalLine | None:
    """Parse a line of the journal; return None for an incomplete line."""
    try:
        entry = json.loads(line)
    except ValueError:
        return None
    arguments = json.dumps(entry["arguments"], ensure_ascii=False)
    return JournalLine(
        entry["time"],
        entry["client"],
        entry["tool"],
        arguments,
        entry["duration_s"],
        entry["result_ids"],
        entry["error"],
    )
