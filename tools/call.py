"""One call to a tool: the workflow's resources, and what the client's host can show of the answer."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

from mcp.types import Resource

from ..workflows.context import WorkflowContext


class ToolCall(WorkflowContext):
    """One call to a tool.

    Attributes:
        most_image_bytes: limit for all pictures of the answer together; larger pictures are only linked.
        names_view: whether the answer refers to its view, because the host shows views.
        shown: ids of the answer's artifacts, for a host that shows them in a view.
    """

    most_image_bytes: int = sys.maxsize
    names_view: bool = False
    shown: tuple[str, ...] = ()

    def shows(self, *ids: str) -> None:
        """Set the artifacts of the answer: scenarios, runs or batches that one view shows together."""
        self.shown = ids

    def trial(self) -> "ToolCall":
        """Return a call for a dry run. It asks the user nothing, and does not change this call."""
        return ToolCall(replace(self.services, recent=self.services.recent.copied()))


@dataclass(frozen=True)
class Image:
    """A picture of an answer: its file and media type."""

    path: Path
    mime_type: str


@dataclass(frozen=True)
class ImageAnswer:
    """The answer of a tool that shows pictures. It has no output schema, because hosts would drop the pictures.

    ``links`` are resources with the same content.
    """

    text: str
    images: tuple[Image, ...]
    links: tuple[Resource, ...] = ()
