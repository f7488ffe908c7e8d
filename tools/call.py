"""One call of a tool: what a workflow works with, and what the client's host can show of the answer."""

import sys
from dataclasses import dataclass
from pathlib import Path

from mcp.types import Resource

from ..workflows.context import WorkflowContext


class ToolCall(WorkflowContext):
    """One call of a tool.

    Attributes:
        most_image_bytes: limit for all pictures in the answer together; larger ones are only linked.
        names_view: whether the answer names its view, because the host shows views.
        shown: ids of what the answer is about, for a host that shows it in a view.
    """

    most_image_bytes: int = sys.maxsize
    names_view: bool = False
    shown: tuple[str, ...] = ()

    def shows(self, *ids: str) -> None:
        """Name what the answer is about: scenarios, runs or batches that one view shows together."""
        self.shown = ids


@dataclass(frozen=True)
class Image:
    """A picture of an answer: its file and media type."""

    path: Path
    mime_type: str


@dataclass(frozen=True)
class ImageAnswer:
    """The answer of a tool that shows pictures: such a tool has no output schema, or hosts drop the pictures.

    ``links`` are resources where the same can be fetched.
    """

    text: str
    images: tuple[Image, ...]
    links: tuple[Resource, ...] = ()
