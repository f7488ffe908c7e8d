"""Scratch folders of servers that were killed are removed, those of others stay."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from plannerforge.engine.workspace import artifacts as scratch
from plannerforge.engine.workspace.artifacts import ABANDONED_S, Workspace


def pid_of_the_dead() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


@pytest.mark.parametrize(
    ("owner", "age_s", "stays"),
    [("dead", 2 * ABANDONED_S, False), ("dead", ABANDONED_S / 2, True), ("nobody", 2 * ABANDONED_S, True)],
)
def test_a_folder_is_deleted_an_hour_after_its_owner_ended(
    tmp_path: Path, owner: str, age_s: float, *, stays: bool
) -> None:
    name = f"{pid_of_the_dead()}-abc" if owner == "dead" else "of-a-user"
    left = tmp_path / "scratch" / name
    left.mkdir(parents=True)
    (left / "scenario.xml").write_text("half", encoding="utf-8")
    os.utime(left, (time.time() - age_s, time.time() - age_s))
    workspace = Workspace(tmp_path)
    with workspace.scratch() as folder:
        assert folder.is_dir()
        assert left.is_dir() == stays


def test_a_process_that_runs_keeps_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scratch, "ABANDONED_S", -1.0)
    with Workspace(tmp_path).scratch() as folder, Workspace(tmp_path).scratch():
        assert folder.is_dir()
