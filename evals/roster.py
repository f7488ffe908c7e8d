"""Agents by name; the module of one is imported when it is asked for."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from ..schemas.errors import UnknownName, closest
from .attempts import Condition, EvaluatedAgent


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
    """How an agent is opened and named (``form``); ``fresh``: each of its requests needs a session of its own."""

    open: Callable[[AgentChoice], EvaluatedAgent]
    form: str
    fresh: bool = False


def open_agent(name: str, condition: Condition, seed: int) -> tuple[EvaluatedAgent, bool]:
    """The agent of a name, and whether each of its requests needs a session of its own.

    Raises:
        UnknownName: there is no such agent; names those that there are.
        InvalidRequest: a journal or its marks cannot be read.
        AgentError: a model is named wrongly, or what it needs is not installed.
    """
    kind, _, argument = name.partition(":")
    if kind not in _AGENTS:
        raise UnknownName(
            f"there is no agent '{name}'",
            valid=[_AGENTS[known].form for known in closest(kind, _AGENTS)],
            next_step="name one of these by --agent",
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
"""By the word before the first colon."""
