"""The input and output of an evaluated agent: values shared by corpora, agents, scorers and tables.

A corpus provides ``EvalRequest``. An ``EvaluatedAgent`` handles one with a ``ToolSession`` and returns an ``Attempt``.
A scorer examines both, and the content of the workspace, and returns a ``Score``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

Task = Literal["generation", "selection", "modification", "routing", "tuning", "e2e"]
Expectation = Literal["ok", "empty", "refuse", "clarify"]
Condition = Literal["baseline", "cp", "cp_cot", "cp_icl", "cp_icl_cot"]
"""The paper's five prompt conditions."""
Ending = Literal["answered", "asked", "refused", "failed"]
"""The end of an attempt: an answer, a question back, a refusal by the agent itself, or a failure."""


@dataclass(frozen=True)
class EvalTurn:
    """A turn of a conversation: its text, the expected result, and its kind (``e2e`` corpora)."""

    text: str
    action: str
    truth: Mapping[str, Any]
    expect: Expectation


@dataclass(frozen=True)
class EvalRequest:
    """A line of a corpus.

    ``corpus`` is the name of the file's task as written there (``modification_T``). ``history`` lists earlier turns as
    (role, text). ``context`` is the state before the request (tuning). ``scenario`` and ``map_file`` are names of files
    to work on.
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
    """A call with its answer; ``turn`` counts the turns of a conversation from 0."""

    tool: str
    arguments: Mapping[str, Any]
    text: str
    structured: Mapping[str, Any]
    is_error: bool
    duration_s: float
    turn: int = 0


@dataclass(frozen=True)
class Attempt:
    """An agent's handling of a request.

    Tokens are as counted by the model's server, or 0 for agents without a model. ``rounds`` counts requests to the
    model; ``answers`` are the last texts of each turn; ``failure`` states why an attempt failed.
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
    """Verdicts on an attempt by column of the paper's table; None if a column does not apply.

    ``done`` is the main result: the request is fulfilled in the workspace, not only in the arguments. ``misses``
    explain failed columns.
    """

    request_id: str
    done: bool
    columns: Mapping[str, bool | None]
    misses: tuple[str, ...] = ()


class ToolSession(Protocol):
    """A connection to the server under evaluation."""

    async def call(self, tool: str, arguments: Mapping[str, Any], turn: int = 0) -> MadeCall:
        """Make a call and wait for its answer; if it becomes a job, wait for the job's end."""


class EvaluatedAgent(Protocol):
    """An agent that turns a request into calls: a language model, the ground truth, a floor, a journal."""

    @property
    def name(self) -> str:
        """The name for ``--agent``, such as ``oracle`` or ``ollama:qwen3:8b``."""

    async def attempt(self, request: EvalRequest, tools: ToolSession) -> Attempt:
        """Handle a request. Failures of a model or a call are recorded in the attempt, never raised."""
