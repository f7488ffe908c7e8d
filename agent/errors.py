"""What ends a turn of the agent, and what to do about it.

    AgentError
    ├── SettingsFault        a model, host or server that was named wrongly     (before anything is asked)
    ├── ModelFailure         the model gives no answer
    │   ├── ModelUnreachable no server answers at the host
    │   ├── UnknownModel     the server has no such model
    │   ├── ModelRefused     the server answers with an error
    │   ├── ModelSilent      nothing came for as long as may be waited
    │   └── StreamCut        the answer broke off or cannot be read
    ├── ToolServerGone       the MCP server cannot be started or has ended
    └── LimitReached         the turn took more rounds, tokens, time or repeated calls than it may

The conversation outlives all of them: what was said and called before stands in the history.
"""

from collections.abc import Iterable
from typing import ClassVar

from ..schemas.text import one_line

_SHOWN_VALUES = 12


class AgentError(Exception):
    """Base of all that ends a turn.

    Args:
        message: what was wrong, naming what was given.
        valid: what there is instead, the nearest first (at most twelve are told).
        next_step: what to do next; by default what usually helps (``usual_step`` of the class).
    """

    usual_step: ClassVar[str] = "say it again; the conversation is kept"

    def __init__(self, message: str, *, valid: Iterable[str] = (), next_step: str = "") -> None:
        self.message = one_line(message, 1000)
        self.valid = tuple(one_line(value) for value in valid)
        self.next_step = next_step or self.usual_step
        super().__init__(self.text)

    @property
    def text(self) -> str:
        """The whole error in a line: what was wrong, what there is, what to do next."""
        more = len(self.valid) - _SHOWN_VALUES
        shown = ", ".join(self.valid[:_SHOWN_VALUES]) + (f" and {more} more" if more > 0 else "")
        valid = f" There are: {shown}." if self.valid else ""
        return f"{self.message.rstrip('.')}.{valid} Next: {self.next_step.rstrip('.')}."


class SettingsFault(AgentError):
    """A model, a server or a limit that was named wrongly."""

    usual_step = "correct what is named and start again"


class ModelFailure(AgentError):
    """The model gives no answer."""


class ModelUnreachable(ModelFailure):
    """No model server answers at the host."""

    usual_step = "start the model server, or name its address"


class UnknownModel(ModelFailure):
    """The model server has no such model; ``valid`` names those that it has."""

    usual_step = "take a model that there is"


class ModelRefused(ModelFailure):
    """The model server answered with an error."""

    usual_step = "see what the server says; a smaller model or a shorter context may help"


class ModelSilent(ModelFailure):
    """Nothing came of the model for as long as may be waited."""

    usual_step = "say it again, or raise silence_s: a large model takes long to load"


class StreamCut(ModelFailure):
    """The model's answer broke off, or cannot be read."""


class ToolServerGone(AgentError):
    """The MCP server cannot be started, or has ended; it is started again with the next turn."""

    usual_step = "say it again: the server is started anew, and what was made is in its workspace"


class LimitReached(AgentError):
    """The turn took more rounds, tokens, time or repeated calls than it may."""

    usual_step = "say how to go on, or ask for less at once; the conversation is kept"
