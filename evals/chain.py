"""``make bench-chain``: how long a chain of calls takes on scenarios of the size that the generator makes.

Through a client, on a server of its own with two workers that are warm and know no scenario; medians of ``--repeats``.
The scenarios are 20 s of traffic at the crossings of the built-in town.

Keys: ``generate_140_s``, ``describe_140_s``, ``edit_140_s`` (the first edit), ``edit_again_140_s``, ``run_140_s``,
``run_again_140_s``, ``reactive_140_s``, ``picture_140_s``: each call on a scenario of 140 cars. ``chain_80_s`` and
``chain_80_warm_s``: generate, describe, edit, two runs, compare and picture on 80 cars, on a fresh server and once more
with another scenario on the same one. ``generate_exponent``, ``edit_exponent``, ``run_exponent``: growth of the time
from the fewest to the most cars of ``--cars``. ``run_small_s``: a run of a public file, the median of ``--files``.
``read_ratio``: processor time in which commonroad-io reads public files and generated ones, over ours.
"""

import argparse
import gc
import math
import statistics
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio
from commonroad.common.file_reader import CommonRoadFileReader
from mcp import Client

from ..engine.commonroad import read_recorded
from ..server.assembly import create_server
from .harness import import_scenarios, print_figures, scenario_files, settings_for, shared_scenarios, spread

CARS = (20, 80, 140)
"""Sizes that are measured; the table is of the largest, the chain of the middle one."""
CONFIGS = ("frenetix:Default", "frenetix:Safety-Conservative")
WORKERS = 2
Times = dict[str, float]


@dataclass
class _Clock:
    """A client whose calls are timed; the seconds of each by the name that it is given."""

    client: Client
    times: Times

    async def call(self, name: str, tool: str, **arguments: Any) -> Any:
        """The structured answer of a tool, whose time is noted; None of one that has none.

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
    """Seconds of every call on one scenario of some cars."""
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
    """Seconds of the calls of a user's chain."""
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
    wanted = {"vehicles": [f"car={cars}..{cars}"], "density": "high", "seed": seed, "duration_s": 20}
    made = await clock.call("generate", "generate_scenarios", **wanted)
    return str(made["scenarios"][0]["scenario_id"])


def _edit(preset: str) -> Mapping[str, Any]:
    return {"op": "set_behaviour", "vehicles": ["nearest:1"], "preset": preset}


@asynccontextmanager
async def _warm_server(workspace: Path) -> AsyncIterator[Client]:
    """The client of a server of its own, whose workers have imported what they will need."""
    async with Client(create_server(settings_for(workspace, shared_scenarios(), WORKERS))) as client:
        async with anyio.create_task_group() as tasks:
            for seed in range(WORKERS):
                tasks.start_soon(_table, client, 5, 100 + seed)
        yield client


async def _measure(repeats: int, cars: Sequence[int], files: int) -> None:
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
                    times = await _chain(one, cars[len(cars) // 2], seed)
                    chains[kind].append(sum(times.values()))
                    sys.stderr.write(f"chain, {kind}: {chains[kind][-1]:.2f} s: {_in_words(times)}\n")
        small = await _small_runs(Path(name) / "small", files)
        ratios = _read_ratios(files, sorted(Path(name).rglob("scenario.xml"))[:files])
    _show(by_size, chains, small, ratios)


async def _small_runs(workspace: Path, files: int) -> list[float]:
    """Seconds of a run of each of some public files."""
    chosen, seconds = scenario_files(shared_scenarios(), files), list[float]()
    async with _warm_server(workspace) as client:
        await import_scenarios(client, chosen)
        for path in chosen:
            one = _Clock(client, {})
            await one.call("run", "run_planner", scenarios=[path.stem], configs=[CONFIGS[0]])
            seconds.append(one.times["run"])
    return seconds


def _read_ratios(files: int, generated: Sequence[Path]) -> list[float]:
    """commonroad-io's processor time over ours for each of some public files and the generated ones."""
    paths = [*scenario_files(shared_scenarios(), files), *generated]
    return [_cpu_s(_read_by_commonroad_io, path) / _cpu_s(read_recorded, path) for path in paths]


def _read_by_commonroad_io(path: Path) -> None:
    CommonRoadFileReader(path).open()


def _cpu_s(read: Callable[[Path], object], path: Path) -> float:
    """The better of two processor times."""
    times = []
    for _ in range(2):
        gc.collect()
        began = time.process_time()
        read(path)
        times.append(time.process_time() - began)
    return min(times)


def _show(
    by_size: Mapping[int, Sequence[Times]],
    chains: Mapping[str, Sequence[float]],
    small: Sequence[float],
    ratios: Sequence[float],
) -> None:
    least, middle, most = min(by_size), sorted(by_size)[len(by_size) // 2], max(by_size)
    of_most = {name: [times[name] for times in by_size[most]] for name in by_size[most][0]}
    figures = {f"{name}_{most}_s": round(statistics.median(values), 2) for name, values in of_most.items()}
    figures |= {f"chain_{middle}_s": round(statistics.median(chains["cold"]), 2)}
    figures |= {f"chain_{middle}_warm_s": round(statistics.median(chains["warm"]), 2)}
    for name in ("generate", "edit", "run"):
        times_s = [statistics.median(times[name] for times in by_size[size]) for size in (least, most)]
        figures[f"{name}_exponent"] = round(math.log(times_s[1] / times_s[0]) / math.log(most / least), 2)
    figures |= {"run_small_s": round(statistics.median(small), 2), "read_ratio": round(statistics.median(ratios), 1)}
    rows = [(f"{name}, {most} cars", spread(values, "s")) for name, values in of_most.items()]
    rows += [(f"chain, {middle} cars, {kind}", spread(values, "s")) for kind, values in chains.items()]
    rows += [
        ("run of a public file", spread(small, "s")),
        ("commonroad-io's reading over ours", spread(ratios, "×", 1)),
    ]
    print_figures("Chain", figures, rows)


def _in_words(times: Times) -> str:
    return ", ".join(f"{name} {seconds:.2f}" for name, seconds in times.items())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Seconds of the calls of a chain.")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--cars", type=int, nargs="+", default=CARS, help="ascending; the largest is that of the table")
    parser.add_argument(
        "--files", type=int, default=40, help="public files, always the same sample, of run and reading"
    )
    given = parser.parse_args()
    anyio.run(_measure, given.repeats, given.cars, given.files)
