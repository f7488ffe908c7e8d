"""Faulty planner programs, listed in a settings file and run from the command line, as a user does.

One batch holds a program for each kind of failure, a working one, and Frenetix. The run of a faulty program must be
lost with a ``planner_failure`` that names the planner and its fault. The others must run, and no process or file of a
program may be left.

Keys: ``own_faults_named``: share of the kinds of failure reported this way; ``own_faults``: number of kinds;
``own_beside``: share of the other runs that were made; ``own_left``: processes and files left behind.
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import psutil

from ..harness import Figures, SeededBench, scenario_files, share

FAULTS: Mapping[str, str] = {
    "hangs": "no answer within 4 s",
    "floods": "more than 1 MB to standard output",
    "writes": "more than 8 MB",
    "exits": "exit status 3",
    "not_a_number": "trajectory.speed_mps.3",
    "other_scenario": "ZAM_Elsewhere-1_1_T-1",
    "dies": "signal 11",
}
"""Kinds of failure, and the required report of each."""
_DRIVES, _COMPANION = "drives", "frenetix"
_PROGRAM = Path(__file__).with_name("faulty_program.py")
_LIMITS = {"time_s": 4, "output_mb": 1, "folder_mb": 8}


def measure(bench: SeededBench) -> Figures:
    """Measure the keys above."""
    folder = bench.folder("own planners")
    settings = folder / "settings" / "plannerforge"
    settings.mkdir(parents=True)
    names = (*FAULTS, _DRIVES)
    (settings / "plannerforge.toml").write_text("".join(map(_section, names)), encoding="utf-8")
    temporary = folder / "temporary"
    temporary.mkdir()
    _call(folder, bench.shared, "import_files", path=str(scenario_files(bench.shared / "data" / "commonroad", 1)[0]))
    answer = _call(folder, bench.shared, "run_planner", scenarios=["preset:1"], configs=[*names, _COMPANION])
    told = {name: _failure_text(answer, name) for name in FAULTS}
    for name, text in told.items():
        sys.stderr.write(f"{name}: {text}\n")
    made = {line["config_name"].partition(":")[0] for line in answer["runs"]}
    running = [one for one in psutil.process_iter(["cmdline"]) if str(_PROGRAM) in (one.info["cmdline"] or ())]
    return {
        "own_faults_named": share(_is_named(name, text) for name, text in told.items()),
        "own_faults": len(FAULTS),
        "own_beside": share(name in made for name in (_DRIVES, _COMPANION)),
        "own_left": len(running) + sum(1 for _ in temporary.iterdir()),
    }


def _section(name: str) -> str:
    """Return the section of the settings file for a program."""
    limits = "".join(f"{key} = {value}\n" for key, value in _LIMITS.items())
    command = json.dumps([sys.executable, "-S", str(_PROGRAM), name])
    return f'[planners.{name}]\nsummary = "a program that {name}"\ncommand = {command}\n{limits}\n'


def _call(folder: Path, shared: Path, tool: str, **arguments: Any) -> Any:
    """Return the structured answer of a tool called by the command line.

    Raises:
        RuntimeError: the call failed.
    """
    command = [sys.executable, "-m", "plannerforge", "call", tool, json.dumps(arguments), "--json"]
    options = ["--workspace", str(folder / "workspace"), "--roots", str(shared), "--workers", "2"]
    environment = {
        **os.environ,
        "XDG_CONFIG_HOME": str(folder / "settings"),
        "TMPDIR": str(folder / "temporary"),
        "PLANNERFORGE_STARTER": "false",
    }
    done = subprocess.run([*command, *options], env=environment, capture_output=True, text=True, check=False)
    if not done.stdout.strip():
        raise RuntimeError(f"{tool} ended with {done.returncode}: {done.stderr[-2000:]}")
    return json.loads(done.stdout)


def _failure_text(answer: Any, name: str) -> str:
    """Return the report on the run that a planner lost, or an empty one."""
    return next((cell["error"] for cell in answer["lost"] if f"planner {name} " in cell["error"]), "")


def _is_named(name: str, text: str) -> bool:
    return text.startswith(f"[planner_failure] planner {name} ") and FAULTS[name] in text
