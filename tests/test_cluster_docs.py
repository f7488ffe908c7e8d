"""docs/cluster.md: the commands that it shows are such that Dask and the server take them."""

import ast
import re
import shlex
from pathlib import Path

import click
import pytest
import yaml
from distributed.cli import dask_scheduler, dask_worker

from benchmarks.tuning.cluster import UNOBSERVED
from plannerforge.server.settings import Settings

DOCS = Path(__file__).parents[1] / "docs"
COMMANDS = {"scheduler": dask_scheduler.main, "worker": dask_worker.main}


def shown_commands() -> list[list[str]]:
    """Every ``dask …`` of the page and of the Kubernetes file, as words."""
    page = (DOCS / "cluster.md").read_text(encoding="utf-8")
    found = [shlex.split(line, comments=True) for line in page.splitlines() if line.startswith("dask ")]
    documents = yaml.safe_load_all((DOCS / "examples/cluster/kubernetes.yaml").read_text(encoding="utf-8"))
    for document in documents:
        template = document["spec"].get("template")
        found += [container["command"] for container in template["spec"]["containers"]] if template else []
    return found


@pytest.mark.parametrize("words", shown_commands(), ids=" ".join)
def test_every_shown_command_is_accepted_by_dask(words: list[str]) -> None:
    command = COMMANDS[words[1]]
    assert isinstance(command, click.Command)
    command.make_context(words[1], words[2:], resilient_parsing=False)


def test_the_setting_exists_in_the_server() -> None:
    page = (DOCS / "cluster.md").read_text(encoding="utf-8")
    variables = set(re.findall(r"PLANNERFORGE_([A-Z]+)=", page))
    assert variables == {"CLUSTER"}
    assert "cluster" in Settings.model_fields


def test_the_slurm_script_is_python_and_names_the_scheduler_file() -> None:
    tree = ast.parse((DOCS / "examples/cluster/slurm_cluster.py").read_text(encoding="utf-8"))
    (call,) = (
        node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == "SLURMCluster"
    )
    assert {"cores", "memory", "walltime", "scheduler_options"} <= {keyword.arg for keyword in call.keywords}


def test_workers_settings_match_those_of_the_bench() -> None:
    shown = (DOCS / "cluster.md").read_text(encoding="utf-8")
    assert {line for line in shown.splitlines() if line.startswith("DASK_")} == {
        f"{name}={value}" for name, value in UNOBSERVED.items()
    }
