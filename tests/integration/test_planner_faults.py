"""Batches of planner runs under faults: every run ends in a result or a named error, none is lost or made double."""

import os
import random
import shutil
import signal
import sqlite3
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
import anyio.to_thread
import psutil
import pytest
from mcp import Client
from support.builders import Problem, town_road
from support.server import StdioServer

from plannerforge.engine.execution import pool
from plannerforge.server.assembly import create_server
from plannerforge.server.settings import Settings
from plannerforge.workflows.operations import RUN_PLANNER

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("importable_tests")]
Ask = Callable[..., Awaitable[Any]]
FAULTS = ("hang", "native_crash", "killed", "leave", "memory", "defect", "disk")
NAMED = {"worker_timeout", "worker_failure", "resource_failure", "unexpected"}
LIGHT = ["idm"]
"""The faults are those of workers; this planner loads no library, so that new workers start fast."""
NEAR = Problem(goal=(62.0, 0.0, 8.0, 3.0), steps=(15, 30))


def scenario_id(number: int) -> str:
    return f"ZAM_Builder-{number}_1_T-1"


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """Nine small scenarios, each with a goal that is two seconds away."""
    folder = tmp_path / "files"
    folder.mkdir()
    for number in range(1, 10):
        builder = replace(town_road().with_vehicles(), problems=(NEAR,), benchmark_id=scenario_id(number))
        builder.write(folder / f"{number}.xml")
    return folder


@pytest.fixture
def faults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Runs go through the operation that misbehaves where a file in this folder says so."""
    folder = tmp_path / "faults"
    folder.mkdir()
    monkeypatch.setenv("PLANNER_FAULTS", str(folder))
    misbehaving = replace(RUN_PLANNER, entry_point="support.planner_faults:run")
    monkeypatch.setattr("plannerforge.workflows.runs.RUN_PLANNER", misbehaving)
    monkeypatch.setitem(pool.PRELOAD, "compute", ())
    return folder


@pytest.fixture
def served(settings: Settings, tmp_path: Path) -> Any:
    @asynccontextmanager
    async def session(workers: int = 2) -> AsyncIterator[Ask]:
        own = settings.model_copy(update={"starter": False, "workers": workers, "journal": False})
        async with Client(create_server(own, start_folder=tmp_path)) as client:

            async def ask(tool: str, **arguments: Any) -> Any:
                result = await client.call_tool(tool, arguments)
                return result.content[0].text if result.is_error else result.structured_content  # type: ignore[union-attr]

            yield ask

    return session


def stored_runs(folder: Path) -> Counter[str]:
    """How many runs the workspace holds, by recipe."""
    connection = sqlite3.connect(folder / "workspace" / "workspace.sqlite")
    rows = connection.execute("SELECT digest FROM artifacts WHERE kind = 'run'").fetchall()
    connection.close()
    return Counter(row[0] for row in rows)


COUNTING = """
CREATE TABLE executions (digest TEXT NOT NULL);
CREATE TRIGGER count_executions AFTER INSERT ON claims
WHEN NOT EXISTS (SELECT 1 FROM artifacts WHERE kind = 'run' AND digest = NEW.digest)
BEGIN INSERT INTO executions VALUES (NEW.digest); END;
"""
"""A run is carried out by whoever claims its recipe while no run of it is stored; a second one leaves no other trace,
because the artifact that is there already stays."""


def count_executions(folder: Path) -> None:
    """Have the workspace count every run that is carried out from now on."""
    connection = sqlite3.connect(folder / "workspace" / "workspace.sqlite")
    connection.executescript(COUNTING)
    connection.close()


def executed_runs(folder: Path) -> Counter[str]:
    """How often each run was carried out, by recipe."""
    connection = sqlite3.connect(folder / "workspace" / "workspace.sqlite")
    rows = connection.execute("SELECT digest FROM executions").fetchall()
    connection.close()
    return Counter(row[0] for row in rows)


def codes(result: Any) -> set[str]:
    return {cell["error"].partition("[")[2].partition("]")[0] for cell in result["lost"]}


async def test_every_misbehaviour_loses_its_own_run_by_name_and_is_tried_again(
    served: Any, files: Path, faults: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    misbehaving = replace(RUN_PLANNER, entry_point="support.planner_faults:run", timeout_s=20.0)
    monkeypatch.setattr("plannerforge.workflows.runs.RUN_PLANNER", misbehaving)
    for number, fault in enumerate(FAULTS, 1):
        (faults / scenario_id(number)).write_text(fault)
    async with served() as ask:
        await ask("import_files", path=str(files))
        first = await ask("run_planner", scenarios=["preset:9"], configs=LIGHT, wait_s=50)
        assert (first["state"], first["total"], first["finished"]) == ("done", 9, 2)
        assert {cell["scenario_id"] for cell in first["lost"]} == {scenario_id(number) for number in range(1, 8)}
        assert codes(first) == NAMED
        assert all("secret" not in cell["error"] for cell in first["lost"])
        shutil.rmtree(faults)
        second = await ask("run_planner", scenarios=["preset:9"], configs=LIGHT, wait_s=50)
        assert (second["finished"], second["reused"], second["lost"]) == (9, 2, [])
        assert second["batch_id"] != first["batch_id"]
        assert list(stored_runs(tmp_path).values()) == [1] * 9


async def test_a_single_run_that_crashes_is_an_error_and_the_next_call_works(
    served: Any, files: Path, faults: Path
) -> None:
    (faults / scenario_id(1)).write_text("native_crash")
    async with served(workers=1) as ask:
        await ask("import_files", path=str(files))
        assert "[worker_failure]" in await ask("run_planner", scenarios=[scenario_id(1)], configs=LIGHT)
        (faults / scenario_id(1)).unlink()
        assert (await ask("run_planner", scenarios=[scenario_id(1)], configs=LIGHT))["finished"] == 1


async def test_workers_killed_at_random_lose_no_run(
    served: Any, files: Path, faults: Path, tmp_path: Path, own_workers: Callable[[], set[psutil.Process]]
) -> None:
    chance, struck = random.Random(4), 0

    async def kill_now_and_then() -> None:
        nonlocal struck
        while struck < 6:
            await anyio.sleep(chance.uniform(0.1, 0.6))
            alive = sorted(own_workers(), key=lambda process: process.pid)
            if alive:
                os.kill(chance.choice(alive).pid, signal.SIGKILL)
                struck += 1

    async with served() as ask, anyio.create_task_group() as tasks:
        await ask("import_files", path=str(files))
        tasks.start_soon(kill_now_and_then)
        finished = 0
        for _ in range(8):
            result = await ask("run_planner", scenarios=["preset:9"], configs=LIGHT, wait_s=50)
            assert result["finished"] + len(result["lost"]) == 9
            assert codes(result) <= {"worker_failure"}
            assert result["finished"] >= finished, "what was finished stays"
            finished = result["finished"]
            if finished == 9:
                break
        tasks.cancel_scope.cancel()
    assert finished == 9
    assert struck
    assert list(stored_runs(tmp_path).values()) == [1] * 9


async def test_a_full_disk_while_a_run_is_written_leaves_no_files(
    served: Any, files: Path, faults: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_text, copyfile = Path.write_text, shutil.copyfile

    def written(path: Path, *arguments: Any, **options: Any) -> int:
        refuse(path)
        return write_text(path, *arguments, **options)

    def copied(source: Path, target: Path) -> Any:
        refuse(target)
        return copyfile(source, target)

    def refuse(path: Path) -> None:
        if path.name == "steps.json":
            raise OSError(28, "No space left on device")

    async with served(workers=1) as ask:
        await ask("import_files", path=str(files))
        for owner, name, full in ((Path, "write_text", written), (shutil, "copyfile", copied)):
            with monkeypatch.context() as patch:
                patch.setattr(owner, name, full)
                first = await ask("run_planner", scenarios=["preset:2"], configs=LIGHT, wait_s=50)
            assert codes(first) == {"resource_failure"}
            assert not stored_runs(tmp_path)
            assert not list((tmp_path / "workspace").glob("runs/*"))
        assert (await ask("run_planner", scenarios=["preset:2"], configs=LIGHT, wait_s=50))["finished"] == 2


async def test_a_cancelled_batch_keeps_its_finished_runs(
    served: Any, files: Path, faults: Path, tmp_path: Path
) -> None:
    (faults / scenario_id(3)).write_text("hang")
    scenarios = [scenario_id(number) for number in (1, 2, 3)]
    async with served(workers=1) as ask:
        await ask("import_files", path=str(files))
        started = await ask("run_planner", scenarios=scenarios, configs=LIGHT, wait_s=0)
        while (await ask("get_job", job_id=started["job_id"], wait_s=1))["share"] < 0.6:
            pass
        cancelled = await ask("cancel_job", job_id=started["job_id"])
        assert cancelled["state"] == "cancelled"
        assert len(cancelled["results"]) == 2
        (faults / scenario_id(3)).unlink()
        again = await ask("run_planner", scenarios=scenarios, configs=LIGHT, wait_s=50)
        assert (again["finished"], again["reused"]) == (3, 2)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Callable[..., StdioServer]]:
    started: list[StdioServer] = []

    def start(*arguments: str) -> StdioServer:
        started.append(StdioServer(tmp_path, arguments))
        return started[-1]

    yield start
    for one in started:
        one.kill()


def test_a_killed_server_resumes_its_batch(server: Callable[..., StdioServer], files: Path, tmp_path: Path) -> None:
    first = server("--workers", "1")
    first.call("import_files", path=str(files))
    grid = {"scenarios": ["preset:6"], "configs": ["frenetix:Default", "frenetix:Safety"]}
    started = first.call("run_planner", wait_s=0, **grid)
    while len(first.call("get_job", job_id=started["job_id"], wait_s=0)["results"]) < 3:
        pass
    first.kill()
    kept = sum(stored_runs(tmp_path).values())
    assert 3 <= kept < 12
    second = server("--workers", "2")
    assert second.call("get_job", job_id=started["job_id"])["state"] == "interrupted"
    result = second.call("run_planner", wait_s=50, **grid)
    assert (result["state"], result["finished"], result["reused"], result["lost"]) == ("done", 12, kept, [])
    assert list(stored_runs(tmp_path).values()) == [1] * 12


async def test_two_servers_on_one_workspace_lose_no_work_and_repeat_none(
    server: Callable[..., StdioServer], files: Path, tmp_path: Path
) -> None:
    servers = [server("--workers", "1"), server("--workers", "1")]
    servers[0].call("import_files", path=str(files))
    count_executions(tmp_path)
    answers: dict[int, Any] = {}

    def work(index: int, grid: dict[str, list[str]]) -> None:
        answers[index] = servers[index].call("run_planner", wait_s=50, **grid)

    for config, sizes in (("idm", (9, 9)), ("idm:Sporty", (9, 6))):
        async with anyio.create_task_group() as tasks:
            for index, size in enumerate(sizes):
                grid = {"scenarios": [f"preset:{size}"], "configs": [config]}
                tasks.start_soon(anyio.to_thread.run_sync, work, index, grid)
        for index, size in enumerate(sizes):
            assert answers[index]["finished"] == size
            assert (answers[index]["state"], answers[index]["lost"]) == ("done", [])
    made = sum(answer["finished"] - answer["reused"] for answer in answers.values())
    assert made == 9, "a run that one makes is waited for by the other where their grids overlap"
    assert list(stored_runs(tmp_path).values()) == [1] * 18
    assert executed_runs(tmp_path) == stored_runs(tmp_path), "each run was carried out once"
