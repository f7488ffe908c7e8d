"""Tools for models without tool support: the model selects a call by writing a JSON object that satisfies a schema.

The model sees the tools as text and must write ``{"tool": …, "arguments": {…}}`` or ``{"answer": "…"}``.
"""

import json
from collections.abc import Sequence
from typing import Any

from .interface import CallPart, Message, RequestedCall, Schema, TextPart, ToolDefinition

_HOW = (
    'Reply with one JSON object and nothing else: {"tool": NAME, "arguments": {...}} to call a tool, or '
    '{"answer": TEXT} to answer the user. The tools:'
)


def choice_schema(tools: Sequence[ToolDefinition]) -> Schema:
    """Return a schema that accepts a call to one of the tools or an answer."""
    calls = [
        {
            "type": "object",
            "properties": {"tool": {"const": tool.name}, "arguments": dict(tool.parameters)},
            "required": ["tool", "arguments"],
            "additionalProperties": False,
        }
        for tool in tools
    ]
    answer = {
        "type": "object",
        "properties": {"answer": {"type": "string"}},
        "required": ["answer"],
        "additionalProperties": False,
    }
    return {"anyOf": [*calls, answer]}


def as_plain_text(messages: Sequence[Message], tools: Sequence[ToolDefinition]) -> list[Message]:
    """Return the conversation for a model without tools: the list of tools, calls and their answers as text."""
    listed = "\n".join(f"- {_describe_tool(tool)}" for tool in tools)
    plain: list[Message] = []
    for message in messages:
        if message.role == "system":
            plain.append(Message("system", f"{message.text}\n\n{_HOW}\n{listed}"))
        elif message.role == "tool":
            plain.append(Message("user", f"Answer of {message.tool}:\n{message.text}"))
        elif message.role == "assistant":
            plain.extend(Message("assistant", text) for text in _choices(message))
        else:
            plain.append(message)
    return plain


def read_choice(text: str, call_id: str) -> CallPart | TextPart:
    """Return the call or the answer that a model wrote; if it wrote neither, return a call without arguments."""
    try:
        choice = json.loads(text)
    except ValueError:
        return CallPart(RequestedCall(call_id, "", None, text))
    if isinstance(choice, dict) and isinstance(choice.get("answer"), str):
        return TextPart(choice["answer"])
    if isinstance(choice, dict) and isinstance(choice.get("tool"), str):
        arguments = choice.get("arguments", {})
        return CallPart(
            RequestedCall(call_id, choice["tool"], arguments if isinstance(arguments, dict) else None, text)
        )
    return CallPart(RequestedCall(call_id, "", None, text))


def _choices(message: Message) -> list[str]:
    written = [_json({"answer": message.text})] if message.text else []
    written += [_json({"tool": call.tool, "arguments": dict(call.arguments or {})}) for call in message.calls]
    return written


def _describe_tool(tool: ToolDefinition) -> str:
    return f"{tool.name}: {tool.description} Arguments: {_json(tool.parameters.get('properties', {}))}"


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))
