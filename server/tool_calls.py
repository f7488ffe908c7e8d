"""Turns a typed function into a tool: checks the arguments, calls it, and shapes the answer or the error."""

import base64
import logging
import re
import sys
from collections.abc import Mapping
from typing import Any

from mcp import MCPError
from mcp.types import CallToolResult, ContentBlock, ImageContent, Resource, ResourceLink, TextContent

from ..resources.apps import VIEW_KEY, view_uri
from ..resources.templates import artifact_link, job_link
from ..schemas.base import Result
from ..schemas.errors import NextCall, NotPossible, PlannerForgeError, UnexpectedFailure, error_to_report
from ..schemas.text import printable, printable_parts
from ..tools.call import ImageAnswer, ToolCall
from ..tools.registry import ToolSpec
from ..workflows.context import Question
from .arguments.checking import read_arguments
from .arguments.proposals import proposed_call

logger = logging.getLogger(__name__)
LONGEST_ANSWER = 400_000
"""Maximum characters of an answer's text, and of its structure as JSON; chosen: ten times what a model reads well."""
MOST_LINKS = 4
"""Maximum links of an answer, in addition to text and structure, which list all ids; chosen: hosts pass them to the
model.
"""
MOST_IMAGE_BYTES = 12 * 1024**2
"""Maximum bytes of all pictures of an answer; more are only linked. Chosen: clients reject messages of tens of MB."""

_ESCAPE = re.compile(r"\\[ubfr]")
"""Matches JSON escapes of unprintable characters; line breaks and tabulators are allowed."""


class InputNeeded(Exception):
    """A call has a question that only its next attempt can answer; ``key`` identifies it there."""

    def __init__(self, key: str, question: Question) -> None:
        super().__init__(question.text)
        self.key, self.question = key, question


async def answer(
    spec: ToolSpec, given: Mapping[str, Any], call: ToolCall, offered: Mapping[str, ToolSpec] | None = None
) -> CallToolResult:
    """Call a tool; turn any error into a result that states the problem and the next step.

    Args:
        spec: the tool.
        given: the arguments as sent.
        call: the resources of the call.
        offered: the tools that the client may call; a refusal proposes only these. None means all.

    Raises:
        InputNeeded: the tool has a question that only the next attempt of the call can answer.
        MCPError: the call violates the protocol.
    """
    try:
        arguments = read_arguments(spec.arguments_type, given, call.remarks)
        if made := [name for name in spec.refused if getattr(arguments, name)]:
            raise NotPossible(f"this server is read-only, but {made[0]} creates data", next_step=f"leave {made[0]} out")
        result = await spec.load_function()(arguments, call)
        return _with_view(_shaped(result, call), call)
    except (InputNeeded, MCPError):
        raise
    except Exception as raised:  # noqa: BLE001 - the boundary of a call: it becomes the error of this one call
        error = error_to_report(raised, spec.name)
        if isinstance(error, UnexpectedFailure):
            logger.error("incident %s:\n%s", error.incident, error.details)  # noqa: TRY400 - it holds the traceback
        return refusal(error, await proposed_call(error, spec, given, call, offered))


def _with_view(result: CallToolResult, call: ToolCall) -> CallToolResult:
    """Return the answer with the name of its view, for a host that shows it."""
    view = view_uri(call.shown) if call.names_view else None
    return result if view is None else result.model_copy(update={"meta": {**(result.meta or {}), VIEW_KEY: view}})


def answer_text(result: CallToolResult) -> str:
    """Return the text of an answer: its blocks of text, one per line."""
    return "\n".join(block.text for block in result.content if isinstance(block, TextContent))


def linked_by(call: ToolCall) -> list[ResourceLink]:
    """Return links to the artifacts that a call created, or only the last of them if there are many; with type, title
    and size.
    """
    if not call.services.links:
        return []
    links: list[ResourceLink] = []
    for kind, made_id in list(call.made_here)[-MOST_LINKS:]:
        if kind == "job":
            resource = job_link(made_id)
        elif (artifact := call.workspace.find(kind, made_id)) is not None:
            resource = artifact_link(artifact, call.workspace)
        else:
            continue
        links.append(_as_link(resource))
    return links


def _as_link(resource: Resource) -> ResourceLink:
    return ResourceLink(type="resource_link", **resource.model_dump(exclude_none=True, exclude={"meta"}))


def _shaped(result: Result | ImageAnswer, call: ToolCall) -> CallToolResult:
    """Return the answer as content blocks and structured content, each complete; remarks come last."""
    content_text = result.text if isinstance(result, ImageAnswer) else result.to_text()
    remarks = [*call.remarks, *_imported_in(content_text, call)]
    if isinstance(result, ImageAnswer):
        shown, left_out = _shown_images(result, min(call.most_image_bytes, MOST_IMAGE_BYTES))
        large = (
            "1 image is too large to embed; open its"
            if left_out == 1
            else f"{left_out} images are too large; open their"
        )
        notes = [f"Note: {large} link{'s' * (left_out > 1)}"] if left_out else []
        text = _bounded(printable("\n".join([content_text, *notes, *remarks])))
        blocks: list[ContentBlock] = [TextContent(type="text", text=text), *shown]
        links = map(_as_link, result.links if call.services.links else ())
        return CallToolResult(content=[*blocks, *links])
    text = _bounded(printable("\n".join([content_text, *remarks])))
    structured, written = result.model_dump(mode="json"), _bounded(result.model_dump_json())
    if _ESCAPE.search(written) or not written.isprintable():  # one check of all texts saves one of each
        structured = printable_parts(structured)
    if _DENORMAL.search(written):
        structured = _without_denormals(structured)
    return CallToolResult(
        content=[TextContent(type="text", text=text), *linked_by(call)], structured_content=structured
    )


_RESULT_ID = re.compile(r"\b(?:run|batch|study|boundary)_[0-9a-f]{12}\b")


def _imported_in(text: str, call: ToolCall) -> list[str]:
    """Return a remark about results of an answer that were imported from an archive, or an empty list."""
    imported = call.workspace.imported_of(dict.fromkeys(_RESULT_ID.findall(text)))
    if not imported:
        return []
    more = f" and {len(imported) - MOST_LINKS} more" if len(imported) > MOST_LINKS else ""
    remark = f"Imported: {', '.join(imported[:MOST_LINKS])}{more} came in an archive; their content is unverified."
    return [f"{remark} run_planner repeats such runs."]


_DENORMAL = re.compile(r"\de-3\d\d\b")
"""Numbers so small that they have lost digits; only a quick check, because texts may contain similar ones."""


def _without_denormals(value: Any) -> Any:
    """Return the same value with 0 for numbers below the normal range, which result from underflow."""
    if isinstance(value, dict):
        return {key: _without_denormals(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_without_denormals(part) for part in value]
    return 0.0 if isinstance(value, float) and abs(value) < sys.float_info.min else value


def _bounded(text: str) -> str:
    """Return the text if it is within the limit of an answer.

    Raises:
        NotPossible: it is longer.
    """
    if len(text) > LONGEST_ANSWER:
        raise NotPossible(
            f"the answer has {len(text):,} characters; the limit is {LONGEST_ANSWER:,}",
            next_step="request less (limit, focus, radius_m, fewer ids); everything created is stored, and listed by "
            "list_artifacts",
        )
    return text


def _shown_images(result: ImageAnswer, most_bytes: int) -> tuple[list[ImageContent], int]:
    """Return the first pictures that fit into an answer, and the number of the remaining pictures."""
    shown: list[ImageContent] = []
    size = 0
    for image in result.images:
        size += image.path.stat().st_size
        if size > most_bytes:
            break
        data = base64.b64encode(image.path.read_bytes()).decode()
        shown.append(ImageContent(type="image", data=data, mime_type=image.mime_type))
    return shown, len(result.images) - len(shown)


NEXT_CALL_KEY = "plannerforge/next_call"
"""Metadata key of a refusal: the call that its text proposes, as ``{"tool": …, "arguments": …}``."""


def refusal(error: PlannerForgeError, following: NextCall | None = None) -> CallToolResult:
    """Return an error as a result with code, message, valid values and next step.

    The next step is a call, if a call helps; programs find it in the metadata.
    """
    text = printable(error.text_with(following))
    meta = None
    if following is not None:
        meta = {NEXT_CALL_KEY: {"tool": following.tool, "arguments": dict(following.arguments)}}
    return CallToolResult(content=[TextContent(type="text", text=text)], is_error=True, _meta=meta)
