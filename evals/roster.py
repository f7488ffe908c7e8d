"""Agents by name; the module of an agent is imported on first use."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..schemas.errors import UnknownName, closest
from .attempts import Condition, EvaluatedAgent


@dataclass(frozen=True)
class AgentChoice:
    """The arguments for opening an agent.

    ``name`` is the whole name, and ``argument`` the part after its first colon; ``seed`` is for its random choices.
    """

    name: str
    argument: str
    condition: Condition
    seed: int


@dataclass(frozen=True)
class _Entry:
    """How to open an agent, and the form of its name; if ``fresh``, each request needs its own session."""

    open: Callable[[AgentChoice], EvaluatedAgent]
    form: str
    fresh: bool = False


def open_agent(name: str, condition: Condition, seed: int) -> tuple[EvaluatedAgent, bool]:
    """Return the agent of a name, and whether each of its requests needs its own session.

    Raises:
        UnknownName: there is no such agent; the error lists the known agents.
        InvalidRequest: a journal or its marks cannot be read.
        AgentError: a model's name is invalid, or its package is not installed.
    """
    kind, _, argument = name.partition(":")
    if kind not in _AGENTS:
        raise UnknownName(
            f"there is no agent '{name}'",
            valid=[_AGENTS[known].form for known in closest(kind, _AGENTS)],
            next_step="use one of these with --agent",
        )
    entry = _AGENTS[kind]
    return entry.open(AgentChoice(name, argument, condition, seed)), entry.fresh


def _oracle(choice: AgentChoice) -> EvaluatedAgent:
    from .oracle import Oracle

    del choice
    return Oracle()


def _scripted(choice: AgentChoice) -> EvaluatedAgent:
    from .spoiled import Scripted

    return Scripted(choice.seed)


def _regex(choice: AgentChoice) -> EvaluatedAgent:
    from .floors import RegexRouter

    del choice
    return RegexRouter()


def _bm25(choice: AgentChoice) -> EvaluatedAgent:
    from .floors import KeywordSearch

    del choice
    return KeywordSearch()


def _journal(choice: AgentChoice) -> EvaluatedAgent:
    from .journal import open_journal

    return open_journal(choice.name, choice.argument)


def _model(choice: AgentChoice) -> EvaluatedAgent:
    from .model_agent import model_agent

    return model_agent(choice.name, choice.condition, choice.seed)


_AGENTS: Mapping[str, _Entry] = {
    "oracle": _Entry(_oracle, "oracle"),
    "scripted": _Entry(_scripted, "scripted"),
    "regex": _Entry(_regex, "regex"),
    "bm25": _Entry(_bm25, "bm25"),
    "journal": _Entry(_journal, "journal:JOURNAL@MARKS"),
    "ollama": _Entry(_model, "ollama:MODEL", fresh=True),
    "openai": _Entry(_model, "openai:MODEL@URL", fresh=True),
}
"""Agents by the text before the first colon."""
