"""Claims on work: one maker at a time, and none that is gone stands in the way."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from plannerforge.engine.execution.claims import Claims
from plannerforge.engine.workspace.artifacts import Workspace
from plannerforge.engine.workspace.database import still_runs


@pytest.fixture
def workspace(tmp_path: Path) -> Iterator[Workspace]:
    opened = Workspace(tmp_path)
    yield opened
    opened.close()


def enter(workspace: Workspace, pid: int, made_at: float) -> None:
    with workspace.database.writing() as connection:
        connection.execute("INSERT INTO claims VALUES ('abc', ?, ?)", (pid, made_at))


def test_a_claim_excludes_all_others_until_it_is_released(workspace: Workspace) -> None:
    claims = Claims(workspace.database)
    with claims.claimed("abc") as first, claims.claimed("abc") as second, claims.claimed("def") as other:
        assert (first, second, other) == (True, False, True)
    with claims.claimed("abc") as again:
        assert again


def test_claim_is_released_when_the_work_fails(workspace: Workspace) -> None:
    claims = Claims(workspace.database)
    with pytest.raises(ValueError, match="broken"), claims.claimed("abc"):
        raise ValueError("broken")
    with claims.claimed("abc") as again:
        assert again


def test_claim_of_a_process_that_runs_is_kept(workspace: Workspace) -> None:
    enter(workspace, os.getppid(), time.time())
    with Claims(workspace.database).claimed("abc") as ours:
        assert not ours


def test_a_claim_of_an_ended_process_is_ignored(workspace: Workspace) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    enter(workspace, gone.pid, time.time())
    with Claims(workspace.database).claimed("abc") as ours:
        assert ours


def test_a_reused_process_id_does_not_own_older_claims(workspace: Workspace) -> None:
    assert still_runs(os.getpid(), time.time())
    assert not still_runs(os.getpid(), 1000.0)
    enter(workspace, os.getppid(), 1000.0)
    with Claims(workspace.database).claimed("abc") as ours:
        assert ours
