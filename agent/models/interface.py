"""The interface of chat models: messages and tools go in, a stream of events comes out."""

from collections.abc import AsyncGenerator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

Role = Literal["system", "user", "assistant", "tool"]
Schema = Mapping[str, Any]
"""A JSON Schema."""


@dataclass(frozen=True)
class ToolDefinition:
    """A tool in the model's format; ``parameters`` is the flat JSON Schema of its arguments.

    ``read_only`` is True if the server declares that a call changes nothing.
    """

    name: str
    description: str
    parameters: Schema
    read_only: bool = False


@dataclass(frozen=True)
class RequestedCall:
    """A call that a model requests; ``arguments`` is None if ``written`` is not a JSON object."""

    call_id: str
    tool: str
    arguments: Mapping[str, Any] | None
    written: str = ""


@dataclass(frozen=True)
class Message:
    """A message of a conversation.

    ``calls`` are those of an assistant; ``call_id`` and ``tool`` identify the call that a tool's message answers.
    """

    role: Role
    text: str
    calls: tuple[RequestedCall, ...] = ()
    call_id: str = ""
    tool: str = ""


@dataclass(frozen=True)
class TextPart:
    """A piece of the streamed answer."""

    text: str


@dataclass(frozen=True)
class ThinkingPart:
    """A piece of the model's thinking before its answer."""

    text: str


@dataclass(frozen=True)
class CallPart:
    """A complete call."""

    call: RequestedCall


@dataclass(frozen=True)
class StreamEnd:
    """The end of an answer, with the server's token counts (None if it does not report them).

    ``cut`` is True if the answer ended at its length limit.
    """

    prompt_tokens: int | None
    completion_tokens: int | None
    cut: bool = False


ModelEvent = TextPart | ThinkingPart | CallPart | StreamEnd


@dataclass(frozen=True)
class ModelFacts:
    """Facts about a model: its context, its size, and its capabilities.

    None means that the server does not report the fact. A model without ``tools`` gets a schema for its output.
    """

    context_tokens: int | None
    parameters_billion: float | None
    tools: bool
    thinking: bool


@dataclass(frozen=True)
class ModelSettings:
    """The options of requests to a model.

    ``host`` is Ollama's address (empty: OLLAMA_HOST, or this machine). ``think`` None leaves it to the model;
    ``context_tokens`` 0 uses the model's context, within bounds. ``answer_tokens`` limits an answer including its
    thinking. ``keep_alive`` is how long Ollama keeps the model in memory. ``temperature`` and ``seed`` None leave them
    to the model. ``silence_s`` is the longest wait for the model's next data.
    """

    host: str = ""
    api_key: str = ""
    think: bool | None = None
    context_tokens: int = 0
    answer_tokens: int = 4096
    keep_alive: str = "5m"
    temperature: float | None = None
    seed: int | None = None
    silence_s: float = 300.0


class ChatModel(Protocol):
    """A language model behind a server."""

    @property
    def name(self) -> str:
        """The name that opened it, such as ``ollama:qwen3:8b``."""

    async def facts(self) -> ModelFacts:
        """Return the facts about the model, which are requested from the server once.

        Raises:
            ModelFailure: The server cannot be reached, or has no such model.
        """

    def stream(
        self,
        messages: Sequence[Message],
        tools: Sequence[ToolDefinition] = (),
        *,
        schema: Schema | None = None,
        think: bool | None = None,
    ) -> AsyncGenerator[ModelEvent, None]:
        """Request the next message, and yield its pieces as they arrive, ending with a ``StreamEnd``.

        Args:
            schema: The JSON Schema that the answer must satisfy; only without tools.
            think: Overrides the setting for this answer.

        Raises:
            ModelFailure: The answer did not arrive, or is incomplete.
        """

    async def close(self) -> None:
        """Close the connection to the server."""
