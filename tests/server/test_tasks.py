"""Tasks: a call that takes long goes on without its request, its session and its server, and is found by its id."""

import math
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client, MCPError
from mcp.types import INVALID_PARAMS, ElicitResult
from pydantic import SecretStr
from support.http_serving import served
from support.tasks import KnowsTasks, ask, once_it

from plannerforge.engine.execution import JobStore, TaskStore
from plannerforge.engine.workspace import Workspace
from plannerforge.schemas.errors import UnknownName
from plannerforge.server import tasks
from plannerforge.server.settings import Settings

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("probe_tools", "impatient")]
THERE = "."
"""A file that each workspace has: a probe that waits for it does not wait."""


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Calls become tasks at once, not after two seconds."""
    monkeypatch.setattr(tasks, "GRACE_S", 0.0)


@pytest.fixture
def patient(impatient: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Calls never become tasks: a server that did not answer before its patience ended would not answer at all."""
    monkeypatch.setattr(tasks, "GRACE_S", math.inf)


@pytest.fixture
def let_it_end(settings: Settings) -> Callable[[], None]:
    """Ends the work that waits for the file ``end``."""
    return (settings.workspace / "end").touch


@pytest.fixture
def era() -> str:
    """The extension is of the stateless revision; another test tries the ones before."""
    return "auto"


async def begin(client: Client, knows: KnowsTasks, tool: str = "make_long", text: str = "end") -> str:
    await client.call_tool(tool, {"text": text})
    return knows.begun[-1].task_id


async def test_long_call_becomes_a_task_with_its_lifetime_and_its_answer(
    connect: Any, let_it_end: Callable[[], None]
) -> None:
    knows = KnowsTasks()
    async with connect(extensions=[knows]) as client:
        task_id = await begin(client, knows)
        begun = await ask(client, "tasks/get", task_id)
        let_it_end()
        ended = await once_it(client, task_id, "completed")
        again = await ask(client, "tasks/get", task_id)
    assert (knows.begun[0].status, begun.status) == ("working", "working")
    assert knows.begun[0].ttl_ms == 7 * 86_400_000
    assert len(task_id) >= 32
    assert ended.result is not None
    assert ended.result["structuredContent"]["said"]["text"] == "done"
    assert again == ended


@pytest.mark.usefixtures("patient")
async def test_quick_calls_and_refused_ones_are_answered_as_soon_as_they_end(connect: Any) -> None:
    knows = KnowsTasks()
    async with connect(extensions=[knows]) as client:
        quick = await client.call_tool("make_long", {"text": THERE})
        refused = await client.call_tool("make_long", {})
    assert knows.begun == []
    assert quick.structured_content["said"]["text"] == "done"
    assert refused.is_error


async def test_reading_calls_never_become_tasks(connect: Any) -> None:
    knows = KnowsTasks()
    async with connect(extensions=[knows]) as client:
        reading = await client.call_tool("echo", {"text": "x"})
    assert knows.begun == []
    assert reading.structured_content["said"]["text"] == "x"


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_a_client_without_tasks_gets_no_task(connect: Any, mode: str, era: str) -> None:
    async with connect() as client:
        answer = await client.call_tool("make_long", {"text": "for ever"})
        with pytest.raises(MCPError) as caught:
            await ask(client, "tasks/get", "x" * 32)
    assert answer.structured_content["said"]["text"] == "running"
    assert caught.value.error.code == -32021


async def test_task_begun_in_one_session_is_found_in_the_next(connect: Any, let_it_end: Callable[[], None]) -> None:
    """Its server is gone meanwhile: the next one takes the call up again."""
    first, second = KnowsTasks(), KnowsTasks()
    async with connect(extensions=[first]) as client:
        task_id = await begin(client, first)
    async with connect(extensions=[second]) as client:
        found = await ask(client, "tasks/get", task_id)
        let_it_end()
        ended = await once_it(client, task_id, "completed")
    assert found.status == "working"
    assert ended.result is not None
    assert ended.result["structuredContent"]["said"]["text"] == "done"


async def test_a_task_of_a_killed_server_is_resumed(connect: Any, settings: Settings) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    workspace = Workspace(settings.workspace)
    task_id = TaskStore(workspace.database).begin("", "make_long", {"text": THERE}).task_id
    with workspace.database.writing() as connection:
        connection.execute("UPDATE tasks SET owner_pid = ?", (gone.pid,))
    workspace.close()
    async with connect(extensions=[KnowsTasks()]) as client:
        ended = await once_it(client, task_id, "completed")
    assert ended.result is not None
    assert ended.result["structuredContent"]["said"]["text"] == "done"


async def test_ended_task_is_found_in_the_next_session(connect: Any) -> None:
    knows = KnowsTasks()
    async with connect(extensions=[knows]) as client:
        task_id = await begin(client, knows, text=THERE)
        ended = await once_it(client, task_id, "completed")
    async with connect(extensions=[KnowsTasks()]) as client:
        assert await ask(client, "tasks/get", task_id) == ended


async def test_cancelled_task_stops_its_job_and_stays_cancelled(connect: Any, settings: Settings) -> None:
    knows = KnowsTasks()
    async with connect(extensions=[knows]) as client:
        task_id = await begin(client, knows)
        workspace = Workspace(settings.workspace)
        jobs = JobStore(workspace.database)
        with anyio.fail_after(60):
            while not jobs.newest(1):
                await anyio.sleep(0.05)
            await ask(client, "tasks/cancel", task_id)
            cancelled = await ask(client, "tasks/get", task_id)
            await ask(client, "tasks/cancel", task_id)
            while not (job := jobs.newest(1)[0]).ended:
                await anyio.sleep(0.05)
        workspace.close()
    assert (cancelled.status, job.state) == ("cancelled", "cancelled")


async def test_progress_is_in_the_message_of_the_task(connect: Any) -> None:
    knows = KnowsTasks()
    async with connect(extensions=[knows]) as client:
        task_id = await begin(client, knows, text="for ever")
        told: set[str] = set()
        with anyio.fail_after(60):
            while len(told) < 2:
                told.add((await ask(client, "tasks/get", task_id)).status_message or "")
                told.discard("")
                await anyio.sleep(0.05)
        await ask(client, "tasks/cancel", task_id)
    assert all(re.fullmatch(r"\d+% step \d+", one) for one in told)


async def test_question_of_a_task_is_answered_by_an_update(connect: Any, let_it_end: Callable[[], None]) -> None:
    knows = KnowsTasks()

    async def nobody(context: Any, parameters: Any) -> ElicitResult:
        raise AssertionError("the question belongs to the task")

    async with connect(extensions=[knows], elicitation_callback=nobody) as client:
        task_id = await begin(client, knows, "ask_late")
        let_it_end()
        asked = await once_it(client, task_id, "input_required")
        ((key, request),) = (asked.input_requests or {}).items()
        await ask(client, "tasks/update", task_id, input_responses={"other": {"action": "accept"}})
        assert (await ask(client, "tasks/get", task_id)).status == "input_required"
        answer = {"action": "accept", "content": {"choice": "right"}}
        await ask(client, "tasks/update", task_id, input_responses={key: answer})
        ended = await once_it(client, task_id, "completed")
    assert request["params"]["message"] == "Which?"
    assert ended.result is not None
    assert ended.result["structuredContent"]["said"]["text"] == "right"


@pytest.mark.usefixtures("patient")
async def test_a_question_before_a_call_becomes_a_task_is_asked_as_usual(connect: Any) -> None:
    async def left(context: Any, parameters: Any) -> ElicitResult:
        return ElicitResult(action="accept", content={"choice": "left"})

    knows = KnowsTasks()
    async with connect(extensions=[knows], elicitation_callback=left) as client:
        answer = await client.call_tool("ask_late", {"text": THERE})
    assert knows.begun == []
    assert answer.structured_content["said"]["text"] == "left"


async def test_a_task_is_found_by_its_own_client_alone(settings: Settings, tmp_path: Path, warm_workers: None) -> None:
    keys = {"one": "o" * 32, "two": "t" * 32}
    own = settings.model_copy(
        update={"http_tokens": tuple(SecretStr(f"{name} {token}") for name, token in keys.items())}
    )
    knows = KnowsTasks()
    async with served(own, tmp_path) as server:
        async with server.client("auto", keys["one"], extensions=[knows]) as client:
            task_id = await begin(client, knows, text="for ever")
        async with server.client("auto", keys["two"], extensions=[KnowsTasks()]) as other:
            for method in ("tasks/get", "tasks/update", "tasks/cancel"):
                with pytest.raises(MCPError, match="no such task") as caught:
                    await ask(other, method, task_id)
                assert caught.value.error.code == INVALID_PARAMS
        async with server.client("auto", keys["one"], extensions=[KnowsTasks()]) as client:
            assert (await ask(client, "tasks/get", task_id)).status == "working"
            await ask(client, "tasks/cancel", task_id)


async def test_task_that_joined_the_job_of_another_token_leaves_it_running(
    settings: Settings, tmp_path: Path, warm_workers: None
) -> None:
    keys = {"one": "o" * 32, "two": "t" * 32}
    own = settings.model_copy(
        update={"http_tokens": tuple(SecretStr(f"{name} {token}") for name, token in keys.items())}
    )
    mine, theirs = KnowsTasks(), KnowsTasks()
    async with (
        served(own, tmp_path) as server,
        server.client("auto", keys["one"], extensions=[mine]) as one,
        server.client("auto", keys["two"], extensions=[theirs]) as two,
    ):
        task_id = await begin(one, mine, text="for ever")
        joined_id = await begin(two, theirs, text="for ever")
        await ask(two, "tasks/cancel", joined_id)
        left = (await one.call_tool("get_job", {"job_id": "latest", "wait_s": 1})).structured_content
        await ask(one, "tasks/cancel", task_id)
        stopped = (await one.call_tool("get_job", {"job_id": "latest", "wait_s": 10})).structured_content
    assert left is not None
    assert stopped is not None
    assert (left["state"], stopped["state"]) == ("running", "cancelled")


def test_task_is_forgotten_after_its_lifetime(settings: Settings) -> None:
    workspace = Workspace(settings.workspace)
    store = TaskStore(workspace.database)
    short = store.begin("", "make_long", {})
    with workspace.database.writing() as connection:
        connection.execute("UPDATE tasks SET created_at = created_at - lifetime_s - 1")
    with pytest.raises(UnknownName, match="it has expired") as caught:
        store.get(short.task_id, "")
    assert short.task_id not in caught.value.text
    store.begin("", "make_long", {})
    rows = workspace.database.connection().execute("SELECT count(*) FROM tasks").fetchone()
    workspace.close()
    assert rows[0] == 1


def test_only_one_server_takes_over_a_task(settings: Settings) -> None:
    workspace = Workspace(settings.workspace)
    store = TaskStore(workspace.database)
    task = store.begin("", "make_long", {"text": "1"})
    assert task.is_carried_out
    store.release(task.task_id)
    left = store.get(task.task_id, "")
    assert not left.is_carried_out
    assert [store.take_over(left), store.take_over(left)] == [True, False]
    store.end(task.task_id, "completed", {"content": []})
    store.end(task.task_id, "cancelled", {})
    assert store.get(task.task_id, "").state == "completed"
    workspace.close()
