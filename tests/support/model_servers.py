"""Local model servers that speak Ollama's and OpenAI's protocol, and answer as scripted.

``tests/agent/test_model_servers.py`` checks their messages against the client libraries' own types.
"""

import json
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Literal

Fault = Literal["", "cut", "hold", "error line", "no json", "endless"]
WRITTEN_AT = "2026-11-02T08:00:00.000000Z"


@dataclass(frozen=True)
class Reply:
    """A model's answer.

    ``calls`` are tools with their arguments: an object, or a text if the model writes invalid JSON; ``fault`` happens
    after the first piece; ``status`` other than 200 refuses with ``text``; ``end`` is why the model stopped.
    """

    text: str = ""
    calls: tuple[tuple[str, Mapping[str, Any] | str], ...] = ()
    thinking: str = ""
    fault: Fault = ""
    status: int = 200
    end: str = "stop"
    counts_tokens: bool = True


Script = Callable[[Mapping[str, Any]], Reply]
"""The reply to a request."""


@dataclass
class ModelServer:
    """A running server: the requests that it received (``requests``), and its models."""

    url: str = ""
    requests: list[dict[str, Any]] = field(default_factory=list)
    models: dict[str, tuple[str, ...]] = field(
        default_factory=lambda: {"big:70b": ("completion", "tools", "thinking"), "plain:8b": ("completion",)}
    )
    context_tokens: int = 40_960
    size: str = "70.6B"
    key: str = ""
    held: threading.Event = field(default_factory=threading.Event)
    """Is set when a reply with the fault ``hold`` has begun."""
    released: threading.Event = field(default_factory=threading.Event)
    script: Script = field(default=lambda request: Reply("Done."))


def replies(*scripted: Reply) -> Script:
    """Give one reply after the other, and repeat the last."""
    waiting = list(scripted)

    def next_reply(request: Mapping[str, Any]) -> Reply:
        return waiting.pop(0) if len(waiting) > 1 else waiting[0]

    return next_reply


@contextmanager
def serving(kind: Literal["ollama", "openai"], script: Script, **settings: Any) -> Iterator[ModelServer]:
    """Run a server on a free local port until the block ends."""
    model_server = ModelServer(script=script, **settings)
    handler = type("Handler", (_OllamaHandler if kind == "ollama" else _OpenAIHandler,), {"known": model_server})
    http_server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    http_server.daemon_threads = True
    model_server.url = f"http://127.0.0.1:{http_server.server_address[1]}"
    thread = threading.Thread(target=http_server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    try:
        yield model_server
    finally:
        model_server.released.set()
        http_server.shutdown()
        http_server.server_close()
        thread.join()


class _Broken(Exception):
    """The connection must be closed at once."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    known: ModelServer

    def log_message(self, format: str, *arguments: Any) -> None:  # noqa: A002 - the base class names it so
        pass

    def handle(self) -> None:
        try:
            super().handle()
        except (ConnectionError, _Broken):
            self.close_connection = True

    def send_json(self, value: Any, status: int = 200) -> None:
        data = json.dumps(value).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json; charset=utf-8")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def body(self) -> dict[str, Any] | None:
        raw = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        try:
            read: dict[str, Any] = json.loads(raw)
        except ValueError:
            return None
        return read

    def begin_stream(self, content_type: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", content_type)
        self.send_header("Transfer-Encoding", "chunked")
        self.end_headers()

    def send_chunk(self, text: str) -> None:
        data = text.encode()
        self.wfile.write(f"{len(data):x}\r\n".encode() + data + b"\r\n")
        self.wfile.flush()

    def end_stream(self) -> None:
        self.wfile.write(b"0\r\n\r\n")
        self.wfile.flush()

    def misbehave(self, fault: Fault, no_json: str) -> None:
        """Carry out the fault after the first piece."""
        if fault == "cut":
            raise _Broken
        if fault == "hold":
            self.known.held.set()
            self.known.released.wait()
            raise _Broken
        if fault == "no json":
            self.send_chunk(no_json)


def _pieces(text: str, length: int = 7) -> Sequence[str]:
    return [text[start : start + length] for start in range(0, len(text), length)]


class _OllamaHandler(_Handler):
    def do_HEAD(self) -> None:
        self.send_response(200)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def do_GET(self) -> None:
        if self.path == "/api/version":
            self.send_json({"version": "0.33.0"})
        elif self.path == "/api/tags":
            self.send_json({"models": [self._listed(name) for name in self.known.models]})
        else:
            self.send_json({"error": "not found"}, 404)

    def do_POST(self) -> None:
        body = self.body()
        if body is None:
            return self.send_json({"error": "missing request body"}, 400)
        name = str(body.get("model", ""))
        able = self.known.models.get(name)
        if able is None:
            return self.send_json({"error": f"model '{name}' not found"}, 404)
        if self.path == "/api/show":
            return self.send_json(self._shown(able))
        if self.path != "/api/chat":
            return self.send_json({"error": "not found"}, 404)
        self.known.requests.append(body)
        if body.get("tools") and "tools" not in able:
            return self.send_json({"error": f"registry.ollama.ai/library/{name} does not support tools"}, 400)
        if body.get("think") and "thinking" not in able:
            return self.send_json({"error": f'"{name}" does not support thinking'}, 400)
        reply = self.known.script(body)
        if reply.status != 200:
            return self.send_json({"error": reply.text}, reply.status)
        return self._stream(name, reply)

    def _stream(self, name: str, reply: Reply) -> None:
        self.begin_stream("application/x-ndjson")
        for piece in _pieces(reply.thinking):
            self._part(name, {"role": "assistant", "content": "", "thinking": piece})
        while reply.fault == "endless":
            self._part(name, {"role": "assistant", "content": "", "thinking": "and then again, "})
        for number, piece in enumerate(_pieces(reply.text) or [""] * bool(reply.fault)):
            self._part(name, {"role": "assistant", "content": piece})
            if number == 0 and reply.fault == "error line":
                self.send_chunk(json.dumps({"error": "an error was encountered while running the model: EOF"}) + "\n")
                return self.end_stream()
            if number == 0:
                self.misbehave(reply.fault, "<html>502 Bad Gateway</html>\n")
        for number, (tool, arguments) in enumerate(reply.calls):
            if isinstance(arguments, str):
                error = f"error parsing tool call: raw='{arguments}', err=invalid character '}}' looking for a value"
                self.send_chunk(json.dumps({"error": error}) + "\n")
                return self.end_stream()
            call = {"id": f"call_{number}", "function": {"index": number, "name": tool, "arguments": arguments}}
            self._part(name, {"role": "assistant", "content": "", "tool_calls": [call]})
        counts = {"prompt_eval_count": 26, "prompt_eval_duration": 342_546_000, "eval_count": 28}
        ended = {"done": True, "done_reason": reply.end, "total_duration": 4_883_583_458, "load_duration": 1_334_875}
        self._part(name, {"role": "assistant", "content": ""}, ended | (counts if reply.counts_tokens else {}))
        return self.end_stream()

    def _part(self, name: str, message: Mapping[str, Any], ended: Mapping[str, Any] | None = None) -> None:
        part = {"model": name, "created_at": WRITTEN_AT, "message": message, "done": False, **(ended or {})}
        self.send_chunk(json.dumps(part) + "\n")

    def _details(self) -> dict[str, Any]:
        described = {"parent_model": "", "format": "gguf", "family": "made", "families": ["made"]}
        return described | {"parameter_size": self.known.size, "quantization_level": "Q4_K_M"}

    def _listed(self, name: str) -> dict[str, Any]:
        size = {"size": 5_225_388_164, "digest": "500a1f067a9f782620b40bee6f7b0c89e17ae61f686b92c24933e4ca4b2b8b41"}
        return {"name": name, "model": name, "modified_at": WRITTEN_AT, "details": self._details(), **size}

    def _shown(self, able: Sequence[str]) -> dict[str, Any]:
        info = {"general.architecture": "made", "made.context_length": self.known.context_tokens}
        texts = {"license": "", "modelfile": "", "parameters": "", "template": ""}
        rest = {"model_info": info, "capabilities": list(able), "modified_at": WRITTEN_AT}
        return {**texts, "details": self._details(), **rest}


class _OpenAIHandler(_Handler):
    def do_GET(self) -> None:
        if self._refused():
            return
        if self.path == "/v1/models":
            about = {"object": "model", "created": 1_700_000_000, "owned_by": "made"}
            context = {"max_model_len": self.known.context_tokens}
            self.send_json({"object": "list", "data": [{"id": name, **about, **context} for name in self.known.models]})
        else:
            self._error("not found", 404)

    def do_POST(self) -> None:
        body = self.body()
        if body is None:
            return self._error("We could not parse the JSON body of your request.", 400)
        if self._refused():
            return None
        if self.path != "/v1/chat/completions":
            return self._error("not found", 404)
        name = str(body.get("model", ""))
        if name not in self.known.models:
            return self._error(f"The model `{name}` does not exist.", 404)
        self.known.requests.append(body)
        reply = self.known.script(body)
        if reply.status != 200:
            return self._error(reply.text, reply.status)
        return self._stream(name, body, reply)

    def _stream(self, name: str, body: Mapping[str, Any], reply: Reply) -> None:
        self.begin_stream("text/event-stream; charset=utf-8")
        self._part(name, {"role": "assistant", "content": ""})
        for piece in _pieces(reply.thinking):
            self._part(name, {"reasoning_content": piece})
        while reply.fault == "endless":
            self._part(name, {"reasoning_content": "and then again, "})
        for number, piece in enumerate(_pieces(reply.text) or [""] * bool(reply.fault)):
            self._part(name, {"content": piece})
            if number == 0 and reply.fault == "error line":
                error = {"message": "CUDA out of memory", "type": "server_error", "code": 500}
                self.send_chunk(f"data: {json.dumps({'error': error})}\n\n")
                return self.end_stream()
            if number == 0:
                self.misbehave(reply.fault, "data: <html>502 Bad Gateway</html>\n\n")
        for number, (tool, arguments) in enumerate(reply.calls):
            begun = {"index": number, "id": f"call_{number}", "type": "function"}
            self._part(name, {"tool_calls": [{**begun, "function": {"name": tool, "arguments": ""}}]})
            written = arguments if isinstance(arguments, str) else json.dumps(arguments)
            for piece in _pieces(written, 5):
                self._part(name, {"tool_calls": [{"index": number, "function": {"arguments": piece}}]})
        self._part(name, {}, finish="tool_calls" if reply.calls else reply.end)
        if reply.counts_tokens and (body.get("stream_options") or {}).get("include_usage"):
            usage = {"prompt_tokens": 26, "completion_tokens": 28, "total_tokens": 54}
            self._send({**self._head(name), "choices": [], "usage": usage})
        self.send_chunk("data: [DONE]\n\n")
        return self.end_stream()

    def _part(self, name: str, delta: Mapping[str, Any], finish: str | None = None) -> None:
        self._send({**self._head(name), "choices": [{"index": 0, "delta": delta, "finish_reason": finish}]})

    def _head(self, name: str) -> dict[str, Any]:
        return {"id": "chatcmpl-1", "object": "chat.completion.chunk", "created": 1_700_000_000, "model": name}

    def _send(self, value: Mapping[str, Any]) -> None:
        self.send_chunk(f"data: {json.dumps(value)}\n\n")

    def _error(self, message: str, status: int) -> None:
        self.send_json({"error": {"message": message, "type": "invalid_request_error", "code": None}}, status)

    def _refused(self) -> bool:
        wanted = self.known.key
        refused = bool(wanted) and self.headers.get("Authorization") != f"Bearer {wanted}"
        if refused:
            self._error("Incorrect API key provided.", 401)
        return refused
