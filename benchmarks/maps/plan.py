"""Runs a coverage plan over all maps in one batch, and kills its server twice without notice.

Keys:

- ``batch_scenarios``: generated. ``batch_per_min``: scenarios per minute from the plan's call to its end, including
  both restarts (the maps are read before, in ``batch_maps_s``). ``batch_cpu_s``: processor time of server and workers
  for each.
- ``batch_memory_slope_mb``: memory growth of the server and its workers per thousand scenarios, one slope over all
  samples, for each server after its first ``_WARM`` scenarios. ``batch_server_slope_mb``: the same for the server
  alone. Both are omitted with fewer than two samples.
- ``batch_server_mb``, ``batch_memory_mb``: peak memory of the server and of all processes.
- ``batch_disk_kb``: size of the workspace per scenario, without its maps and the recordings cached by workers (512 MB
  at most).
- ``batch_kills``, ``batch_refused`` (attempts), ``batch_failed``.
- ``batch_lost``: scenarios with a missing or broken file or record, that vanished in a kill, that were generated twice,
  or that are missing from the requested ones.
- ``coverage_2way``: of the pairs of levels that the maps allow, the share that the files show by type, density, classes
  and turn. ``coverage_pairs``: their number without ``batch_cannot``. ``coverage_asked``: the share of all pairs,
  including refused ones.
- ``batch_cannot``: the pairs that were refused three times and never generated although a map holds the site type and
  the type has the turn (listed on standard error).
- ``batch_shown``: share of the judged levels that the files show.

``evals/scoring/made_files.py`` judges the files as for single generations. Turns follow from the ego's heading at its
start and goal, or from the classes of the roads there. Lane changes are not judged.
"""

import json
import math
import os
import sqlite3
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations, product
from pathlib import Path
from typing import Any, get_args

import anyio
import numpy as np
import psutil
from lxml import etree
from mcp import Client, StdioServerParameters, stdio_client

from plannerforge.engine.geometry import Points
from plannerforge.engine.network import NetEdge
from plannerforge.evals.scoring.made_files import MadeFiles, judge_density, shows_type
from plannerforge.evals.scoring.map_evidence import MapEvidence, read_evidence
from plannerforge.schemas.generation import TURNS_AT, Density, SiteType, Turn

from ..harness import Figures, as_measured, ask, process_pool, share
from .bench import MapsBench

CLASSES = ("cars", "truck", "bus", "bicycle", "motorcycle")
LEVELS: Mapping[str, tuple[str, ...]] = {
    "scenario_type": get_args(SiteType),
    "density": get_args(Density),
    "vehicles": CLASSES,
    "turn": get_args(Turn),
}
_KILLS = 2
_LOOK_S = 2.0
"""Time between two samples of progress and memory (chosen)."""
_WARM = 60
"""Scenarios of a server before its memory counts: workers load libraries and maps first (chosen)."""
_JUDGED = 400
"""Number of judged scenarios, evenly spaced; more only for pairs that these do not show (chosen)."""
_TURNED_RAD = (math.radians(20.0), math.radians(170.0))
"""Range of the change of heading between start and goal in a turn (chosen: streets bend before and after it)."""
_FAST = frozenset({"motorway", "trunk"})
Pair = tuple[tuple[str, str], tuple[str, str]]
Row = tuple[str, ...]
"""A level of each factor, in the order of ``LEVELS``."""


@dataclass
class _Watch:
    """The observations during the plan: memory by number of scenarios, for each server."""

    server: list[list[tuple[int, float]]] = field(default_factory=list)
    all_of_it: list[list[tuple[int, float]]] = field(default_factory=list)
    there_at_kills: list[frozenset[str]] = field(default_factory=list)
    plan: dict[str, Any] = field(default_factory=dict)
    cpu_s: dict[tuple[int, float], float] = field(default_factory=dict)
    maps_s: float = 0.0
    batch_s: float = 0.0
    asked: int = 0


@dataclass(frozen=True)
class End:
    """The condition for killing a server: a number of scenarios, or a time of ``perf_counter``."""

    made: int | None
    moment_s: float | None

    def is_reached(self, made: int) -> bool:
        """Return True if it must be killed now."""
        enough = self.made is not None and made >= self.made
        return enough or (self.moment_s is not None and time.perf_counter() >= self.moment_s)


def measure(bench: MapsBench) -> Figures:
    """Carry out the plan, kill its server twice, and judge the result."""
    folder = bench.folder("plan")
    watch = _Watch()
    anyio.run(_carry_out, bench, folder, watch)
    workspace = folder / "workspace"
    made = _made(workspace)
    with process_pool(bench.workers) as pool:
        shown = _shown(made, workspace, partial(pool.map, chunksize=1))
    levels = [is_shown for row in shown.values() for is_shown in row]
    allowed, cannot = _pairs_to_cover(workspace)
    covered = {pair for number, row in shown.items() for pair in _pairs_of(made[number].row, row)} & allowed
    for pair in sorted(allowed - covered):
        sys.stderr.write(f"no made file shows {' + '.join('='.join(part) for part in pair)}\n")
    for pair, reason in sorted(cannot.items()):
        sys.stderr.write(f"cannot be: {' + '.join('='.join(part) for part in pair)}: {reason}\n")
    held = [value for life in watch.all_of_it for _, value in life]
    return as_measured(
        {
            "batch_scenarios": len(made),
            "batch_per_min": round(len(made) / watch.batch_s * 60, 2),
            "batch_cpu_s": round(sum(watch.cpu_s.values()) / max(len(made), 1), 2),
            "batch_maps_s": round(watch.maps_s, 1),
            "batch_memory_slope_mb": slope_mb(watch.all_of_it),
            "batch_server_slope_mb": slope_mb(watch.server),
            "batch_server_mb": round(max(value for life in watch.server for _, value in life), 1),
            "batch_memory_mb": round(max(held), 1),
            "batch_disk_kb": round(_disk_bytes(workspace) / 1024 / max(len(made), 1), 1),
            "batch_kills": len(watch.there_at_kills),
            "batch_lost": len(_lost(workspace, made, watch, watch.asked)),
            "batch_refused": int(watch.plan["refused"]),
            "batch_failed": int(watch.plan["failed"]),
            "batch_shown": share(levels),
            "batch_cannot": len(cannot),
            "coverage_pairs": len(allowed),
            "coverage_asked": round(len(covered) / max(len(allowed) + len(cannot), 1), 4),
            "coverage_2way": round(len(covered) / max(len(allowed), 1), 4),
        }
    )


async def _carry_out(bench: MapsBench, folder: Path, watch: _Watch) -> None:
    """Carry out the plan from its first call to its end, over as many servers as necessary."""
    cover = [f"{name}={'|'.join(levels)}" for name, levels in LEVELS.items()]
    wish = {"cover": cover, "count": bench.scenarios}
    started = time.perf_counter()
    async with _server(bench, folder) as client:
        await ask(client, "generate_scenarios", duration_s=5)  # reads the maps
    watch.maps_s = time.perf_counter() - started
    started = time.perf_counter()
    workspace = folder / "workspace"
    for number in range(_KILLS + 1):
        share = (number + 1) / (_KILLS + 1)
        end = End(
            made=int(bench.scenarios * share) if number < _KILLS else None,
            moment_s=None if bench.minutes is None else started + 60 * bench.minutes * share,
        )
        with suppress(Exception):
            async with _server(bench, folder) as client:
                await _one_server(client, wish, workspace, watch, end)
        if not watch.plan:
            watch.there_at_kills.append(frozenset(_stored_files(workspace)))
    watch.batch_s = time.perf_counter() - started
    watch.asked = bench.scenarios
    if not watch.plan and bench.minutes is not None:  # time is up: the results so far count
        watch.asked = _count_made(workspace)
        async with _server(bench, folder) as client:
            watch.plan = (await ask(client, "generate_scenarios", **{**wish, "count": watch.asked}))["plan"]
    if not watch.plan:
        raise RuntimeError("the plan did not finish")
    if not any(watch.server):
        raise RuntimeError(f"no server made {_WARM} scenarios, so the memory could not be measured; allow more minutes")


def _server(bench: MapsBench, folder: Path) -> Client:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PLANNERFORGE_")}
    environment |= {"PLANNERFORGE_WARM_UP": "false", "PLANNERFORGE_STARTER": "false", "PLANNERFORGE_JOURNAL": "false"}
    environment |= {"PLANNERFORGE_MAP_FOLDERS": str(bench.maps), "PLANNERFORGE_WORKERS": str(bench.workers)}
    serve = ["-m", "plannerforge", "serve", "--workspace", str(folder / "workspace"), "--roots", str(folder)]
    server = StdioServerParameters(command=sys.executable, args=serve, env=environment, cwd=str(folder))
    return Client(stdio_client(server), cache=None)


async def _one_server(client: Client, wish: Mapping[str, Any], workspace: Path, watch: _Watch, end: End) -> None:
    """Let one server continue the plan, sample its memory, and kill it when its end is reached."""
    process = next(child for child in psutil.Process().children() if str(workspace) in child.cmdline())
    begun = _count_made(workspace)
    server: list[tuple[int, float]] = []
    all_of_it: list[tuple[int, float]] = []
    watch.server.append(server)
    watch.all_of_it.append(all_of_it)
    told = [begun // 100]
    async with anyio.create_task_group() as tasks:

        async def look() -> None:
            while True:
                await anyio.sleep(_LOOK_S)
                made = await anyio.to_thread.run_sync(_count_made, workspace)
                processes = [process, *process.children(recursive=True)]
                watch.cpu_s |= _cpu_s(processes)
                if end.is_reached(made):
                    process.kill()
                    return
                if made - begun >= _WARM or wish["count"] < 3 * _WARM:
                    server.append((made, _memory_mb([process])))
                    all_of_it.append((made, _memory_mb(processes)))
                if made // 100 > told[0]:
                    told[0] = made // 100
                    sys.stderr.write(f"{made} made\n")

        tasks.start_soon(look)
        answer = await ask(client, "generate_scenarios", **wish)
        while answer["state"] == "running":
            await ask(client, "get_job", job_id=answer["job_id"], wait_s=50)
            answer = await ask(client, "generate_scenarios", **wish)
        watch.plan = answer["plan"]
        tasks.cancel_scope.cancel()


def _cpu_s(processes: Sequence[psutil.Process]) -> dict[tuple[int, float], float]:
    """Return the processor seconds of each process, including its ended children (netconvert)."""
    spent = {}
    for process in processes:
        with suppress(psutil.Error):
            spent[process.pid, process.create_time()] = sum(process.cpu_times()[:4])
    return spent


def _memory_mb(processes: Sequence[psutil.Process]) -> float:
    """Return the private and shared memory of processes in MB; shared memory counts once."""
    held = 0.0
    for process in processes:
        with suppress(psutil.Error):
            held += process.memory_full_info().pss / 2**20
    return held


def slope_mb(lives: Sequence[Sequence[tuple[int, float]]]) -> float | None:
    """Return MB per thousand scenarios: one slope through the samples of all servers, each centred on its own mean.

    None if no server has samples at two numbers of scenarios.
    """
    above = below = 0.0
    for life in lives:
        if len(life) < 2:
            continue
        middle, mean = statistics.fmean(made for made, _ in life), statistics.fmean(value for _, value in life)
        above += sum((made - middle) * (value - mean) for made, value in life)
        below += sum((made - middle) ** 2 for made, _ in life)
    return round(1000 * above / below, 2) if below else None


@dataclass(frozen=True)
class _Made:
    """A scenario of the plan: its row, the folder of its files, and its map."""

    scenario_id: str
    row: Row
    folder: Path
    map_path: Path
    notes: tuple[str, ...]


def _rows(workspace: Path, query: str) -> list[sqlite3.Row]:
    path = workspace / "workspace.sqlite"
    if not path.is_file():
        return []
    connection = sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True, timeout=30.0)
    connection.row_factory = sqlite3.Row
    try:
        return connection.execute(query).fetchall()
    except sqlite3.OperationalError:  # the table is not there yet
        return []
    finally:
        connection.close()


def _count_made(workspace: Path) -> int:
    return sum(row["n"] for row in _rows(workspace, "SELECT count(*) AS n FROM plan_rows WHERE state = 'made'"))


def _stored_files(workspace: Path) -> Iterator[str]:
    """Return the scenarios in the workspace that have a record."""
    for row in _rows(workspace, "SELECT artifact_id FROM artifacts WHERE kind = 'scenario'"):
        if (workspace / "scenarios" / row["artifact_id"] / "scenario.xml").is_file():
            yield row["artifact_id"]


def _made(workspace: Path) -> dict[int, _Made]:
    """Return the generated rows of the plan by number, with the workspace's content for each."""
    recipes = {
        row["artifact_id"]: json.loads(row["recipe"])["arguments"]
        for row in _rows(workspace, "SELECT artifact_id, recipe FROM artifacts WHERE kind = 'scenario'")
    }
    maps = {path.parent.name: path for path in (workspace / "maps").glob("*/*") if path.is_file()}
    library = Path(__file__).resolve().parent.parent.parent / "engine" / "maps" / "library"
    found = {}
    for row in _rows(workspace, "SELECT * FROM plan_rows WHERE state = 'made' ORDER BY number"):
        folder = workspace / "scenarios" / row["scenario_id"]
        asked = recipes.get(row["scenario_id"])
        if asked is None or not (folder / "generation.json").is_file():
            continue  # counted as lost
        report = json.loads((folder / "generation.json").read_text(encoding="utf-8"))
        path = maps.get(asked["map_id"]) or next(library.glob(f"{asked['place'].lower()}.osm"))
        found[int(row["number"])] = _Made(row["scenario_id"], _row_of(asked), folder, path, tuple(report["notes"]))
    return found


def _row_of(asked: Mapping[str, Any]) -> Row:
    """Return the request for a scenario, by its recipe."""
    classes = [demand["vehicle_class"] for demand in asked["vehicles"]] or ["cars"]
    return asked["scenario_type"], asked["density"], classes[0], asked["goal"].removeprefix("through:")


def _shown(made: Mapping[int, _Made], workspace: Path, spread: Any) -> dict[int, tuple[bool, ...]]:
    """Return which levels the files of some scenarios show: evenly spaced ones, then those with unseen pairs."""
    numbers = sorted(made)
    step = max(1, len(numbers) // _JUDGED)
    judged = _judge_all({number: made[number] for number in numbers[::step]}, spread)
    seen = {pair for number, row in judged.items() for pair in _pairs_of(made[number].row, row)}
    allowed, _ = _pairs_to_cover(workspace)
    for number in numbers:
        if number not in judged and any(pair in allowed - seen for pair in _pairs_of(made[number].row, [True] * 4)):
            judged |= _judge_all({number: made[number]}, spread)
            seen.update(_pairs_of(made[number].row, judged[number]))
    return judged


def _judge_all(made: Mapping[int, _Made], spread: Any) -> dict[int, tuple[bool, ...]]:
    groups: defaultdict[Path, dict[int, _Made]] = defaultdict(dict)
    for number, one in made.items():
        groups[one.map_path][number] = one
    return {number: row for judged in spread(_judge_group, groups.items()) for number, row in judged.items()}


def _judge_group(group: tuple[Path, dict[int, _Made]]) -> dict[int, tuple[bool, ...]]:
    """Judge the scenarios of one map."""
    path, made = group
    evidence = read_evidence(path)
    return {number: _judge(one, evidence) for number, one in made.items()}


def _judge(one: _Made, evidence: MapEvidence) -> tuple[bool, ...]:
    kind, density, vehicles, turn = one.row
    try:
        files = MadeFiles.read(one.folder)
    except (OSError, etree.XMLSyntaxError, ValueError):
        return (False,) * 4
    classes = files.classes()
    has_classes = set(classes) <= {"car"} if vehicles == "cars" else classes[vehicles] > 0
    met = judge_density(files, density, one.notes).met  # type: ignore[arg-type]
    return shows_type(files, kind, evidence), met, has_classes, _turns(one.folder, files, turn)


def _turns(folder: Path, files: MadeFiles, turn: str) -> bool:
    """Return True if the ego's start and goal fit the requested turn."""
    root = etree.parse(folder / "scenario.xml").getroot()
    problem = root.find("planningProblem")
    if problem is None:
        return False
    start_rad = float(problem.findtext("initialState/orientation/exact", "nan"))
    goal_rad = statistics.fmean(
        float(problem.findtext(f"goalState/orientation/interval{end}", "nan")) for end in ("Start", "End")
    )
    turned = math.remainder(goal_rad - start_rad, 2 * math.pi)
    if turn in ("left", "right", "unprotected_left"):
        return _TURNED_RAD[0] < (-turned if turn == "right" else turned) < _TURNED_RAD[1]
    if turn == "u_turn":
        return abs(turned) > math.radians(140.0)
    if turn in ("merge", "exit"):
        start, goal = (_classes_at(files, _point(problem, path)) for path in _POINTS)
        return (bool(start & _FAST), bool(goal & _FAST)) == (turn == "exit", turn == "merge")
    return True if turn == "lane_change" else abs(turned) < math.radians(60.0)


_POINTS = ("initialState/position/point", "goalState/position/rectangle/center")


def _point(problem: etree._Element, path: str) -> Points:
    return np.array([float(problem.findtext(f"{path}/{axis}", "nan")) for axis in "xy"])


def _classes_at(files: MadeFiles, point: Points) -> frozenset[str]:
    """Return OSM's classes of the road nearest to a point."""

    def distance_m(edge: NetEdge) -> float:
        return min(
            float(np.linalg.norm(_dense(files.net.lanes[lane].shape) - point, axis=1).min()) for lane in edge.lane_ids
        )

    roads = [edge for edge in files.net.edges.values() if not edge.internal]
    nearest = min(roads, key=distance_m)
    return frozenset(part.removeprefix("highway.") for part in nearest.road_type.split("|"))


def _dense(line: Points) -> Points:
    steps = np.linspace(0.0, 1.0, 6)[:, None, None]
    return ((1 - steps) * line[None, :-1] + steps * line[None, 1:]).reshape(-1, 2)


def _pairs_of(row: Row, shown: Sequence[bool]) -> Iterator[Pair]:
    """Yield the pairs of levels that a scenario shows."""
    parts = [part for part, is_shown in zip(zip(LEVELS, row, strict=True), shown, strict=True) if is_shown]
    yield from combinations(parts, 2)


def _pairs_to_cover(workspace: Path) -> tuple[set[Pair], dict[Pair, str]]:
    """Return the pairs that the maps allow, and those refused three times and never generated, with a reason."""
    kinds = {
        kind
        for row in _rows(workspace, "SELECT record FROM artifacts WHERE kind = 'map'")
        for kind, count in json.loads(row["record"])["sites"].items()
        if count
    }
    parts = [[(name, level) for level in levels] for name, levels in LEVELS.items()]
    pairs = {pair for one, other in combinations(parts, 2) for pair in product(one, other)}
    possible = {pair for pair in pairs if _is_possible(pair, kinds)}
    refused: defaultdict[Pair, list[str]] = defaultdict(list)
    made: set[Pair] = set()
    for row in _rows(workspace, "SELECT levels, state, reason FROM plan_rows WHERE state IN ('made', 'refused')"):
        levels = tuple(names[index] for names, index in zip(LEVELS.values(), json.loads(row["levels"]), strict=True))
        for pair in _pairs_of(levels, [True] * len(levels)):
            if row["state"] == "made":
                made.add(pair)
            else:
                refused[pair].append(row["reason"])
    cannot = {pair: refused[pair][0] for pair in possible - made if len(refused[pair]) >= 3}
    return possible - set(cannot), cannot


def _is_possible(pair: Pair, kinds: set[str]) -> bool:
    """Return True if a map holds the type of site, and sites of the type have the turn."""
    levels = dict(pair)
    kind = levels.get("scenario_type")
    if kind is None:
        return True
    return kind in kinds and levels.get("turn", "straight") in TURNS_AT[kind]  # type: ignore[index]


def _lost(workspace: Path, made: Mapping[int, _Made], watch: _Watch, asked: int) -> list[str]:
    """Describe missing, broken and duplicate scenarios."""
    now = frozenset(_stored_files(workspace))
    ids = [one.scenario_id for one in made.values()]
    lost = [f"{key} was there when a server was killed" for there in watch.there_at_kills for key in there - now]
    lost += [f"{key} was made twice" for key in set(ids) if ids.count(key) > 1]
    lost += [f"{key} has no file" for key in set(ids) - now]
    lost += [f"{one.scenario_id} is broken" for one in made.values() if not _is_whole(one.folder)]
    lost += ["a requested scenario is missing"] * max(asked - len(made), 0)
    for text in lost[:20]:
        sys.stderr.write(f"LOST: {text}\n")
    return lost


def _is_whole(folder: Path) -> bool:
    try:
        return all(len(etree.parse(folder / name).getroot()) > 0 for name in ("scenario.xml", "scenario.net.xml"))
    except (OSError, etree.XMLSyntaxError):
        return False


def _disk_bytes(workspace: Path) -> int:
    """Return the workspace's disk use in blocks, without maps and cached recordings."""
    others = {workspace / name for name in ("maps", "recordings", "scratch", "logs")}
    kept = (path for path in workspace.rglob("*") if path.is_file() and not others & set(path.parents))
    return sum(path.stat().st_blocks * 512 for path in kept)
