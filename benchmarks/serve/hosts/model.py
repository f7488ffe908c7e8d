"""A scripted model on loopback that speaks the protocols of language-model clients.

It supports OpenAI's chat completions and responses, Anthropic's messages and Ollama's chat, streamed or complete as
requested, and a plain protocol for clients without a model. All follow the same story (``story.py``). Between requests
it keeps only the last content shown: like any model, it knows only the part of the story in the request.
"""

import json
import socket
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .story import Move, ShownResult, next_move

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response

NAME = "story:8b"
"""The model's name, if clients can choose one."""
_CREATED, _DATE = 1_700_000_000, "2026-11-02T08:00:00.000000Z"
_PIECE = 24
"""Characters of a streamed piece (chosen)."""
_USAGE = (1200, 40)
"""Claimed input and output tokens: clients require figures, and this server does not count."""
_STOP_S = 10.0
_ADDRESSED = ("image", "image_url", "input_image", "file", "input_file", "document")
Json = Mapping[str, Any]


@dataclass(frozen=True)
class ModelRequest:
    """The content of a request to a model.

    Args:
        tools: names of the offered tools, with a namespace if the protocol has one.
        shown: the answers of tools so far, oldest first.
        streamed: whether the client wants the answer in pieces.
        unusable: the address of a picture or file that a model service cannot fetch; the request is refused.
    """

    tools: tuple[tuple[str, str], ...]
    shown: tuple[ShownResult, ...]
    streamed: bool
    unusable: str = ""


@dataclass(frozen=True)
class _Reply:
    """The next message: the name of a tool as the client offers it, or a text."""

    text: str = ""
    tool: str = ""
    space: str = ""
    arguments: Json | None = None
    number: int = 0

    @property
    def written(self) -> str:
        """The arguments as JSON."""
        return json.dumps(self.arguments)

    @property
    def call_id(self) -> str:
        """An id for the call that no other call of the story has."""
        return f"call_{self.number:04d}"


class ScriptedModel:
    """The server: its address, and the tools' answers in the request that held the most of them."""

    def __init__(self) -> None:
        self.url = ""
        self.shown: tuple[ShownResult, ...] = ()
        self.requests = 0

    def reply(self, asked: ModelRequest) -> _Reply:
        """Return the next message; a text if the request offers none of the server's tools (for a title, say)."""
        self.requests += 1
        if len(asked.shown) >= len(self.shown):
            self.shown = asked.shown
        move = next_move(asked.shown)
        if not move.tool:
            return _Reply(text=move.text)
        offered = _offered(move, asked.tools)
        if offered is None:
            return _Reply(text=f"I am offered no tool {move.tool}.")
        space, name = offered
        return _Reply(tool=name, space=space, arguments=move.arguments, number=len(asked.shown))


def _offered(move: Move, tools: Sequence[tuple[str, str]]) -> tuple[str, str] | None:
    """Return the tool under the name that the client gave it, which ends as the server's own."""
    return next(((space, name) for space, name in tools if _own_name(name) == move.tool), None)


def _own_name(name: str) -> str:
    """Return the server's name of a tool, without a client's prefix."""
    for separator in ("__", ".", ":", "/"):
        name = name.rpartition(separator)[2]
    return name.removeprefix("plannerforge_").removeprefix("plannerforge-")


@contextmanager
def scripted_model() -> Iterator[ScriptedModel]:
    """Provide a server on a free port of loopback, until the block is left."""
    import uvicorn

    model = ScriptedModel()
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()  # early connections wait for the server's start
        model.url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        config = uvicorn.Config(
            model_application(model), log_level="error", access_log=False, lifespan="off", timeout_graceful_shutdown=1
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
        thread.start()
        try:
            yield model
        finally:
            server.should_exit = True
            thread.join(_STOP_S)


def model_application(model: ScriptedModel) -> "Starlette":
    """Return the application that speaks all protocols."""
    from starlette.applications import Starlette
    from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
    from starlette.routing import Route

    def spoken(protocol: _Protocol) -> Callable[["Request"], Any]:
        async def endpoint(request: "Request") -> "Response":
            asked = protocol.read(await request.json())
            if asked.unusable:
                error = {
                    "type": "invalid_request_error",
                    "message": f"cannot be fetched: {asked.unusable}",
                    "code": None,
                }
                return JSONResponse({"type": "error", "error": error}, 400)
            reply = model.reply(asked)
            if asked.streamed:
                return StreamingResponse(protocol.stream(reply), media_type=protocol.media_type)
            return JSONResponse(protocol.whole(reply))

        return endpoint

    def fixed(value: Any) -> Callable[["Request"], Any]:
        async def endpoint(request: "Request") -> "Response":
            del request
            return JSONResponse(value)

        return endpoint

    async def alive(request: "Request") -> Response:
        del request
        return PlainTextResponse("Ollama is running")

    listed = {"id": NAME, "object": "model", "created": _CREATED, "owned_by": "made"}
    details = {"parent_model": "", "format": "gguf", "family": "made", "families": ["made"]}
    details |= {"parameter_size": "8B", "quantization_level": "Q4_K_M"}
    local = {"name": NAME, "model": NAME, "modified_at": _DATE, "size": 1, "digest": "0" * 64, "details": details}
    information = {"general.architecture": "made", "made.context_length": 262_144}
    about = {"details": details, "model_info": information, "capabilities": ["completion", "tools", "vision"]}
    return Starlette(
        routes=[
            Route("/", alive, methods=["GET", "HEAD"]),
            Route("/story", spoken(_PLAIN), methods=["POST"]),
            Route("/v1/models", fixed({"object": "list", "data": [listed]})),
            Route("/v1/chat/completions", spoken(_CHAT), methods=["POST"]),
            Route("/v1/responses", spoken(_RESPONSES), methods=["POST"]),
            Route("/v1/messages", spoken(_MESSAGES), methods=["POST"]),
            Route("/v1/messages/count_tokens", fixed({"input_tokens": _USAGE[0]}), methods=["POST"]),
            Route("/api/version", fixed({"version": "0.33.0"})),
            Route("/api/tags", fixed({"models": [local]})),
            Route("/api/ps", fixed({"models": []})),
            Route("/api/show", fixed({**about, "modified_at": _DATE, "template": ""}), methods=["POST"]),
            Route("/api/chat", spoken(_OLLAMA), methods=["POST"]),
        ]
    )


@dataclass(frozen=True)
class _Protocol:
    """How to read a request, and how to write a message whole and in pieces."""

    read: Callable[[Json], ModelRequest]
    whole: Callable[[_Reply], Json]
    stream: Callable[[_Reply], Iterator[str]]
    media_type: str = "text/event-stream"


class _Conversation:
    """The answers of tools in a conversation, as its messages bring them: names of calls come before their answers."""

    def __init__(self) -> None:
        self._tools: dict[str, str] = {}
        self._shown: list[ShownResult] = []
        self._unusable = ""

    def called(self, call_id: object, name: str) -> None:
        """Return a call of the model."""
        self._tools[str(call_id)] = _own_name(name)

    def answered(self, call_id: object, content: Any) -> None:
        """Return the answer to it, as the client shows it."""
        text, pictures = self._flat(content)
        self._shown.append(ShownResult(self._tools.get(str(call_id), ""), text, pictures))

    def added(self, content: Any) -> None:
        """Return the client's further content: pictures that its protocol keeps out of the answer."""
        _, pictures = self._flat(content)
        if self._shown and pictures:
            last = self._shown[-1]
            self._shown[-1] = ShownResult(last.tool, last.text, last.pictures + pictures)

    def asked(self, tools: Sequence[tuple[str, str]], streamed: bool) -> ModelRequest:
        """Return all of it."""
        return ModelRequest(tuple(tools), tuple(self._shown), streamed, self._unusable)

    def _flat(self, content: Any) -> tuple[str, int]:
        """Return text and number of pictures of a content, in any of the protocols' forms."""
        if content is None:
            return "", 0
        if isinstance(content, str):
            return content, 0
        if isinstance(content, list):
            parts = [self._flat(part) for part in content]
            return "\n".join(text for text, _ in parts if text), sum(pictures for _, pictures in parts)
        if isinstance(content, dict):
            kind = content.get("type")
            if kind in _ADDRESSED:
                self._unusable = self._unusable or _unusable_address(content)
            if kind in {"image", "image_url", "input_image"}:
                return "", 1
            if kind in {"text", "input_text", "output_text"}:
                return str(content.get("text", "")), 0
        return json.dumps(content, ensure_ascii=False), 0


def _unusable_address(content: Json) -> str:
    """Return the address of a picture or file that is neither on the web nor data, empty if there is none."""
    places = [content.get(name) for name in ("url", "image_url", "file_url", "source")]
    places += [place.get("url") for place in places if isinstance(place, dict)]
    texts = [place for place in places if isinstance(place, str)]
    return next((text for text in texts if not text.startswith(("http://", "https://", "data:"))), "")


def _pieces(text: str) -> Iterator[str]:
    return (text[start : start + _PIECE] for start in range(0, len(text), _PIECE))


def _event(value: Json, name: str = "") -> str:
    head = f"event: {name}\n" if name else ""
    return f"{head}data: {json.dumps(value)}\n\n"


# OpenAI's chat completions


def _read_chat(body: Json) -> ModelRequest:
    conversation = _Conversation()
    for message in body.get("messages", []):
        for call in message.get("tool_calls") or []:
            conversation.called(call["id"], call["function"]["name"])
        if message["role"] == "tool":
            conversation.answered(message.get("tool_call_id"), message.get("content"))
        elif message["role"] == "user":
            conversation.added(message.get("content"))
    tools = [("", tool["function"]["name"]) for tool in body.get("tools") or [] if "function" in tool]
    return conversation.asked(tools, bool(body.get("stream")))


def _chat_head(kind: str) -> dict[str, Any]:
    return {"id": "chatcmpl-1", "object": kind, "created": _CREATED, "model": NAME}


def _chat_usage() -> dict[str, int]:
    return {"prompt_tokens": _USAGE[0], "completion_tokens": _USAGE[1], "total_tokens": sum(_USAGE)}


def _chat_calls(reply: _Reply) -> list[dict[str, Any]]:
    function = {"name": reply.tool, "arguments": reply.written}
    return [{"id": reply.call_id, "type": "function", "function": function}] if reply.tool else []


def _whole_chat(reply: _Reply) -> Json:
    message: dict[str, Any] = {"role": "assistant", "content": reply.text or None}
    if reply.tool:
        message["tool_calls"] = _chat_calls(reply)
    choice = {"index": 0, "message": message, "logprobs": None, "finish_reason": _chat_end(reply)}
    return {**_chat_head("chat.completion"), "choices": [choice], "usage": _chat_usage()}


def _chat_end(reply: _Reply) -> str:
    return "tool_calls" if reply.tool else "stop"


def _stream_chat(reply: _Reply) -> Iterator[str]:
    def part(delta: Json, end: str | None = None) -> str:
        choice = {"index": 0, "delta": delta, "finish_reason": end}
        return _event({**_chat_head("chat.completion.chunk"), "choices": [choice]})

    yield part({"role": "assistant", "content": ""})
    for piece in _pieces(reply.text):
        yield part({"content": piece})
    for call in _chat_calls(reply):
        begun = {**call, "function": {"name": reply.tool, "arguments": ""}}
        yield part({"tool_calls": [{"index": 0, **begun}]})
        for piece in _pieces(reply.written):
            yield part({"tool_calls": [{"index": 0, "function": {"arguments": piece}}]})
    yield part({}, _chat_end(reply))
    yield _event({**_chat_head("chat.completion.chunk"), "choices": [], "usage": _chat_usage()})
    yield "data: [DONE]\n\n"


# OpenAI's responses


def _read_responses(body: Json) -> ModelRequest:
    conversation = _Conversation()
    given = body.get("input") or []
    for item in [] if isinstance(given, str) else given:
        kind = item.get("type", "message")
        if kind in {"function_call", "custom_tool_call"}:
            conversation.called(item["call_id"], item["name"])
        elif kind in {"function_call_output", "custom_tool_call_output"}:
            conversation.answered(item["call_id"], item.get("output"))
        elif kind == "message" and item.get("role") == "user":
            conversation.added(item.get("content"))
    tools: list[tuple[str, str]] = []
    for tool in body.get("tools") or []:
        inner = tool.get("tools") if tool.get("type") == "namespace" else None
        tools += [(tool["name"], one["name"]) for one in inner or []]
        tools += [("", tool["name"])] if tool.get("type") == "function" else []
    return conversation.asked(tools, bool(body.get("stream")))


def _responses_item(reply: _Reply) -> dict[str, Any]:
    if reply.tool:
        call = {"id": f"fc_{reply.call_id}", "type": "function_call", "status": "completed", "call_id": reply.call_id}
        call |= {"name": reply.tool, "arguments": reply.written}
        return call | ({"namespace": reply.space} if reply.space else {})
    text = {"type": "output_text", "text": reply.text, "annotations": [], "logprobs": []}
    return {"id": "msg_1", "type": "message", "role": "assistant", "status": "completed", "content": [text]}


def _responses_head(status: str, output: list[Any]) -> dict[str, Any]:
    details = {
        "input_tokens_details": {"cached_tokens": 0, "cache_write_tokens": 0},
        "output_tokens_details": {"reasoning_tokens": 0},
    }
    usage = {"input_tokens": _USAGE[0], "output_tokens": _USAGE[1], "total_tokens": sum(_USAGE), **details}
    head = {"id": "resp_1", "object": "response", "created_at": _CREATED, "status": status, "model": NAME}
    rest: dict[str, Any] = {
        "error": None,
        "incomplete_details": None,
        "instructions": None,
        "metadata": {},
        "tools": [],
    }
    rest |= {"parallel_tool_calls": False, "tool_choice": "auto", "temperature": None, "top_p": None}
    return {**head, **rest, "output": output, "usage": usage if status == "completed" else None}


def _whole_responses(reply: _Reply) -> Json:
    return _responses_head("completed", [_responses_item(reply)])


def _stream_responses(reply: _Reply) -> Iterator[str]:
    item = _responses_item(reply)
    place = {"item_id": item["id"], "output_index": 0}
    events: list[dict[str, Any]] = [
        {"type": "response.created", "response": _responses_head("in_progress", [])},
        {"type": "response.in_progress", "response": _responses_head("in_progress", [])},
    ]
    if reply.tool:
        begun = {**item, "arguments": "", "status": "in_progress"}
        name = "response.function_call_arguments"
        events.append({"type": "response.output_item.added", "output_index": 0, "item": begun})
        events += [{"type": f"{name}.delta", **place, "delta": piece} for piece in _pieces(reply.written)]
        events.append({"type": f"{name}.done", **place, "name": reply.tool, "arguments": reply.written})
    else:
        (text,) = item["content"]
        place |= {"content_index": 0}
        begun = {**item, "content": [], "status": "in_progress"}
        events.append({"type": "response.output_item.added", "output_index": 0, "item": begun})
        events.append({"type": "response.content_part.added", **place, "part": {**text, "text": ""}})
        delta = {"type": "response.output_text.delta", **place, "logprobs": []}
        events += [{**delta, "delta": piece} for piece in _pieces(reply.text)]
        events.append({"type": "response.output_text.done", **place, "logprobs": [], "text": reply.text})
        events.append({"type": "response.content_part.done", **place, "part": text})
    events.append({"type": "response.output_item.done", "output_index": 0, "item": item})
    events.append({"type": "response.completed", "response": _responses_head("completed", [item])})
    for number, event in enumerate(events):
        yield _event({**event, "sequence_number": number}, event["type"])


# Anthropic's messages


def _read_messages(body: Json) -> ModelRequest:
    conversation = _Conversation()
    for message in body.get("messages", []):
        content = message.get("content")
        for block in content if isinstance(content, list) else []:
            if block.get("type") == "tool_use":
                conversation.called(block["id"], block["name"])
            elif block.get("type") == "tool_result":
                conversation.answered(block["tool_use_id"], block.get("content"))
            elif message["role"] == "user":
                conversation.added([block])
    tools = [("", tool["name"]) for tool in body.get("tools") or []]
    return conversation.asked(tools, bool(body.get("stream")))


def _message_block(reply: _Reply) -> dict[str, Any]:
    if reply.tool:
        return {"type": "tool_use", "id": f"toolu_{reply.call_id}", "name": reply.tool, "input": reply.arguments}
    return {"type": "text", "text": reply.text}


def _message_head(content: list[Any], end: str | None) -> dict[str, Any]:
    usage = {"input_tokens": _USAGE[0], "output_tokens": _USAGE[1]}
    head = {"id": "msg_1", "type": "message", "role": "assistant", "model": NAME}
    return {**head, "content": content, "stop_reason": end, "stop_sequence": None, "usage": usage}


def _whole_messages(reply: _Reply) -> Json:
    return _message_head([_message_block(reply)], "tool_use" if reply.tool else "end_turn")


def _stream_messages(reply: _Reply) -> Iterator[str]:
    block = _message_block(reply)
    begun = {**block, "input": {}} if reply.tool else {**block, "text": ""}
    kind, field, whole = (
        ("input_json_delta", "partial_json", reply.written) if reply.tool else ("text_delta", "text", reply.text)
    )
    end = {"stop_reason": "tool_use" if reply.tool else "end_turn", "stop_sequence": None}
    deltas = [{"type": kind, field: piece} for piece in _pieces(whole)]
    events: list[dict[str, Any]] = [
        {"type": "message_start", "message": _message_head([], None)},
        {"type": "content_block_start", "index": 0, "content_block": begun},
        *({"type": "content_block_delta", "index": 0, "delta": delta} for delta in deltas),
        {"type": "content_block_stop", "index": 0},
        {"type": "message_delta", "delta": end, "usage": {"output_tokens": _USAGE[1]}},
        {"type": "message_stop"},
    ]
    for event in events:
        yield _event(event, event["type"])


# Ollama's chat


def _read_ollama(body: Json) -> ModelRequest:
    conversation = _Conversation()
    for number, message in enumerate(body.get("messages", [])):
        for call in message.get("tool_calls") or []:
            conversation.called(f"last {call['function']['name']}", call["function"]["name"])
            last = f"last {call['function']['name']}"
        if message["role"] == "tool":
            name = message.get("tool_name") or message.get("name")
            del number
            conversation.answered(f"last {name}" if name else last, message.get("content"))
        conversation.added([{"type": "image"}] * len(message.get("images") or []))
    tools = [("", tool["function"]["name"]) for tool in body.get("tools") or []]
    return conversation.asked(tools, body.get("stream", True) is not False)


def _ollama_part(message: Json, done: bool) -> dict[str, Any]:
    part = {"model": NAME, "created_at": _DATE, "message": {"role": "assistant", "content": "", **message}}
    if not done:
        return {**part, "done": False}
    times = {"total_duration": 4_883_583_458, "load_duration": 1_334_875, "prompt_eval_duration": 342_546_000}
    counts = {"prompt_eval_count": _USAGE[0], "eval_count": _USAGE[1], "eval_duration": 4_535_599_000}
    return {**part, "done": True, "done_reason": "stop", **times, **counts}


def _ollama_calls(reply: _Reply) -> dict[str, Any]:
    function = {"index": 0, "name": reply.tool, "arguments": reply.arguments}
    return {"tool_calls": [{"id": reply.call_id, "function": function}]} if reply.tool else {}


def _whole_ollama(reply: _Reply) -> Json:
    return _ollama_part({"content": reply.text, **_ollama_calls(reply)}, done=True)


def _stream_ollama(reply: _Reply) -> Iterator[str]:
    parts = [{"content": piece} for piece in _pieces(reply.text)] or [_ollama_calls(reply)]
    for message in parts:
        yield json.dumps(_ollama_part(message, done=False)) + "\n"
    yield json.dumps(_ollama_part({}, done=True)) + "\n"


# A plain protocol, for clients with a driver that requests the next call


def _read_plain(body: Json) -> ModelRequest:
    conversation = _Conversation()
    for number, result in enumerate(body["shown"]):
        conversation.called(number, result["tool"])
        conversation.answered(number, result["content"])
    return conversation.asked([("", name) for name in body["tools"]], streamed=False)


def _whole_plain(reply: _Reply) -> Json:
    return {"tool": reply.tool, "arguments": reply.arguments, "text": reply.text}


def _stream_plain(reply: _Reply) -> Iterator[str]:
    yield json.dumps(_whole_plain(reply))


_PLAIN = _Protocol(_read_plain, _whole_plain, _stream_plain)
_CHAT = _Protocol(_read_chat, _whole_chat, _stream_chat)
_RESPONSES = _Protocol(_read_responses, _whole_responses, _stream_responses)
_MESSAGES = _Protocol(_read_messages, _whole_messages, _stream_messages)
_OLLAMA = _Protocol(_read_ollama, _whole_ollama, _stream_ollama, "application/x-ndjson")
