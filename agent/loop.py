"""The agent: a model that thinks, calls tools and looks at what comes back, until it answers.

Whatever goes wrong with a model, a call or the server ends the turn in words; the conversation goes on.
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
"""How a turn ended: with an answer, a question back, a refusal of the model's own, broken off, or by the user."""
_RESERVED_SHARE = 0.25
"""Of a model's context, kept free for its answer and for what tokenizers count otherwise; chosen."""
_LEAST_BUDGET_TOKENS = 1000
_RUNAWAY_CHARACTERS = 8
"""For each token that an answer may have: a server that does not keep to the bound is left there; chosen."""
_MOST_MALFORMED = 3
"""Calls that cannot be read, one after the other; chosen."""
_MOST_REPEATS_REFUSED = 3
_UNFINISHED = {"running", "queued", "pending", "waiting"}
"""States of work that goes on: to look at it again and again is right."""


@dataclass(frozen=True)
class TurnLimits:
    """What a turn may take; ``repeats``: how often the same call may give the same answer."""

    rounds: int = 24
    tokens: int = 500_000
    turn_s: float = 1800.0
    repeats: int = 2
    answer_tokens: int = 4096
    result_characters: int = 12_000
    history_tokens: int = 125_000


@dataclass(frozen=True)
class CallStarted:
    """A call is being made."""

    call: RequestedCall


@dataclass(frozen=True)
class CallProgress:
    """How far a call is: the share that is done, 0 to 1 (None: unknown), and what is being done."""

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
    """Something that the user should know of how the turn goes."""

    text: str


AgentEvent = TextPart | ThinkingPart | CallStarted | CallProgress | CompletedCall | Note
Show = Callable[[AgentEvent], None]


@dataclass(frozen=True)
class TurnResult:
    """What came of a turn.

    ``answer`` is the last text of the model, ``problem`` what went wrong in words for the user; tokens as the model's
    server counted them, or estimated where it does not.
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


def _unseen(event: AgentEvent) -> None:
    del event


class AgentSession:
    """A conversation with a model that has tools; one turn at a time.

    Args:
        instructions: the system message in place of the agent's own, such as a prompt condition of the evaluation.
        short: ask for short answers.
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
        """What the conversation costs, in o200k_base tokens."""
        return self._history.tokens

    def clear(self) -> None:
        """Begin anew: forget the conversation and what was being worked on."""
        self._history.clear()
        self.state = SessionState()

    def interrupt(self) -> None:
        """End the turn in progress, if there is one; what was said and called in it is kept."""
        if self._scope is not None:
            self._interrupted = True
            self._scope.cancel()

    async def take_turn(self, text: str, show: Show = _unseen) -> TurnResult:
        """Carry out what the user says; whatever goes wrong is in the result, and the conversation can go on.

        Args:
            show: is told of everything as it happens.
        """
        turn = _Turn(show)
        self._history.begin_turn()
        self._history.append(Message("user", f"{text}\n\n{self.state.line}" if self.state.line else text))
        self._interrupted = False
        try:
            with anyio.move_on_after(self._limits.turn_s) as self._scope:
                await self._carry_out(turn)
            if self._interrupted:
                turn.fail("Interrupted; what was done so far is kept.", "interrupted")
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
        """Leave the history such that a model can go on from it: every call answered, the last word the assistant's."""
        messages = self._history.messages
        asked = [call for message in messages for call in message.calls]
        answered = {message.call_id for message in messages if message.role == "tool"}
        for call in asked:
            if call.call_id not in answered:
                self._history.append(_tool_message(call, "[not carried out: the turn ended before]"))
        last = self._history.messages[-1]
        if last.role != "assistant":
            self._history.append(
                Message("assistant", f"[The turn ended without an answer: {turn.problem or 'broken off'}]")
            )

    async def _carry_out(self, turn: _Turn) -> None:
        if await self._tools.ready():
            turn.show(Note("the MCP server was started again"))
        facts = await self._model.facts()
        while True:
            if turn.counted_rounds >= self._limits.rounds:
                raise LimitReached(f"the model was asked {turn.counted_rounds} times without an answer to the end")
            fitted = await self._history.fit(self._model, self._budget_tokens(facts))
            if fitted:
                turn.show(Note(fitted))
            reply = await self._ask(turn)
            if turn.prompt_tokens + turn.completion_tokens > self._limits.tokens:
                self._keep(reply.text, ())
                raise LimitReached(f"the turn took more than {self._limits.tokens:,} tokens")
            if not await self._went_on(turn, reply):
                return

    async def _went_on(self, turn: _Turn, reply: _Reply) -> bool:
        """Take a reply: make its calls, or ask for what is wrong with it; False where it was the answer."""
        readable = tuple(call for call in reply.calls if call.arguments is not None)
        if reply.calls:
            unread = [call for call in reply.calls if call.arguments is None]
            self._keep(reply.text or "\n".join(call.written for call in unread)[:1000], readable)
            turn.malformed = turn.malformed + 1 if unread and not readable else 0
            unfinished = [await self._called(turn, call) for call in readable]
            if unread:
                self._correct_malformed(turn, unread)
            turn.counted_rounds += not (unfinished and all(unfinished))
            return True
        turn.counted_rounds += 1
        turn.malformed = 0
        wrong = self._what_is_wrong(turn, reply)
        if wrong is None:
            self._answered(turn, reply.text)
            return False
        kind, told, asked, problem = wrong
        self._keep(reply.text or f"[{told}]", ())
        if kind in turn.corrections:
            turn.answer = reply.text
            turn.fail(problem)
            return False
        turn.corrections.add(kind)
        turn.show(Note(f"{told}; the model is asked once more"))
        self._history.append(Message("user", asked))
        return True

    def _what_is_wrong(self, turn: _Turn, reply: _Reply) -> tuple[str, str, str, str] | None:
        """Of a reply without calls: kind of fault, what user and model are told, how it ends if it stays; or None."""
        again = "say it in other words, or take another model"
        if reply.runaway:
            return (
                "runaway",
                "the answer came to no end and was left",
                "[That came to no end and was cut. Do not think long: make the next call, or answer briefly.]",
                f"The model came to no end, twice. Next: {again}, or --think off.",
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
                f"a call of {tool} was written as text and not made",
                f"[That was text: no tool was called. Call {tool} as a tool call, not as text.]",
                f"The model writes the call of {tool} as text and does not make it: nothing was done. Next: {again}.",
            )
        made = any(not done.answer.is_error for done in turn.calls)
        if not made and claims_work(reply.text) and "claim" not in turn.corrections:
            return (
                "claim",
                "the answer says that something was done, but no tool was called",
                "[No tool was called in this turn: nothing was done. Make the call, or say that it was done before.]",
                "",
            )
        return None

    def _answered(self, turn: _Turn, text: str) -> None:
        self._keep(text, ())
        turn.answer = text
        if text.lstrip("*_# ").lower().startswith(OUT_OF_SCOPE.lower()):
            turn.ending = "refused"
        elif text.rstrip("*_ \n").endswith("?") and not self._changed_something(turn):
            turn.ending = "asked"  # and not the offer that follows upon work that is done
        made = any(not done.answer.is_error for done in turn.calls)
        if not made and claims_work(text):
            problem = "The answer says that something was done, but no tool was called in this turn: nothing was done."
            earlier = any(message.role == "tool" for message in self._history.messages)
            turn.problem = f"{problem} Next: ask for it again, or take another model."
            if not earlier:
                turn.ending = "failed"

    def _changed_something(self, turn: _Turn) -> bool:
        read_only = {tool.name for tool in self._tools.tools if tool.read_only}
        return any(not done.answer.is_error and done.call.tool not in read_only for done in turn.calls)

    def _correct_malformed(self, turn: _Turn, unread: Sequence[RequestedCall]) -> None:
        if turn.malformed >= _MOST_MALFORMED:
            raise LimitReached(f"the model wrote {turn.malformed} calls one after the other that are no JSON")
        names = ", ".join(call.tool for call in unread if call.tool) or "a tool"
        turn.show(Note(f"a call of {names} could not be read; the model is asked to write it again"))
        asked = f"[The call of {names} was not made: its arguments are no JSON object. Make the call again.]"
        self._history.append(Message("user", asked))

    async def _ask(self, turn: _Turn) -> _Reply:
        """Ask the model for its next message."""
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
        numbered = tuple(self._own(call, number) for number, call in enumerate(calls))
        cut = characters > most_characters or (end is not None and end.cut)
        return _Reply(text, numbered, runaway=cut and not calls)

    def _own(self, call: RequestedCall, number: int) -> RequestedCall:
        """The call with an id that no other of the conversation has, and without what stands before a tool's name.

        Models write ``functions.render`` for ``render``, as some were taught: no other tool can be meant.
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
        """What the history may cost: the setting, or what system message, tools and the answer leave of the context."""
        if facts.context_tokens is None:
            return self._limits.history_tokens
        prompt = system_prompt(self._tools.instructions, short=self._short, given=self._instructions)
        fixed = message_tokens(Message("system", prompt + json.dumps([_plain(tool) for tool in self._tools.tools])))
        left = int(facts.context_tokens * (1 - _RESERVED_SHARE)) - fixed
        return min(self._limits.history_tokens, max(left, _LEAST_BUDGET_TOKENS))

    async def _called(self, turn: _Turn, call: RequestedCall) -> bool:
        """Make a call and keep its answer; returns whether the answer is that work goes on."""
        arguments = dict(call.arguments or {})
        known = [tool.name for tool in self._tools.tools]
        key = f"{call.tool} {json.dumps(arguments, sort_keys=True, ensure_ascii=False)}"
        before = turn.answers_of.setdefault(key, [])
        repeated = len(before) >= self._limits.repeats and len(set(before[-self._limits.repeats :])) == 1
        turn.show(CallStarted(call))
        started = time.perf_counter()
        if call.tool not in known:
            near = ", ".join(closest(call.tool, known)[:5])
            told = f"There is no tool {quoted(call.tool)}. The nearest: {near}. Next: call a tool that there is."
            answer = ToolAnswer(told, {}, is_error=True)
        elif repeated:
            turn.refused_repeats += 1
            told = (
                f"This call was made {len(before)} times with the same answer and is not made again. Next: use the "
                "answer, or call with other arguments."
            )
            answer = ToolAnswer(told, {}, is_error=True)
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
            raise LimitReached(f"the model makes the same call again and again: {key[:200]}")
        return unfinished


def _tool_message(call: RequestedCall, text: str) -> Message:
    return Message("tool", text, call_id=call.call_id, tool=call.tool)


def _plain(tool: Any) -> Mapping[str, Any]:
    return {"name": tool.name, "description": tool.description, "parameters": dict(tool.parameters)}
