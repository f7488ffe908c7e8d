"""Records the planners' outcomes over a folder of scenarios, and compares two versions of the code.

``measure`` runs each planner under each prediction and traffic over the folder, with this checkout or the one that
``--checkout`` gives, and adds one JSON row per run to a file. It skips runs that the file already holds. ``compare``
prints the outcomes of two such files side by side, and lists each run with a changed outcome::

    python -m benchmarks.planners.outcomes measure --checkout ../before --out before.jsonl
    python -m benchmarks.planners.outcomes measure --out after.jsonl
    python -m benchmarks.planners.outcomes compare before.jsonl after.jsonl
"""

import argparse
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from ..harness import existing, scenario_files, shared_scenarios

CHECKOUT = Path(__file__).resolve().parents[2]
_CONFIGURATIONS = ("frenetix:Default", "idm:Default", "mp_rbfn:Default")
_PREDICTIONS = ("ground_truth", "constant_velocity")
_TRAFFIC = ("recorded", "reactive")
_KEY = ("scenario", "configuration", "prediction", "traffic")
Row = dict[str, Any]
Key = tuple[str, ...]
_AT_GOAL = ("goal_reached", "goal_refused")
"""Outcomes of egos that reached the goal; older checkouts do not test whether the benchmark accepts the motion."""
_FAILED = "no run"
"""The outcome of a run that could not be made."""


def measured(wanted: Sequence[Row], checkout: Path) -> Iterator[Row]:
    """Yield the row of each cell, run with the code of a checkout in a process of its own.

    A process that ends over a cell gives a row without an outcome, and the next cell gets a new process.
    """
    process: subprocess.Popen[str] | None = None
    try:
        for cell in wanted:
            process = process or _driver(checkout)
            row = _run_cell(process, cell)
            if row is None:
                error = f"the process ended with {process.wait()}"
                key = {name: cell[name] for name in _KEY[1:]}
                row, process = {"scenario": Path(cell["file"]).stem, **key, "outcome": None, "error": error}, None
            yield row
    finally:
        if process is not None:
            process.kill()
            process.wait()


def _driver(checkout: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-P", str(Path(__file__).with_name("outcomes_driver.py"))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": str(checkout)},
    )


def _run_cell(process: "subprocess.Popen[str]", cell: Row) -> Row | None:
    """Return the driver's row for a cell, or None if the driver has ended."""
    if process.stdin is None or process.stdout is None:
        return None
    try:
        process.stdin.write(json.dumps(cell) + "\n")
        process.stdin.flush()
    except BrokenPipeError:
        return None
    line = process.stdout.readline()
    return json.loads(line) if line else None


def cells(
    files: Sequence[Path], configurations: Sequence[str], predictions: Sequence[str], traffic: Sequence[str]
) -> list[Row]:
    """Return every combination that exists: reactive traffic has no recorded future, so no ground truth."""
    return [
        {"file": str(path), "configuration": configuration, "prediction": prediction, "traffic": mode}
        for configuration, prediction, mode in product(configurations, predictions, traffic)
        if (prediction, mode) != ("ground_truth", "reactive")
        for path in files
    ]


def _key(row: Row) -> Key:
    return tuple(str(row[name]) for name in _KEY)


def read_rows(path: Path) -> dict[Key, Row]:
    """Read a file of rows by scenario, configuration, prediction and traffic."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return {_key(row): row for row in map(json.loads, lines)}


def outcome_of(row: Row) -> str:
    """Return the outcome of a row, or that there was no run."""
    return row["outcome"] or _FAILED


def _measure(given: argparse.Namespace) -> None:
    files = scenario_files(existing(given.folder), given.limit)
    known = read_rows(given.out)
    wanted = [
        cell
        for cell in cells(files, given.configurations, given.predictions, given.traffic)
        if (Path(cell["file"]).stem, *(cell[name] for name in _KEY[1:])) not in known
    ]
    with given.out.open("a", encoding="utf-8") as out:
        for row in measured(wanted, given.checkout.resolve()):
            out.write(json.dumps(row) + "\n")
            out.flush()


def _compare(given: argparse.Namespace) -> None:
    before, after = read_rows(given.before), read_rows(given.after)
    both = sorted(before.keys() & after.keys(), key=lambda key: (key[1:], key[0]))
    console = Console(width=150)
    for group in sorted({key[1:] for key in both}):
        keys = [key for key in both if key[1:] == group]
        counts = [Counter(outcome_of(rows[key]) for key in keys) for rows in (before, after)]
        table = Table("outcome", "before", "after", title=f"{', '.join(group)} (n {len(keys)})")
        for outcome in sorted(counts[0] | counts[1]):
            table.add_row(outcome, str(counts[0][outcome]), str(counts[1][outcome]))
        at_goal = [sum(counted[outcome] for outcome in _AT_GOAL) for counted in counts]
        table.add_row("at the goal, by the paper's rule", *map(str, at_goal))
        beyond = [sum(bool(rows[key].get("beyond_vehicle")) for key in keys) for rows in (before, after)]
        table.add_row("beyond the vehicle's limits", *map(str, beyond))
        console.print(table)
        for key in keys:
            if outcome_of(before[key]) != outcome_of(after[key]):
                words = after[key].get("reason") or after[key].get("error")
                console.print(f"  {key[0]}: {outcome_of(before[key])} → {outcome_of(after[key])}: {words}")


def _main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    measure = commands.add_parser("measure", help="run planners and add the rows to a file")
    measure.add_argument("--checkout", type=Path, default=CHECKOUT, help="the checkout that runs (default: this one)")
    measure.add_argument("--folder", type=Path, default=shared_scenarios())
    measure.add_argument("--out", type=Path, required=True)
    measure.add_argument("--limit", type=int, default=None, help="only a sample of this many files")
    measure.add_argument("--configurations", nargs="+", default=_CONFIGURATIONS)
    measure.add_argument("--predictions", nargs="+", default=_PREDICTIONS)
    measure.add_argument("--traffic", nargs="+", default=_TRAFFIC)
    measure.set_defaults(command=_measure)
    compare = commands.add_parser("compare", help="say what moved between two files of rows")
    compare.add_argument("before", type=Path)
    compare.add_argument("after", type=Path)
    compare.set_defaults(command=_compare)
    given = parser.parse_args()
    given.command(given)


if __name__ == "__main__":
    _main()
