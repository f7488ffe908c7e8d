"""Compares the product with Scenario Factory 2.0 on the same map files and machine, alternately, each in one process.

Scenario Factory runs offline in its own environment (``factory_requirements.txt``), in the folder that
``PLANNERFORGE_FACTORY`` gives or a temporary one, created once. It receives the map files themselves
(``factory_driver.py``): the XML extracts within the size that its documentation allows. The settings follow its
documentation: scenarios of 20 s cut from 100 s of traffic (its command line) and of 5 s cut from 50 s (its readme). The
product generates scenarios of the same lengths at different sites with its defaults.

Times are processor times including started programs, because other load lengthens the wall time
(``factory_ratio_clock``). They exclude start-up and, for Scenario Factory, its table of places and the pauses of its
executor; they include reading and indexing the map. For each map, ``factory_judge.py`` judges a limited number of
scenarios of each side, and their share represents the rest.

Keys:

- ``factory_ratio``: executable scenarios of 20 s per minute, ours over theirs; ``factory_ratio_5s``;
  ``factory_ratio_clock`` (20 s); ``factory_ratio_places``: the same for different places with an executable scenario.
- For ``ours`` and ``theirs`` at each length: ``_made``, ``_judged``, ``_executable`` (share of the judged),
  ``_per_min``, ``_places`` (different networks), ``_empty_maps`` (maps without a scenario), ``_inside`` (positions on
  lanelets), ``_feasible`` (tracks), ``_overlaps`` (pairs), ``_collisions`` (of the default planner's runs);
  ``_sites_km2``.
- ``factory_environment_s`` (0 if it existed), ``factory_environment_mb``; ``factory_maps``.

Faults and their reasons go to standard error, and the full log to ``factory.log`` in the environment's folder.
"""

import asyncio
import json
import math
import re
import sys
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

from plannerforge.engine.execution import silent
from plannerforge.engine.generation import count_sites, generate_scenario
from plannerforge.engine.maps import MapEntry, read_map
from plannerforge.schemas.errors import PlannerForgeError
from plannerforge.schemas.generation import GenerateScenariosArguments, ReadMapRequest
from plannerforge.workflows.generation.map_choice import assign_sites, plan_maps, request_for
from plannerforge.workflows.generation.specification import read_specification

from ..generation.figures import motion_figures, ratio
from ..harness import (
    Figures,
    LineProcess,
    NoAnswer,
    Spent,
    call_in_process,
    drawn,
    made_environment,
    process_pool,
    share,
)
from .bench import MapsBench
from .factory_judge import FileVerdict, judge_file

LARGEST_KM2 = 1.6**2
"""The largest map in km²: its documentation allows places of up to 0.8 km around a middle."""
LENGTHS: Mapping[int, int] = {20: 1000, 5: 500}
"""Seconds of a scenario, and the steps of 0.1 s of traffic that the documentation simulates for it."""
MOST_JUDGED = 6
"""Number of judged scenarios for each generator, map and length (chosen); ours generates no more."""
LIMIT_S = 400.0
"""Wall time after which a map is given up and its time left out (chosen)."""
KM_A_DEGREE = 111.2
THEIRS, OURS = "theirs", "ours"
_REQUIREMENTS, _DRIVER = (Path(__file__).with_name(f"factory_{name}") for name in ("requirements.txt", "driver.py"))


@dataclass(frozen=True)
class MapTask:
    """A map to make scenarios from: its file, the country and place that the folder's list names, its size in km²."""

    path: Path
    country: str
    place: str
    km2: float
    length_s: int
    folder: Path
    seed: int = 1


@dataclass(frozen=True)
class Produced:
    """A generator's result for a map: files, number of sites, time, and faults with their counts."""

    task: MapTask
    maker: str
    files: tuple[Path, ...] = ()
    sites: int = 0
    spent: Spent = field(default_factory=Spent)
    faults: Mapping[str, int] = field(default_factory=dict)

    @property
    def places(self) -> int:
        """Different networks among the files: theirs bear a number, every one of ours is a site of its own."""
        numbers = (re.search(r"-(\d+)_", path.name) for path in self.files)
        return len({number[1] for number in numbers if number}) if self.maker == THEIRS else len(self.files)


def measure(bench: MapsBench) -> Figures:
    """Generate scenarios alternately, judge them, and compare both sides.

    Raises:
        LeftOut: the other environment cannot be created here.
    """
    environment, made_in_s = prepared_environment()
    tasks = _tasks(bench)
    with (environment / "factory.log").open("w") as log, Factory(environment, log) as factory, process_pool(1) as own:
        _warm_up(tasks[0], bench, factory, own)
        produced = [one for number, task in enumerate(tasks) for one in _by_turns(task, number, factory, own)]
    with process_pool(bench.workers) as pool:
        chosen = [(one, drawn([str(path) for path in one.files], MOST_JUDGED)) for one in produced]
        jobs = [(Path(name), one.task.seed) for one, names in chosen for name in names]
        verdicts = iter(list(pool.map(judge_file, *zip(*jobs, strict=True)))) if jobs else iter(())
    judged = [(one, [next(verdicts) for _ in names]) for one, names in chosen]
    _print_faults(judged)
    return {
        **figures(judged),
        "factory_environment_s": round(made_in_s),
        "factory_environment_mb": _megabytes(environment),
        "factory_maps": len(tasks) // len(LENGTHS),
    }


def prepared_environment() -> tuple[Path, float]:
    """Return the folder of the environment, and the seconds to create it (nearly 0 if it existed).

    Raises:
        LeftOut: it cannot be created here.
    """
    began = time.perf_counter()
    return made_environment("factory", "Scenario Factory", _REQUIREMENTS), time.perf_counter() - began


class Factory(LineProcess):
    """Scenario Factory in a process of its own that works on one map after the other."""

    def __init__(self, environment: Path, log: TextIO) -> None:
        super().__init__(
            [str(environment / "bin" / "python"), "-P", str(_DRIVER)], log, LIMIT_S, {"QT_QPA_PLATFORM": "offscreen"}
        )

    def make(self, task: MapTask) -> Produced:
        """Generate scenarios of a map; a timeout or the end of the process is a fault, and its time is left out."""
        task.folder.mkdir(parents=True)
        try:
            answer = self.answer(
                {
                    "map": str(task.path),
                    "folder": str(task.folder),
                    "steps": 10 * task.length_s,
                    "simulated_steps": LENGTHS[task.length_s],
                    "seed": task.seed,
                }
            )
        except NoAnswer as reason:
            return Produced(task, THEIRS, faults={str(reason): 1})
        files = tuple(sorted(task.folder.glob("*.cr.xml")))
        spent = Spent(answer["wall_s"], answer["processor_s"])
        return Produced(task, THEIRS, files, answer["sites"], spent, answer["faults"])


def make_ours(task: MapTask) -> Produced:
    """Return scenarios of a map at different sites, as ``generate_scenarios`` assigns them."""
    began = Spent.now()
    files: list[Path] = []
    faults: Counter[str] = Counter()
    sites = 0
    try:
        facts = read_map(ReadMapRequest(path=str(task.path), place=task.place, country=task.country), silent)
        entry = MapEntry(facts.model_copy(update={"file_name": task.path.name}), task.path)
        given = {"duration_s": task.length_s, "count": MOST_JUDGED, "seed": task.seed}
        spec = read_specification(GenerateScenariosArguments.model_validate(given))
        matches = plan_maps(spec, [entry]).matches
        assigned = asyncio.run(assign_sites(spec, call_in_process(), matches)).planned
        sites = count_sites(request_for(spec, assigned[0], 0), silent).count
    except PlannerForgeError as error:
        return Produced(task, OURS, spent=Spent.now() - began, faults={error.message: 1})
    for number, site in enumerate(assigned):
        folder = task.folder / str(number)
        folder.mkdir(parents=True)
        try:
            generate_scenario(request_for(spec, site, number).model_copy(update={"folder": str(folder)}), silent)
            files.append(folder / "scenario.xml")
        except PlannerForgeError as error:
            faults[error.message] += 1
    return Produced(task, OURS, tuple(files), sites, Spent.now() - began, faults)


def figures(judged: Sequence[tuple[Produced, Sequence[FileVerdict]]]) -> dict[str, float | int | str]:
    """Compute the module's keys from the results and their verdicts."""
    found: dict[str, float | int | str] = {}
    rates: dict[tuple[int, str], _Rate] = {}
    for length_s in LENGTHS:
        for maker in (OURS, THEIRS):
            part = [(one, seen) for one, seen in judged if one.task.length_s == length_s and one.maker == maker]
            rates[length_s, maker] = _Rate.of(part)
            begin = f"factory_{maker}_{length_s}s"
            found |= {f"{begin}_{key}": figure for key, figure in _part_figures(part).items()}
            found[f"{begin}_per_min"] = round(rates[length_s, maker].per_min, 2)
    for maker in (OURS, THEIRS):
        of_maker = [one for one, _ in judged if one.maker == maker]
        found[f"factory_{maker}_sites_km2"] = _over(
            sum(one.sites for one in of_maker), sum(one.task.km2 for one in of_maker)
        )
    for key, length_s, name in (
        ("factory_ratio", 20, "per_min"),
        ("factory_ratio_5s", 5, "per_min"),
        ("factory_ratio_clock", 20, "per_min_on_clock"),
        ("factory_ratio_places", 20, "places_per_min"),
    ):
        found[key] = _over(getattr(rates[length_s, OURS], name), getattr(rates[length_s, THEIRS], name))
    return found


@dataclass(frozen=True)
class _Rate:
    """Executable scenarios, and different places with one, a minute of processor time, and by the clock."""

    per_min: float
    per_min_on_clock: float
    places_per_min: float

    @classmethod
    def of(cls, part: Sequence[tuple[Produced, Sequence[FileVerdict]]]) -> "_Rate":
        spent = sum((one.spent for one, _ in part), Spent())
        good = sum(len(one.files) * share(verdict.executable for verdict in seen) for one, seen in part)
        places = sum(one.places * share(verdict.executable for verdict in seen) for one, seen in part)
        return cls(
            60 * good / max(spent.processor_s, 1e-9),
            60 * good / max(spent.wall_s, 1e-9),
            60 * places / max(spent.processor_s, 1e-9),
        )


def _part_figures(part: Sequence[tuple[Produced, Sequence[FileVerdict]]]) -> dict[str, float | int]:
    """Compute the figures of one generator at one length."""
    verdicts = [verdict for _, seen in part for verdict in seen]
    motion = motion_figures(verdict.motion for verdict in verdicts)
    runs = [verdict for verdict in verdicts if verdict.outcome not in ("", "invalid")]
    return {
        "made": sum(len(one.files) for one, _ in part),
        "judged": len(verdicts),
        "executable": share(verdict.executable for verdict in verdicts),
        "places": sum(one.places for one, _ in part),
        "empty_maps": sum(not one.files for one, _ in part),
        "inside": motion["inside_lanelets"],
        "feasible": motion["feasible"],
        "overlaps": int(motion["overlaps"]),
        "collisions": ratio(sum(verdict.outcome == "collision" for verdict in runs), len(runs)),
    }


def _over(one: float, other: float) -> float:
    return round(one / other, 2) if other else math.inf if one else 0.0


def _tasks(bench: MapsBench) -> list[MapTask]:
    """Return every map at every length; with a limit, always the same maps."""
    listed = json.loads((bench.maps / "places.json").read_text(encoding="utf-8"))
    known = {path.name: listed[path.name] for path in sorted(bench.maps.glob("*.osm")) if path.name in listed}
    sizes = {name: _km2(shown["bbox"]) for name, shown in known.items()}
    names = drawn([name for name, size in sizes.items() if size <= LARGEST_KM2], bench.limit)
    folder = bench.folder("factory")
    return [
        MapTask(
            bench.maps / name,
            known[name]["country"],
            known[name]["places"][0],
            sizes[name],
            length_s,
            folder / f"{length_s}-{name}",
        )
        for name in names
        for length_s in LENGTHS
    ]


def _km2(box: Iterable[float]) -> float:
    south, west, north, east = box
    return (north - south) * (east - west) * KM_A_DEGREE**2 * math.cos(math.radians(south))


def _warm_up(task: MapTask, bench: MapsBench, factory: Factory, own: ProcessPoolExecutor) -> None:
    """Run a map that does not count, so that both load their libraries."""
    factory.make(_moved(task, bench.scratch / "warm-up" / THEIRS))
    own.submit(make_ours, _moved(task, bench.scratch / "warm-up" / OURS)).result()


def _by_turns(task: MapTask, number: int, factory: Factory, own: ProcessPoolExecutor) -> list[Produced]:
    """Run both generators on one map, in reverse order on every other map."""

    def ours() -> Produced:
        return own.submit(make_ours, _moved(task, task.folder / OURS)).result()

    def theirs() -> Produced:
        return factory.make(_moved(task, task.folder / THEIRS))

    made = [maker() for maker in ((ours, theirs) if number % 2 else (theirs, ours))]
    for one in made:
        sys.stderr.write(
            f"{one.task.path.name} {one.task.length_s} s {one.maker}: {len(one.files)} scenarios of {one.sites} sites, "
            f"{one.spent.processor_s:.1f} s of the processor, {one.spent.wall_s:.1f} s on the clock\n"
        )
    sys.stderr.flush()
    return made


def _moved(task: MapTask, folder: Path) -> MapTask:
    return MapTask(task.path, task.country, task.place, task.km2, task.length_s, folder, task.seed)


def _print_faults(judged: Sequence[tuple[Produced, Sequence[FileVerdict]]]) -> None:
    """Print faults of generation and of the files, by generator, most frequent first."""
    for maker in (OURS, THEIRS):
        making: Counter[str] = Counter()
        for one, _ in judged:
            making.update(one.faults if one.maker == maker else {})
        files = Counter(verdict.fault for one, seen in judged if one.maker == maker for verdict in seen)
        del files[""]
        for what, counts in (("making", making), ("files", files)):
            sys.stderr.writelines(f"{maker}, {what}: {count} × {reason}\n" for reason, count in counts.most_common())


def _megabytes(folder: Path) -> int:
    return round(sum(path.lstat().st_size for path in folder.rglob("*")) / 1e6)
