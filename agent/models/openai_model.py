"""``openai:MODEL@URL``: a model of a server with OpenAI's chat-completions API, through the official client.

Such servers are vLLM, llama.cpp, LM Studio and hosted ones. The extra ``openai`` installs the client.
"""

import json
from collections.abc import AsyncGenerator, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from ...schemas.errors import closest
from ...schemas.text import quoted
from ..errors import ModelFailure, ModelRefused, ModelSilent, ModelUnreachable, SettingsFault, StreamCut, UnknownModel
from .interface import (
    CallPart,
    Message,
    ModelEvent,
    ModelFacts,
    ModelSettings,
    RequestedCall,
    Schema,
    StreamEnd,
    ThinkingPart,
    ToolDefinition,
)
from .thinking_tags import ThinkingTags

if TYPE_CHECKING:
    from openai.types.chat import ChatCompletionChunk

_CONTEXT_FIELDS = ("max_model_len", "context_length", "n_ctx", "max_context_length")
"""The fields for a model's context in servers' lists: vLLM, others, llama.cpp, LM Studio."""
_THINKING_FIELDS = ("reasoning_content", "reasoning")
"""The fields for a model's thinking: vLLM, llama.cpp and LM Studio; OpenRouter and newer vLLM."""


@dataclass
class _CallInParts:
    call_id: str = ""
    tool: str = ""
    arguments: str = ""


class OpenAIModel:
    """A model behind an address that ends in ``/v1``; the key comes from the setting, or from OPENAI_API_KEY."""

    def __init__(self, model_and_url: str, settings: ModelSettings) -> None:
        model, _, url = model_and_url.rpartition("@")
        try:
            parts = urlsplit(url)
        except ValueError:
            parts = urlsplit("")
        if not (model and parts.scheme in {"http", "https"} and parts.hostname):
            raise SettingsFault(
                f"'openai:{model_and_url}' is not a model with an address",
                next_step="write openai:MODEL@URL, such as openai:my-model@http://localhost:8000/v1",
            )
        try:
            import openai
        except ModuleNotFoundError as error:
            raise SettingsFault(
                "models behind an OpenAI-compatible server need the package openai, which is not installed",
                next_step="run `pip install 'plannerforge-mcp[openai]'`",
            ) from error
        self._openai, self._model, self._settings = openai, model, settings
        self._url = url.rstrip("/") if parts.path.strip("/") else f"{url.rstrip('/')}/v1"
        try:
            self._client = openai.AsyncOpenAI(
                base_url=self._url, api_key=settings.api_key or None, timeout=settings.silence_s, max_retries=0
            )
        except openai.OpenAIError:  # neither setting nor OPENAI_API_KEY, which local servers do not need
            self._client = openai.AsyncOpenAI(
                base_url=self._url, api_key="none", timeout=settings.silence_s, max_retries=0
            )
        hosted = parts.hostname.endswith("openai.com")
        self._bound = "max_completion_tokens" if hosted else "max_tokens"  # local servers support only the older name
        self._facts: ModelFacts | None = None

    @property
    def name(self) -> str:
        """The name ``openai:MODEL``, without the address."""
        return f"openai:{self._model}"

    async def facts(self) -> ModelFacts:
        """Return the facts about the model from the server's list; a server without a list is not checked."""
        if self._facts is None:
            self._facts = await self._request_facts()
        return self._facts

    async def stream(
        self,
        messages: Sequence[Message],
        tools: Sequence[ToolDefinition] = (),
        *,
        schema: Schema | None = None,
        think: bool | None = None,
    ) -> AsyncGenerator[ModelEvent, None]:
        """Request the next message; see ``ChatModel``. The server decides whether the model thinks."""
        wanted = self._settings.think if think is None else think
        calls: dict[int, _CallInParts] = {}
        tags = ThinkingTags()
        usage, finish, begun = None, "", False
        try:
            async with await self._client.chat.completions.create(
                **self._request(messages, tools, schema, wanted)
            ) as chunks:
                async for chunk in chunks:
                    begun = True
                    usage = chunk.usage or usage
                    for choice in chunk.choices[:1]:
                        finish = choice.finish_reason or finish
                        _join_calls(calls, choice.delta.tool_calls or ())
                    for event in _events(chunk, tags):
                        yield event
        except (self._openai.OpenAIError, ValueError) as error:  # a ``ValueError`` is a line that is not JSON
            raise await self._convert_error(error, begun=begun) from error
        if not finish:
            raise StreamCut(f"the answer of {self.name} was interrupted")
        for left in tags.rest():
            yield left
        for number, call in sorted(calls.items()):
            yield CallPart(_complete_call(call, number))
        yield StreamEnd(
            usage.prompt_tokens if usage else None, usage.completion_tokens if usage else None, cut=finish == "length"
        )

    async def close(self) -> None:
        """Close the connections."""
        await self._client.close()

    async def _request_facts(self) -> ModelFacts:
        context: int | None = None
        try:
            listed = await self._client.models.list()
        except self._openai.APIConnectionError as error:
            raise await self._convert_error(error) from error
        except (self._openai.OpenAIError, ValueError):
            listed = None  # not every server has a list; the first request will show
        entries = {entry.id: entry for entry in listed.data} if listed else {}
        if entries and self._model not in entries:
            raise self._unknown(list(entries))
        if entries:
            extra = entries[self._model].model_extra or {}
            values = [extra.get(field) for field in _CONTEXT_FIELDS]
            context = next((value for value in values if isinstance(value, int)), None)
        return ModelFacts(
            context_tokens=self._settings.context_tokens or context, parameters_billion=None, tools=True, thinking=True
        )

    def _request(
        self, messages: Sequence[Message], tools: Sequence[ToolDefinition], schema: Schema | None, think: bool | None
    ) -> dict[str, Any]:
        request: dict[str, Any] = {
            "model": self._model,
            "messages": [_wire_message(message) for message in messages],
            "stream": True,
            "stream_options": {"include_usage": True},
            self._bound: self._settings.answer_tokens,
        }
        if tools:
            request["tools"] = [_wire_tool(tool) for tool in tools]
        if schema is not None:
            wrapped = {"name": "answer", "schema": dict(schema)}
            request["response_format"] = {"type": "json_schema", "json_schema": wrapped}
        if self._settings.temperature is not None:
            request["temperature"] = self._settings.temperature
        if self._settings.seed is not None:
            request["seed"] = self._settings.seed
        if think is not None:
            request["extra_body"] = {"chat_template_kwargs": {"enable_thinking": think}}
        return request

    def _unknown(self, known: Sequence[str]) -> UnknownModel:
        return UnknownModel(
            f"the server at {self._url} has no model {quoted(self._model)}", valid=closest(self._model, known)
        )

    async def _convert_error(self, error: Exception, *, begun: bool = False) -> ModelFailure:
        """Convert the client's exception into the failure that it represents."""
        library = self._openai
        if isinstance(error, library.NotFoundError):
            try:
                known = [entry.id for entry in (await self._client.models.list()).data]
            except (library.OpenAIError, ValueError):
                known = []
            return self._unknown(known)
        if isinstance(error, library.AuthenticationError | library.PermissionDeniedError):
            step = "set PLANNERFORGE_AGENT_API_KEY or OPENAI_API_KEY"
            return ModelRefused(f"the server at {self._url} refuses the key: {error.message}", next_step=step)
        if isinstance(error, library.APITimeoutError):
            return ModelSilent(f"nothing came from {self.name} for {self._settings.silence_s:g} s")
        if isinstance(error, library.APIConnectionError) and not begun:
            step = "start the server, or correct the address behind the @ of the model's name"
            return ModelUnreachable(f"no server answers at {self._url}", next_step=step)
        if isinstance(error, library.APIError) and not isinstance(error, library.APIConnectionError):
            return ModelRefused(f"the server at {self._url} refused: {error.message}")
        return StreamCut(f"the answer of {self.name} was interrupted or cannot be read: {error}")


def _events(chunk: "ChatCompletionChunk", tags: ThinkingTags) -> Iterator[ModelEvent]:
    for choice in chunk.choices[:1]:
        extra = choice.delta.model_extra or {}
        thinking = next((extra[field] for field in _THINKING_FIELDS if extra.get(field)), "")
        if thinking:
            yield ThinkingPart(str(thinking))
        if choice.delta.content:
            yield from tags.feed(choice.delta.content)


def _join_calls(calls: dict[int, _CallInParts], parts: Sequence[Any]) -> None:
    for part in parts:
        call = calls.setdefault(part.index, _CallInParts())
        call.call_id = part.id or call.call_id
        if part.function is not None:
            call.tool += part.function.name or ""
            call.arguments += part.function.arguments or ""


def _complete_call(call: _CallInParts, number: int) -> RequestedCall:
    try:
        arguments = json.loads(call.arguments or "{}")
    except ValueError:
        arguments = None
    known = arguments if isinstance(arguments, dict) else None
    return RequestedCall(call.call_id or f"call_{number + 1}", call.tool, known, call.arguments)


def _wire_message(message: Message) -> dict[str, Any]:
    sent: dict[str, Any] = {"role": message.role, "content": message.text}
    if message.calls:
        sent["tool_calls"] = [
            {
                "id": call.call_id,
                "type": "function",
                "function": {
                    "name": call.tool,
                    "arguments": json.dumps(dict(call.arguments or {}), ensure_ascii=False),
                },
            }
            for call in message.calls
        ]
    if message.role == "tool":
        sent["tool_call_id"] = message.call_id
    return sent


def _wire_tool(tool: ToolDefinition) -> dict[str, Any]:
    function = {"name": tool.name, "description": tool.description, "parameters": dict(tool.parameters)}
    return {"type": "function", "function": function}
