"""Operations on a Dask cluster: files that travel by their content, errors that come back, a cluster that is gone."""

import os
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
from distributed import LocalCluster
from support.worker_operations import Letter, Words

from plannerforge.engine.execution import pool as pool_module
from plannerforge.engine.execution.cluster import ClusterExecutor
from plannerforge.engine.execution.executor import Operation
from plannerforge.engine.execution.limits import Limits
from plannerforge.engine.execution.pool import WorkerPool
from plannerforge.schemas.errors import ResourceFailure, UnexpectedFailure, UnknownName, WorkerFailure

pytestmark = [pytest.mark.anyio, pytest.mark.usefixtures("importable_tests")]
COPY = Operation(
    "support.worker_operations:copy_letter", Letter, Letter, timeout_s=60.0, reads=("path",), writes="folder"
)


def words(name: str) -> Operation[Words, Words]:
    """An operation of tests that travels: ``text`` names a file."""
    return Operation(f"support.worker_operations:{name}", Words, Words, timeout_s=60.0, reads=("text",))


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, importable_tests: None) -> Iterator[LocalCluster]:
    monkeypatch.setitem(pool_module.PRELOAD, "compute", ())
    with LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        dashboard_address=None,
        local_directory=str(tmp_path / "cluster"),
    ) as opened:
        yield opened


@pytest.fixture
async def executor(cluster: LocalCluster, tmp_path: Path) -> AsyncIterator[ClusterExecutor]:
    limits = Limits(roots=(tmp_path,), worker_count=1)
    async with (
        WorkerPool.open(limits, tmp_path / "here.log") as here,
        ClusterExecutor.open(cluster.scheduler_address, here, limits) as opened,
    ):
        yield opened


def letter(folder: Path, text: str) -> Letter:
    """A file of that content, and a new folder for what is made of it."""
    path, out = folder / "letter.txt", folder / f"out {text}"
    path.write_text(text, encoding="utf-8")
    out.mkdir()
    return Letter(path=str(path), folder=str(out))


async def test_files_travel_there_and_back(executor: ClusterExecutor, tmp_path: Path) -> None:
    for text in ("first", "second, of the same name"):
        request = letter(tmp_path, text)
        answer = await executor.run(COPY, request)
        assert answer.text.startswith(text)
        assert (Path(request.folder) / "copies" / "letter.txt").read_text() == text
    assert executor.notice == ""
    assert executor.capacity == 2


async def test_a_file_is_sent_to_a_worker_once(executor: ClusterExecutor, tmp_path: Path) -> None:
    request = letter(tmp_path, "text")
    await executor.run(COPY, request)
    (Path(request.folder) / "copies" / "letter.txt").unlink()
    await executor.run(COPY, request)
    assert executor.sent_files == 1


async def test_errors_keep_their_types(executor: ClusterExecutor, tmp_path: Path) -> None:
    named = Words(text=letter(tmp_path, "text").path)
    with pytest.raises(UnknownName, match="no such thing") as refusal:
        await executor.run(words("refuse"), named)
    assert list(refusal.value.valid) == ["this", "that"]
    with pytest.raises(UnexpectedFailure) as defect:
        await executor.run(words("fail"), named)
    assert "KeyError" in defect.value.details
    with pytest.raises(WorkerFailure, match="signal 9"):
        await executor.run(words("kill_itself"), named)
    assert (await executor.run(words("tell_pid"), named)).number != os.getpid()


async def test_a_missing_file_is_named(executor: ClusterExecutor, tmp_path: Path) -> None:
    with pytest.raises(ResourceFailure, match=r"letter\.txt cannot be read"):
        await executor.run(words("echo"), Words(text=str(tmp_path / "letter.txt")))


async def test_a_worker_with_other_versions_is_refused(cluster: LocalCluster, tmp_path: Path) -> None:
    limits = Limits(roots=(tmp_path,), worker_count=1)
    async with (
        WorkerPool.open(limits, tmp_path / "here.log") as here,
        ClusterExecutor.open(cluster.scheduler_address, here, limits, versions={"numpy": "0.1"}) as executor,
    ):
        with pytest.raises(ResourceFailure, match=r"has numpy .*, not 0\.1, so its results would differ"):
            await executor.run(COPY, letter(tmp_path, "text"))


async def test_operations_unknown_to_the_cluster_stay_local(executor: ClusterExecutor) -> None:
    stays = Operation("support.worker_operations:tell_environment", Words, Words, timeout_s=60.0)
    answer = await executor.run(stays, Words(text="PLANNERFORGE_RECORDINGS"))
    assert answer.text == "", "a worker of the cluster keeps recordings, this one does not"


async def test_a_lost_cluster_is_reported_and_the_work_continues_locally(
    executor: ClusterExecutor, cluster: LocalCluster, tmp_path: Path
) -> None:
    await executor.run(COPY, letter(tmp_path, "there"))
    cluster.close()
    request = letter(tmp_path, "here")
    assert (await executor.run(COPY, request)).text.startswith("here")
    assert (Path(request.folder) / "copies" / "letter.txt").read_text() == "here"
    assert "is unavailable (its scheduler went away); operations run on this machine" in executor.notice
    assert executor.capacity == 1


async def test_an_address_without_a_scheduler_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(pool_module.PRELOAD, "compute", ())
    limits = Limits(roots=(tmp_path,), worker_count=1)
    async with (
        WorkerPool.open(limits, tmp_path / "here.log") as here,
        ClusterExecutor.open("tcp://127.0.0.1:9", here, limits, connect_s=0.2) as executor,
    ):
        assert "the cluster at tcp://127.0.0.1:9 is unavailable" in executor.notice
        assert (await executor.run(COPY, letter(tmp_path, "here"))).text.startswith("here")
