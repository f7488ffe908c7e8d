"""Jobs: durable records that every server on the workspace answers for, and the runner that carries them out."""

import logging
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import anyio
import pytest

from plannerforge.engine.execution.jobs import Job, JobProgress, JobRunner, JobStore
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.engine.workspace.recipe import Recipe
from plannerforge.schemas.errors import NotPossible, ResourceFailure, UnknownName

pytestmark = pytest.mark.anyio
RECIPE = Recipe(tool="run_planner", arguments={"scenarios": ["a", "b"]})
OTHER = Recipe(tool="run_planner", arguments={"scenarios": ["c"]})


@pytest.fixture
def workspace(tmp_path: Path) -> Iterator[Workspace]:
    opened = Workspace(tmp_path)
    yield opened
    opened.close()


@pytest.fixture
def store(workspace: Workspace) -> JobStore:
    return JobStore(workspace.database)


async def ignore(job: Job) -> None:
    pass


async def succeed(progress: JobProgress) -> None:
    for number in (1, 2):
        progress.add_result(f"run_{number}")
        progress.report(number / 2, f"{number} of 2")


async def wait_for_good(progress: JobProgress) -> None:
    progress.add_result("run_1")
    progress.report(0.5, "half")
    await anyio.sleep_forever()


def test_a_job_is_recorded_with_its_messages(store: JobStore) -> None:
    job = store.start("batch", RECIPE)[0]
    assert job.job_id == f"job_{RECIPE.digest}"
    assert (job.state, job.share, job.ended, job.remaining_s) == ("running", 0, False, None)
    store.update(job.job_id, share=0.5, message="half", results=("run_1",))
    found = store.get(job.job_id)
    assert (found.share, found.message, found.results, found.recipe) == (0.5, "half", ("run_1",), RECIPE)
    assert found.remaining_s is not None
    assert found.remaining_s >= 0


def test_job_that_ended_stays_as_it_is(store: JobStore) -> None:
    job = store.start("batch", RECIPE)[0]
    store.end(job.job_id, "done", results=("run_1",))
    store.end(job.job_id, "failed", results=(), error="late")
    store.update(job.job_id, share=0.1, message="late", results=())
    found = store.get(job.job_id)
    assert (found.state, found.share, found.results, found.error, found.ended) == ("done", 1.0, ("run_1",), "", True)
    assert found.remaining_s is None


def test_attempts_of_one_recipe_have_their_own_ids(store: JobStore) -> None:
    first = store.start("batch", RECIPE)[0]
    store.end(first.job_id, "failed", results=(), error="x")
    second = store.start("batch", RECIPE)[0]
    assert second.job_id == f"{first.job_id}_2"
    assert store.running(RECIPE) == second
    assert store.running(OTHER) is None
    assert store.get("latest") == second
    assert [job.job_id for job in store.newest(5)] == [second.job_id, first.job_id]


def test_a_job_stays_its_owner_s_when_others_join_it(store: JobStore) -> None:
    mine = store.start("batch", RECIPE, "one")[0]
    joined, is_new = store.start("batch", RECIPE, "two")
    without = store.start("batch", OTHER)[0]
    assert (joined, is_new) == (mine, False)
    assert [job.owner for job in (mine, store.get(mine.job_id), without)] == ["one", "one", ""]
    assert [store.newest_of(owner, 5) for owner in ("one", "two", "")] == [[mine], [], []]
    assert "owner" not in mine.model_dump()


def test_unknown_job_names_the_nearest(store: JobStore) -> None:
    with pytest.raises(UnknownName, match="no job yet"):
        store.get("latest")
    job = store.start("batch", RECIPE)[0]
    with pytest.raises(UnknownName) as caught:
        store.get(job.job_id[:-1] + "x")
    assert caught.value.valid == (job.job_id,)


def test_a_job_of_an_ended_server_is_interrupted_and_may_start_again(store: JobStore, tmp_path: Path) -> None:
    program = (
        "import sys\n"
        "from pathlib import Path\n"
        "from plannerforge.engine.execution.jobs import JobStore\n"
        "from plannerforge.engine.workspace.artifacts import Workspace\n"
        "from plannerforge.engine.workspace.recipe import Recipe\n"
        "store = JobStore(Workspace(Path(sys.argv[1])).database)\n"
        "job = store.start('batch', Recipe.model_validate_json(sys.argv[2]))[0]\n"
        "store.update(job.job_id, share=0.5, message='half', results=('run_1',))\n"
        "print(job.job_id)\n"
    )
    command = [sys.executable, "-c", program, str(tmp_path), RECIPE.model_dump_json()]
    job_id = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    found = store.get(job_id)
    assert (found.state, found.ended, found.results) == ("interrupted", True, ("run_1",))
    assert store.running(RECIPE) is None
    assert store.start("batch", RECIPE)[0].job_id == f"{job_id}_2"


async def test_work_that_succeeds_is_done_with_its_results(store: JobStore) -> None:
    told: list[float] = []

    async def listen(job: Job) -> None:
        told.append(job.share)

    async with anyio.create_task_group() as tasks:
        runner = JobRunner(store, tasks)
        job = await runner.wait(runner.start("batch", RECIPE, succeed).job_id, 50, listen)
    assert (job.state, job.share, job.results, job.error) == ("done", 1.0, ("run_1", "run_2"), "")
    assert told == sorted(told)
    assert told[-1] == 1.0


async def test_a_refusal_fails_the_job_and_keeps_finished_work(store: JobStore) -> None:
    async def refuse(progress: JobProgress) -> None:
        progress.add_result("run_1")
        raise NotPossible("the lane ends", next_step="take another")

    async with anyio.create_task_group() as tasks:
        runner = JobRunner(store, tasks)
        job = await runner.wait(runner.start("batch", RECIPE, refuse).job_id, 50, ignore)
    assert (job.state, job.results) == ("failed", ("run_1",))
    assert job.error == "[not_possible] the lane ends. Next: take another."


async def test_defect_fails_the_job_with_an_incident_that_is_logged(
    store: JobStore, caplog: pytest.LogCaptureFixture
) -> None:
    async def break_down(progress: JobProgress) -> None:
        raise KeyError("secret")

    with caplog.at_level(logging.ERROR):
        async with anyio.create_task_group() as tasks:
            runner = JobRunner(store, tasks)
            job = await runner.wait(runner.start("batch", RECIPE, break_down).job_id, 50, ignore)
    assert job.state == "failed"
    assert "secret" not in job.error
    incident = job.error.partition("incident ")[2].partition(")")[0]
    assert incident in caplog.text
    assert "KeyError: 'secret'" in caplog.text


async def test_a_cancelled_job_stops_and_keeps_finished_work(store: JobStore) -> None:
    async with anyio.create_task_group() as tasks:
        runner = JobRunner(store, tasks)
        job = runner.start("batch", RECIPE, wait_for_good)
        await anyio.wait_all_tasks_blocked()
        job = await runner.cancel(job.job_id)
        assert (job.state, job.results, job.error) == ("cancelled", ("run_1",), "")
        assert await runner.cancel(job.job_id) == job, "cancelling again changes nothing"


async def test_job_of_a_server_that_ends_is_interrupted(store: JobStore) -> None:
    async with anyio.create_task_group() as tasks:
        runner = JobRunner(store, tasks)
        job = runner.start("batch", RECIPE, wait_for_good)
        await anyio.wait_all_tasks_blocked()
        tasks.cancel_scope.cancel()
    assert store.get(job.job_id).state == "interrupted"
    assert store.get(job.job_id).results == ("run_1",)


async def test_same_recipe_joins_the_job_that_makes_it(store: JobStore) -> None:
    async with anyio.create_task_group() as tasks:
        runner = JobRunner(store, tasks)
        first = runner.start("batch", RECIPE, wait_for_good)
        assert runner.start("batch", RECIPE, succeed).job_id == first.job_id
        assert runner.start("batch", OTHER, succeed).job_id != first.job_id
        await runner.cancel(first.job_id)
        assert runner.start("batch", RECIPE, succeed).job_id == f"{first.job_id}_2"


async def test_waiting_ends_with_the_time_and_leaves_the_job_alone(store: JobStore) -> None:
    async with anyio.create_task_group() as tasks:
        runner = JobRunner(store, tasks)
        job = runner.start("batch", RECIPE, wait_for_good)
        for wait_s in (0.0, 0.05):
            assert (await runner.wait(job.job_id, wait_s, ignore)).state == "running"
        await runner.cancel(job.job_id)


async def test_end_that_cannot_be_recorded_is_logged_and_other_jobs_go_on(
    store: JobStore, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    recorded = store.end

    def full_disk(job_id: str, *arguments: object, **options: object) -> None:
        if RECIPE.digest in job_id:
            raise ResourceFailure("database or disk is full")
        recorded(job_id, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(store, "end", full_disk)
    async with anyio.create_task_group() as tasks:
        runner = JobRunner(store, tasks)
        runner.start("batch", RECIPE, succeed)
        job = await runner.wait(runner.start("batch", OTHER, succeed).job_id, 50, ignore)
    assert job.state == "done"
    assert "disk is full" in caplog.text


async def test_end_that_a_full_disk_refused_is_recorded_once_there_is_room(
    store: JobStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full_disk(*arguments: object, **options: object) -> None:
        raise ResourceFailure("database or disk is full")

    async with anyio.create_task_group() as tasks:
        runner = JobRunner(store, tasks)
        with monkeypatch.context() as patch:
            patch.setattr(store, "end", full_disk)
            job = runner.start("batch", RECIPE, succeed)
            assert (await runner.wait(job.job_id, 0.2, ignore)).state == "running"
        assert (await runner.wait(job.job_id, 50, ignore)).state == "done"
        assert runner.start("batch", RECIPE, succeed).job_id != job.job_id, "nobody joins a job that has ended"


async def test_progress_that_cannot_be_recorded_does_not_end_the_work(
    store: JobStore, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full_disk(*arguments: object, **options: object) -> None:
        raise ResourceFailure("database or disk is full")

    monkeypatch.setattr(store, "update", full_disk)
    async with anyio.create_task_group() as tasks:
        runner = JobRunner(store, tasks)
        job = await runner.wait(runner.start("batch", RECIPE, succeed).job_id, 50, ignore)
    assert job.state == "done"
    assert "disk is full" in caplog.text


async def test_job_that_cannot_begin_fails_alone(store: JobStore) -> None:
    """Its thread cannot be started: the other jobs and the server go on."""

    async def nowhere(*_: object) -> None:
        raise RuntimeError("can't start new thread")

    async with anyio.create_task_group() as tasks:
        job = JobRunner(store, tasks, nowhere).start("batch", RECIPE, succeed)
        other = JobRunner(store, tasks).start("batch", OTHER, succeed)
        while not (store.get(job.job_id).ended and store.get(other.job_id).ended):
            await anyio.sleep(0)
    assert (store.get(job.job_id).state, store.get(other.job_id).state) == ("failed", "done")
    assert "[resource_failure]" in store.get(job.job_id).error


def test_job_runs_although_the_clock_was_set_back_before_it_began(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By that clock its process has not been started yet."""
    earlier = time.time() - 3600.0
    monkeypatch.setattr(time, "time", lambda: earlier)
    job, is_new = JobStore(workspace.database).start("batch", Recipe(tool="run_planner"))
    assert is_new
    assert JobStore(workspace.database).get(job.job_id).state == "running"
    assert not JobStore(workspace.database).start("batch", Recipe(tool="run_planner"))[1]
