"""The one place that turns a typed function into a tool: check the arguments, call, shape the answer or the error."""

import base64
import logging
from collections.abc import Mapping
from typing import Any

from mcp.types import CallToolResult, ContentBlock, ImageContent, ResourceLink, TextContent

from ..schemas.base import Result
from ..schemas.errors import PlannerForgeError, UnexpectedFailure, as_told
from ..schemas.text import printable
from ..tools.call import ImageAnswer, ToolCall
from ..tools.registry import ToolSpec
from .argument_errors import read_arguments

logger = logging.getLogger(__name__)


async def answer(spec: ToolSpec, given: Mapping[str, Any], call: ToolCall) -> CallToolResult:
    """Call a tool; whatever goes wrong becomes a result that says what was wrong and what to do next."""
    try:
        arguments = read_arguments(spec.arguments_type, given)
        return _shaped(await spec.load_function()(arguments, call))
    except Exception as raised:  # noqa: BLE001 - the boundary of a call: it becomes the error of this one call
        error = as_told(raised, spec.name)
        if isinstance(error, UnexpectedFailure):
            logger.error("incident %s:\n%s", error.incident, error.details)  # noqa: TRY400 - it holds the traceback
        return _refusal(error)


def answer_text(result: CallToolResult) -> str:
    """What an answer says in words: its blocks of text, one below the other."""
    return "\n".join(block.text for block in result.content if isinstance(block, TextContent))


def _shaped(result: Result | ImageAnswer) -> CallToolResult:
    """The answer as content blocks and structured content, each of which says the whole."""
    if isinstance(result, ImageAnswer):
        blocks: list[ContentBlock] = [TextContent(type="text", text=printable(result.text))]
        for image in result.images:
            data = base64.b64encode(image.path.read_bytes()).decode()
            blocks.append(ImageContent(type="image", data=data, mime_type=image.mime_type))
        blocks.extend(
            ResourceLink(type="resource_link", name=link.rpartition("/")[2], uri=link) for link in result.links
        )
        return CallToolResult(content=blocks)
    text = printable(result.to_text())
    structured = _printable_parts(result.model_dump(mode="json"))
    return CallToolResult(content=[TextContent(type="text", text=text)], structured_content=structured)


def _refusal(error: PlannerForgeError) -> CallToolResult:
    """An error result: its text holds code, message, valid values and next step."""
    return CallToolResult(content=[TextContent(type="text", text=printable(error.text))], is_error=True)


def _printable_parts(value: Any) -> Any:
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, list):
        return [_printable_parts(part) for part in value]
    if isinstance(value, dict):
        return {printable(key): _printable_parts(part) for key, part in value.items()}
    return value
