"""The agent: a model that thinks, calls tools and reads their answers, until it answers the user.

Any failure of a model, a call or the server ends the turn with a message; the conversation continues.
"""

import json
import re
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import aclosing
from dataclasses import dataclass, field
from typing import Any, Literal

import anyio

from ..schemas.errors import closest
from ..schemas.text import quoted
from .claims import claims_work, written_call
from .connection import ToolAnswer, ToolSource, shown_to_model
from .errors import AgentError, LimitReached
from .instructions import OUT_OF_SCOPE, system_prompt
from .memory import History, SessionState, message_tokens
from .models.interface import CallPart, ChatModel, Message, ModelFacts, RequestedCall, StreamEnd, TextPart, ThinkingPart

Ending = Literal["answered", "asked", "refused", "failed", "interrupted"]
"""How a turn ended: with an answer, a question, a refusal by the model, a failure, or an interruption by the user."""
_RESERVED_SHARE = 0.25
"""Share of a model's context reserved for its answer and for differences between tokenizers (chosen)."""
_LEAST_BUDGET_TOKENS = 1000
_RUNAWAY_CHARACTERS = 8
"""Characters per allowed token of an answer, after which a server that ignores the limit is cut off (chosen)."""
_MOST_MALFORMED = 3
"""Maximum number of consecutive unreadable calls (chosen)."""
_MOST_REPEATS_REFUSED = 3
_UNFINISHED = {"running", "queued", "pending", "waiting"}
"""States of unfinished work, which may be checked repeatedly."""


@dataclass(frozen=True)
class TurnLimits:
    """The limits of a turn; ``repeats``: how often the same call may give the same answer."""

    rounds: int = 24
    tokens: int = 500_000
    turn_s: float = 1800.0
    repeats: int = 2
    answer_tokens: int = 4096
    result_characters: int = 12_000
    history_tokens: int = 125_000


@dataclass(frozen=True)
class CallStarted:
    """A call has started."""

    call: RequestedCall


@dataclass(frozen=True)
class CallProgress:
    """Progress of a call: the completed share, 0 to 1 (None if unknown), and the current activity."""

    call: RequestedCall
    share: float | None
    message: str


@dataclass(frozen=True)
class CompletedCall:
    """A call and its answer."""

    call: RequestedCall
    answer: ToolAnswer
    duration_s: float


@dataclass(frozen=True)
class Note:
    """A message to the user about the progress of the turn."""

    text: str


AgentEvent = TextPart | ThinkingPart | CallStarted | CallProgress | CompletedCall | Note
Show = Callable[[AgentEvent], None]


@dataclass(frozen=True)
class TurnResult:
    """The result of a turn.

    ``answer`` is the model's last text, ``problem`` describes a failure for the user; tokens are counted by the model's
    server, or estimated.
    """

    answer: str
    ending: Ending
    problem: str
    calls: tuple[CompletedCall, ...]
    rounds: int
    prompt_tokens: int
    completion_tokens: int
    duration_s: float


@dataclass(frozen=True)
class _Reply:
    text: str
    calls: tuple[RequestedCall, ...]
    runaway: bool


@dataclass
class _Turn:
    """A turn in progress."""

    show: Show
    started: float = field(default_factory=time.perf_counter)
    calls: list[CompletedCall] = field(default_factory=list)
    answers_of: dict[str, list[str]] = field(default_factory=dict)
    corrections: set[str] = field(default_factory=set)
    answer: str = ""
    ending: Ending = "answered"
    problem: str = ""
    rounds: int = 0
    counted_rounds: int = 0
    malformed: int = 0
    refused_repeats: int = 0
    prompt_tokens: int = 0
    completion_tokens: int = 0

    def fail(self, problem: str, ending: Ending = "failed") -> None:
        self.problem, self.ending = problem, ending

    def result(self) -> TurnResult:
        return TurnResult(
            answer=self.answer,
            ending=self.ending,
            problem=self.problem,
            calls=tuple(self.calls),
            rounds=self.rounds,
            prompt_tokens=self.prompt_tokens,
            completion_tokens=self.completion_tokens,
            duration_s=time.perf_counter() - self.started,
        )


def _ignore_event(event: AgentEvent) -> None:
    del event


class AgentSession:
    """A conversation with a model that has tools, one turn at a time.

    Args:
        instructions: A system message that replaces the agent's own, such as a prompt condition of the evaluation.
        short: True to request short answers.
    """

    def __init__(
        self,
        model: ChatModel,
        tools: ToolSource,
        limits: TurnLimits | None = None,
        *,
        instructions: str = "",
        short: bool = False,
        history: Sequence[Message] = (),
    ) -> None:
        self._model, self._tools, self._limits = model, tools, limits or TurnLimits()
        self._instructions, self._short = instructions, short
        self._history = History(history)
        self._scope: anyio.CancelScope | None = None
        self._interrupted = False
        self.state = SessionState()

    @property
    def messages(self) -> tuple[Message, ...]:
        """The conversation so far, without the system message."""
        return self._history.messages

    @property
    def history_tokens(self) -> int:
        """The cost of the conversation in o200k_base tokens."""
        return self._history.tokens

    def clear(self) -> None:
        """Start over: forget the conversation and the current ids."""
        self._history.clear()
        self.state = SessionState()

    def interrupt(self) -> None:
        """End the turn in progress, if there is one; its messages and calls are kept."""
        if self._scope is not None:
            self._interrupted = True
            self._scope.cancel()

    async def take_turn(self, text: str, show: Show = _ignore_event) -> TurnResult:
        """Fulfil the user's request; any failure is in the result, and the conversation can continue.

        Args:
            show: Receives every event as it happens.
        """
        turn = _Turn(show)
        self._history.begin_turn()
        self._history.append(Message("user", f"{text}\n\n{self.state.line}" if self.state.line else text))
        self._interrupted = False
        try:
            with anyio.move_on_after(self._limits.turn_s) as self._scope:
                await self._run_turn(turn)
            if self._interrupted:
                turn.fail("Interrupted; all work so far is kept.", "interrupted")
            elif self._scope.cancelled_caught:
                limit = f"the turn took longer than {self._limits.turn_s:g} s"
                turn.fail(LimitReached(limit).text)
        except AgentError as error:
            turn.fail(error.text)
        finally:
            self._scope = None
            self._settle(turn)
        return turn.result()

    def _settle(self, turn: _Turn) -> None:
        """Complete the history so that a model can continue: every call is answered, and the assistant speaks last."""
        messages = self._history.messages
        requested = [call for message in messages for call in message.calls]
        answered = {message.call_id for message in messages if message.role == "tool"}
        for call in requested:
            if call.call_id not in answered:
                self._history.append(_tool_message(call, "[not carried out: the turn ended before]"))
        last = self._history.messages[-1]
        if last.role != "assistant":
            self._history.append(
                Message("assistant", f"[The turn ended without an answer: {turn.problem or 'broken off'}]")
            )

    async def _run_turn(self, turn: _Turn) -> None:
        if await self._tools.ready():
            turn.show(Note("the MCP server was restarted"))
        facts = await self._model.facts()
        while True:
            if turn.counted_rounds >= self._limits.rounds:
                raise LimitReached(f"the model was called {turn.counted_rounds} times without reaching an answer")
            fitted = await self._history.fit(self._model, self._budget_tokens(facts))
            if fitted:
                turn.show(Note(fitted))
            reply = await self._ask(turn)
            if turn.prompt_tokens + turn.completion_tokens > self._limits.tokens:
                self._keep(reply.text, ())
                raise LimitReached(f"the turn took more than {self._limits.tokens:,} tokens")
            if not await self._process_reply(turn, reply):
                return

    async def _process_reply(self, turn: _Turn, reply: _Reply) -> bool:
        """Process a reply: make its calls, or ask for a correction; return False if it was the answer."""
        readable = tuple(call for call in reply.calls if call.arguments is not None)
        if reply.calls:
            unread = [call for call in reply.calls if call.arguments is None]
            self._keep(reply.text or "\n".join(call.written for call in unread)[:1000], readable)
            turn.malformed = turn.malformed + 1 if unread and not readable else 0
            unfinished = [await self._make_call(turn, call) for call in readable]
            if unread:
                self._correct_malformed(turn, unread)
            turn.counted_rounds += not (unfinished and all(unfinished))
            return True
        turn.counted_rounds += 1
        turn.malformed = 0
        wrong = self._find_fault(turn, reply)
        if wrong is None:
            self._accept_answer(turn, reply.text)
            return False
        kind, notice, correction, problem = wrong
        self._keep(reply.text or f"[{notice}]", ())
        if kind in turn.corrections:
            turn.answer = reply.text
            turn.fail(problem)
            return False
        turn.corrections.add(kind)
        turn.show(Note(f"{notice}; the model gets another try"))
        self._history.append(Message("user", correction))
        return True

    def _find_fault(self, turn: _Turn, reply: _Reply) -> tuple[str, str, str, str] | None:
        """Return the fault of a reply without calls, or None: its kind, the texts for the user and the model, and the
        error.
        """
        again = "rephrase the request, or use another model"
        if reply.runaway:
            return (
                "runaway",
                "the answer did not end and was cut",
                "[That came to no end and was cut. Do not think long: make the next call, or answer briefly.]",
                f"The model's answer did not end, twice. Next: {again}, or --think off.",
            )
        if not reply.text.strip():
            return (
                "empty",
                "the answer was empty",
                "[Your answer was empty. Make the next call, or answer the user.]",
                f"The model gave an empty answer, twice. Next: {again}.",
            )
        tool = written_call(reply.text, [tool.name for tool in self._tools.tools])
        if tool:
            return (
                "written call",
                f"a call of {tool} was only written as text",
                f"[That was text: no tool was called. Call {tool} as a tool call, not as text.]",
                f"The model only wrote the call of {tool} as text, so nothing was done. Next: {again}.",
            )
        made = any(not done.answer.is_error for done in turn.calls)
        if not made and claims_work(reply.text) and "claim" not in turn.corrections:
            return (
                "claim",
                "the answer claims work, but no tool was called",
                "[No tool was called in this turn: nothing was done. Make the call, or say that it was done before.]",
                "",
            )
        return None

    def _accept_answer(self, turn: _Turn, text: str) -> None:
        self._keep(text, ())
        turn.answer = text
        if text.lstrip("*_# ").lower().startswith(OUT_OF_SCOPE.lower()):
            turn.ending = "refused"
        elif text.rstrip("*_ \n").endswith("?") and not self._changed_something(turn):
            turn.ending = "asked"  # not an offer that follows completed work
        made = any(not done.answer.is_error for done in turn.calls)
        if not made and claims_work(text):
            problem = "The answer claims work, but no tool was called in this turn, so nothing was done."
            earlier = any(message.role == "tool" for message in self._history.messages)
            turn.problem = f"{problem} Next: repeat the request, or use another model."
            if not earlier:
                turn.ending = "failed"

    def _changed_something(self, turn: _Turn) -> bool:
        read_only = {tool.name for tool in self._tools.tools if tool.read_only}
        return any(not done.answer.is_error and done.call.tool not in read_only for done in turn.calls)

    def _correct_malformed(self, turn: _Turn, unread: Sequence[RequestedCall]) -> None:
        if turn.malformed >= _MOST_MALFORMED:
            raise LimitReached(f"the model wrote {turn.malformed} consecutive calls that are not JSON")
        names = ", ".join(call.tool for call in unread if call.tool) or "a tool"
        turn.show(Note(f"a call of {names} could not be read; the model gets another try"))
        correction = f"[The call of {names} was not made: its arguments are not a JSON object. Make the call again.]"
        self._history.append(Message("user", correction))

    async def _ask(self, turn: _Turn) -> _Reply:
        """Request the model's next message."""
        prompt = Message("system", system_prompt(self._tools.instructions, short=self._short, given=self._instructions))
        messages = [prompt, *self._history.messages]
        think = False if "runaway" in turn.corrections else None
        texts: list[str] = []
        calls: list[RequestedCall] = []
        characters, most_characters = 0, self._limits.answer_tokens * _RUNAWAY_CHARACTERS
        end: StreamEnd | None = None
        turn.rounds += 1
        try:
            async with aclosing(self._model.stream(messages, self._tools.tools, think=think)) as events:
                async for event in events:
                    if isinstance(event, CallPart):
                        calls.append(event.call)
                    elif isinstance(event, StreamEnd):
                        end = event
                    else:
                        turn.show(event)
                        characters += len(event.text)
                        texts += [event.text] if isinstance(event, TextPart) else []
                    if characters > most_characters:
                        break
        except BaseException:
            if texts:
                self._keep(f"{''.join(texts)} [broken off]", ())
            raise
        text = "".join(texts)
        self._count(turn, messages, text, end)
        numbered = tuple(self._normalise_call(call, number) for number, call in enumerate(calls))
        cut = characters > most_characters or (end is not None and end.cut)
        return _Reply(text, numbered, runaway=cut and not calls)

    def _normalise_call(self, call: RequestedCall, number: int) -> RequestedCall:
        """Return the call with an id that is unique in the conversation, and without any prefix to the tool's name.

        Some models were trained to write ``functions.render`` for ``render``; the tool is unambiguous.
        """
        call_id = f"{call.call_id}_{len(self._history.messages)}_{number}"
        last = re.split(r"[.:/]", call.tool)[-1]
        tool = last if last in {tool.name for tool in self._tools.tools} else call.tool
        return RequestedCall(call_id, tool, call.arguments, call.written)

    def _count(self, turn: _Turn, messages: Sequence[Message], text: str, end: StreamEnd | None) -> None:
        counted = end.prompt_tokens if end else None
        if counted is None:
            counted = sum(message_tokens(message) for message in messages)
        written = end.completion_tokens if end else None
        turn.prompt_tokens += counted
        turn.completion_tokens += message_tokens(Message("assistant", text)) if written is None else written

    def _keep(self, text: str, calls: tuple[RequestedCall, ...]) -> None:
        self._history.append(Message("assistant", text, calls))

    def _budget_tokens(self, facts: ModelFacts) -> int:
        """Return the history's token budget: as set, or what the system message, tools and answer leave free."""
        if facts.context_tokens is None:
            return self._limits.history_tokens
        prompt = system_prompt(self._tools.instructions, short=self._short, given=self._instructions)
        fixed = message_tokens(Message("system", prompt + json.dumps([_plain(tool) for tool in self._tools.tools])))
        left = int(facts.context_tokens * (1 - _RESERVED_SHARE)) - fixed
        return min(self._limits.history_tokens, max(left, _LEAST_BUDGET_TOKENS))

    async def _make_call(self, turn: _Turn, call: RequestedCall) -> bool:
        """Make a call and keep its answer; return True if the work is unfinished."""
        arguments = dict(call.arguments or {})
        known = [tool.name for tool in self._tools.tools]
        key = f"{call.tool} {json.dumps(arguments, sort_keys=True, ensure_ascii=False)}"
        before = turn.answers_of.setdefault(key, [])
        repeated = len(before) >= self._limits.repeats and len(set(before[-self._limits.repeats :])) == 1
        turn.show(CallStarted(call))
        started = time.perf_counter()
        if call.tool not in known:
            near = ", ".join(closest(call.tool, known)[:5])
            notice = f"There is no tool {quoted(call.tool)}. Nearest: {near}. Next: call an existing tool."
            answer = ToolAnswer(notice, {}, is_error=True)
        elif repeated:
            turn.refused_repeats += 1
            notice = (
                f"This call was made {len(before)} times with the same answer and is not repeated. Next: use the "
                "answer, or call with other arguments."
            )
            answer = ToolAnswer(notice, {}, is_error=True)
        else:
            answer = await self._tools.call(
                call.tool, arguments, lambda share, message: turn.show(CallProgress(call, share, message))
            )
        unfinished = not answer.is_error and answer.structured.get("state") in _UNFINISHED
        if not unfinished and not repeated:
            before.append(answer.text)
        self._history.append(_tool_message(call, shown_to_model(answer, self._limits.result_characters)))
        done = CompletedCall(call, answer, time.perf_counter() - started)
        turn.calls.append(done)
        turn.show(done)
        if not answer.is_error:
            self.state = self.state.after(answer.structured)
        if turn.refused_repeats >= _MOST_REPEATS_REFUSED:
            raise LimitReached(f"the model keeps repeating the same call: {key[:200]}")
        return unfinished


def _tool_message(call: RequestedCall, text: str) -> Message:
    return Message("tool", text, call_id=call.call_id, tool=call.tool)


def _plain(tool: Any) -> Mapping[str, Any]:
    return {"name": tool.name, "description": tool.description, "parameters": dict(tool.parameters)}
