"""``make bench-modification``: does an edit do what was asked, and nothing else?

All scenarios of a folder that have dynamic obstacles (a drawn edit of each task, refusals, the recipes of the safety
table) and the requests of the modification corpus with their ground truth as arguments.

Keys (shares unless said otherwise): ``round_trip`` (files whose road users SUMO shows where and as fast as they were
recorded), ``T_ends``, ``B_preset``, ``P_count``, ``G_edge`` (the paper's checks), ``checks_min`` (the least of all
checks), ``valid_min``, ``executable_min`` (the least over the tasks), ``refused_right``, ``untouched_identical``,
``physical_T``, ``physical_B``, ``physical_P`` (a touched vehicle of each edit by the drivability checker from its
hand-over + 1 s on), ``unreported_collisions`` (a touched vehicle), ``collisions_left``, ``several_calls_equal``,
``edit_median_s``, ``edit_p95_s`` (seconds of a warm worker, reading and writing included; a scenario's first edit reads
it, later ones find it kept), ``edit_first_median_s`` (first edits alone), ``edit_cpu_median_s`` (processor time of all,
which other work does not lengthen).
"""

import argparse
import os
import statistics
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from rich.console import Console
from rich.progress import track

from plannerforge.engine.execution.pool import PRELOAD
from plannerforge.engine.execution.worker import warm_up
from plannerforge.evals.bench_output import print_figures
from plannerforge.evals.modification_cases import Case, Measured, measure_file, measure_line
from plannerforge.evals.modification_safety import safety_rows

TASKS = ("T", "B", "P", "G")
CORPUS = ("T", "B", "P", "G", "composite")
EVERY_PLANNED, EVERY_CHECKED = 8, 2
"""The planner is run on the edits of every eighth file, the drivability checker on those of every second one and on all
of the corpus: either takes as long as all the edits of a file."""

HEADLINES = ("T_ends", "B_preset", "P_count", "G_edge")


def measure(files: Sequence[Path], lines: Sequence[str], data: Path, workers: int) -> list[Measured]:
    """All jobs on worker processes; the results in no particular order."""
    spawn, modules = get_context("spawn"), PRELOAD["compute"]
    with ProcessPoolExecutor(workers, mp_context=spawn, initializer=warm_up, initargs=(modules,)) as pool:
        jobs: list[Future[Measured]] = []
        for index, path in enumerate(files):
            planned, checked = index % EVERY_PLANNED == 0, index % EVERY_CHECKED == 0
            jobs.append(pool.submit(measure_file, path, run_planner=planned, check_drivable=checked))
        jobs += [pool.submit(measure_line, line, data) for line in lines]
        return [job.result() for job in track(as_completed(jobs), total=len(jobs), console=Console(stderr=True))]


def figures_of(measured: Sequence[Measured]) -> dict[str, float]:
    """The figures by key."""
    cases = [case for one in measured for case in one.cases]
    made = [case for case in cases if not case.refused]
    checks: dict[str, list[bool]] = defaultdict(list)
    for case in cases:
        for name in case.checks or _headlines(case):
            checks[name].append(case.checks.get(name, False))
    trips = [one.round_trip_error for one in measured if one.round_trip_error is not None]
    refused = [right for one in measured for _, right in one.refused_right]
    touched = max(sum(case.touched for case in made), 1)
    several = [case.in_several_calls_equal for case in made if case.in_several_calls_equal is not None]
    seconds = sorted(case.edit_s for case in made)
    first = [case.edit_s for case in made if case.is_first]
    found = {
        "round_trip": _share(not trip for trip in trips),
        **{name: _share(checks[name]) for name in HEADLINES},
        "checks_min": min((_share(values) for values in checks.values()), default=0.0),
        "valid_min": _least(made, lambda case: case.valid),
        "executable_min": _least(
            [case for case in made if case.executed is not None], lambda case: bool(case.executed)
        ),
        "refused_right": _share(refused),
        "untouched_identical": _share(case.untouched_identical for case in made),
        **{f"physical_{task}": _share(p.settled for c in made if c.task == task for p in c.physical) for task in "TBP"},
        "unreported_collisions": sum(case.unreported for case in made) / touched,
        "collisions_left": sum(case.collisions for case in made) / touched,
        "several_calls_equal": _share(several),
        "edit_median_s": statistics.median(seconds),
        "edit_p95_s": seconds[int(0.95 * len(seconds))],
        "edit_first_median_s": statistics.median(first) if first else 0.0,
        "edit_cpu_median_s": statistics.median(case.edit_cpu_s for case in made),
    }
    return {name: round(value, 4) for name, value in found.items()}


def rows_of(measured: Sequence[Measured]) -> list[tuple[str, str]]:
    """What is said beside the figures: counts, hand-overs, and the checker's verdicts."""
    cases = [case for one in measured for case in one.cases]
    made = [case for case in cases if not case.refused]
    rows = []
    for task in (*TASKS, "composite"):
        mine = [case for case in cases if case.task == task]
        rows.append((f"edits {task}", f"{sum(not case.refused for case in mine)} done of {len(mine)}"))
    rows += [(f"drivable {task}", _drivable([case for case in made if case.task == task])) for task in "TBP"]
    jump, step = (max((getattr(case, name) for case in made), default=0.0) for name in ("jump_m", "speed_step_mps"))
    rows.append(("largest hand-over", f"{jump:.3f} m beyond v·dt, {step:.2f} m/s"))
    rows.append(("handed over besides", str(sum(case.handed_over for case in made))))
    rows.append(("collisions reported", str(sum(case.collisions for case in made))))
    return rows + safety_rows([shift for one in measured for shift in one.shifts])


def failures_of(measured: Sequence[Measured]) -> list[str]:
    """Every request and check that went wrong, one line each."""
    found = [f"round trip: {one.round_trip_error}" for one in measured if one.round_trip_error]
    found += [f"not refused right: {name}" for one in measured for name, right in one.refused_right if not right]
    for case in (case for one in measured for case in one.cases):
        bad = [name for name, passed in case.checks.items() if not passed]
        bad += [] if case.refused or case.valid else ["valid"]
        bad += [] if case.refused or case.untouched_identical else ["untouched"]
        bad += ["executed"] if case.executed is False else []
        bad += ["several calls"] if case.in_several_calls_equal is False else []
        bad += ["physical"] if any(not one.settled for one in case.physical) else []
        bad += [f"{case.unreported} unreported collisions"] if case.unreported else []
        bad += [f"{case.collisions} collisions reported"] if case.collisions else []
        bad += [f"speed step {case.speed_step_mps:.2f} m/s"] if case.speed_step_mps > 1.0 else []
        bad += [f"jump {case.jump_m:.3f} m"] if case.jump_m > 0.05 else []
        bad += [f"refused: {case.refused}"] if case.refused else []
        found += [f"{case.task} {case.name}: {', '.join(bad)}"] if bad else []
    return sorted(found)


def _drivable(cases: Sequence[Case]) -> str:
    verdicts = [one for case in cases for one in case.physical]
    settled, whole = sum(one.settled for one in verdicts), sum(one.whole for one in verdicts)
    recorded = [one.recorded for one in verdicts if one.recorded is not None]
    agree = sum(one.closed_form == one.whole for one in verdicts)
    return (
        f"from 1 s after the hand-over on {settled}, whole {whole} of {len(verdicts)}; recorded {sum(recorded)} of "
        f"{len(recorded)}; closed form agrees on {agree}"
    )


def _headlines(case: Case) -> tuple[str, ...]:
    """What a request that was refused counts as failed for."""
    return tuple(name for name in HEADLINES if name.startswith(f"{case.task}_"))


def _share(values: Iterable[object]) -> float:
    found = [bool(value) for value in values]
    return sum(found) / len(found) if found else 0.0


def _least(cases: Sequence[Case], judge: Callable[[Case], bool]) -> float:
    by_task = {task: [judge(case) for case in cases if case.task == task] for task in {case.task for case in cases}}
    return min((_share(values) for values in by_task.values()), default=0.0)


def main() -> None:
    """Measure and print; the failures go to the error stream."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=1, help="only every n-th file and request")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    shared = Path(os.environ.get("PLANNERFORGE_SHARED", "../shared"))
    data = shared / "data" / "commonroad"
    files = sorted(data.glob("*.xml"))[:: arguments.every]
    corpora = [shared / "corpora" / "dev" / f"modification_{task}.jsonl" for task in CORPUS]
    lines = [line for path in corpora for line in path.read_text(encoding="utf-8").splitlines()][:: arguments.every]
    measured = measure(files, lines, data, arguments.workers)
    figures = figures_of(measured)
    Console(stderr=True, soft_wrap=True).print("\n".join(failures_of(measured)), markup=False, highlight=False)
    print_figures("Modification", [*((k, f"{v:g}") for k, v in figures.items()), *rows_of(measured)], figures)


if __name__ == "__main__":
    main()
