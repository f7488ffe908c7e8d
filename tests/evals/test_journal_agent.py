"""What another client did, from the journal of its server and marks of when it was asked what."""

import io
import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from mcp.types import CallToolResult, TextContent
from rich.console import Console
from support.evaluations import EchoSession, line_of, request, requests

from plannerforge.evals.attempts import EvalTurn, MadeCall
from plannerforge.evals.corpora import read_corpus
from plannerforge.evals.journal import JournalAgent, ask_one_by_one, open_journal
from plannerforge.evals.roster import open_agent
from plannerforge.evals.running import print_requests
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.server.observing.journal import Journal

pytestmark = pytest.mark.anyio


class RefusingSession(EchoSession):
    """A session that refuses every call."""

    async def call(self, tool: str, arguments: Mapping[str, Any], turn: int = 0) -> MadeCall:
        return MadeCall(tool, arguments, "no such id", {}, is_error=True, duration_s=0.0, turn=turn)


def journalled(journal: Journal, at_s: float, tool: str, error: str = "", **arguments: Any) -> None:
    result = CallToolResult(content=[TextContent(type="text", text=error or "done")], is_error=bool(error))
    moment = datetime.fromtimestamp(at_s, UTC).isoformat(timespec="milliseconds")
    journal.add(time=moment, call_id="1", client="test", tool=tool, arguments=arguments, duration_s=0.1, result=result)


def agent_of(folder: Path, *marks: Mapping[str, Any]) -> JournalAgent:
    path, marked = folder / "calls.jsonl", folder / "marks.jsonl"
    journal = Journal(path, 10**6)
    journalled(journal, 10.0, "find_scenarios", text="before")
    journalled(journal, 20.5, "find_scenarios", "'lorry' is no tag", tags=["lorry"])
    journalled(journal, 21.5, "find_scenarios", text="one")
    journalled(journal, 22.5, "get_job", job_id="job_1")
    journalled(journal, 30.5, "describe_catalog")
    journalled(journal, 40.5, "find_scenarios", text="x" * 1000)
    journal.close()
    marked.write_text("".join(f"{json.dumps(mark)}\n" for mark in marks), encoding="utf-8")
    name = f"journal:{path}@{marked}"
    return open_journal(name, name.partition(":")[2])


def mark(request_id: str, began_s: float, ended_s: float, **fields: Any) -> dict[str, Any]:
    return {"request_id": request_id, "began_s": began_s, "ended_s": ended_s, **fields}


async def test_calls_within_the_marks_are_repeated_and_refusals_kept(tmp_path: Path) -> None:
    agent = agent_of(tmp_path, mark("sel-001", 20, 25), mark("sel-002", 30, 35))
    attempt = await agent.attempt(request(1), EchoSession(tmp_path))
    assert [(call.is_error, dict(call.arguments)) for call in attempt.calls] == [
        (True, {"tags": ["lorry"]}),
        (False, {"text": "one"}),
    ]
    assert (attempt.ending, attempt.failure) == ("answered", "")
    assert "lorry" in attempt.calls[0].text


async def test_a_client_s_ending_comes_from_the_mark(tmp_path: Path) -> None:
    agent = agent_of(tmp_path, mark("sel-001", 50, 55, ending="asked"))
    attempt = await agent.attempt(request(1), EchoSession(tmp_path))
    assert (attempt.ending, attempt.calls) == ("asked", ())


async def test_turns_of_a_conversation_have_their_own_marks(tmp_path: Path) -> None:
    agent = agent_of(tmp_path, mark("e2e-001", 30, 35, turn=1), mark("e2e-001", 20, 25))
    attempt = await agent.attempt(request(1, "e2e"), EchoSession(tmp_path))
    assert [call.turn for call in attempt.calls] == [0, 0, 1]


@pytest.mark.parametrize(
    ("marks", "session", "told"),
    [
        ([mark("sel-002", 20, 25)], EchoSession, "do not contain this request"),
        ([mark("sel-001", 40, 45)], EchoSession, "cut a long text"),
        ([mark("sel-001", 30, 35)], RefusingSession, "refused now: no such id"),
    ],
)
async def test_an_irreproducible_step_fails_with_the_reason(
    marks: list[dict[str, Any]], session: type[EchoSession], told: str, tmp_path: Path
) -> None:
    attempt = await agent_of(tmp_path, *marks).attempt(request(1), session(tmp_path))
    assert attempt.ending == "failed"
    assert told in attempt.failure


async def test_older_files_of_a_journal_are_read_too(tmp_path: Path) -> None:
    agent_of(tmp_path, mark("sel-001", 20, 25))
    (tmp_path / "calls.jsonl").rename(tmp_path / "calls.jsonl.1")
    (tmp_path / "calls.jsonl").write_text("", encoding="utf-8")
    agent, fresh = open_agent(f"journal:{tmp_path}/calls.jsonl@{tmp_path}/marks.jsonl", "baseline", 0)
    attempt = await agent.attempt(request(1), EchoSession(tmp_path))
    assert (len(attempt.calls), fresh) == (2, False)


def test_unreadable_marks_are_reported_by_line(tmp_path: Path) -> None:
    with pytest.raises(InvalidRequest, match=r"line 2 of .*marks.jsonl"):
        agent_of(tmp_path, mark("sel-001", 20, 25), {"request_id": "sel-002"})


@pytest.mark.parametrize("argument", ["calls.jsonl", "calls.jsonl@", "nowhere.jsonl@marks.jsonl"])
def test_a_journal_without_readable_files_is_refused(argument: str) -> None:
    with pytest.raises(InvalidRequest, match="JOURNAL@MARKS"):
        open_journal(f"journal:{argument}", argument)


def test_clients_are_prompted_turn_by_turn_until_the_ending_is_a_valid_word(tmp_path: Path) -> None:
    turns = (EvalTurn("First.", "select", {}, "ok"), EvalTurn("Second.", "test", {}, "ok"))
    said, shown = iter(["", "askd", "asked"]), list[str]()
    talk = request(1, "e2e", turns=turns)
    ask_one_by_one([(talk, {"id": talk.request_id})], tmp_path / "m.jsonl", shown.append, lambda text: next(said))
    noted = [json.loads(line) for line in (tmp_path / "m.jsonl").read_text(encoding="utf-8").splitlines()]
    assert [(one["turn"], one["ending"]) for one in noted] == [(0, "answered"), (1, "asked")]
    assert shown[1::2] == ["First.", "Second."]


async def test_marks_of_the_command_are_read_by_the_agent(tmp_path: Path) -> None:
    corpus, marks = tmp_path / "selection.jsonl", tmp_path / "marks.jsonl"
    corpus.write_text("".join(f"{line_of(one)}\n" for one in requests(1)), encoding="utf-8")
    journal = Journal(tmp_path / "calls.jsonl", 10**6)

    def answer(question: str) -> str:
        del question
        journalled(journal, datetime.now(UTC).timestamp(), "find_scenarios", text="0")
        return ""

    print_requests("selection", corpus, limit=None, marks=marks, console=Console(file=io.StringIO()), wait=answer)
    journal.close()
    agent = open_journal("journal:", f"{tmp_path / 'calls.jsonl'}@{marks}")
    attempt = await agent.attempt(read_corpus(corpus)[0], EchoSession(tmp_path))
    assert [call.arguments for call in attempt.calls] == [{"text": "0"}]
