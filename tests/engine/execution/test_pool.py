"""Worker processes: what they answer, and that no misbehaviour of an operation reaches the server."""

import logging
import os
import signal
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import anyio
import psutil
import pytest
from support.tree import CHECKOUT

from plannerforge.engine.execution import pool as pool_module
from plannerforge.engine.execution.executor import OnProgress, Operation, no_progress
from plannerforge.engine.execution.limits import Limits
from plannerforge.engine.execution.pool import WorkerPool
from plannerforge.schemas.base import Model
from plannerforge.schemas.errors import ResourceFailure, UnexpectedFailure, UnknownName, WorkerFailure, WorkerTimeout

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("importable_tests")]
PATIENCE_S = 60.0


class Words(Model):
    text: str = ""
    number: int = 0


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "logs" / "workers.log"


@pytest.fixture
async def pool(tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[WorkerPool]:
    monkeypatch.setitem(pool_module.PRELOAD, "compute", ())
    limits = Limits(
        roots=(tmp_path,), worker_count=1, worker_memory_bytes=512 * 1024**2, operation_timeout_s=PATIENCE_S
    )
    async with WorkerPool.open(limits, log) as opened:
        yield opened


@pytest.fixture(scope="module")
async def shared_pool(
    anyio_backend: str, tmp_path_factory: pytest.TempPathFactory
) -> AsyncIterator[tuple[WorkerPool, Path]]:
    """A pool for the tests after which its worker goes on, and its log."""
    folder = tmp_path_factory.mktemp("pool")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join([str(CHECKOUT / "tests"), os.environ.get("PYTHONPATH", "")]))
        limits = Limits(roots=(folder,), worker_count=1, operation_timeout_s=PATIENCE_S)
        async with WorkerPool.open(limits, folder / "workers.log") as opened:
            await pid_of_worker(opened)
            yield opened, folder / "workers.log"


@pytest.fixture
def kept(shared_pool: tuple[WorkerPool, Path]) -> WorkerPool:
    """The pool whose worker goes on."""
    return shared_pool[0]


async def run(
    pool: WorkerPool,
    name: str,
    text: str = "",
    number: int = 0,
    *,
    timeout_s: float | None = None,
    on_progress: OnProgress = no_progress,
) -> Words:
    operation = Operation(f"support.worker_operations:{name}", Words, Words, timeout_s)
    return await pool.run(operation, Words(text=text, number=number), on_progress=on_progress)


async def test_a_worker_with_too_much_memory_between_operations_is_replaced(
    tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(pool_module.PRELOAD, "compute", ())
    for most, same in ((1, False), (1024**3, True)):
        limits = Limits(roots=(tmp_path,), worker_count=1, worker_idle_bytes=most, operation_timeout_s=PATIENCE_S)
        async with WorkerPool.open(limits, log) as pool:
            first, second = await pid_of_worker(pool), await pid_of_worker(pool)
            assert (first == second) is same
            assert same or await gone(first)


async def test_a_module_in_the_current_folder_replaces_no_other(
    pool: WorkerPool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("json.py", "numpy.py", "plannerforge.py"):
        (tmp_path / name).write_text("raise SystemExit('a foreign module was imported')")
    monkeypatch.chdir(tmp_path)
    assert (await run(pool, "tell_pid")).number > 0


async def pid_of_worker(pool: WorkerPool) -> int:
    return (await run(pool, "tell_pid")).number


async def gone(*pids: int) -> bool:
    """Whether the processes end (a zombie that waits for its new parent has ended)."""
    with anyio.move_on_after(PATIENCE_S):
        while any(psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE for pid in pids):
            await anyio.sleep(0.02)
        return True
    return False


class Hanging:
    """Progress of ``hang``: the pids that it told, as soon as it has told them."""

    def __init__(self) -> None:
        self.pids: tuple[int, ...] = ()
        self.told = anyio.Event()

    async def __call__(self, share: float, message: str) -> None:
        self.pids = tuple(int(pid) for pid in message.split())
        self.told.set()


async def test_answer_is_that_of_the_operation(kept: WorkerPool) -> None:
    assert await run(kept, "echo", "Grüße, 世界\n\u2028\x00", 7) == Words(text="Grüße, 世界\n\u2028\x00", number=7)


async def test_worker_is_warm_for_the_next_call(kept: WorkerPool) -> None:
    assert await pid_of_worker(kept) == await pid_of_worker(kept)
    assert len(kept.worker_pids) == 1


async def test_large_request_and_answer_pass(kept: WorkerPool) -> None:
    text = "x" * 5_000_000
    assert (await run(kept, "echo", text)).text == text


async def test_progress_arrives_whole_and_in_order(kept: WorkerPool) -> None:
    told: list[tuple[float, str]] = []

    async def note(share: float, message: str) -> None:
        told.append((share, message))

    await run(kept, "tell_progress", number=500, on_progress=note)
    assert told == [(step / 500, f"step {step}") for step in range(500)]


async def test_stray_output_goes_to_the_log_and_never_into_the_protocol(shared_pool: tuple[WorkerPool, Path]) -> None:
    kept, log = shared_pool
    for _ in range(2):
        assert (await run(kept, "write_to_standard_output")).text == "true answer"
    written = log.read_text()
    for stray in ("forged by native code", "forged by print", "forged by puts", "no newline at the end"):
        assert stray in written


async def test_started_program_cannot_read_the_orders(kept: WorkerPool) -> None:
    assert (await run(kept, "read_standard_input")).number == 0
    assert (await run(kept, "echo", "next")).text == "next"


async def test_sums_are_computed_by_one_thread(pool: WorkerPool, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(variable, "2")
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        assert (await run(pool, "tell_environment", variable)).text == "1"


@pytest.mark.parametrize(
    ("operation", "number", "cause"),
    [
        ("kill_itself", 0, f"signal {signal.SIGKILL}"),
        ("touch_bad_memory", 0, f"signal {signal.SIGSEGV}"),
        ("leave", 3, "exit status 3"),
        ("leave", 0, "exit status 0"),
    ],
)
async def test_death_of_a_worker_is_one_failure_and_the_next_call_gets_a_fresh_one(
    pool: WorkerPool, operation: str, number: int, cause: str
) -> None:
    before = await pid_of_worker(pool)
    with pytest.raises(WorkerFailure, match=cause) as caught:
        await run(pool, operation, number=number)
    assert operation in caught.value.message
    assert caught.value.next_step
    assert await pid_of_worker(pool) != before
    assert await gone(before)


async def test_worker_that_died_while_idle_is_replaced(pool: WorkerPool) -> None:
    before = await pid_of_worker(pool)
    psutil.Process(before).kill()
    assert await gone(before)
    await anyio.sleep(0.05)  # the event loop notices the exit
    assert await pid_of_worker(pool) != before


async def test_time_out_ends_the_worker_and_all_that_it_started(pool: WorkerPool) -> None:
    hanging = Hanging()
    await pid_of_worker(pool)  # only the operation takes time, not the start of a worker on a busy machine
    with pytest.raises(WorkerTimeout, match=r"hang took longer than 2 s") as caught:
        await run(pool, "hang", timeout_s=2, on_progress=hanging)
    assert "operation_timeout_s" in caught.value.next_step
    assert len(hanging.pids) == 2
    assert await gone(*hanging.pids)
    assert await pid_of_worker(pool) not in hanging.pids


async def test_cancelled_call_ends_the_worker_and_all_that_it_started(pool: WorkerPool) -> None:
    hanging = Hanging()
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(lambda: run(pool, "hang", on_progress=hanging))
        await hanging.told.wait()
        tasks.cancel_scope.cancel()
    assert await gone(*hanging.pids)
    assert pool.worker_pids == ()
    assert (await run(pool, "echo", "next")).text == "next"


async def test_a_call_cancelled_while_it_waits_for_a_worker_disturbs_no_other(pool: WorkerPool) -> None:
    hanging = Hanging()
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(lambda: run(pool, "hang", on_progress=hanging))
        await hanging.told.wait()
        with anyio.move_on_after(0.05) as waiting:
            await run(pool, "echo")
        assert waiting.cancelled_caught
        assert pool.worker_pids == (hanging.pids[0],)
        tasks.cancel_scope.cancel()
    assert (await run(pool, "echo", "next")).text == "next"


async def test_memory_beyond_the_limit_is_a_failure_of_that_call_only(pool: WorkerPool) -> None:
    with pytest.raises((ResourceFailure, WorkerFailure)):
        await run(pool, "fill_memory", number=4 * 1024**3)
    assert (await run(pool, "fill_memory", number=1000)).number == 1000


async def test_a_refusal_comes_back_unchanged(kept: WorkerPool) -> None:
    with pytest.raises(UnknownName) as caught:
        await run(kept, "refuse")
    assert caught.value.text == "[unknown_name] there is no such thing. Valid: this, that. Next: ask for this."


async def test_defect_of_an_operation_has_an_incident_number_and_keeps_its_details(kept: WorkerPool) -> None:
    before = await pid_of_worker(kept)
    with pytest.raises(UnexpectedFailure) as caught:
        await run(kept, "fail", "Alice")
    assert "secret of Alice" in caught.value.details
    assert "secret" not in caught.value.text
    assert await pid_of_worker(kept) == before, "a defect in Python does not cost the worker"


async def test_refusal_of_the_operating_system_is_logged(kept: WorkerPool, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.ERROR), pytest.raises(ResourceFailure, match="No such file"):
        await run(kept, "read_missing_file")
    assert "/no/such/file" in caplog.text


@pytest.mark.parametrize("entry_point", ["answer_with_no_model", "no_such_operation"])
async def test_operation_that_breaks_its_contract_is_a_defect(kept: WorkerPool, entry_point: str) -> None:
    with pytest.raises(UnexpectedFailure):
        await run(kept, entry_point)
    assert (await run(kept, "echo", "next")).text == "next"


async def test_failing_listener_does_not_look_like_a_dead_worker(pool: WorkerPool) -> None:
    async def hang_up(share: float, message: str) -> None:
        raise anyio.BrokenResourceError

    with pytest.raises(anyio.BrokenResourceError):
        await run(pool, "tell_progress", number=3, on_progress=hang_up)
    assert (await run(pool, "echo", "next")).text == "next"


async def test_calls_share_the_workers_and_wait_for_each_other(kept: WorkerPool) -> None:
    pids: set[int] = set()

    async def note_pid() -> None:
        pids.add(await pid_of_worker(kept))

    async with anyio.create_task_group() as tasks:
        for _ in range(5):
            tasks.start_soon(note_pid)
    assert len(pids) == 1


async def test_warm_up_starts_the_worker_that_the_first_call_gets(pool: WorkerPool) -> None:
    await pool.warm_up()
    (pid,) = pool.worker_pids
    assert await pid_of_worker(pool) == pid
    await pool.warm_up()
    assert pool.worker_pids == (pid,)


async def test_warm_up_imports_are_left_out_of_later_collections(
    pool: WorkerPool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(pool_module.PRELOAD, "compute", ("json",))
    assert (await run(pool, "tell_frozen_objects")).number > 1000


async def test_closed_pool_leaves_no_process(tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(pool_module.PRELOAD, "compute", ())
    async with WorkerPool.open(Limits(roots=(tmp_path,)), log) as pool:
        hanging = Hanging()
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(lambda: run(pool, "hang", on_progress=hanging))
            await hanging.told.wait()
            idle = await pid_of_worker(pool)
            assert set(pool.worker_pids) == {hanging.pids[0], idle}
            tasks.cancel_scope.cancel()
    assert pool.worker_pids == ()
    assert await gone(idle, *hanging.pids)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux shows environments in /proc")
async def test_a_worker_s_environment_has_no_token(pool: WorkerPool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PLANNERFORGE_HTTP_TOKENS", "a token of the server")
    monkeypatch.setenv("API_KEY", "of the user")
    assert (await run(pool, "tell_environment", "PLANNERFORGE_HTTP_TOKENS")).text == ""
    assert (await run(pool, "tell_environment", "API_KEY")).text == "of the user", "a planner of the user may need it"
    shown = psutil.Process((await run(pool, "tell_pid")).number).environ()
    assert shown == {}
