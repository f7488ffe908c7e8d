"""``make bench-chain``: how long a chain of calls takes on scenarios of the size that the generator makes.

A client calls its own server with two warm workers that have not seen the scenarios; figures are medians over
``--repeats``. The scenarios are 20 s of traffic at the crossings of the built-in town, and the ego's goal is 50 steps
ahead, as in the paper.

Keys:

- ``generate_140_s``, ``describe_140_s``, ``edit_140_s`` (the first edit), ``edit_again_140_s``, ``run_140_s``,
  ``run_again_140_s``, ``reactive_140_s``, ``picture_140_s``: each call on a scenario with 140 cars.
- ``chain_80_s``, ``chain_80_warm_s``: generate, describe, edit, two runs, compare and picture with 80 cars, on a fresh
  server and again with another scenario on the same server.
- ``generate_exponent``, ``edit_exponent``, ``run_exponent``: growth of the time from the fewest to the most cars of
  ``--cars``.
- ``run_small_s``: a run of a public file, the median of ``--files``.
- ``read_ratio``: processor time of commonroad-io for public and generated files over ours, if their recordings are on
  disk (after a scenario was created or described once); ``read_ratio_new``: if they are not.
- ``import_10k_per_s``: files per second for ``--imports`` copies of public files with unique ids, without the larger
  half of the files.
- ``import_memory_slope_mb``: growth of the server's memory per thousand files after the first two calls (omitted if
  there were no more).
- ``million_search_ms``: a filtered search among ``--entries`` entries built from the facts of those files, the median
  over the corpus once every search ran before; ``million_first_search_ms``: the same right after the server's start;
  ``million_memory_mb``: memory of that server after all searches.
- ``demo_stages_s``: all calls of the demo.
"""

import argparse
import gc
import hashlib
import math
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import anyio
import psutil
from commonroad.common.file_reader import CommonRoadFileReader
from mcp import Client, StdioServerParameters

from plannerforge.engine.catalog.tables import facts_of
from plannerforge.engine.commonroad import LoadedScenario, read_recorded
from plannerforge.engine.commonroad.reader import forget_obstacles
from plannerforge.engine.commonroad.recordings import Recording, RecordingStore
from plannerforge.engine.workspace import Database
from plannerforge.evals.ground_truth.selection import read_requests
from plannerforge.server.assembly import create_server

from .harness import (
    Figures,
    as_measured,
    ask_to_the_end,
    import_scenarios,
    print_figures,
    scenario_files,
    settings_for,
    shared_folder,
    shared_scenarios,
    spread,
)
from .selection.pages import search_ms
from .selection.speed import make_catalog

CARS = (20, 80, 140, 300)
"""Measured sizes; growth is from the smallest to the largest."""
TABLE_CARS, CHAIN_CARS = 140, 80
"""Sizes for the table and the chain."""
_A_FOLDER = 1_000
"""Number of files for one import call."""
CONFIGS = ("frenetix:Default", "frenetix:Safety-Conservative")
WORKERS = 2
Times = dict[str, float]


@dataclass
class _Clock:
    """A client that measures its calls; the seconds of each are stored by a given name."""

    client: Client
    times: Times

    async def call(self, name: str, tool: str, **arguments: Any) -> Any:
        """Return the structured answer of a tool (None if it has none), and record its time.

        Raises:
            RuntimeError: the tool refused.
        """
        began = time.perf_counter()
        answer = await self.client.call_tool(tool, arguments)
        self.times[name] = time.perf_counter() - began
        if answer.is_error:
            raise RuntimeError(f"{tool}: {answer.content}")
        return answer.structured_content


async def _table(client: Client, cars: int, seed: int) -> Times:
    """Return the seconds of every call on one scenario with some cars."""
    clock = _Clock(client, {})
    scenario = await _generated(clock, cars, seed)
    await clock.call("describe", "describe_scenario", scenario_id=scenario)
    for name, preset in (("edit", "aggressive"), ("edit_again", "cautious")):
        await clock.call(name, "modify_scenario", scenario_id=scenario, edits=[_edit(preset)])
    for name, number in (("run", 0), ("run_again", 1)):
        await clock.call(name, "run_planner", scenarios=[scenario], configs=[CONFIGS[0]], seed=number)
    await clock.call("reactive", "run_planner", scenarios=[scenario], configs=[CONFIGS[0]], traffic="reactive")
    await clock.call("picture", "render", ids=[scenario])
    return clock.times


async def _chain(client: Client, cars: int, seed: int) -> Times:
    """Return seconds of the calls of a user's chain."""
    clock = _Clock(client, {})
    scenario = await _generated(clock, cars, seed)
    await clock.call("describe", "describe_scenario", scenario_id=scenario)
    edited = await clock.call("edit", "modify_scenario", scenario_id=scenario, edits=[_edit("aggressive")])
    runs = []
    for config in CONFIGS:
        ran = await clock.call(f"run {config}", "run_planner", scenarios=[edited["scenario_id"]], configs=[config])
        runs += [run["run_id"] for run in ran["runs"]]
    await clock.call("compare", "compare_results", results=runs)
    await clock.call("picture", "render", ids=[edited["scenario_id"]])
    return clock.times


async def _generated(clock: _Clock, cars: int, seed: int) -> str:
    wanted = {
        "vehicles": [f"car={cars}..{cars}"],
        "density": "high",
        "seed": seed,
        "duration_s": 20,
        "goal": "steps:50",
    }
    made = await clock.call("generate", "generate_scenarios", **wanted)
    return str(made["scenarios"][0]["scenario_id"])


def _edit(preset: str) -> Mapping[str, Any]:
    return {"op": "set_behaviour", "vehicles": ["nearest:1"], "preset": preset}


@asynccontextmanager
async def _warm_server(workspace: Path) -> AsyncIterator[Client]:
    """Open a client of a separate server with workers that have imported everything they need."""
    async with Client(create_server(settings_for(workspace, shared_scenarios(), WORKERS))) as client:
        async with anyio.create_task_group() as tasks:
            for seed in range(WORKERS):
                tasks.start_soon(_table, client, 5, 100 + seed)
        yield client


async def _measure(repeats: int, cars: Sequence[int], files: int, imports: int, entries: int) -> None:
    by_size: dict[int, list[Times]] = {size: [] for size in cars}
    chains: dict[str, list[float]] = {"cold": [], "warm": []}
    with tempfile.TemporaryDirectory() as name:
        for number in range(repeats):
            for size in cars:
                async with _warm_server(Path(name) / f"{size}_{number}") as one:
                    by_size[size].append(await _table(one, size, number))
                    sys.stderr.write(f"{size} cars: {_in_words(by_size[size][-1])}\n")
            async with _warm_server(Path(name) / f"chain_{number}") as one:
                for kind, seed in (("cold", number), ("warm", 1_000 + number)):
                    times = await _chain(one, CHAIN_CARS, seed)
                    chains[kind].append(sum(times.values()))
                    sys.stderr.write(f"chain, {kind}: {chains[kind][-1]:.2f} s: {_in_words(times)}\n")
        small = await _small_runs(Path(name) / "small", files)
        generated = sorted(Path(name).rglob("scenario.xml"))[:files]
        ratios = _read_ratios(files, generated, RecordingStore(Path(name) / "recordings"))
        demo = {"demo_stages_s": _demo_s(Path(name) / "demo")}
        volume = await _volume(Path(name) / "volume", imports, entries)
    _show(by_size, chains, small, ratios, {**demo, **volume})


async def _small_runs(workspace: Path, files: int) -> list[float]:
    """Return seconds of a run of each of some public files."""
    chosen, seconds = scenario_files(shared_scenarios(), files), list[float]()
    async with _warm_server(workspace) as client:
        await import_scenarios(client, chosen)
        for path in chosen:
            one = _Clock(client, {})
            await one.call("run", "run_planner", scenarios=[path.stem], configs=[CONFIGS[0]])
            seconds.append(one.times["run"])
    return seconds


def _read_ratios(files: int, generated: Sequence[Path], store: RecordingStore) -> tuple[list[float], list[float]]:
    """Return commonroad-io's processor time over ours for public and generated files, cached on disk and new."""
    known, new = [], []
    for path in [*scenario_files(shared_scenarios(), files), *generated]:
        by_commonroad_io_s = _cpu_s(_read_by_commonroad_io, path)
        new.append(by_commonroad_io_s / _cpu_s(_read_by_us, path))
        loaded = read_recorded(path).loaded
        kept = Recording(loaded.scenario, loaded.planning_problems, loaded.declared_id, loaded.plain_states)
        store.put(_content_of(path), kept)
        known.append(by_commonroad_io_s / _cpu_s(partial(_read_known, store), path))
    return known, new


def _read_known(store: RecordingStore, path: Path) -> None:
    """Read a file, tracks included, as ``kept_recording`` does if its recording is on disk."""
    found = store.find(_content_of(path))
    if found is None:
        raise RuntimeError(f"the stored recording of {path.name} is missing")
    loaded = LoadedScenario(found.scenario, found.planning_problems, path, found.declared_id, found.plain_states)
    _ = loaded.tracks


def _content_of(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _read_by_us(path: Path) -> None:
    forget_obstacles()
    read_recorded(path)


def _read_by_commonroad_io(path: Path) -> None:
    CommonRoadFileReader(path).open()


def _cpu_s(read: Callable[[Path], object], path: Path) -> float:
    """Return the better of two processor times."""
    times = []
    for _ in range(2):
        gc.collect()
        began = time.process_time()
        read(path)
        times.append(time.process_time() - began)
    return min(times)


def _demo_s(folder: Path) -> float:
    """Return the seconds of all calls of the demo, by its own report."""
    plannerforge = Path(sys.executable).parent / "plannerforge"
    told = subprocess.run([plannerforge, "demo", "--folder", folder], capture_output=True, text=True, check=True)
    taken = re.search(r"calls took ([\d.]+) s", told.stdout)
    if taken is None:
        raise RuntimeError(f"the demo does not report the duration of its calls: {told.stdout[-500:]}")
    return float(taken[1])


async def _volume(folder: Path, imports: int, entries: int) -> Figures:
    """Import many files, and search among many entries made of their facts, each with a server in its own process."""
    folders = _copies(folder / "files", imports)
    memory_mb: list[tuple[int, float]] = []
    async with _server_process(folder / "workspace", folder) as (client, server):
        began = time.perf_counter()
        for number, one in enumerate(folders, start=1):
            await ask_to_the_end(client, "import_files", path=str(one))
            memory_mb.append((min(number * _A_FOLDER, imports), server.memory_info().rss / 1e6))
            sys.stderr.write(f"{memory_mb[-1][0]} files, server {memory_mb[-1][1]:.0f} MB\n")
        import_s = time.perf_counter() - began
    (few, before_mb), (many, after_mb) = memory_mb[:2][-1], memory_mb[-1]
    database = Database(folder / "workspace" / "workspace.sqlite")
    rows = database.connection().execute("SELECT artifact_id FROM artifacts WHERE kind = 'scenario' LIMIT 500")
    real = list(facts_of(database.connection(), [row[0] for row in rows.fetchall()]).values())
    database.close()
    (folder / "many").mkdir()
    make_catalog(folder / "many" / "workspace.sqlite", real, entries).close()
    async with _server_process(folder / "many", folder) as (client, server):
        requests = read_requests(shared_folder() / "corpora/dev/selection.jsonl")
        first_ms, times_ms = await search_ms(client, requests), await search_ms(client, requests)
        searched_mb = server.memory_info().rss / 1e6
    return as_measured(
        {
            "import_10k_per_s": round(imports / import_s, 1),
            "import_memory_slope_mb": round((after_mb - before_mb) / (many - few) * 1000, 2) if many > few else None,
            "million_search_ms": round(statistics.median(times_ms), 1),
            "million_first_search_ms": round(statistics.median(first_ms), 1),
            "million_memory_mb": round(searched_mb, 1),
        }
    )


def _copies(folder: Path, count: int) -> list[Path]:
    """Return folders of scenario files with unique ids, copied from the smaller half of the public files."""
    by_size = sorted(scenario_files(shared_scenarios(), None), key=lambda path: path.stat().st_size)
    contents = [path.read_bytes() for path in by_size[: len(by_size) // 2]]
    folders = [folder / f"{number:03d}" for number in range(math.ceil(count / _A_FOLDER))]
    for one in folders:
        one.mkdir(parents=True)
    for number in range(count):
        named = b'benchmarkID="ZAM_Copy-%d_1_T-1"' % (number + 1)
        content = re.sub(rb'benchmarkID="[^"]*"', named, contents[number % len(contents)], count=1)
        (folders[number // _A_FOLDER] / f"copy_{number}.xml").write_bytes(content)
    return folders


@asynccontextmanager
async def _server_process(workspace: Path, root: Path) -> AsyncIterator[tuple[Client, psutil.Process]]:
    """Open a client of a server in its own process, and return that process too."""
    arguments = ["-m", "plannerforge", "serve", "--workspace", str(workspace), "--roots", str(root)]
    settings = {"STARTER": "false", "WARM_UP": "false", "WORKERS": str(WORKERS)}
    environment = {**os.environ, **{f"PLANNERFORGE_{name}": value for name, value in settings.items()}}
    before = {child.pid for child in psutil.Process().children()}
    server = StdioServerParameters(command=sys.executable, args=arguments, env=environment)
    async with Client(server) as client:
        await client.list_tools()
        yield client, next(child for child in psutil.Process().children() if child.pid not in before)


def _show(
    by_size: Mapping[int, Sequence[Times]],
    chains: Mapping[str, Sequence[float]],
    small: Sequence[float],
    ratios: tuple[Sequence[float], Sequence[float]],
    volume: Figures,
) -> None:
    least, most = min(by_size), max(by_size)
    shown = TABLE_CARS if TABLE_CARS in by_size else most
    of_shown = {name: [times[name] for times in by_size[shown]] for name in by_size[shown][0]}
    figures: dict[str, float | int | str] = {
        f"{name}_{shown}_s": round(statistics.median(values), 2) for name, values in of_shown.items()
    }
    figures |= {f"chain_{CHAIN_CARS}_s": round(statistics.median(chains["cold"]), 2)}
    figures |= {f"chain_{CHAIN_CARS}_warm_s": round(statistics.median(chains["warm"]), 2)}
    for name in ("generate", "edit", "run"):
        times_s = [statistics.median(times[name] for times in by_size[size]) for size in (least, most)]
        figures[f"{name}_exponent"] = round(math.log(times_s[1] / times_s[0]) / math.log(most / least), 2)
    known, new = ratios
    figures |= {"run_small_s": round(statistics.median(small), 2), "read_ratio": round(statistics.median(known), 1)}
    figures |= {"read_ratio_new": round(statistics.median(new), 1)}
    rows = [(f"{name}, {shown} cars", spread(values, "s")) for name, values in of_shown.items()]
    rows += [(f"chain, {CHAIN_CARS} cars, {kind}", spread(values, "s")) for kind, values in chains.items()]
    rows += [(name, str(value)) for name, value in volume.items()]
    rows += [
        ("run of a public file", spread(small, "s")),
        ("commonroad-io's reading over ours, known on disk", spread(known, "×", 1)),
        ("commonroad-io's reading over ours, new", spread(new, "×", 1)),
    ]
    print_figures("Chain", {**figures, **volume}, rows)


def _at_least_one(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError("at least 1")
    return number


def _in_words(times: Times) -> str:
    return ", ".join(f"{name} {seconds:.2f}" for name, seconds in times.items())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Seconds of the calls of a chain.")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--cars", type=int, nargs="+", default=CARS, help="ascending")
    parser.add_argument("--files", type=int, default=40, help="number of public files to run and read (a fixed sample)")
    parser.add_argument("--imports", type=_at_least_one, default=10_000, help="number of files to import")
    parser.add_argument(
        "--entries", type=_at_least_one, default=1_000_000, help="number of entries in the searched catalogue"
    )
    given = parser.parse_args()
    anyio.run(_measure, given.repeats, given.cars, given.files, given.imports, given.entries)
