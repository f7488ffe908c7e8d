"""Language models under evaluation: the reference agent with the prompt of a condition, on one request at a time."""

from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Any

from ..agent.connection import OnProgress, ToolAnswer, ToolSource
from ..agent.loop import AgentSession, TurnResult
from ..agent.models.interface import ChatModel, Message, ToolDefinition
from ..agent.models.registry import open_model
from ..agent.settings import AgentSettings
from ..prompts.composition import system_prompt
from .attempts import Attempt, Condition, Ending, EvalRequest, MadeCall, ToolSession
from .connection import ServerSession


class ModelAgent:
    """An ``EvaluatedAgent`` over a chat model; conversations continue over their turns."""

    def __init__(self, name: str, settings: AgentSettings, condition: Condition) -> None:
        self.name = name
        self._settings, self._condition = settings, condition

    async def attempt(self, request: EvalRequest, tools: ToolSession) -> Attempt:
        """Let the model handle the request; see ``EvaluatedAgent``.

        Raises:
            ModelFailure: the model's server is gone, so that the attempt would not measure the model.
        """
        source = _Recording(tools)
        await _configure(request, tools)
        async with self._opened() as model:
            results = await self._converse(model, request, source)
        if results[-1].ending == "failed" and not results[-1].completion_tokens:
            async with self._opened():
                pass
        return _attempt(request, source.calls, results)

    @asynccontextmanager
    async def _opened(self) -> AsyncIterator[ChatModel]:
        """Open the model after checking that its server is available."""
        model = open_model(self.name, self._settings.for_model())
        try:
            await model.facts()
            yield model
        finally:
            await model.close()

    async def _converse(self, model: ChatModel, request: EvalRequest, source: "_Recording") -> list[TurnResult]:
        facts = await model.facts()
        session = AgentSession(
            model,
            source,
            self._settings.for_turns(facts),
            instructions=system_prompt("session" if request.turns else request.task, self._condition),
            short=bool(self._settings.small(facts)),
            history=[Message("user" if role == "user" else "assistant", text) for role, text in request.history],
        )
        results = []
        for number, text in enumerate(_user_messages(request)):
            source.turn = number
            results.append(await session.take_turn(text))
        return results


def model_agent(name: str, condition: Condition, seed: int) -> ModelAgent:
    """Return the agent of ``ollama:MODEL`` or ``openai:MODEL@URL``, with the settings of ``PLANNERFORGE_AGENT_…``.

    Raises:
        SettingsFault: the name has neither of these forms, or its package is missing.
    """
    settings = AgentSettings(seed=seed)
    open_model(name, settings.for_model())
    return ModelAgent(name, settings, condition)


class _Recording(ToolSource):
    """The session's tools for the agent's loop; records all calls."""

    def __init__(self, tools: ToolSession) -> None:
        self._tools = tools
        self.calls: list[MadeCall] = []
        self.turn = 0

    @property
    def tools(self) -> tuple[ToolDefinition, ...]:
        return self._tools.connection.tools if isinstance(self._tools, ServerSession) else ()

    @property
    def instructions(self) -> str:
        return self._tools.connection.instructions if isinstance(self._tools, ServerSession) else ""

    async def ready(self) -> bool:
        return False

    async def call(self, tool: str, arguments: Mapping[str, Any], on_progress: OnProgress) -> ToolAnswer:
        del on_progress
        made = await self._tools.call(tool, arguments, self.turn)
        self.calls.append(made)
        return ToolAnswer(made.text, made.structured, made.is_error)


async def _configure(request: EvalRequest, tools: ToolSession) -> None:
    """Set the configuration from which a tuning request starts; this is not a call of the agent."""
    context = request.context
    if "planner" not in context:
        return
    base = {"base": f"{context['planner']}:{context.get('preset') or 'Default'}"}
    weights = {**context.get("weights", {}), **context.get("overrides", {})}
    await tools.call("configure_planner", {**base, "weights": [f"{name}={value}" for name, value in weights.items()]})


def _user_messages(request: EvalRequest) -> list[str]:
    """Return the user's messages: those of the turns, or the request's text and its scenario."""
    if request.turns:
        return [turn.text for turn in request.turns]
    about = (request.scenario or "").removesuffix(".xml")
    return [f"{request.text}\n\nCurrent scenario: {about}" if about else request.text]


def _attempt(request: EvalRequest, calls: list[MadeCall], results: list[TurnResult]) -> Attempt:
    last = results[-1]
    ending: Ending = "failed" if last.ending == "interrupted" else last.ending
    return Attempt(
        request_id=request.request_id,
        calls=tuple(calls),
        answers=tuple(result.answer for result in results),
        ending=ending,
        failure="; ".join(result.problem for result in results if result.problem),
        prompt_tokens=sum(result.prompt_tokens for result in results),
        completion_tokens=sum(result.completion_tokens for result in results),
        rounds=sum(result.rounds for result in results),
        duration_s=sum(result.duration_s for result in results),
    )
