"""Bounds of a call: paths stay inside the allowed roots, whatever way they are written."""

import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import psutil
import pytest

from plannerforge.engine.execution.limits import Limits, MemoryTrimmer
from plannerforge.schemas.errors import InvalidRequest, OutsideRoots, UnsafeInput


@pytest.fixture
def roots(tmp_path: Path) -> tuple[Path, ...]:
    folders = (tmp_path / "one", tmp_path / "two")
    for folder in folders:
        folder.mkdir()
    return folders


def test_freed_memory_is_returned_after_work_but_not_all_the_time() -> None:
    trims, now_s = [], [0.0]
    heaps = MemoryTrimmer(lambda: trims.append(now_s[0]), lambda: now_s[0])
    for moment_s in (1.0, 9.9, 10.0, 10.5, 19.9, 20.0, 300.0):
        now_s[0] = moment_s
        heaps.after_work()
    assert trims == [10.0, 20.0, 300.0]


def test_path_inside_a_root_is_made_absolute(roots: tuple[Path, ...]) -> None:
    limits = Limits(roots=roots)
    assert limits.allowed_path("maps/a.osm") == roots[0] / "maps/a.osm"
    assert limits.allowed_path(str(roots[1] / "b" / ".." / "c")) == roots[1] / "c"
    assert limits.allowed_path(str(roots[0])) == roots[0]


def test_path_outside_is_refused_with_the_roots_and_the_setting(roots: tuple[Path, ...]) -> None:
    (roots[0] / "link").symlink_to("/etc")
    (roots[0] / "loop").symlink_to(roots[0] / "loop")
    sibling = f"{roots[0]}_sibling"
    outside = ["/etc/passwd", "../three/a", "../../../etc/passwd", "link/passwd", "~/x", "~nobody_at_all/x", sibling]
    for text in [*outside, "loop/x", "null\x00byte"]:
        with pytest.raises(OutsideRoots) as caught:
            Limits(roots=roots).allowed_path(text)
        assert caught.value.valid == tuple(map(str, roots))
        assert "PLANNERFORGE_ROOTS" in caught.value.next_step


def test_a_file_that_is_too_large_is_refused_before_it_is_read(roots: tuple[Path, ...]) -> None:
    path = roots[0] / "large.xml"
    with path.open("wb") as stream:
        stream.truncate(2_000_001)
    Limits(roots=roots, file_bytes=2_000_001).check_size(path)
    with pytest.raises(UnsafeInput, match="2,000,001 bytes; the limit is 2,000,000") as refusal:
        Limits(roots=roots, file_bytes=2_000_000).check_size(path)
    assert "file_mb" in refusal.value.text


@pytest.mark.parametrize("text", ["", "  ", "\t"])
def test_an_empty_path_is_refused(roots: tuple[Path, ...], text: str) -> None:
    with pytest.raises(InvalidRequest, match="is empty"):
        Limits(roots=roots).allowed_path(text)


def test_a_path_a_thousand_folders_deep_is_refused_in_a_line(roots: tuple[Path, ...]) -> None:
    with pytest.raises(InvalidRequest, match="folders deep") as refusal:
        Limits(roots=roots).allowed_path("a/" * 1_000)
    assert len(refusal.value.text) < 300


@pytest.mark.skipif(sys.platform != "linux", reason="bounds of other systems differ")
def test_bounded_process_gets_a_memory_error_instead_of_the_machine() -> None:
    program = (
        "from plannerforge.engine.execution import limit_memory\n"
        "limit_memory(200 * 1024**2)\n"
        "try:\n    bytearray(400 * 1024**2)\nexcept MemoryError:\n    print('bounded')"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "bounded"


HEAPS = """
import ctypes, sys, threading
system = ctypes.CDLL(None)
if not hasattr(system, "malloc_info") or not hasattr(system, "mallopt"):
    sys.exit("not glibc")
from plannerforge.engine.execution import share_heaps
share_heaps()
all_there = threading.Barrier(13)
def take():
    bytearray(10_000)  # from the heap of this thread: Python keeps smaller things in its own places
    all_there.wait()
    all_there.wait()
threads = [threading.Thread(target=take, daemon=True) for _ in range(12)]
for thread in threads:
    thread.start()
all_there.wait()
system.fopen.restype = system.fdopen.restype = ctypes.c_void_p
out = ctypes.c_void_p(system.fdopen(1, b"w"))
system.malloc_info(0, out)
system.fflush(out)
all_there.wait()
"""


def heaps_of_twelve_threads(more: Mapping[str, str]) -> int:
    """How many heaps glibc has for threads that live at once."""
    usual = {name: value for name, value in os.environ.items() if name not in ("MALLOC_ARENA_MAX", "GLIBC_TUNABLES")}
    done = subprocess.run([sys.executable, "-c", HEAPS], capture_output=True, text=True, env={**usual, **more})
    if "not glibc" in done.stderr:
        pytest.skip("another C library")
    assert done.returncode == 0, done.stderr
    return done.stdout.count("<heap nr=")


@pytest.mark.skipif(sys.platform != "linux", reason="mallopt is glibc's")
def test_any_number_of_threads_shares_two_heaps() -> None:
    assert heaps_of_twelve_threads({}) == 2


@pytest.mark.skipif(sys.platform != "linux", reason="mallopt is glibc's")
def test_a_number_of_heaps_in_the_environment_is_kept() -> None:
    assert heaps_of_twelve_threads({"MALLOC_ARENA_MAX": "5"}) == 5
    assert heaps_of_twelve_threads({"GLIBC_TUNABLES": "glibc.malloc.arena_max=3"}) == 3


@pytest.mark.skipif(sys.platform != "linux", reason="prctl is Linux's")
def test_a_program_ends_if_its_parent_ended_before_it_could_watch_it() -> None:
    program = "import os\nfrom plannerforge.engine.execution import end_with_parent\nend_with_parent({})\nprint('on')"
    alive = subprocess.run([sys.executable, "-c", program.format("os.getppid()")], capture_output=True, check=False)
    assert (alive.returncode, alive.stdout) == (0, b"on\n")
    orphan = subprocess.run([sys.executable, "-c", program.format("1 << 22")], capture_output=True, check=False)
    assert (orphan.returncode, orphan.stdout) == (-signal.SIGKILL, b"")


def test_a_program_ends_with_the_killed_process_that_started_it() -> None:
    program = (
        "import subprocess, sys, time\n"
        "from plannerforge.engine.execution import end_with_parent\n"
        "child = subprocess.Popen(['sleep', '600'], preexec_fn=end_with_parent)\n"
        "print(child.pid, flush=True)\ntime.sleep(600)"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True) as started:
        assert started.stdout is not None
        child = psutil.Process(int(started.stdout.readline()))
        started.kill()
        child.wait()
    assert not child.is_running()
