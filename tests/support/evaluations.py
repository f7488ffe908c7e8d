"""Evaluations under test: requests, an agent without a model, a scorer, and a session without a server."""

import json
import os
import signal
import sys
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio

from plannerforge.evals.attempts import Attempt, EvalRequest, MadeCall, Score, ToolSession
from plannerforge.evals.campaign import Evaluation, evaluate


def request(number: int, corpus: str = "selection", **fields: Any) -> EvalRequest:
    task: Any = corpus.partition("_")[0]
    return EvalRequest(
        request_id=f"{corpus[:3]}-{number:03d}",
        task=task,
        corpus=corpus,
        text=f"Find scenario {number}.",
        truth={"matching_ids": [str(number)]},
        expect="ok",
        **fields,
    )


def requests(count: int, corpus: str = "selection") -> list[EvalRequest]:
    return [request(number, corpus) for number in range(count)]


def line_of(one: EvalRequest) -> str:
    return json.dumps(
        {"id": one.request_id, "task": one.corpus, "text": one.text, "truth": dict(one.truth), "expect": one.expect}
    )


class EchoSession:
    """A session that answers every call with its arguments."""

    def __init__(self, workspace: Path) -> None:
        self.workspace = workspace

    async def call(self, tool: str, arguments: Mapping[str, Any], turn: int = 0) -> MadeCall:
        await anyio.sleep(0)
        return MadeCall(
            tool, arguments, json.dumps(dict(arguments)), arguments, is_error=False, duration_s=0.0, turn=turn
        )


@dataclass
class CountingAgent:
    """Requests the number in its request; omits given requests, and kills the process at one."""

    wrong: frozenset[str] = frozenset()
    killed_at: str = ""
    name: str = "counting"
    attempted: list[str] = field(default_factory=list)

    async def attempt(self, request: EvalRequest, tools: ToolSession) -> Attempt:
        if request.request_id == self.killed_at:
            os.kill(os.getpid(), signal.SIGKILL)
        self.attempted.append(request.request_id)
        wanted = "none" if request.request_id in self.wrong else request.truth["matching_ids"][0]
        call = await tools.call("find_scenarios", {"text": wanted})
        return Attempt(request.request_id, (call,), (wanted,), "answered", prompt_tokens=100, completion_tokens=10)


def score(request: EvalRequest, attempt: Attempt, workspace: Path) -> Score:
    found = attempt.answers == tuple(request.truth["matching_ids"])
    columns = {"sat_top1": found, "extract": None}
    return Score(request.request_id, found, columns, () if found else ("the scenario was not found",))


@asynccontextmanager
async def echo_session(number: int, request: EvalRequest) -> AsyncIterator[EchoSession]:
    yield EchoSession(Path(f"workspace-{number}"))


def evaluation(agent: CountingAgent) -> Evaluation:
    return Evaluation(agent, "cp", score)


if __name__ == "__main__":  # an evaluation in a process of its own, which ends itself in the middle
    anyio.run(evaluate, requests(12), evaluation(CountingAgent(killed_at=sys.argv[2])), Path(sys.argv[1]), echo_session)
