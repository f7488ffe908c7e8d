"""Recordings on disk give what reading the XML gives, or nothing; no content of theirs is ever run."""

import hashlib
import logging
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
from support.builders import town_road

from plannerforge.engine.commonroad import recordings
from plannerforge.engine.commonroad.reader import LoadedScenario, read_recorded
from plannerforge.engine.commonroad.recordings import Recording, RecordingStore
from plannerforge.engine.execution.limits import Limits
from plannerforge.engine.execution.pool import WorkerPool
from plannerforge.schemas.scenarios import ReadFactsRequest
from plannerforge.workflows.operations import READ_FACTS


def digest_of(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def recording_of(path: Path) -> Recording:
    loaded = read_recorded(path).loaded
    return Recording(
        loaded.scenario, loaded.planning_problems, loaded.declared_id, loaded.plain_states, loaded.ego_classes
    )


@pytest.fixture
def town(tmp_path: Path) -> Path:
    return town_road().write(tmp_path / "scenario.xml")


@pytest.fixture
def store(tmp_path: Path) -> RecordingStore:
    return RecordingStore(tmp_path / "recordings")


def assert_same(path: Path, found: Recording | None) -> None:
    """Compared with commonroad-io's own equality, the arrays by their bytes, and the tracks that come of them."""
    assert found is not None
    read = read_recorded(path).loaded
    again = LoadedScenario(found.scenario, found.planning_problems, path, found.declared_id, found.plain_states)
    assert again.scenario == read.scenario, path.name
    assert again.planning_problems == read.planning_problems, path.name
    assert again.benchmark_id == read.benchmark_id
    assert again.tracks.keys() == read.tracks.keys()
    for key, track in read.tracks.items():
        for name in ("positions", "headings_rad", "speeds_mps"):
            values = getattr(again.tracks[key], name)
            assert values.tobytes() == getattr(track, name).tobytes(), (path.name, key)
            assert values.flags.writeable == getattr(track, name).flags.writeable
    for lanelet in read.scenario.lanelet_network.lanelets:
        other = again.scenario.lanelet_network.find_lanelet_by_id(lanelet.lanelet_id)
        assert np.array_equal(other.center_vertices, lanelet.center_vertices)
        assert other.polygon.shapely_object.equals(lanelet.polygon.shapely_object)


def test_public_files_are_the_same_from_their_recordings(shared_data: Path, store: RecordingStore) -> None:
    files = sorted((shared_data / "data/commonroad").glob("*.xml"))
    assert len(files) > 100
    for path in files[::16]:  # in the order of their countries
        store.put(digest_of(path), recording_of(path))
        assert_same(path, store.find(digest_of(path)))


def test_a_file_without_a_recording_gives_none(store: RecordingStore, town: Path) -> None:
    assert store.find(digest_of(town)) is None


@pytest.mark.parametrize("part", [slice(0, -9), slice(0, 0), slice(40, None), slice(1, None)])
def test_a_damaged_recording_is_ignored_and_recorded_again(
    part: slice, store: RecordingStore, town: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store.put(digest_of(town), recording_of(town))
    (path,) = store.folder.iterdir()
    path.write_bytes(path.read_bytes()[part])
    with caplog.at_level(logging.WARNING):
        assert store.find(digest_of(town)) is None
    assert "is invalid and will be made again" in caplog.text
    assert not path.exists()
    store.put(digest_of(town), recording_of(town))
    assert_same(town, store.find(digest_of(town)))


class _ForgedType:
    """A NumPy data type with a field of objects that says of itself that it holds none."""

    def __reduce__(self) -> tuple[object, ...]:
        return np.dtype, ("V8", False, True), (3, "|", None, ("a",), {"a": (np.dtype("O"), 0)}, 8, 1, 0)


@pytest.mark.parametrize("kind", ["O", "|O", "V8", "|O8", "<M8[s]", "<f8,<f8", "<U4", "<c16"])
def test_an_array_of_anything_but_numbers_is_refused(kind: str) -> None:
    with pytest.raises(pickle.UnpicklingError):
        recordings._array(kind, (1,), bytearray(16))


class _Hostile:
    def __init__(self, target: Path) -> None:
        self._target = target

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, (str(self._target),)


@pytest.mark.parametrize(
    "named", ["os.mkdir", "builtins.eval", "commonroad class that is no data", "forged data type", "NumPy's own form"]
)
def test_a_recording_contains_only_plain_data(
    named: str, store: RecordingStore, town: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store.put(digest_of(town), recording_of(town))
    (path,) = store.folder.iterdir()
    made = tmp_path / "made"
    payload = {
        "os.mkdir": pickle.dumps(_Hostile(made)),
        "builtins.eval": b"cbuiltins\neval\n(S'__import__(\"os\").mkdir(%r)'\ntR." % str(made),
        "forged data type": pickle.dumps(_ForgedType()),
        "NumPy's own form": pickle.dumps(np.zeros(3)),
        "commonroad class that is no data": b"ccommonroad.common.file_reader\nCommonRoadFileReader\n(S'x'\ntR.",
    }[named]
    path.write_bytes(hashlib.sha256(payload).digest() + payload)
    with caplog.at_level(logging.WARNING):
        assert store.find(digest_of(town)) is None
    assert "which is not plain data" in caplog.text
    assert not made.exists()


def test_a_folder_that_cannot_be_written_is_logged(
    tmp_path: Path, town: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("in the way")
    with caplog.at_level(logging.WARNING):
        RecordingStore(tmp_path / "file" / "recordings").put(digest_of(town), recording_of(town))
    assert "no recording is stored" in caplog.text


def test_a_damaged_recording_in_a_folder_that_cannot_be_written_is_passed_over(
    store: RecordingStore, town: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.put(digest_of(town), recording_of(town))
    (path,) = store.folder.iterdir()

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "read-only")

    monkeypatch.setattr(os, "utime", refuse)
    assert_same(town, store.find(digest_of(town)))
    path.write_bytes(b"damaged")
    monkeypatch.setattr(Path, "unlink", refuse)
    assert store.find(digest_of(town)) is None


def test_a_full_disk_leaves_no_partial_files(
    store: RecordingStore, town: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    store.put(digest_of(town), recording_of(town))
    assert list(store.folder.iterdir()) == []


def test_the_least_recently_used_recording_makes_room(store: RecordingStore, town: Path) -> None:
    recording = recording_of(town)
    for number, name in enumerate("abc"):
        store.put(name, recording)
        (path,) = store.folder.glob(f"{name}-*")
        os.utime(path, (number, number))
    assert store.find("a") is not None  # so that "b" is the oldest
    size = path.stat().st_size
    RecordingStore(store.folder, most_bytes=3 * size + size // 2).put("d", recording)
    assert sorted(path.name[0] for path in store.folder.iterdir()) == ["a", "c", "d"]


@pytest.mark.anyio
async def test_workers_store_recordings_and_reuse_stored_ones(tmp_path: Path, town: Path) -> None:
    folder = tmp_path / "recordings"
    limits = Limits(roots=(tmp_path,), recordings=folder)
    async with WorkerPool.open(limits, tmp_path / "log") as pool:
        facts = await pool.run(READ_FACTS, ReadFactsRequest(path=town))
        empty = town_road().with_vehicles().write(tmp_path / "b.xml")
        once = await pool.run(READ_FACTS, ReadFactsRequest(path=empty, keep=False))
    assert facts.participants != once.participants
    (kept,) = folder.iterdir()
    other = digest_of(tmp_path / "b.xml")
    kept.rename(folder / kept.name.replace(digest_of(town), other))
    async with WorkerPool.open(limits, tmp_path / "log") as pool:
        found = await pool.run(READ_FACTS, ReadFactsRequest(path=tmp_path / "b.xml"))
    assert found == facts
