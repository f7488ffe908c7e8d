"""The programs of docs/python.md run as they are printed."""

import contextlib
import io
import re
from pathlib import Path

import pytest
from support.tree import CHECKOUT

PROGRAMS = re.findall(r"```python\n(.*?)```", (CHECKOUT / "docs" / "python.md").read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.usefixtures("starter_ready", "warm_workers")
@pytest.mark.parametrize("program", PROGRAMS, ids=["planners by name", "an own planner"])
def test_a_printed_program_runs(program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PLANNERFORGE_WARM_UP", "false")
    shorter = program.replace("limit=3", "limit=1")  # one scenario tells as much whether the program runs
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(shorter, "docs/python.md", "exec"), {"__name__": "printed"})
    assert said.getvalue().strip()
