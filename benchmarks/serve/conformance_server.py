"""The real server over HTTP, plus the tools, resources and prompts that the official suite calls by name.

``python -m benchmarks.serve.conformance_server --port 0``. Fixtures that take time are ordinary tools of this server
(``ToolSpec``), so that its tasks are tested. Fixtures that use parts of the protocol that no tool of this server uses
(sampling, logging, audio, state between rounds) are answered before its own handlers. The suite's scenarios define each
fixture: https://github.com/modelcontextprotocol/conformance.
"""

import argparse
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any

import anyio
from mcp import MCPError
from mcp.server.context import ServerRequestContext
from mcp.server.mcpserver.context import Context
from mcp.server.mcpserver.server import require_client_extension
from mcp.types import (
    INTERNAL_ERROR,
    INVALID_PARAMS,
    MISSING_REQUIRED_CLIENT_CAPABILITY,
    AudioContent,
    BlobResourceContents,
    CallToolRequestParams,
    CallToolResult,
    ClientCapabilities,
    CompleteRequestParams,
    CompleteResult,
    Completion,
    CreateMessageRequest,
    CreateMessageRequestParams,
    CreateMessageResult,
    ElicitRequest,
    ElicitRequestFormParams,
    ElicitResult,
    EmbeddedResource,
    EmptyResult,
    GetPromptRequestParams,
    GetPromptResult,
    ImageContent,
    InputRequiredResult,
    ListRootsRequest,
    MissingRequiredClientCapabilityErrorData,
    Prompt,
    PromptArgument,
    PromptMessage,
    PromptReference,
    ReadResourceRequestParams,
    ReadResourceResult,
    Resource,
    ResourceTemplate,
    SamplingMessage,
    SetLevelRequestParams,
    SubscribeRequestParams,
    TextContent,
    TextResourceContents,
    Tool,
    UnsubscribeRequestParams,
)
from pydantic import BaseModel, Field

from plannerforge.schemas.base import Answer, Arguments, Result
from plannerforge.schemas.errors import NotPossible
from plannerforge.server import tasks
from plannerforge.server.assembly import create_server
from plannerforge.server.http.serving import HttpServer, bound
from plannerforge.server.settings import Settings
from plannerforge.tools.call import ToolCall
from plannerforge.tools.registry import ToolSpec
from plannerforge.workflows.context import Question

PNG = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
WAV = "UklGRiQAAABXQVZFZm10IBAAAAABAAEAQB8AAIA+AAACABAAZGF0YQAAAAA="


class SlowArguments(Arguments):
    """Take some time."""

    seconds: float = 0.0
    label: str = ""


class FileArguments(Arguments):
    """Ask before a file is deleted."""

    filename: str = ""


class NameArguments(Arguments):
    """Greet."""

    name: str = "World"


class NoArguments(Arguments):
    """Take nothing."""


class Sentence(Result):
    """A sentence."""

    text: str

    def answer(self) -> Answer:
        """Return the sentence."""
        return Answer(self.text)


async def greet(arguments: NameArguments, call: ToolCall) -> Sentence:
    """Greet at once."""
    del call
    return Sentence(text=f"Hello, {arguments.name}!")


async def greet_later(arguments: NameArguments, call: ToolCall) -> Sentence:
    """Greet after the call has become a task."""
    del call
    await anyio.sleep(_LATER_S)
    return Sentence(text=f"Hello, {arguments.name}!")


async def slow_compute(arguments: SlowArguments, call: ToolCall) -> Sentence:
    """Take some time."""
    del call
    await anyio.sleep(arguments.seconds)
    return Sentence(text=f"computed {arguments.label}")


async def failing_job(arguments: NoArguments, call: ToolCall) -> Sentence:
    """Take a second, then refuse."""
    del arguments, call
    await anyio.sleep(1.0)
    raise NotPossible("this tool always fails")


async def protocol_error_job(arguments: NoArguments, call: ToolCall) -> Sentence:
    """Wait briefly, then break the protocol."""
    del arguments, call
    await anyio.sleep(0.5)
    raise MCPError(INTERNAL_ERROR, "this tool always breaks")


async def confirm_delete(arguments: FileArguments, call: ToolCall) -> Sentence:
    """Ask as a task."""
    await anyio.sleep(_LATER_S)
    chosen = await call.ask(Question(f"Delete {arguments.filename}?", ("yes", "no")))
    return Sentence(text=f"{arguments.filename}: {chosen}")


async def multi_input(arguments: NoArguments, call: ToolCall) -> Sentence:
    """Ask two questions at once, as a task."""
    del arguments
    await anyio.sleep(_LATER_S)
    answers: list[str | None] = []

    async def ask(text: str) -> None:
        answers.append(await call.ask(Question(text, ("yes", "no"))))

    async with anyio.create_task_group() as group:
        group.start_soon(ask, "First?")
        group.start_soon(ask, "Second?")
    return Sentence(text=f"{len(answers)} answers")


_GRACE_S, _LATER_S = 0.1, 0.4
"""Delay after which calls become tasks here; questions of tasks come later."""


@dataclass(frozen=True)
class _FixtureSpec(ToolSpec):
    """A tool that is given as a function."""

    call: Callable[..., Awaitable[Any]] = greet

    def load_function(self) -> Callable[..., Awaitable[Any]]:
        """Return the function."""
        return self.call


_SPECS: tuple[ToolSpec, ...] = (
    _FixtureSpec("greet", "Greet", "", read_only=True, call=greet),
    *(
        _FixtureSpec(function.__name__, "Fixture", "", call=function)
        for function in (greet_later, slow_compute, failing_job, protocol_error_job, confirm_delete, multi_input)
    ),
)

Fixture = Callable[[Context[Any, Any], Mapping[str, Any]], Awaitable[CallToolResult | InputRequiredResult]]
_NO_ARGUMENTS: dict[str, Any] = {"type": "object", "properties": {}}


def _text(text: str, *, is_error: bool = False) -> CallToolResult:
    return CallToolResult(content=[TextContent(type="text", text=text)], is_error=is_error)


def _constant(*content: Any) -> Fixture:
    async def answer(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult:
        del context, arguments
        return CallToolResult(content=list(content))

    return answer


def _embedded(uri: str, mime_type: str, text: str) -> EmbeddedResource:
    return EmbeddedResource(type="resource", resource=TextResourceContents(uri=uri, mime_type=mime_type, text=text))


async def _log(context: Context[Any, Any], text: str) -> None:
    session = context.request_context.session
    await session.send_log_message("info", text, related_request_id=context.request_context.request_id)


async def _with_logging(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult:
    del arguments
    for text in ("Tool execution started", "Tool processing data", "Tool execution completed"):
        await _log(context, text)
        await anyio.sleep(0.05)
    return _text("three messages were sent")


async def _with_progress(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult:
    del arguments
    for progress in (0, 50, 100):
        await context.report_progress(progress, 100)
        await anyio.sleep(0.05)
    return _text("progress was told three times")


async def _failing(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult:
    del context, arguments
    return _text("This tool intentionally returns an error for testing", is_error=True)


async def _sampling(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult:
    message = SamplingMessage(role="user", content=TextContent(type="text", text=str(arguments.get("prompt", ""))))
    session = context.request_context.session
    result = await session.create_message(
        messages=[message], max_tokens=100, related_request_id=context.request_context.request_id
    )
    return _text(f"LLM response: {getattr(result.content, 'text', result.content)}")


class _User(BaseModel):
    username: str = Field(description="User's response")
    email: str = Field(description="User's email address")


class _Defaults(BaseModel):
    name: str = "John Doe"
    age: int = 30
    score: float = 95.5
    status: str = Field("active", json_schema_extra={"enum": ["active", "inactive", "pending"]})
    verified: bool = True


def _titled(values: Mapping[str, str]) -> list[dict[str, str]]:
    return [{"const": value, "title": title} for value, title in values.items()]


_TITLES = {"value1": "First Option", "value2": "Second Option", "value3": "Third Option"}


class _Enums(BaseModel):
    untitledSingle: str = Field(json_schema_extra={"enum": ["option1", "option2", "option3"]})  # noqa: N815 - the suite's names
    titledSingle: str = Field(json_schema_extra={"oneOf": _titled(_TITLES)})  # type: ignore[dict-item]  # noqa: N815
    legacyEnum: str = Field(  # noqa: N815
        json_schema_extra={"enum": ["opt1", "opt2"], "enumNames": ["Option One", "Option Two"]}
    )
    untitledMulti: list[str] = Field(  # noqa: N815
        json_schema_extra={"items": {"type": "string", "enum": ["option1", "option2", "option3"]}}
    )
    titledMulti: list[str] = Field(json_schema_extra={"items": {"anyOf": _titled(_TITLES)}})  # type: ignore[dict-item]  # noqa: N815


def _eliciting(form: type[BaseModel], default_message: str) -> Fixture:
    async def ask(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult:
        result = await context.elicit(str(arguments.get("message", default_message)), form)
        content = result.data.model_dump_json() if result.action == "accept" else "{}"
        return _text(f"Elicitation completed: action={result.action}, content={content}")

    return ask


def _elicit(message: str, **properties: str) -> ElicitRequest:
    schema = {
        "type": "object",
        "properties": {name: {"type": kind} for name, kind in properties.items()},
        "required": list(properties),
    }
    return ElicitRequest(params=ElicitRequestFormParams(message=message, requested_schema=schema))


def _sample(text: str, most: int) -> CreateMessageRequest:
    message = SamplingMessage(role="user", content=TextContent(type="text", text=text))
    return CreateMessageRequest(params=CreateMessageRequestParams(messages=[message], max_tokens=most))


def _accepted(context: Context[Any, Any], key: str, name: str) -> Any:
    """Return a client's input, or None."""
    given = (context.input_responses or {}).get(key)
    if not isinstance(given, ElicitResult) or given.action != "accept":
        return None
    return (given.content or {}).get(name)


async def _use_name(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult | InputRequiredResult:
    del arguments
    name = _accepted(context, "user_name", "name")
    if isinstance(name, str):
        return _text(f"Hello, {name}!")
    return InputRequiredResult(input_requests={"user_name": _elicit("What is your name?", name="string")})


async def _use_capital(
    context: Context[Any, Any], arguments: Mapping[str, Any]
) -> CallToolResult | InputRequiredResult:
    del arguments
    given = (context.input_responses or {}).get("capital_question")
    if isinstance(given, CreateMessageResult):
        return _text(str(getattr(given.content, "text", given.content)))
    return InputRequiredResult(input_requests={"capital_question": _sample("What is the capital of France?", 100)})


async def _use_roots(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult | InputRequiredResult:
    del arguments
    given = (context.input_responses or {}).get("client_roots")
    if given is not None and hasattr(given, "roots"):
        return _text(", ".join(str(root.uri) for root in given.roots))
    return InputRequiredResult(input_requests={"client_roots": ListRootsRequest()})


async def _state_kept(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult | InputRequiredResult:
    del arguments
    if context.request_state == "confirming" and _accepted(context, "confirm", "ok") is not None:
        return _text("state-ok")
    return InputRequiredResult(
        input_requests={"confirm": _elicit("Please confirm", ok="boolean")}, request_state="confirming"
    )


async def _use_several(
    context: Context[Any, Any], arguments: Mapping[str, Any]
) -> CallToolResult | InputRequiredResult:
    del arguments
    wanted = {"user_name", "greeting", "client_roots"}
    if context.request_state == "several" and wanted <= set(context.input_responses or {}):
        return _text("all three were answered")
    return InputRequiredResult(
        input_requests={
            "user_name": _elicit("What is your name?", name="string"),
            "greeting": _sample("Generate a greeting", 50),
            "client_roots": ListRootsRequest(),
        },
        request_state="several",
    )


async def _rounds(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult | InputRequiredResult:
    del arguments
    if context.request_state == "round 2" and (color := _accepted(context, "step2", "color")) is not None:
        return _text(f"the color is {color}")
    if context.request_state == "round 1" and _accepted(context, "step1", "name") is not None:
        question = _elicit("Step 2: What is your favorite color?", color="string")
        return InputRequiredResult(input_requests={"step2": question}, request_state="round 2")
    question = _elicit("Step 1: What is your name?", name="string")
    return InputRequiredResult(input_requests={"step1": question}, request_state="round 1")


async def _only_declared(
    context: Context[Any, Any], arguments: Mapping[str, Any]
) -> CallToolResult | InputRequiredResult:
    """Send requests only as the client declared."""
    del arguments
    capabilities, requests = context.client_capabilities, dict[str, Any]()
    if capabilities is not None and capabilities.elicitation is not None:
        requests["user_name"] = _elicit("What is your name?", name="string")
    if capabilities is not None and capabilities.sampling is not None:
        requests["greeting"] = _sample("Generate a greeting", 50)
    if context.input_responses or not requests:
        return _text("nothing more is asked")
    return InputRequiredResult(input_requests=requests)


async def _needs_sampling(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult:
    del arguments
    capabilities = context.client_capabilities
    if capabilities is None or capabilities.sampling is None:
        data = MissingRequiredClientCapabilityErrorData(required_capabilities=ClientCapabilities(sampling={}))
        told = data.model_dump(by_alias=True, mode="json", exclude_none=True)
        raise MCPError(MISSING_REQUIRED_CLIENT_CAPABILITY, "this tool needs sampling", data=told)
    return _text("the client declared sampling")


async def _reconnecting(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult:
    del arguments
    request = context.request_context
    if request.close_sse_stream is not None:
        await request.close_sse_stream()
    await anyio.sleep(0.2)
    return _text("Reconnection test completed")


async def _tools_changed(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult:
    del arguments
    await context.notify_tools_changed()
    return _text("told")


async def _prompts_changed(context: Context[Any, Any], arguments: Mapping[str, Any]) -> CallToolResult:
    del arguments
    await context.notify_prompts_changed()
    return _text("told")


_ADDRESS = {
    "$anchor": "addressDef",
    "type": "object",
    "properties": {"street": {"type": "string"}, "city": {"type": "string"}},
}
_RICH_SCHEMA: dict[str, Any] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "type": "object",
    "$defs": {"address": _ADDRESS},
    "properties": {
        "name": {"type": "string"},
        "address": {"$ref": "#/$defs/address"},
        "contactMethod": {"type": "string", "enum": ["phone", "email"]},
        "phone": {"type": "string"},
        "email": {"type": "string"},
    },
    "allOf": [{"anyOf": [{"required": ["phone"]}, {"required": ["email"]}]}],
    "if": {"properties": {"contactMethod": {"const": "phone"}}, "required": ["contactMethod"]},
    "then": {"required": ["phone"]},
    "else": {"required": ["email"]},
    "additionalProperties": False,
}
_HEADER_SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {"region": {"type": "string", "x-mcp-header": "Region"}, "query": {"type": "string"}},
    "required": ["region"],
}
_MESSAGE = {"type": "object", "properties": {"message": {"type": "string"}}}
_PROMPTED = {"type": "object", "properties": {"prompt": {"type": "string"}}}
_IMAGE = ImageContent(type="image", data=PNG, mime_type="image/png")
_TEXT = TextContent(type="text", text="This is a simple text response for testing.")
_MIXED = (
    TextContent(type="text", text="Multiple content types test:"),
    _IMAGE,
    _embedded("test://mixed-content-resource", "application/json", '{"test":"data","value":123}'),
)
_FIXTURES: dict[str, tuple[dict[str, Any], Fixture]] = {
    "test_simple_text": (_NO_ARGUMENTS, _constant(_TEXT)),
    "test_image_content": (_NO_ARGUMENTS, _constant(_IMAGE)),
    "test_audio_content": (_NO_ARGUMENTS, _constant(AudioContent(type="audio", data=WAV, mime_type="audio/wav"))),
    "test_embedded_resource": (
        _NO_ARGUMENTS,
        _constant(_embedded("test://embedded-resource", "text/plain", "This is an embedded resource content.")),
    ),
    "test_multiple_content_types": (_NO_ARGUMENTS, _constant(*_MIXED)),
    "test_tool_with_logging": (_NO_ARGUMENTS, _with_logging),
    "test_logging_tool": (_NO_ARGUMENTS, _with_logging),
    "test_tool_with_progress": (_NO_ARGUMENTS, _with_progress),
    "test_error_handling": (_NO_ARGUMENTS, _failing),
    "test_sampling": (_PROMPTED, _sampling),
    "test_elicitation": (_MESSAGE, _eliciting(_User, "Who are you?")),
    "test_elicitation_sep1034_defaults": (_NO_ARGUMENTS, _eliciting(_Defaults, "Please provide user information")),
    "test_elicitation_sep1330_enums": (_NO_ARGUMENTS, _eliciting(_Enums, "Please choose")),
    "test_reconnection": (_NO_ARGUMENTS, _reconnecting),
    "json_schema_2020_12_tool": (_RICH_SCHEMA, _constant(_TEXT)),
    "test_custom_headers": (_HEADER_SCHEMA, _constant(_TEXT)),
    "test_input_required_result_elicitation": (_NO_ARGUMENTS, _use_name),
    "test_input_required_result_sampling": (_NO_ARGUMENTS, _use_capital),
    "test_input_required_result_list_roots": (_NO_ARGUMENTS, _use_roots),
    "test_input_required_result_request_state": (_NO_ARGUMENTS, _state_kept),
    "test_input_required_result_tampered_state": (_NO_ARGUMENTS, _state_kept),
    "test_input_required_result_multiple_inputs": (_NO_ARGUMENTS, _use_several),
    "test_input_required_result_multi_round": (_NO_ARGUMENTS, _rounds),
    "test_input_required_result_capabilities": (_NO_ARGUMENTS, _only_declared),
    "test_missing_capability": (_NO_ARGUMENTS, _needs_sampling),
    "test_streaming_elicitation": (_NO_ARGUMENTS, _use_name),
    "test_trigger_tool_change": (_NO_ARGUMENTS, _tools_changed),
    "test_trigger_prompt_change": (_NO_ARGUMENTS, _prompts_changed),
    "test_tool_with_task": (_NO_ARGUMENTS, _use_name),
}
_RESOURCES = {
    "test://static-text": ("text/plain", "This is the content of the static text resource."),
    "test://static-binary": ("image/png", ""),
    "test://watched-resource": ("text/plain", "Watched resource content"),
}
_TEMPLATE = ResourceTemplate(
    uri_template="test://template/{id}/data", name="template", description="fixture", mime_type="application/json"
)


def _message(content: Any) -> PromptMessage:
    return PromptMessage(role="user", content=content)


def _prompt_messages(name: str, given: Mapping[str, str]) -> list[PromptMessage] | None:
    if name == "test_simple_prompt":
        return [_message(TextContent(type="text", text="This is a simple prompt for testing."))]
    if name == "test_prompt_with_arguments":
        text = f"Prompt with arguments: arg1='{given.get('arg1', '')}', arg2='{given.get('arg2', '')}'"
        return [_message(TextContent(type="text", text=text))]
    if name == "test_prompt_with_embedded_resource":
        embedded = _embedded(given.get("resourceUri", ""), "text/plain", "Embedded resource content for testing.")
        text = "Please process the embedded resource above."
        return [_message(embedded), _message(TextContent(type="text", text=text))]
    if name == "test_prompt_with_image":
        return [_message(_IMAGE), _message(TextContent(type="text", text="Please analyze the image above."))]
    return None


_PROMPTS = {
    "test_simple_prompt": (),
    "test_prompt_with_arguments": ("arg1", "arg2"),
    "test_prompt_with_embedded_resource": ("resourceUri",),
    "test_prompt_with_image": (),
    "test_input_required_result_prompt": (),
}


async def _ask_then_begin(
    context: ServerRequestContext[Any], request: CallToolRequestParams, go_on: Callable[..., Awaitable[Any]]
) -> Any:
    """Ask for a name; with the answer, call the server's tool that becomes a task."""
    name = _accepted(Context(request_context=context, input_params=request), "user_name", "name")
    if not isinstance(name, str):
        return InputRequiredResult(input_requests={"user_name": _elicit("What is your name?", name="string")})
    return await go_on(context, request.model_copy(update={"name": "greet_later", "arguments": {"name": name}}))


def add_fixtures(server: Any) -> None:
    """Make the server answer fixtures by name, and everything else as before."""
    protocol, known = server.protocol, {}
    for method in (
        "tools/list",
        "tools/call",
        "resources/list",
        "resources/templates/list",
        "resources/read",
        "resources/subscribe",
        "resources/unsubscribe",
        "prompts/list",
        "prompts/get",
        "completion/complete",
    ):
        known[method] = protocol.get_request_handler(method)

    def over(method: str, parameters: type[BaseModel], answer: Callable[..., Awaitable[Any]]) -> None:
        async def handle(context: ServerRequestContext[Any], request: Any) -> Any:
            found = await answer(context, request)
            return await known[method].handler(context, request) if found is None else found

        protocol.add_request_handler(method, parameters, handle)

    def joined(method: str, field: str, more: list[Any]) -> None:
        before = known[method]

        async def handle(context: ServerRequestContext[Any], request: Any) -> Any:
            own = await before.handler(context, request)
            return own.model_copy(update={field: [*getattr(own, field), *more]})

        protocol.add_request_handler(method, before.params_type, handle)

    async def call(context: ServerRequestContext[Any], request: CallToolRequestParams) -> Any:
        if request.name == "failing_job":
            require_client_extension(context, tasks.EXTENSION)
        if request.name == "test_tool_with_task":
            return await _ask_then_begin(context, request, known["tools/call"].handler)
        if request.name not in _FIXTURES:
            return None
        inner: Context[Any, Any] = Context(
            request_context=context, mcp_server=server, input_params=request, subscriptions=server.news
        )
        try:
            return await _FIXTURES[request.name][1](inner, request.arguments or {})
        except ValueError as error:
            return _text(str(error), is_error=True)

    async def read(context: ServerRequestContext[Any], request: ReadResourceRequestParams) -> Any:
        del context
        uri = str(request.uri)
        if uri == "test://static-binary":
            return ReadResourceResult(contents=[BlobResourceContents(uri=uri, blob=PNG, mime_type="image/png")])
        if uri in _RESOURCES:
            kind, text = _RESOURCES[uri]
            return ReadResourceResult(contents=[TextResourceContents(uri=uri, text=text, mime_type=kind)])
        if uri.startswith("test://template/"):
            number = uri.split("/")[3]
            text = f'{{"id":"{number}","templateTest":true,"data":"Data for ID: {number}"}}'
            return ReadResourceResult(contents=[TextResourceContents(uri=uri, text=text, mime_type="application/json")])
        return None

    async def get_prompt(context: ServerRequestContext[Any], request: GetPromptRequestParams) -> Any:
        if request.name == "test_input_required_result_prompt":
            inner: Context[Any, Any] = Context(request_context=context, mcp_server=server, input_params=request)
            said = _accepted(inner, "user_context", "context")
            if said is None:
                question = _elicit("What context should the prompt use?", context="string")
                return InputRequiredResult(input_requests={"user_context": question})
            return GetPromptResult(messages=[_message(TextContent(type="text", text=f"Context: {said}"))])
        missing = [name for name in _PROMPTS.get(request.name, ()) if name not in (request.arguments or {})]
        if missing:
            raise MCPError(INVALID_PARAMS, f"missing: {missing}")
        messages = _prompt_messages(request.name, request.arguments or {})
        return None if messages is None else GetPromptResult(messages=messages)

    async def complete(context: ServerRequestContext[Any], request: CompleteRequestParams) -> Any:
        del context
        if isinstance(request.ref, PromptReference) and request.ref.name in _PROMPTS:
            return CompleteResult(completion=Completion(values=["paris", "park"], total=2, has_more=False))
        return None

    async def subscribe(context: ServerRequestContext[Any], request: Any) -> Any:
        del context
        return EmptyResult() if request.uri in _RESOURCES else None

    async def set_level(context: ServerRequestContext[Any], request: SetLevelRequestParams) -> EmptyResult:
        del context, request
        return EmptyResult()

    over("tools/call", CallToolRequestParams, call)
    over("resources/read", ReadResourceRequestParams, read)
    over("prompts/get", GetPromptRequestParams, get_prompt)
    over("completion/complete", CompleteRequestParams, complete)
    over("resources/subscribe", SubscribeRequestParams, subscribe)
    over("resources/unsubscribe", UnsubscribeRequestParams, subscribe)
    protocol.add_request_handler("logging/setLevel", SetLevelRequestParams, set_level)
    joined(
        "tools/list",
        "tools",
        [Tool(name=name, description="fixture", input_schema=schema) for name, (schema, _) in _FIXTURES.items()],
    )
    joined(
        "resources/list",
        "resources",
        [Resource(uri=uri, name=uri, description="fixture", mime_type=kind) for uri, (kind, _) in _RESOURCES.items()],
    )
    joined("resources/templates/list", "resource_templates", [_TEMPLATE])
    joined(
        "prompts/list",
        "prompts",
        [
            Prompt(
                name=name, description="fixture", arguments=[PromptArgument(name=one, required=True) for one in wanted]
            )
            for name, wanted in _PROMPTS.items()
        ],
    )
    protocol.get_tool_input_schema = lambda name: _FIXTURES[name][0] if name in _FIXTURES else None


def _main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=0)
    given = parser.parse_args()
    tasks.GRACE_S = _GRACE_S
    settings = Settings(warm_up=False, maps_online="offline", starter=False, http_rate=10_000.0, http_calls=256)
    server = create_server(settings, extra_tools=_SPECS)
    add_fixtures(server)
    with bound("127.0.0.1", given.port) as listener:
        anyio.run(HttpServer(server, settings).serve, listener)


if __name__ == "__main__":
    _main()
