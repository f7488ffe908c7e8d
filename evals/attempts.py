"""What an evaluated agent is given and what it did: the values that corpora, agents, scorers and tables share.

A corpus gives ``EvalRequest``; an ``EvaluatedAgent`` carries one out with a ``ToolSession`` and gives an ``Attempt``;
a scorer looks at both, and at what stands in the workspace, and gives a ``Score``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

Task = Literal["generation", "selection", "modification", "routing", "tuning", "e2e"]
Expectation = Literal["ok", "empty", "refuse", "clarify"]
Condition = Literal["baseline", "cp", "cp_cot", "cp_icl", "cp_icl_cot"]
"""The paper's five prompt conditions."""
Ending = Literal["answered", "asked", "refused", "failed"]
"""How an attempt ended: with an answer, with a question back, with a refusal of the agent itself, or broken off."""


@dataclass(frozen=True)
class EvalTurn:
    """A turn of a conversation: what is said, what has to come out, and of which kind it is (``e2e`` corpora)."""

    text: str
    action: str
    truth: Mapping[str, Any]
    expect: Expectation


@dataclass(frozen=True)
class EvalRequest:
    """A line of a corpus.

    ``corpus`` is the name of the file's task as written there (``modification_T``), ``history`` earlier turns as
    (role, text), ``context`` what is in force before (tuning), ``scenario`` and ``map_file`` names of files to work on.
    """

    request_id: str
    task: Task
    corpus: str
    text: str
    truth: Mapping[str, Any]
    expect: Expectation
    category: str = ""
    scenario: str | None = None
    map_file: str | None = None
    history: tuple[tuple[str, str], ...] = ()
    context: Mapping[str, Any] = field(default_factory=dict)
    turns: tuple[EvalTurn, ...] = ()


@dataclass(frozen=True)
class MadeCall:
    """A call as it was made and answered; ``turn`` counts the turns of a conversation from 0."""

    tool: str
    arguments: Mapping[str, Any]
    text: str
    structured: Mapping[str, Any]
    is_error: bool
    duration_s: float
    turn: int = 0


@dataclass(frozen=True)
class Attempt:
    """What an agent did with a request.

    Tokens are those that the model's server counted, or 0 for agents without a model; ``rounds`` how often the model
    was asked; ``answers`` the last words of each turn; ``failure`` says why an attempt was broken off.
    """

    request_id: str
    calls: tuple[MadeCall, ...]
    answers: tuple[str, ...]
    ending: Ending
    failure: str = ""
    prompt_tokens: int = 0
    completion_tokens: int = 0
    rounds: int = 0
    duration_s: float = 0.0


@dataclass(frozen=True)
class Score:
    """Verdicts on an attempt by column of the paper's table; None where a column does not apply.

    ``done`` is the headline: what was asked for is there, in the world and not in the arguments alone; ``misses`` say
    in words why a column failed.
    """

    request_id: str
    done: bool
    columns: Mapping[str, bool | None]
    misses: tuple[str, ...] = ()


class ToolSession(Protocol):
    """A connection to the server under evaluation."""

    async def call(self, tool: str, arguments: Mapping[str, Any], turn: int = 0) -> MadeCall:
        """Make a call and wait for its answer; of work that becomes a job, for its end."""


class EvaluatedAgent(Protocol):
    """Whatever turns a request into calls: a language model, the ground truth, a floor, a journal."""

    @property
    def name(self) -> str:
        """The name by which ``--agent`` finds it, such as ``oracle`` or ``ollama:qwen3:8b``."""

    async def attempt(self, request: EvalRequest, tools: ToolSession) -> Attempt:
        """Carry a request out. What goes wrong with a model or a call is in the attempt, never raised."""
