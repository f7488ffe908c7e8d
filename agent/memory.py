"""What an agent keeps of a conversation: its messages within a budget of tokens, and what is being worked on."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from ..server.tokens import count_tokens
from .errors import ModelFailure
from .models.interface import ChatModel, Message, RequestedCall, TextPart

_MESSAGE_OVERHEAD = 6
"""Tokens of the marks around a message; chosen, chat templates have 4 to 8."""
_SUMMARISED_CHARACTERS, _LEAST_SUMMARISED_CHARACTERS = 3000, 200
"""Of each message that is summarised, at most and at least; chosen: the ids and figures of an answer come first."""
_CHARACTERS_PER_TOKEN = 3
"""Of text with ids and figures; chosen, o200k_base has about 3.3."""
_SHORTENED_CHARACTERS = 400
"""That are kept of an answer that has to make room; chosen."""
_SUMMARISE = (
    "Summarise the conversation below for yourself, in at most 300 words: what the user wants, what was made (with all "
    "ids exactly as written), the figures that matter, what was refused, what is still open. Write the summary only."
)
SUMMARY_MARK = "[Summary of the conversation so far]"
LEFT_OUT_MARK = "[Earlier messages were left out for want of room]"


@dataclass(frozen=True)
class SessionState:
    """The ids that are being worked on, by what they are; empty where there is none yet."""

    scenario: str = ""
    configuration: str = ""
    search: str = ""
    batch: str = ""
    run: str = ""
    job: str = ""

    def after(self, structured: Mapping[str, Any]) -> "SessionState":
        """The state after an answer of a tool, from the ids in its structure."""
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
        """The state in a line for the model; empty where nothing is known yet."""
        known = {field.name: getattr(self, field.name) for field in fields(self)}
        told = ", ".join(f"{name} {value}" for name, value in known.items() if value)
        return f"[Being worked on: {told}]" if told else ""


def _first_of(items: Any, key: str) -> Any:
    first = items[0] if isinstance(items, list) and items else None
    return first.get(key) if isinstance(first, Mapping) else None


class History:
    """The messages of a conversation behind its system message, and what each costs in tokens."""

    def __init__(self, messages: Sequence[Message] = ()) -> None:
        self._messages: list[Message] = []
        self._tokens: list[int] = []
        self._turn_start = 0
        for message in messages:
            self.append(message)

    @property
    def messages(self) -> tuple[Message, ...]:
        """All messages, the oldest first."""
        return tuple(self._messages)

    @property
    def tokens(self) -> int:
        """What the messages cost together, in o200k_base tokens."""
        return sum(self._tokens)

    def begin_turn(self) -> None:
        """From here on, messages belong to the user's new turn, which is never summarised before it ends."""
        self._turn_start = len(self._messages)

    def append(self, message: Message) -> None:
        """Add a message."""
        self._messages.append(message)
        self._tokens.append(message_tokens(message))

    def clear(self) -> None:
        """Forget all."""
        self._messages, self._tokens, self._turn_start = [], [], 0

    async def fit(self, model: ChatModel, budget_tokens: int) -> str:
        """Make the messages fit a budget; returns what was done, in a sentence for the user, or nothing.

        What was before the turn is summarised by the model; where it cannot, it is left out. Where the turn alone is
        too long, its older answers of tools are shortened.
        """
        done = []
        if self.tokens > budget_tokens and self._turn_start:
            before, turn = self._messages[: self._turn_start], self._messages[self._turn_start :]
            old_tokens = self.tokens
            try:
                summary = f"{SUMMARY_MARK}\n{await _summary(model, before, budget_tokens)}"
                what = "summarised"
            except ModelFailure:
                summary, what = LEFT_OUT_MARK, "left out, since the model gave no summary"
            kept = [Message("user", summary), Message("assistant", "Understood.")]
            self._replace([*kept, *turn], turn_start=len(kept))
            done.append(f"the conversation before was {what} ({old_tokens:,} tokens became {self.tokens:,})")
        if self.tokens > budget_tokens:
            shortened = self._shorten_answers(budget_tokens)
            done += [f"{shortened} older answers of tools were shortened to make room"] if shortened else []
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
    """What a message costs, in o200k_base tokens, the marks around it included (an estimate for other tokenizers)."""
    calls = "".join(
        f"{call.tool}{json.dumps(dict(call.arguments or {}), ensure_ascii=False)}" for call in message.calls
    )
    return count_tokens(message.text + calls) + _MESSAGE_OVERHEAD


async def _summary(model: ChatModel, messages: Sequence[Message], budget_tokens: int) -> str:
    """What the model says of the messages, of each of which it is shown so much that all fit the budget."""
    share = budget_tokens * _CHARACTERS_PER_TOKEN // len(messages)
    longest = max(_LEAST_SUMMARISED_CHARACTERS, min(_SUMMARISED_CHARACTERS, share))
    told = "\n".join(_told(message, longest) for message in messages)
    asked = [Message("system", _SUMMARISE), Message("user", told)]
    parts = [event.text async for event in model.stream(asked, think=False) if isinstance(event, TextPart)]
    summary = "".join(parts).strip()
    if not summary:
        raise ModelFailure("the model gave no summary")
    return summary


def _told(message: Message, longest: int) -> str:
    calls = "".join(f" [calls {_called(call)}]" for call in message.calls)
    speaker = f"answer of {message.tool}" if message.role == "tool" else message.role
    return f"{speaker}: {message.text[:longest]}{calls}"


def _called(call: RequestedCall) -> str:
    return f"{call.tool} {json.dumps(dict(call.arguments or {}), ensure_ascii=False)}"


def as_json(message: Message) -> str:
    """A message as a line of JSON, for a file."""
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
    """The message of such a line.

    Raises:
        ValueError: it is none.
    """
    try:
        record = json.loads(line)
        calls = tuple(
            RequestedCall(call["call_id"], call["tool"], dict(call["arguments"])) for call in record.get("calls", ())
        )
        return Message(record["role"], record["text"], calls, record.get("call_id", ""), record.get("tool", ""))
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"no message: {error!r}") from error
