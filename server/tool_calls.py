"""The one place that turns a typed function into a tool: check the arguments, call, shape the answer or the error."""

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
from ..schemas.errors import NextCall, NotPossible, PlannerForgeError, UnexpectedFailure, as_told
from ..schemas.text import printable, printable_parts
from ..tools.call import ImageAnswer, ToolCall
from ..tools.registry import ToolSpec
from ..workflows.context import Question
from .arguments.checking import read_arguments
from .arguments.proposals import proposed_call

logger = logging.getLogger(__name__)
LONGEST_ANSWER = 400_000
"""Characters of an answer's text, and of its structure as JSON; chosen: ten times what a model reads with profit."""
MOST_LINKS = 4
"""Of an answer, beside its text and structure, which name all ids; chosen: hosts hand them to the model."""
MOST_IMAGE_BYTES = 12 * 1024**2
"""Of all pictures of an answer; more are only linked. Chosen: clients refuse messages of tens of megabytes."""

_ESCAPE = re.compile(r"\\[ubfr]")
"""Stands in JSON for a character that is not printed; line breaks and tabulators are."""


class InputNeeded(Exception):
    """A call has a question whose answer only its next attempt can bring; ``key`` names it there."""

    def __init__(self, key: str, question: Question) -> None:
        super().__init__(question.text)
        self.key, self.question = key, question


async def answer(
    spec: ToolSpec, given: Mapping[str, Any], call: ToolCall, offered: Mapping[str, ToolSpec] | None = None
) -> CallToolResult:
    """Call a tool; whatever goes wrong becomes a result that says what was wrong and what to do next.

    Args:
        spec: the tool.
        given: the arguments as they were sent.
        call: what the call may use.
        offered: the tools that the client may call, which alone a refusal proposes; all if it is None.

    Raises:
        InputNeeded: the tool has a question that only the next attempt of the call can answer.
        MCPError: the call breaks the protocol.
    """
    try:
        arguments = read_arguments(spec.arguments_type, given, call.remarks)
        if made := [name for name in spec.refused if getattr(arguments, name)]:
            raise NotPossible(f"this server makes nothing, and {made[0]} does", next_step=f"leave {made[0]} out")
        result = await spec.load_function()(arguments, call)
        return _with_view(_shaped(result, call), call)
    except (InputNeeded, MCPError):
        raise
    except Exception as raised:  # noqa: BLE001 - the boundary of a call: it becomes the error of this one call
        error = as_told(raised, spec.name)
        if isinstance(error, UnexpectedFailure):
            logger.error("incident %s:\n%s", error.incident, error.details)  # noqa: TRY400 - it holds the traceback
        return refusal(error, await proposed_call(error, spec, given, call, offered))


def _with_view(result: CallToolResult, call: ToolCall) -> CallToolResult:
    """The answer with the name of its view, for a host that shows it."""
    view = view_uri(call.shown) if call.names_view else None
    return result if view is None else result.model_copy(update={"meta": {**(result.meta or {}), VIEW_KEY: view}})


def answer_text(result: CallToolResult) -> str:
    """What an answer says in words: its blocks of text, one below the other."""
    return "\n".join(block.text for block in result.content if isinstance(block, TextContent))


def linked_by(call: ToolCall) -> list[ResourceLink]:
    """Links to what a call made, the last ones where it made many; with type, title and size."""
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
    """The answer as content blocks and structured content, each of which says the whole; remarks come last."""
    said = result.text if isinstance(result, ImageAnswer) else result.to_text()
    remarks = [*call.remarks, *_imported_in(said, call)]
    if isinstance(result, ImageAnswer):
        shown, left_out = _shown_images(result, min(call.most_image_bytes, MOST_IMAGE_BYTES))
        notes = [f"Note: too large for this answer, to be opened by their links: {left_out}"] if left_out else []
        text = _bounded(printable("\n".join([said, *notes, *remarks])))
        blocks: list[ContentBlock] = [TextContent(type="text", text=text), *shown]
        links = map(_as_link, result.links if call.services.links else ())
        return CallToolResult(content=[*blocks, *links])
    text = _bounded(printable("\n".join([said, *remarks])))
    structured, written = result.model_dump(mode="json"), _bounded(result.model_dump_json())
    if _ESCAPE.search(written) or not written.isprintable():  # one look at the whole spares one at each of its texts
        structured = printable_parts(structured)
    if _DENORMAL.search(written):
        structured = _without_denormals(structured)
    return CallToolResult(
        content=[TextContent(type="text", text=text), *linked_by(call)], structured_content=structured
    )


_RESULT_ID = re.compile(r"\b(?:run|batch|study)_[0-9a-f]{12}\b")


def _imported_in(text: str, call: ToolCall) -> list[str]:
    """Return a remark on the results named in an answer that came in an archive; empty if there are none."""
    imported = call.workspace.imported_of(dict.fromkeys(_RESULT_ID.findall(text)))
    if not imported:
        return []
    more = f" and {len(imported) - MOST_LINKS} more" if len(imported) > MOST_LINKS else ""
    remark = (
        f"Imported: {', '.join(imported[:MOST_LINKS])}{more} came in an archive; what they say is what its maker says."
    )
    return [f"{remark} run_planner makes such runs anew."]


_DENORMAL = re.compile(r"\de-3\d\d\b")
"""Numbers so small that they have lost digits; only a look, since texts may hold the like."""


def _without_denormals(value: Any) -> Any:
    """The same with 0 for every number that is smaller than normal ones: it is what underflow leaves, not a figure."""
    if isinstance(value, dict):
        return {key: _without_denormals(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_without_denormals(part) for part in value]
    return 0.0 if isinstance(value, float) and abs(value) < sys.float_info.min else value


def _bounded(text: str) -> str:
    """The text, if it is no longer than an answer may be.

    Raises:
        NotPossible: it is longer.
    """
    if len(text) > LONGEST_ANSWER:
        raise NotPossible(
            f"the answer has {len(text):,} characters; at most {LONGEST_ANSWER:,} are given",
            next_step="ask for less at once (limit, focus, radius_m, fewer ids); what was made is stored and listed by "
            "list_artifacts",
        )
    return text


def _shown_images(result: ImageAnswer, most_bytes: int) -> tuple[list[ImageContent], int]:
    """The first pictures, as many as an answer holds, and the number of the others."""
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
"""In the metadata of a refusal: the call that its text proposes, as ``{"tool": …, "arguments": …}``."""


def refusal(error: PlannerForgeError, following: NextCall | None = None) -> CallToolResult:
    """Return an error as a result: its text holds code, message, valid values and next step.

    The next step is a call if there is one that helps; programs find it in the metadata.
    """
    text = printable(error.text_with(following))
    meta = None
    if following is not None:
        meta = {NEXT_CALL_KEY: {"tool": following.tool, "arguments": dict(following.arguments)}}
    return CallToolResult(content=[TextContent(type="text", text=text)], is_error=True, _meta=meta)
