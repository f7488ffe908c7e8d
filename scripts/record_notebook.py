"""Write and execute ``docs/examples/thirty_runs.ipynb``: ``make notebook``.

The notebook runs in a new workspace, as after a new installation, and keeps the output of its cells.
"""

import os
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).resolve().parent.parent / "docs" / "examples" / "thirty_runs.ipynb"
INSTALL = "%pip install --quiet plannerforge-mcp"
PROGRAM = """\
import plannerforge as pf

class MyPlanner:
    def __init__(self, speed_mps):
        self.speed_mps = speed_mps
    def reset(self, task):
        self.route = pf.RouteFollower(task)
    def plan(self, observation):
        return pf.Plan(self.route.trajectory(observation.ego, self.speed_mps))

workspace = pf.Workspace("workspace")
runs = workspace.run(workspace.find(limit=10), {"slow": MyPlanner(5), "steady": MyPlanner(8), "fast": MyPlanner(11)})
runs.to_pandas()[["scenario_id", "config_name", "outcome"]].pivot(index="scenario_id", columns="config_name")"""


def cells() -> list[nbformat.NotebookNode]:
    """Return the cells without output."""
    text, code = nbformat.v4.new_markdown_cell, nbformat.v4.new_code_cell
    made = [
        text(
            "# Thirty runs of your own planner\n\n"
            "A planner is a class with `reset` and `plan`. This one drives along its route at one speed and looks at "
            "no other road user, so it is easy to beat. The package includes 32 scenarios; ten of them "
            "are run here."
        ),
        code(INSTALL),
        code(PROGRAM),
        text("Did it matter how fast it drives? `compare` pairs the runs of each scenario."),
        code("workspace.compare(runs)"),
        text("A run can be looked at, here one that ended in a collision."),
        code('next(run for run in runs if run.outcome == "collision").plot()'),
        text(
            "A breakpoint in `plan()` stops there, because your planner drives in this process. Change the class, run "
            "the cell again, and only what changed is driven anew.\n\n[From Python](../python.md) has all methods."
        ),
        code("workspace.close()"),
    ]
    for number, cell in enumerate(made):
        cell["id"] = f"cell-{number}"  # the same bytes for the same cells
    return made


def executed(folder: Path) -> nbformat.NotebookNode:
    """Return the notebook with the output of its cells, run in a folder without installing anything."""
    notebook = nbformat.v4.new_notebook(cells=cells())
    notebook.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3", "language": "python"}
    runnable = nbformat.v4.new_notebook(
        cells=[cell for cell in notebook.cells if cell.source != INSTALL], metadata=notebook.metadata
    )
    NotebookClient(
        runnable, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(folder)}}, record_timing=False
    ).execute()
    notebook.metadata.pop("language_info", None)
    for cell in runnable.cells:
        for output in cell.get("outputs", []):
            if "text/html" in output.get("data", {}):  # which is what people see; the other names this run's folder
                output["data"]["text/plain"] = "shown as HTML"
    return notebook


def main() -> None:
    """Run the notebook and write it."""
    os.environ["PLANNERFORGE_WARM_UP"] = "false"
    with tempfile.TemporaryDirectory() as folder:
        notebook = executed(Path(folder))
    nbformat.validate(notebook)
    NOTEBOOK.write_text(nbformat.writes(notebook) + "\n", encoding="utf-8")
    sys.stdout.write(f"{NOTEBOOK}\n")


if __name__ == "__main__":
    main()
