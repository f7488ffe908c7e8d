"""Errors that end a turn of the agent, and the user's next step.

    AgentError
    ├── SettingsFault        invalid model, host or server     (before any request)
    ├── ModelFailure         the model gives no answer
    │   ├── ModelUnreachable no server answers at the host
    │   ├── UnknownModel     the server has no such model
    │   ├── ModelRefused     the server answers with an error
    │   ├── ModelSilent      no data arrived within the time limit
    │   └── StreamCut        the answer was interrupted or cannot be read
    ├── ToolServerGone       the MCP server cannot be started or has ended
    └── LimitReached         the turn exceeded its rounds, tokens, time or repeated calls

The conversation survives all of them: its history keeps all earlier messages and calls.
"""

from collections.abc import Iterable
from typing import ClassVar

from ..schemas.text import one_line

_SHOWN_VALUES = 12


class AgentError(Exception):
    """Base of all errors that end a turn.

    Args:
        message: The problem, including the given value.
        valid: The valid alternatives, nearest first (at most twelve are shown).
        next_step: The next step; by default the class's ``usual_step``.
    """

    usual_step: ClassVar[str] = "repeat the request; the conversation is kept"

    def __init__(self, message: str, *, valid: Iterable[str] = (), next_step: str = "") -> None:
        self.message = one_line(message, 1000)
        self.valid = tuple(one_line(value) for value in valid)
        self.next_step = next_step or self.usual_step
        super().__init__(self.text)

    @property
    def text(self) -> str:
        """The whole error in one line: the problem, the valid values, the next step."""
        more = len(self.valid) - _SHOWN_VALUES
        shown = ", ".join(self.valid[:_SHOWN_VALUES]) + (f" and {more} more" if more > 0 else "")
        valid = f" Valid: {shown}." if self.valid else ""
        return f"{self.message.rstrip('.')}.{valid} Next: {self.next_step.rstrip('.')}."


class SettingsFault(AgentError):
    """An invalid model, server or limit."""

    usual_step = "correct the setting and start again"


class ModelFailure(AgentError):
    """The model gives no answer."""


class ModelUnreachable(ModelFailure):
    """No model server answers at the host."""

    usual_step = "start the model server, or give its address"


class UnknownModel(ModelFailure):
    """The model server has no such model; ``valid`` lists its models."""

    usual_step = "choose an available model"


class ModelRefused(ModelFailure):
    """The model server answered with an error."""

    usual_step = "read the server's message; a smaller model or a shorter context may help"


class ModelSilent(ModelFailure):
    """The model sent nothing within the time limit."""

    usual_step = "repeat the request, or raise silence_s, since a large model takes long to load"


class StreamCut(ModelFailure):
    """The model's answer was interrupted, or cannot be read."""


class ToolServerGone(AgentError):
    """The MCP server cannot be started, or has ended; it restarts with the next turn."""

    usual_step = "repeat the request; the server restarts, and its workspace keeps all results"


class LimitReached(AgentError):
    """The turn exceeded its rounds, tokens, time or repeated calls."""

    usual_step = "say how to continue, or request less at once; the conversation is kept"
