"""The commands of evaluations: what they print, write, refuse and go on with."""

import io
import json
import re
from pathlib import Path

import pytest
from rich.console import Console
from support.agents import named
from support.evaluations import CountingAgent, echo_session, evaluation, line_of, request, requests
from support.model_servers import Reply, replies, serving
from support.tool_server import tool_server
from support.tree import CHECKOUT
from typer.testing import CliRunner

from benchmarks.agents import MISBEHAVIOURS, tokens_of
from plannerforge.agent.connection import ToolConnection
from plannerforge.agent.errors import ModelFailure
from plannerforge.cli.main import application
from plannerforge.evals.attempts import Attempt, EvalRequest, ToolSession
from plannerforge.evals.campaign import evaluate, rows_path
from plannerforge.evals.connection import ServerSession
from plannerforge.evals.model_agent import ModelAgent
from plannerforge.evals.results.rows import AGENT_FAILED
from plannerforge.evals.roster import open_agent
from plannerforge.evals.running import EvaluationOrder, print_requests, print_results, run_evaluation

pytestmark = pytest.mark.anyio


def corpus(folder: Path, *chosen: EvalRequest) -> Path:
    path = folder / "selection.jsonl"
    path.write_text("".join(f"{line_of(one)}\n" for one in chosen), encoding="utf-8")
    return path


def command(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(application, list(arguments))
    return result.exit_code, result.output + result.stderr


def test_requests_are_printed_without_their_answers(tmp_path: Path) -> None:
    path = corpus(tmp_path, *requests(3))
    code, printed = command("eval", "requests", "selection", "--corpus", str(path), "--limit", "2")
    assert code == 0
    lines = [json.loads(line) for line in printed.splitlines() if line.startswith("{")]
    assert [line["id"] for line in lines] == ["sel-000", "sel-001"]
    assert "matching_ids" not in printed


def test_marks_note_when_each_request_began_and_ended(tmp_path: Path) -> None:
    path, marks = corpus(tmp_path, *requests(3)), tmp_path / "marks.jsonl"
    shown = Console(file=io.StringIO())
    print_requests("selection", path, limit=1, marks=marks, console=shown, wait=lambda text: None)
    print_requests("selection", path, limit=None, marks=marks, console=shown, wait=lambda text: None)
    noted = [json.loads(line) for line in marks.read_text(encoding="utf-8").splitlines()]
    assert [mark["request_id"] for mark in noted] == ["sel-000", "sel-001", "sel-002"]
    assert all(mark["began_s"] <= mark["ended_s"] for mark in noted)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("eval", "selection", "--agent", "orcle"), "there is no agent 'orcle'"),
        (("eval", "selection", "--condition", "hints"), "there is no condition 'hints'"),
        (("eval", "requests", "walking"), "there is no task 'walking'"),
        (("eval", "compare", "nowhere", "nowhere"), "has no rows"),
        (("eval", "tuning", "--conversations", "3"), "--conversations is for e2e"),
        (("eval", "selection", "--agent", "ollama:"), "is not a model name"),
    ],
)
def test_an_invalid_name_is_reported_in_one_line(
    arguments: tuple[str, ...], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, printed = command(*arguments)
    assert code in (1, 2)
    assert told in printed
    assert "Next:" in printed
    assert "Traceback" not in printed


async def test_results_are_printed_and_written_again(tmp_path: Path) -> None:
    await evaluate(requests(4), evaluation(CountingAgent(frozenset({"sel-002"}))), tmp_path / "a", echo_session)
    shown = Console(file=io.StringIO(), width=160)
    assert print_results(tmp_path / "a", shown) == 0
    assert "75.0" in (tmp_path / "a" / "tables.md").read_text(encoding="utf-8")
    assert "the scenario was not found" in (tmp_path / "a" / "report.html").read_text(encoding="utf-8")
    await evaluate(requests(4), evaluation(CountingAgent()), tmp_path / "b", echo_session)
    code, printed = command("eval", "compare", str(tmp_path / "a"), str(tmp_path / "b"))
    assert code == 0
    assert "gained: sel-002" in printed


async def test_an_agent_that_raises_costs_only_its_row(tmp_path: Path) -> None:
    class Broken(CountingAgent):
        async def attempt(self, request: EvalRequest, tools: ToolSession) -> Attempt:
            if request.request_id == "sel-001":
                raise KeyError("search_id")
            return await super().attempt(request, tools)

    rows = await evaluate(requests(3), evaluation(Broken()), tmp_path, echo_session)
    assert [row.score.done for row in rows] == [True, False, True]
    assert rows[1].attempt.failure.startswith(AGENT_FAILED)


async def test_a_model_makes_calls_and_its_tokens_are_counted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    script = replies(Reply(calls=(("make_scenario", {"vehicles": 4}),)), Reply("Made with 4 vehicles."))
    with serving("ollama", script) as server:
        monkeypatch.setenv("PLANNERFORGE_AGENT_HOST", server.url)
        agent, fresh = open_agent(named("ollama", server.url), "baseline", seed=1)
        async with ToolConnection.open(tool_server()) as connection:
            attempt = await agent.attempt(request(1, "generation"), ServerSession(connection, tmp_path))
    assert fresh
    assert [(call.tool, dict(call.arguments)) for call in attempt.calls] == [("make_scenario", {"vehicles": 4})]
    assert attempt.answers == ("Made with 4 vehicles.",)
    assert attempt.ending == "answered"
    assert attempt.rounds == 2
    assert attempt.prompt_tokens > 0
    assert attempt.completion_tokens > 0


async def test_an_evaluation_ends_if_the_model_server_is_lost(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with serving("ollama", replies(Reply("Hello."))) as server:
        monkeypatch.setenv("PLANNERFORGE_AGENT_HOST", server.url)
        agent, _ = open_agent(named("ollama", server.url), "cp", seed=1)
    with pytest.raises(ModelFailure):
        await evaluate(requests(3), evaluation(agent), tmp_path, echo_session)  # type: ignore[arg-type]
    assert rows_path(tmp_path, "selection").read_bytes() == b""
    assert isinstance(agent, ModelAgent)


@pytest.mark.usefixtures("warm_workers")
def test_the_ground_truth_carries_out_packaged_requests_and_an_evaluation_continues(tmp_path: Path) -> None:
    shown = Console(file=io.StringIO(), width=160)
    out = tmp_path / "out"
    assert run_evaluation(EvaluationOrder("selection", "oracle", "cp", out=out, limit=1), shown) == 0
    assert run_evaluation(EvaluationOrder("selection", "oracle", "cp", out=out, limit=2), shown) == 0
    lines = rows_path(out, "selection").read_text(encoding="utf-8").splitlines()
    assert [json.loads(line)["score"]["done"] for line in lines] == [True] * 2


def test_every_kind_of_misbehaviour_has_a_test() -> None:
    names = re.findall(r"def (test_\w+)", (CHECKOUT / "tests" / "agent" / "test_misbehaviour.py").read_text("utf-8"))
    assert len(MISBEHAVIOURS) >= 15
    assert [
        kind for kind, words in MISBEHAVIOURS.items() if not any(word in name for word in words for name in names)
    ] == []


async def test_an_ideal_agents_tokens_count_prompt_tools_and_answers_once(tmp_path: Path) -> None:
    rows = await evaluate(requests(2, "e2e"), evaluation(CountingAgent()), tmp_path, echo_session)
    figures = tokens_of(rows)
    assert int(figures["essential_tokens"]) < int(figures["tool_tokens"]) < int(figures["tokens_e2e"])
    assert int(figures["tokens_e2e"]) - int(figures["tool_tokens"]) > rows[0].answer_tokens
