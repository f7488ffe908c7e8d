"""``ollama:MODEL``: a model of an Ollama server, through the official client."""

import os
import re
from collections.abc import AsyncGenerator, Iterator, Sequence
from contextlib import aclosing
from typing import Any, cast

import httpx
import ollama
from pydantic import ValidationError

from ...schemas.errors import closest
from ...schemas.text import quoted
from ..errors import ModelFailure, ModelRefused, ModelSilent, ModelUnreachable, SettingsFault, StreamCut, UnknownModel
from .constrained import as_plain_text, choice_schema, read_choice
from .interface import (
    CallPart,
    Message,
    ModelEvent,
    ModelFacts,
    ModelSettings,
    RequestedCall,
    Schema,
    StreamEnd,
    TextPart,
    ThinkingPart,
    ToolDefinition,
)
from .thinking_tags import ThinkingTags

_USUAL_CONTEXT_TOKENS = 16_384
"""Default context (chosen: it fits the tools, a session of twenty calls, and the memory of small machines). Ollama's
own default is 4,096, which the tools alone fill.
"""
_MISREAD_CALL = re.compile(r"error parsing tool call", re.IGNORECASE)
"""Ollama's message if a model wrote a call that is not JSON."""
_RAISED = (ollama.ResponseError, ConnectionError, httpx.HTTPError, ValidationError, ValueError)
"""All exceptions that the client raises; ``ValueError`` means a line that is not JSON."""
_NOT_FOUND = 404
_UNITS = {"K": 1e-6, "M": 1e-3, "B": 1.0, "T": 1e3}


class OllamaModel:
    """A model of an Ollama server; a model without tool support gets a schema for its output."""

    def __init__(self, model: str, settings: ModelSettings) -> None:
        self._model, self._settings = model, settings
        try:
            self._client = ollama.AsyncClient(settings.host or None, timeout=httpx.Timeout(settings.silence_s))
        except (ValueError, httpx.InvalidURL) as error:
            raise SettingsFault(f"{quoted(self._host)} is not an address of an Ollama server: {error}") from error
        self._facts: ModelFacts | None = None
        self._calls = 0

    @property
    def name(self) -> str:
        """The name ``ollama:MODEL``."""
        return f"ollama:{self._model}"

    async def facts(self) -> ModelFacts:
        """Return the server's facts about the model, requested once, with the context length that requests will use."""
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
        """Request the next message; see ``ChatModel``."""
        facts = await self.facts()
        chosen = bool(tools) and not facts.tools
        sent_tools = [] if chosen else [_wire_tool(tool) for tool in tools]
        if chosen:
            messages, schema = as_plain_text(messages, tools), choice_schema(tools)
        wanted = self._settings.think if think is None else think
        request = self._client.chat(
            model=self._model,
            messages=[_wire_message(message) for message in messages],
            tools=sent_tools or None,
            stream=True,
            think=wanted if facts.thinking else None,
            format=dict(schema) if schema is not None else None,
            options=self._options(facts),
            keep_alive=_duration(self._settings.keep_alive),
        )
        written: list[str] = []
        tags = ThinkingTags()
        ended = False
        try:
            async with aclosing(cast("AsyncGenerator[ollama.ChatResponse, None]", await request)) as parts:
                async for part in parts:
                    ended = ended or bool(part.done)
                    for event in self._events(part, tags):
                        if chosen and isinstance(event, TextPart):
                            written.append(event.text)
                            continue
                        if isinstance(event, StreamEnd) and written:
                            yield read_choice("".join(written), self._next_id())
                        yield event
        except _RAISED as error:
            if not (isinstance(error, ollama.ResponseError) and _MISREAD_CALL.search(error.error)):
                raise await self._convert_error(error) from error
            yield CallPart(RequestedCall(self._next_id(), "", None, error.error))
            yield StreamEnd(None, None)
            ended = True
        if not ended:
            raise StreamCut(f"the answer of {self.name} was interrupted")

    async def close(self) -> None:
        """Close the connections."""
        await self._client.close()  # type: ignore[no-untyped-call]

    async def _request_facts(self) -> ModelFacts:
        try:
            shown = await self._client.show(self._model)
        except _RAISED as error:
            raise await self._convert_error(error) from error
        able = shown.capabilities or []
        lengths = [
            value
            for key, value in (shown.modelinfo or {}).items()
            if key.endswith(".context_length") and isinstance(value, int)
        ]
        longest = max(lengths, default=0)
        context = self._settings.context_tokens or min(longest or _USUAL_CONTEXT_TOKENS, _USUAL_CONTEXT_TOKENS)
        return ModelFacts(
            context_tokens=min(context, longest) if longest else context,
            parameters_billion=_billions(shown.details.parameter_size if shown.details else None),
            tools="tools" in able,
            thinking="thinking" in able,
        )

    def _options(self, facts: ModelFacts) -> dict[str, Any]:
        options: dict[str, Any] = {"num_ctx": facts.context_tokens, "num_predict": self._settings.answer_tokens}
        if self._settings.temperature is not None:
            options["temperature"] = self._settings.temperature
        if self._settings.seed is not None:
            options["seed"] = self._settings.seed
        return options

    def _events(self, part: ollama.ChatResponse, tags: ThinkingTags) -> Iterator[ModelEvent]:
        message = part.message
        if message.thinking:
            yield ThinkingPart(message.thinking)
        if message.content:
            yield from tags.feed(message.content)
        for call in message.tool_calls or ():
            arguments = dict(call.function.arguments)
            yield CallPart(RequestedCall(self._next_id(), call.function.name, arguments))
        if part.done:
            yield from tags.rest()
            yield StreamEnd(part.prompt_eval_count, part.eval_count, cut=part.done_reason == "length")

    def _next_id(self) -> str:
        self._calls += 1
        return f"call_{self._calls}"

    async def _convert_error(self, error: Exception) -> ModelFailure:
        """Convert the client's exception into the failure that it represents."""
        if isinstance(error, ollama.ResponseError):
            if error.status_code == _NOT_FOUND:
                known = closest(self._model, await self._known_models())
                step = f"run `ollama pull {self._model}`, or choose an available one"
                return UnknownModel(
                    f"Ollama at {self._host} has no model {quoted(self._model)}", valid=known, next_step=step
                )
            return ModelRefused(f"Ollama refused: {error.error}")
        if isinstance(error, ConnectionError | httpx.ConnectError | httpx.ConnectTimeout | httpx.UnsupportedProtocol):
            step = "start it with `ollama serve`, or give its address in --host or OLLAMA_HOST"
            return ModelUnreachable(f"no Ollama answers at {self._host}", next_step=step)
        if isinstance(error, httpx.TimeoutException):
            return ModelSilent(f"nothing came from {self.name} for {self._settings.silence_s:g} s")
        if isinstance(error, httpx.HTTPError):
            return StreamCut(f"the answer of {self.name} was interrupted: {error}")
        return StreamCut(f"the answer of {self.name} cannot be read: {error}")

    async def _known_models(self) -> list[str]:
        try:
            listed = await self._client.list()
        except _RAISED:
            return []
        return [model.model for model in listed.models if model.model]

    @property
    def _host(self) -> str:
        return self._settings.host or os.environ.get("OLLAMA_HOST", "") or "http://127.0.0.1:11434"


def _wire_message(message: Message) -> dict[str, Any]:
    sent: dict[str, Any] = {"role": message.role, "content": message.text}
    if message.calls:
        sent["tool_calls"] = [
            {"function": {"name": call.tool, "arguments": dict(call.arguments or {})}} for call in message.calls
        ]
    if message.role == "tool":
        sent["tool_name"] = message.tool
    return sent


def _wire_tool(tool: ToolDefinition) -> dict[str, Any]:
    function = {"name": tool.name, "description": tool.description, "parameters": dict(tool.parameters)}
    return {"type": "function", "function": function}


def _duration(written: str) -> float | str:
    """Return a time in Ollama's format: a number of seconds if it is only a number, otherwise a text with its unit."""
    try:
        return float(written)
    except ValueError:
        return written


def _billions(size: str | None) -> float | None:
    """Return billions of parameters from Ollama's text, such as ``8.2B`` or ``494.03M``; None if unreadable."""
    found = re.fullmatch(r"([\d.]+)([KMBT])", size or "")
    return float(found[1]) * _UNITS[found[2]] if found else None
