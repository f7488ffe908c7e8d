"""The notebook of the documentation: twelve lines from the installation to thirty runs of an own planner."""

import json
from pathlib import Path

import pandas
import pytest
from support.tree import CHECKOUT, loaded_script

NOTEBOOK = CHECKOUT / "docs" / "examples" / "thirty_runs.ipynb"


def test_the_notebook_contains_the_executed_cells() -> None:
    stored = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    written = loaded_script("record_notebook").cells()
    assert ["".join(cell["source"]) for cell in stored] == [cell["source"] for cell in written]
    shown = [cell for cell in stored if cell["cell_type"] == "code" and cell["outputs"]]
    assert len(shown) == 3
    assert not [output for cell in shown for output in cell["outputs"] if output["output_type"] == "error"]


@pytest.mark.usefixtures("starter_ready", "warm_workers")
def test_twelve_lines_make_a_table_of_runs_of_an_own_planner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = loaded_script("record_notebook")
    lines = [line for line in f"{script.INSTALL}\n{script.PROGRAM}".splitlines() if line]
    assert len(lines) <= 12
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PLANNERFORGE_WARM_UP", "false")
    assert "limit=10" in script.PROGRAM  # two scenarios tell as much as ten whether the lines run
    *program, table = script.PROGRAM.replace("limit=10", "limit=2").splitlines()
    names: dict[str, object] = {"__name__": "notebook"}
    exec(compile("\n".join(program), NOTEBOOK.name, "exec"), names)
    try:
        shown = eval(table, names)
    finally:
        exec("workspace.close()", names)
    assert isinstance(shown, pandas.DataFrame)
    assert shown.shape == (2, 3)
    assert not shown.isna().to_numpy().any()
