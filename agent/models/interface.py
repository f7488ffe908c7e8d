"""What a chat model is: messages and tools go in, a stream of events comes out."""

from collections.abc import AsyncGenerator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

Role = Literal["system", "user", "assistant", "tool"]
Schema = Mapping[str, Any]
"""A JSON Schema."""


@dataclass(frozen=True)
class ToolDefinition:
    """A tool as a model sees it; ``parameters`` is the JSON Schema of its arguments, flat.

    ``read_only`` says that a call changes nothing, where the server tells so.
    """

    name: str
    description: str
    parameters: Schema
    read_only: bool = False


@dataclass(frozen=True)
class RequestedCall:
    """A call that a model asks for; ``arguments`` is None where ``written`` is no JSON object."""

    call_id: str
    tool: str
    arguments: Mapping[str, Any] | None
    written: str = ""


@dataclass(frozen=True)
class Message:
    """A message of a conversation.

    ``calls`` are those of an assistant; ``call_id`` and ``tool`` say which call a tool's message answers.
    """

    role: Role
    text: str
    calls: tuple[RequestedCall, ...] = ()
    call_id: str = ""
    tool: str = ""


@dataclass(frozen=True)
class TextPart:
    """A piece of the answer, as it comes."""

    text: str


@dataclass(frozen=True)
class ThinkingPart:
    """A piece of what the model thinks before it answers."""

    text: str


@dataclass(frozen=True)
class CallPart:
    """A whole call."""

    call: RequestedCall


@dataclass(frozen=True)
class StreamEnd:
    """The end of an answer: tokens as the model's server counted them (None: it does not say).

    ``cut`` says that the answer ended because it may not be longer.
    """

    prompt_tokens: int | None
    completion_tokens: int | None
    cut: bool = False


ModelEvent = TextPart | ThinkingPart | CallPart | StreamEnd


@dataclass(frozen=True)
class ModelFacts:
    """What is known of a model: the context that it is asked with, its size, and what it can do.

    None where the server does not say. A model without ``tools`` is asked by a schema for its output.
    """

    context_tokens: int | None
    parameters_billion: float | None
    tools: bool
    thinking: bool


@dataclass(frozen=True)
class ModelSettings:
    """How a model is asked.

    ``host`` is Ollama's address (empty: OLLAMA_HOST, or this machine); ``think`` None leaves it to the model;
    ``context_tokens`` 0 takes the model's, within bounds; ``answer_tokens`` bounds an answer with its thinking;
    ``keep_alive`` is how long Ollama keeps the model in memory; ``temperature`` and ``seed`` None leave them to the
    model; ``silence_s`` is how long is waited for the next sign of the model.
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
        """The name by which it was opened, such as ``ollama:qwen3:8b``."""

    async def facts(self) -> ModelFacts:
        """What is known of the model; asked of the server once.

        Raises:
            ModelFailure: the server cannot be reached, or has no such model.
        """

    def stream(
        self,
        messages: Sequence[Message],
        tools: Sequence[ToolDefinition] = (),
        *,
        schema: Schema | None = None,
        think: bool | None = None,
    ) -> AsyncGenerator[ModelEvent, None]:
        """Ask for the next message; its pieces as they come, a ``StreamEnd`` last.

        Args:
            schema: the JSON Schema that the answer has to keep to; without tools only.
            think: overrides the setting for this answer.

        Raises:
            ModelFailure: the answer did not come, or not to its end.
        """

    async def close(self) -> None:
        """Close the connection to the server."""
