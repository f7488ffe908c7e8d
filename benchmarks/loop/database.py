"""``make bench-database FOLDER=FOLDER``: every scenario of a folder under the planners, in the product's workers.

The intended folder is a download of the public CommonRoad database with over 2,000 scenarios; any folder of CommonRoad
files works. Each run is one request to a warm worker process, as in the product. The journal (``--out``) has one JSON
line per run and is not repeated, so an interrupted bench resumes. Refused files are listed with the reason and count in
no share.

Success means that the goal is reached and that CommonRoad's benchmark accepts the motion (``success_rule`` of the run).
A table by kind of scenario goes to standard error. The kind is the first folder below the given one, or the ``source``
of a file directly in it.

If the folder holds scenarios that FISS's authors measured, these run again in the authors' way: CommonRoad's vehicle 3
(VW Vanagon), a plan at every step, five end states per dimension, a horizon of 5 s, the recording as prediction. The
authors' figures (fiss-planner 1.0.0, docs/benchmarks.md, on an Intel Core i9-12900K) use a smoother that this project
does not have: ``fop`` 70.7 % success, 2.1 % collisions, 8.7 ms per plan; ``fiss`` 69.3 %, 1.4 %, 0.6 ms; without it
61.8 %, 2.1 % and 61.1 %, 2.1 %.

Keys:

- ``scenarios``, ``refused``; ``lost``: runs that ended with an error of ours.
- ``runs_per_second``: of Frenetix, over the time that its runs took (the journal counts earlier parts);
  ``runs_per_second_PLANNER``.
- ``beyond_limits``: the largest share among all planners of motions that exceed a limit of the vehicle.
- ``success_PLANNER``, ``collisions_PLANNER``: shares of the runs that could be attempted.
- ``authors_scenarios``: how many of the 280 are in the folder; on these ``authors_success_SEARCH``,
  ``authors_collisions_SEARCH``, and the medians ``authors_plan_ms_SEARCH`` (a plan as the loop waits for it) and
  ``authors_core_ms_SEARCH`` (its share in the core).
"""

import argparse
import json
import re
import statistics
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files as package_files
from pathlib import Path
from typing import Any, get_args

import anyio

from plannerforge.engine.execution import Limits, WorkerPool
from plannerforge.engine.planners import PLANNERS
from plannerforge.engine.tuning import changed_configuration
from plannerforge.evals.scoring.common import built_in
from plannerforge.schemas.errors import InvalidRequest, PlannerForgeError, UnsafeInput
from plannerforge.schemas.planning import PlannerConfiguration, RunRequest, RunResponse
from plannerforge.schemas.runs import Prediction, Traffic
from plannerforge.workflows.operations import RUN_PLANNER

from ..harness import Figures, drawn, existing, print_figures

_HEAD_BYTES = 4000
"""Length of a file's beginning that contains the root element of a scenario."""
_OTHER_XML = (".net.xml", ".rou.xml", ".add.xml", ".edg.xml", ".nod.xml", ".con.xml", ".typ.xml")
"""SUMO files that accompany interactive scenarios."""
_SOURCES = {
    "ngsim": "NGSIM",
    "next generation simulation": "NGSIM",
    "scenario factory": "scenario-factory",
    "sumo": "SUMO",
    "synthesis": "hand-crafted",
}
"""Words in a file's ``source`` and their kinds; the first match counts."""
_REPORTED_EVERY = 50
DEFAULT_PLANNERS = ("frenetix", "mp_rbfn", "idm", "fiss")
"""The default planners; the reference drivers can be requested by name."""
AUTHORS = "280"
"""The turn of the scenarios of FISS's authors, in rows and tables."""
_AUTHORS_SETTINGS = ("vehicle=3", "replan_steps=1", "horizon_s=5", "sampling_level=1")
_AUTHORS_SEARCHES = {"fop": 0, "fiss": 2}


def authors_scenarios() -> frozenset[str]:
    """Return the names, without ending, of the 280 scenarios on which FISS's authors measured."""
    text = package_files(__package__).joinpath("fiss_scenarios.txt").read_text("utf-8")
    return frozenset(line for line in text.splitlines() if line and not line.startswith("#"))


@dataclass(frozen=True)
class Turn:
    """One configuration over scenario files."""

    name: str
    configuration: PlannerConfiguration
    files: Sequence[Path]
    prediction: Prediction
    traffic: Traffic

    def key(self, path: Path) -> tuple[str, str, str, str]:
        """Return the key of a run of this turn in the journal."""
        return self.configuration.config_id, self.prediction, self.traffic, str(path)


@dataclass
class Journal:
    """The rows of all runs, on disk as JSON lines; half a line at the end, of a bench that was killed, is left out."""

    path: Path
    rows: dict[tuple[str, str, str, str], dict[str, Any]] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path) -> "Journal":
        """Return the journal of a file; it is empty if there is no file."""
        journal = cls(path)
        if path.exists():
            whole = [line for line in path.read_bytes().splitlines(keepends=True) if line.endswith(b"\n")]
            for row in map(json.loads, whole):
                journal.rows[_key(row)] = row
            path.write_bytes(b"".join(whole))
        return journal

    def add(self, row: dict[str, Any]) -> None:
        """Write a row down."""
        self.rows[_key(row)] = row
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")

    def of(self, turn: Turn) -> list[dict[str, Any]]:
        """Return the rows of a turn, in the order of its files."""
        return [self.rows[turn.key(path)] for path in turn.files if turn.key(path) in self.rows]


def _key(row: Mapping[str, Any]) -> tuple[str, str, str, str]:
    return row["config_id"], row["prediction"], row["traffic"], row["path"]


def scenarios_in(folder: Path, limit: int | None) -> list[Path]:
    """Return the CommonRoad files below a folder, by name; with a limit always the same sample."""
    found = [path for path in folder.rglob("*.xml") if not path.name.endswith(_OTHER_XML) and _is_commonroad(path)]
    by_name = {str(path.relative_to(folder)): path for path in sorted(found)}
    return [by_name[name] for name in (drawn(by_name, limit) if limit else by_name)]


def _is_commonroad(path: Path) -> bool:
    """Return True if a file is or may be CommonRoad's: a broken file must be refused, not overlooked."""
    head = _head(path)
    root = re.search(r"<([A-Za-z][\w:.-]*)[\s>/]", re.sub(r"<!--.*?-->", "", head, flags=re.DOTALL))
    return root is None or root.group(1) == "commonRoad"


def _head(path: Path) -> str:
    with path.open("rb") as file:
        return file.read(_HEAD_BYTES).decode("utf-8", "replace")


def kind_of(path: Path, folder: Path) -> str:
    """Return the kind of a scenario: the first folder below the given one, otherwise its file's source."""
    parts = path.relative_to(folder).parts[:-1]
    if parts:
        return parts[0]
    stated = re.search(r'\ssource="([^"]*)"', _head(path))
    source = stated.group(1).lower() if stated else ""
    return next((kind for word, kind in _SOURCES.items() if word in source), "other")


def top_folder(folder: Path) -> Path:
    """Return the folder itself, or the deepest folder that holds all that it holds."""
    while True:
        inside = [child for child in folder.iterdir() if not child.name.startswith(".")]
        if len(inside) != 1 or not inside[0].is_dir():
            return folder
        folder = inside[0]


def turns_for(
    scenarios: Sequence[Path], planners: Iterable[str], prediction: Prediction, traffic: Traffic
) -> Iterator[Turn]:
    """Yield every planner over all scenarios, then FISS as its authors ran it over theirs."""
    for planner in planners:
        yield Turn(planner, built_in(f"{planner}:Default"), scenarios, prediction, traffic)
    theirs = authors_scenarios()
    own = [path for path in scenarios if path.stem in theirs]
    if own and "fiss" in planners:
        for search, number in _AUTHORS_SEARCHES.items():
            settings = (*_AUTHORS_SETTINGS, f"search={number}")
            configuration, _ = changed_configuration(built_in("fiss:Default"), None, (), settings)
            yield Turn(f"{AUTHORS} {search}", configuration, own, "ground_truth", "recorded")


async def run_turn(pool: WorkerPool, turn: Turn, journal: Journal, folder: Path) -> None:
    """Make the runs of a turn that have no row yet, as many at once as there are workers."""
    waiting = [path for path in turn.files if turn.key(path) not in journal.rows]
    before, began = len(turn.files) - len(waiting), time.perf_counter()
    queue, made = iter(waiting), 0

    async def work() -> None:
        nonlocal made
        for path in queue:
            row = await _row(pool, turn, path, kind_of(path, folder))
            made += 1
            # wall time since the last row of any worker: the sum is the turn's time
            row["clock_s"] = round(time.perf_counter() - began - sum(clocks), 4)
            clocks.append(row["clock_s"])
            journal.add(row)
            if row["error"]:
                sys.stderr.write(f"{turn.name}: {path.name}: {row['error']}\n")
            if made % _REPORTED_EVERY == 0:
                rate = made / (time.perf_counter() - began)
                sys.stderr.write(f"{turn.name}: {before + made} of {len(turn.files)} runs, {rate:.1f} a second\n")

    clocks: list[float] = []
    async with anyio.create_task_group() as group:
        for _ in range(pool.capacity):
            group.start_soon(work)


async def _row(pool: WorkerPool, turn: Turn, path: Path, kind: str) -> dict[str, Any]:
    request = RunRequest(
        run_id="run_0",
        scenario_path=str(path),
        scenario_id=path.stem,
        configuration=turn.configuration,
        prediction=turn.prediction,
        traffic=turn.traffic,
    )
    row: dict[str, Any] = {
        "turn": turn.name,
        "config_id": turn.configuration.config_id,
        "prediction": turn.prediction,
        "traffic": turn.traffic,
        "path": str(path),
        "kind": kind,
        "error": "",
        "refused": False,
    }
    try:
        response = await pool.run(RUN_PLANNER, request)
    except PlannerForgeError as error:
        refused = isinstance(error, UnsafeInput | InvalidRequest)
        return row | {"error": f"{error.code}: {error}", "refused": refused}
    return row | _measured(response)


def _measured(response: RunResponse) -> dict[str, Any]:
    record, timing = response.record, response.timing
    return {
        "scenario_id": record.scenario_id,
        "outcome": record.outcome,
        "success_rule": record.success_rule,
        "reason": record.reason,
        "beyond": [limit.name for limit in record.beyond_vehicle or ()],
        "wall_s": round(timing.wall_s, 4),
        "plan_ms": round(timing.planning_step_median_ms, 3),
        "core_ms": None if timing.core_step_median_ms is None else round(timing.core_step_median_ms, 3),
    }


def figures_of(turns: Sequence[Turn], journal: Journal) -> dict[str, float | int | str]:
    """Return the figures of the keys above, only from the journal."""
    rows = {turn.name: journal.of(turn) for turn in turns}
    every = [row for own in rows.values() for row in own]
    planners = [turn for turn in turns if not turn.name.startswith(AUTHORS)]
    found: dict[str, float | int | str] = {
        "scenarios": max((len(turn.files) for turn in planners), default=0),
        "refused": len({row["path"] for row in every if row["refused"]}),
        "lost": sum(1 for row in every if row["error"] and not row["refused"]),
    }
    beyond = []
    for turn in planners:
        done = _done(rows[turn.name])
        rate = _runs_per_second(rows[turn.name])
        found[f"runs_per_second_{turn.name}"] = rate
        if turn.name == "frenetix":
            found["runs_per_second"] = rate
        attempted = [row for row in done if row["outcome"] != "invalid"]
        found[f"success_{turn.name}"] = _share(attempted, "goal_reached")
        found[f"collisions_{turn.name}"] = _share(attempted, "collision")
        beyond.append(round(sum(bool(row["beyond"]) for row in attempted) / max(len(attempted), 1), 4))
    found["beyond_limits"] = max(beyond, default=0.0)
    for turn in turns:
        if turn.name.startswith(AUTHORS):
            found |= _figures_of_authors(turn.name.removeprefix(AUTHORS).strip(), turn, _done(rows[turn.name]))
    return found


def _figures_of_authors(search: str, turn: Turn, done: Sequence[Mapping[str, Any]]) -> dict[str, float | int]:
    """Return the figures on the authors' scenarios; a scenario that could not be attempted is not a success."""
    figures: dict[str, float | int] = {
        "authors_scenarios": len(turn.files),
        f"authors_success_{search}": _share(done, "goal_reached"),
        f"authors_collisions_{search}": _share(done, "collision"),
    }
    times = [row for row in done if row["core_ms"] is not None]
    if times:
        figures[f"authors_plan_ms_{search}"] = round(statistics.median(row["plan_ms"] for row in times), 2)
        figures[f"authors_core_ms_{search}"] = round(statistics.median(row["core_ms"] for row in times), 2)
    return figures


def _done(rows: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    return [row for row in rows if not row["error"]]


def _share(rows: Sequence[Mapping[str, Any]], outcome: str) -> float:
    return float(round(sum(row["outcome"] == outcome for row in rows) / max(len(rows), 1), 4))


def _runs_per_second(rows: Sequence[Mapping[str, Any]]) -> float:
    return float(round(len(rows) / max(sum(row["clock_s"] for row in rows), 1e-9), 2))


def table_of(turns: Sequence[Turn], journal: Journal) -> str:
    """Return outcomes by turn and kind of scenario, as Markdown."""
    lines = ["| planner | kind | runs | outcomes |", "| --- | --- | --- | --- |"]
    for turn in turns:
        by_kind: dict[str, Counter[str]] = defaultdict(Counter)
        for row in journal.of(turn):
            outcome = row["outcome"] if not row["error"] else "refused" if row["refused"] else "lost"
            by_kind[row["kind"]][outcome] += 1
        for kind, outcomes in sorted(by_kind.items()):
            told = ", ".join(f"{name} {count}" for name, count in outcomes.most_common())
            lines.append(f"| {turn.name} | {kind} | {outcomes.total()} | {told} |")
    return "\n".join(lines) + "\n"


async def measure(
    folder: Path,
    planners: Sequence[str],
    journal: Journal,
    *,
    prediction: Prediction,
    traffic: Traffic,
    limit: int | None,
    workers: int,
) -> Figures:
    """Make all runs that have no row yet, tell the table, and give the keys above."""
    top = top_folder(folder)
    scenarios = scenarios_in(top, limit)
    turns = list(turns_for(scenarios, planners, prediction, traffic))
    with tempfile.TemporaryDirectory() as scratch:
        limits = Limits(roots=(folder,), worker_count=workers, recordings=Path(scratch))
        async with WorkerPool.open(limits, Path(scratch) / "worker.log") as pool:
            for turn in turns:
                await run_turn(pool, turn, journal, top)
    sys.stderr.write(table_of(turns, journal))
    return figures_of(turns, journal)


def _main() -> int:
    """Read the command line, measure and print; return 1 if a run was lost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, required=True, help="folder of CommonRoad files, including subfolders")
    parser.add_argument("--planners", nargs="+", choices=list(PLANNERS), default=list(DEFAULT_PLANNERS))
    parser.add_argument("--prediction", choices=get_args(Prediction), default="constant_velocity")
    parser.add_argument("--traffic", choices=get_args(Traffic), default="recorded")
    parser.add_argument("--limit", type=int, help="only this many scenarios, always the same ones")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="journal of rows; existing rows are not repeated")
    given = parser.parse_args()
    folder = existing(given.folder)
    with tempfile.TemporaryDirectory() as scratch:
        journal = Journal.read(given.out or Path(scratch) / "rows.jsonl")
        figures = anyio.run(
            lambda: measure(
                folder,
                given.planners,
                journal,
                prediction=given.prediction,
                traffic=given.traffic,
                limit=given.limit,
                workers=given.workers,
            )
        )
    print_figures("Database", figures)
    return 1 if figures["lost"] else 0


if __name__ == "__main__":
    sys.exit(_main())
