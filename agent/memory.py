"""The agent's memory of a conversation: its messages within a token budget, and the current ids."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from ..server.tokens import count_tokens
from .errors import ModelFailure
from .models.interface import ChatModel, Message, RequestedCall, TextPart

_MESSAGE_OVERHEAD = 6
"""Tokens of the marks around a message (chosen: chat templates have 4 to 8)."""
_SUMMARISED_CHARACTERS, _LEAST_SUMMARISED_CHARACTERS = 3000, 200
"""Maximum and minimum characters of each summarised message (chosen: ids and figures come first in an answer)."""
_CHARACTERS_PER_TOKEN = 3
"""Characters per token of text with ids and figures (chosen: o200k_base has about 3.3)."""
_SHORTENED_CHARACTERS = 400
"""Characters of a shortened answer (chosen)."""
_SUMMARISE = (
    "Summarise the conversation below for yourself, in at most 300 words: what the user wants, what was made (with all "
    "ids exactly as written), the figures that matter, what was refused, what is still open. Write the summary only."
)
SUMMARY_MARK = "[Summary of the conversation so far]"
LEFT_OUT_MARK = "[Earlier messages were left out for want of room]"


@dataclass(frozen=True)
class SessionState:
    """The current ids by kind; empty if there is no artifact yet."""

    scenario: str = ""
    configuration: str = ""
    search: str = ""
    batch: str = ""
    run: str = ""
    job: str = ""

    def after(self, structured: Mapping[str, Any]) -> "SessionState":
        """Return the state after a tool's answer, from the ids in its structure."""
        found = {
            "scenario": structured.get("scenario_id") or _first_of(structured.get("scenarios"), "scenario_id"),
            "configuration": structured.get("config_id"),
            "search": structured.get("search_id"),
            "batch": structured.get("batch_id"),
            "run": _first_of(structured.get("runs"), "run_id") if structured.get("total") == 1 else None,
            "job": structured.get("job_id"),
        }
        return replace(self, **{name: value for name, value in found.items() if isinstance(value, str) and value})

    @property
    def line(self) -> str:
        """The state in one line for the model; empty if nothing is known yet."""
        known = {field.name: getattr(self, field.name) for field in fields(self)}
        known_text = ", ".join(f"{name} {value}" for name, value in known.items() if value)
        return f"[Working on: {known_text}]" if known_text else ""


def _first_of(items: Any, key: str) -> Any:
    first = items[0] if isinstance(items, list) and items else None
    return first.get(key) if isinstance(first, Mapping) else None


class History:
    """The messages of a conversation after its system message, and the token cost of each."""

    def __init__(self, messages: Sequence[Message] = ()) -> None:
        self._messages: list[Message] = []
        self._tokens: list[int] = []
        self._turn_start = 0
        for message in messages:
            self.append(message)

    @property
    def messages(self) -> tuple[Message, ...]:
        """All messages, oldest first."""
        return tuple(self._messages)

    @property
    def tokens(self) -> int:
        """The total cost of the messages in o200k_base tokens."""
        return sum(self._tokens)

    def begin_turn(self) -> None:
        """Start the user's new turn; its messages are never summarised before it ends."""
        self._turn_start = len(self._messages)

    def append(self, message: Message) -> None:
        """Add a message."""
        self._messages.append(message)
        self._tokens.append(message_tokens(message))

    def clear(self) -> None:
        """Forget all messages."""
        self._messages, self._tokens, self._turn_start = [], [], 0

    async def fit(self, model: ChatModel, budget_tokens: int) -> str:
        """Make the messages fit a budget; return a sentence for the user on what was done, or an empty string.

        The model summarises what precedes the turn; if it cannot, that part is dropped. If the turn alone is too long,
        its older tool answers are shortened.
        """
        done = []
        if self.tokens > budget_tokens and self._turn_start:
            before, turn = self._messages[: self._turn_start], self._messages[self._turn_start :]
            old_tokens = self.tokens
            try:
                summary = f"{SUMMARY_MARK}\n{await _summary(model, before, budget_tokens)}"
                what = "summarised"
            except ModelFailure:
                summary, what = LEFT_OUT_MARK, "dropped, since the model gave no summary"
            kept = [Message("user", summary), Message("assistant", "Understood.")]
            self._replace([*kept, *turn], turn_start=len(kept))
            done.append(f"the earlier conversation was {what} ({old_tokens:,} tokens became {self.tokens:,})")
        if self.tokens > budget_tokens:
            shortened = self._shorten_answers(budget_tokens)
            done += [f"{shortened} older tool answers were shortened to save space"] if shortened else []
        return "; ".join(done)

    def _replace(self, messages: Sequence[Message], *, turn_start: int) -> None:
        self._messages = list(messages)
        self._tokens = [message_tokens(message) for message in messages]
        self._turn_start = turn_start

    def _shorten_answers(self, budget_tokens: int) -> int:
        shortened = 0
        for number, message in enumerate(self._messages[:-1]):
            if self.tokens <= budget_tokens:
                break
            if message.role == "tool" and len(message.text) > _SHORTENED_CHARACTERS + 100:
                text = f"{message.text[:_SHORTENED_CHARACTERS]}\n[shortened to make room; call again to see it whole]"
                self._messages[number] = replace(message, text=text)
                self._tokens[number] = message_tokens(self._messages[number])
                shortened += 1
        return shortened


def message_tokens(message: Message) -> int:
    """Return the cost of a message in o200k_base tokens, including its marks (an estimate for other tokenizers)."""
    calls = "".join(
        f"{call.tool}{json.dumps(dict(call.arguments or {}), ensure_ascii=False)}" for call in message.calls
    )
    return count_tokens(message.text + calls) + _MESSAGE_OVERHEAD


async def _summary(model: ChatModel, messages: Sequence[Message], budget_tokens: int) -> str:
    """Return the model's summary of the messages, each cut so that all fit the budget."""
    share = budget_tokens * _CHARACTERS_PER_TOKEN // len(messages)
    longest = max(_LEAST_SUMMARISED_CHARACTERS, min(_SUMMARISED_CHARACTERS, share))
    known_text = "\n".join(_transcript_line(message, longest) for message in messages)
    prompt = [Message("system", _SUMMARISE), Message("user", known_text)]
    parts = [event.text async for event in model.stream(prompt, think=False) if isinstance(event, TextPart)]
    summary = "".join(parts).strip()
    if not summary:
        raise ModelFailure("the model gave no summary")
    return summary


def _transcript_line(message: Message, longest: int) -> str:
    calls = "".join(f" [calls {_format_call(call)}]" for call in message.calls)
    speaker = f"answer of {message.tool}" if message.role == "tool" else message.role
    return f"{speaker}: {message.text[:longest]}{calls}"


def _format_call(call: RequestedCall) -> str:
    return f"{call.tool} {json.dumps(dict(call.arguments or {}), ensure_ascii=False)}"


def as_json(message: Message) -> str:
    """Return a message as a line of JSON for a file."""
    record: dict[str, Any] = {"role": message.role, "text": message.text}
    if message.calls:
        record["calls"] = [
            {"call_id": call.call_id, "tool": call.tool, "arguments": dict(call.arguments or {})}
            for call in message.calls
        ]
    if message.role == "tool":
        record |= {"call_id": message.call_id, "tool": message.tool}
    return json.dumps(record, ensure_ascii=False)


def from_json(line: str) -> Message:
    """Return the message in a line that :func:`as_json` wrote.

    Raises:
        ValueError: The line is not a message.
    """
    try:
        record = json.loads(line)
        calls = tuple(
            RequestedCall(call["call_id"], call["tool"], dict(call["arguments"])) for call in record.get("calls", ())
        )
        return Message(record["role"], record["text"], calls, record.get("call_id", ""), record.get("tool", ""))
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"not a message: {error!r}") from error
