"""Agents and scorers by name; the module of one is imported when it is asked for."""

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import cast

from ...schemas.errors import UnknownName, closest
from .attempts import Condition, EvaluatedAgent, Task
from .campaign import Scorer


@dataclass(frozen=True)
class AgentChoice:
    """What an agent is opened with.

    ``name`` is the whole name and ``argument`` what stands behind its first colon; ``seed`` is for what it draws.
    """

    name: str
    argument: str
    condition: Condition
    seed: int


@dataclass(frozen=True)
class _Entry:
    """Where an agent's factory is; ``form`` is how it is named, ``fresh`` whether its requests need own sessions."""

    factory: str
    form: str
    meaning: str
    fresh: bool = False


AGENTS: Mapping[str, _Entry] = {
    "ollama": _Entry(".model_agent:model_agent", "ollama:MODEL", "a model of an Ollama server", fresh=True),
    "openai": _Entry(
        ".model_agent:model_agent", "openai:MODEL@URL", "a model of any OpenAI-compatible server", fresh=True
    ),
}
"""By the word before the first colon."""
SCORERS: Mapping[Task, str] = {}
"""A scorer by task."""


def open_agent(name: str, condition: Condition, seed: int) -> tuple[EvaluatedAgent, bool]:
    """The agent of a name, and whether each of its requests needs a session of its own.

    Raises:
        UnknownName: there is no such agent; names those that there are.
        AgentError: a model is named wrongly, or what it needs is not installed.
    """
    kind, _, argument = name.partition(":")
    if kind not in AGENTS:
        raise UnknownName(
            f"there is no agent '{name}'",
            valid=[AGENTS[known].form for known in closest(kind, AGENTS)],
            next_step="name one of these by --agent",
        )
    factory = cast("Callable[[AgentChoice], EvaluatedAgent]", _named(AGENTS[kind].factory))
    return factory(AgentChoice(name, argument, condition, seed)), AGENTS[kind].fresh


def scorer_of(task: Task) -> Scorer:
    """What scores the attempts at a task."""
    return cast("Scorer", _named(SCORERS[task]))


def _named(place: str) -> object:
    module, _, attribute = place.partition(":")
    return getattr(importlib.import_module(module, __package__), attribute)
