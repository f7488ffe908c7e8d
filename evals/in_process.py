"""A tool's call without server and workers: what a tool plans can be asked for where its work is timed."""

from importlib import import_module
from typing import TypeVar, cast

from plannerforge.engine.execution.progress import silent
from plannerforge.schemas.base import Model
from plannerforge.tools.call import ToolCall

Response = TypeVar("Response", bound=Model)


class _InProcess:
    """Runs the engine operations of a tool in this process, without a time limit."""

    async def run(self, entry_point: str, request: Model, response_type: type[Response], **limits: object) -> Response:
        """The operation's response."""
        del limits
        module, _, name = entry_point.partition(":")
        return response_type.model_validate(getattr(import_module(module), name)(request, silent))


def call_in_process() -> ToolCall:
    """A call that can do nothing but run operations."""
    return cast("ToolCall", _InProcess())
