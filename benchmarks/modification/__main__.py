"""``make bench-modification``: checks that an edit does what was requested, and nothing else.

The bench edits all scenarios of a folder that have dynamic obstacles (a drawn edit of each task, refusals, the recipes
of the safety table) and carries out the requests of the modification corpus with their ground truth as arguments. It
judges the written file and the content of SUMO in that run: a vehicle's type and the route that it drove.

Keys (shares unless stated otherwise):

- ``round_trip``: files with all road users at their recorded positions and speeds in SUMO.
- ``T_ends``, ``B_preset``, ``P_count``, ``G_edge``: the paper's checks; a refusal of a feasible edit fails.
- ``composite_done``: all checks of all edits of a composite.
- ``T_arrives``: redirected vehicles that arrive before the scenario ends. ``T_ends`` requires of the others that they
  are on their route and lacked time or were held up.
- ``checks_min``: the lowest of all checks.
- ``valid_min``: no schema error that the source does not have, except for vehicles that the request lets enter after
  time 0, which CommonRoad's schema cannot express; ``valid_strict_min``: without this exception.
- ``executable_min``: as the two before, the lowest over the tasks.
- ``refused_right``, ``untouched_identical``.
- ``physical_T``, ``physical_B``, ``physical_P``, ``physical_composite``: vehicles named by the edits, by the
  drivability checker from 1 s after their hand-over on; ``physical_handed_over``: vehicles that no edit names.
- ``handovers_smooth``: at most 5 cm beyond v·dt and 1 m/s, from the old and the new file.
- ``unreported_collisions`` (of a touched vehicle), ``collisions_left``: numbers.
- ``several_calls_equal``: composites, by calls of the tool.
- ``edit_median_s``, ``edit_p95_s``: seconds of a warm worker including reading and writing (a scenario's first edit
  reads it, later ones find it cached); ``edit_first_median_s``: first edits alone; ``edit_cpu_median_s``: processor
  time of all edits.

``--fresh SEED`` makes the same drawn edits on newly created scenarios, ``--count`` for each seed (``fresh_scenarios``
of ``benchmarks.symmetries.fresh_data``): one half generated, one half rewritten recordings. Keys: ``seeds``,
``fresh_files``, ``fresh_refused`` (refused by name on reading, which is no failure), ``fresh_crashed``, ``fresh_edits``
(carried out), as above ``fresh_round_trip``, ``fresh_T_ends``, ``fresh_B_preset``, ``fresh_P_count``, ``fresh_G_edge``,
``fresh_checks_min``, ``fresh_valid_min``, ``fresh_executable_min``, ``fresh_refused_right``,
``fresh_handovers_smooth``, ``fresh_untouched_identical``, ``fresh_unreported_collisions``, and ``fresh_physical_min``
(the lowest of ``physical_*``).
"""

import argparse
import re
import statistics
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, as_completed
from pathlib import Path

from rich.console import Console
from rich.progress import track

from plannerforge.engine.analysis import wilson_interval
from plannerforge.evals.ground_truth.modification import published_presets

from ..harness import existing, percentile_95, print_figures, process_pool, share, shared_folder, shared_scenarios
from .cases import Case, Effort, Measured, Refusal, measure_file, measure_fresh, measure_line
from .safety import safety_rows

TASKS = ("T", "B", "P", "G")
CORPUS = ("T", "B", "P", "G", "composite")
EVERY_FILE_PLANNED, EVERY_FILE_SAFE, EVERY_FILE_WHOLE, EVERY_LINE_PLANNED = 4, 8, 4, 16
"""The planner drives the edits of every fourth file and of every sixteenth line of the corpus, and the recipes of every
eighth file. The drivability checker judges one drawn vehicle of each edit, and all touched ones on every fourth file.
Either takes longer than the edits; the table states the sample of each figure.
"""
HEADLINES = ("T_ends", "B_preset", "P_count", "G_edge", "composite_done")
PHYSICAL = ("T", "B", "P", "composite")
LARGEST_JUMP_M, LARGEST_STEP_MPS = 0.05, 1.0
"""Limits of a smooth hand-over: distance beyond v·dt, and speed."""
FRESH = (
    *("round_trip", "T_ends", "B_preset", "P_count", "G_edge", "checks_min", "valid_min", "executable_min"),
    *("refused_right", "handovers_smooth", "untouched_identical", "unreported_collisions"),
)
"""Figures also measured on fresh scenarios."""
REASONS, REASON_LETTERS = 6, 110
"""Number and length of the refusals that the table shows for each task."""


def _measure(files: Sequence[Path], lines: Sequence[str], workers: int) -> list[Measured]:
    """Run all jobs on worker processes, in no particular order."""
    presets = published_presets(shared_folder() / "facts")
    with process_pool(workers) as pool:
        jobs: list[Future[Measured]] = []
        for index, path in enumerate(files):
            effort = Effort(
                planner=index % EVERY_FILE_PLANNED == 0,
                safety=index % EVERY_FILE_SAFE == 0,
                every_vehicle=index % EVERY_FILE_WHOLE == 0,
            )
            jobs.append(pool.submit(measure_file, path, presets, effort))
        for index, line in enumerate(lines):
            effort = Effort(planner=index % EVERY_LINE_PLANNED == 0)
            jobs.append(pool.submit(measure_line, line, shared_scenarios(), effort))
        return _results(jobs)


def _measure_fresh(seeds: Sequence[int], count: int, workers: int) -> list[Measured]:
    """Measure the given number of fresh scenarios of each seed on worker processes, in no particular order."""
    presets = published_presets(shared_folder() / "facts")
    with process_pool(workers) as pool:
        jobs = [
            pool.submit(
                measure_fresh,
                seed,
                number,
                presets,
                Effort(
                    planner=number // 2 % EVERY_FILE_PLANNED == 0,
                    every_vehicle=number // 2 % EVERY_FILE_WHOLE == 0,
                    recipes=False,
                ),
            )
            for seed in seeds
            for number in range(count)
        ]
        return _results(jobs)


def _results(jobs: Sequence[Future[Measured]]) -> list[Measured]:
    """Return the results of the jobs, and print faults at once, because a long run may be interrupted."""
    console, results = Console(stderr=True, soft_wrap=True), list[Measured]()
    try:
        for job in track(as_completed(jobs), total=len(jobs), console=console):
            results.append(job.result())
            for line in failures_of(results[-1:]):
                console.print(line, markup=False, highlight=False)
    except BaseException:
        for job in jobs:
            job.cancel()
        raise
    return results


def fresh_figures(seeds: Sequence[int], measured: Sequence[Measured]) -> dict[str, float | int | str]:
    """Return the figures of fresh scenarios by key."""
    made = [case for result in measured for case in result.cases if not case.refused]
    figures = figures_of(measured)
    physical = [_settled(made, task) for task in (*PHYSICAL, None)]
    return {
        "seeds": " ".join(map(str, seeds)),
        "fresh_files": len(measured),
        "fresh_refused": sum(bool(result.unread) for result in measured),
        "fresh_crashed": sum(bool(result.crashed) for result in measured),
        "fresh_edits": len(made),
        **{f"fresh_{name}": figures[name] for name in FRESH},
        "fresh_physical_min": min((share(verdicts) for verdicts in physical if verdicts), default=0.0),
    }


def figures_of(measured: Sequence[Measured]) -> dict[str, float]:
    """Return the figures by key."""
    cases = [case for result in measured for case in result.cases]
    made = [case for case in cases if not case.refused]
    checks = _checks(cases)
    trips = [result.round_trip_error for result in measured if result.round_trip_error is not None]
    touched = max(sum(case.touched for case in made), 1)
    seconds = [case.edit_s for case in made]
    first = [case.edit_s for case in made if case.is_first]
    figures = {
        "round_trip": share(not trip for trip in trips),
        **{name: share(checks.get(name, ())) for name in HEADLINES},
        "T_arrives": share(there for case in made for there in case.arrivals),
        "checks_min": min((share(values) for values in checks.values()), default=0.0),
        "valid_min": _least(made, lambda case: case.valid),
        "valid_strict_min": _least(made, lambda case: case.strictly_valid),
        "executable_min": _least(made, lambda case: case.executed),
        "refused_right": share(right for result in measured for _, right in result.refused_right),
        "untouched_identical": share(case.untouched_identical for case in made),
        **{f"physical_{task}": share(_settled(made, task)) for task in PHYSICAL},
        "physical_handed_over": share(_settled(made)),
        "handovers_smooth": share(_is_smooth(*errors) for case in made for errors in case.handovers),
        "unreported_collisions": sum(case.unreported for case in made) / touched,
        "collisions_left": sum(case.collisions for case in made) / touched,
        "several_calls_equal": share(_known(case.in_several_calls_equal for case in made)),
        "edit_median_s": statistics.median(seconds or [0.0]),
        "edit_p95_s": percentile_95(seconds or [0.0]),
        "edit_first_median_s": statistics.median(first or [0.0]),
        "edit_cpu_median_s": statistics.median([case.edit_cpu_s for case in made] or [0.0]),
    }
    return {name: round(value, 4) for name, value in figures.items()}


def rows_of(measured: Sequence[Measured]) -> list[tuple[str, str]]:
    """Return the rows next to the figures: counts, hand-overs, and the checker's verdicts."""
    cases = [case for result in measured for case in result.cases]
    made = [case for case in cases if not case.refused]
    rows = []
    for task in (*TASKS, "composite"):
        mine = [case for case in cases if case.task == task]
        rows.append((f"edits {task}", f"{sum(not case.refused for case in mine)} done of {len(mine)}"))
    rows += [(f"check {name}", _interval(values)) for name, values in sorted(_checks(cases).items())]
    arrivals = [there for case in made for there in case.arrivals]
    rows.append(("arrive in time", f"{_interval(arrivals)}; the others are on their way, or T_ends fails"))
    rows += refusal_rows([refusal for case in cases for refusal in case.tries])
    rows += [(f"physical {task}", _interval(_settled(made, task))) for task in PHYSICAL]
    rows.append(("physical, also handed over", _interval(_settled(made))))
    rows += [(f"drivable {task}", _drivable([case for case in made if case.task == task])) for task in PHYSICAL]
    for task in (*TASKS, "composite"):
        rows.append((f"executable {task}", _interval([case.executed for case in made if case.task == task])))
    later = sum(case.enter_later > 0 for case in made)
    rows.append(("enter later, as requested", f"{later} files, for which the schema has no form"))
    given = [errors for case in made for errors in case.handovers]
    jump, step = (max(errors, default=0.0) for errors in (zip(*given, strict=True) if given else ((), ())))
    rows.append(("largest hand-over", f"{jump:.3f} m beyond v·dt, {step:.2f} m/s, of {len(given)}"))
    for task in TASKS:
        rows.append((f"no request {task}", f"{sum(task in result.no_request for result in measured)} files"))
    refused = [right for result in measured for _, right in result.refused_right]
    lenient = [name for result in measured for name in result.not_to_refuse]
    rows.append(("refused right", f"{_interval(refused)}; going on is right too: {', '.join(lenient) or 'none'}"))
    on_road, off_lanes = (sum(getattr(result, name) for result in measured) for name in ("road_users", "off_lanes"))
    rows.append(("round trip", f"{on_road} road users, {off_lanes} of them off all lanelets"))
    rows += [("refused when read", result.unread) for result in measured if result.unread]
    rows += [("crashed", result.crashed) for result in measured if result.crashed]
    rows.append(("also handed over", str(sum(case.handed_over for case in made))))
    rows.append(("collisions reported", str(sum(case.collisions for case in made))))
    return rows + safety_rows([shift for result in measured for shift in result.shifts])


def refusal_rows(tries: Sequence[Refusal]) -> list[tuple[str, str]]:
    """Count the refused requests, drawn or from the corpus, by their reasons without figures."""
    rows = []
    for task in (*TASKS, "composite"):
        mine = [refusal for refusal in tries if refusal.task == task]
        judged = _known(refusal.is_right for refusal in mine)
        rows.append((f"tries refused {task}", f"{len(mine)}, {judged.count(False)} of {len(judged)} judged wrongly"))
        reasons = Counter(_in_short(refusal.reason) for refusal in mine)
        rows += [(f"  because, {task}", f"{count} × {reason}") for reason, count in reasons.most_common(REASONS)]
    return rows


def failures_of(measured: Sequence[Measured]) -> list[str]:
    """Return every failed request and check, one line each."""
    lines = [f"round trip: {result.round_trip_error}" for result in measured if result.round_trip_error]
    lines += [f"not refused right: {name}" for result in measured for name, right in result.refused_right if not right]
    lines += [f"crashed: {result.crashed}" for result in measured if result.crashed]
    for case in (case for result in measured for case in result.cases):
        wrong = [
            *(name for name, passed in case.checks.items() if not passed),
            *(f"wrongly refused: {refusal.reason}" for refusal in case.tries if refusal.is_right is False),
        ]
        if not case.refused:
            wrong += [] if case.valid else ["valid"]
            wrong += [] if case.untouched_identical else ["untouched"]
        wrong += ["executed"] if case.executed is False else []
        wrong += ["several calls"] if case.in_several_calls_equal is False else []
        wrong += ["physical"] if any(verdict.settled is False for verdict in case.physical) else []
        wrong += [f"{case.unreported} unreported collisions"] if case.unreported else []
        wrong += [f"{case.collisions} collisions reported"] if case.collisions else []
        rough = [errors for errors in case.handovers if not _is_smooth(*errors)]
        wrong += [f"hand-over {jump:.3f} m, {step:.2f} m/s" for jump, step in rough]
        wrong += [f"refused: {case.refused}"] if case.refused else []
        lines += [f"{case.task} {case.name}: {', '.join(wrong)}"] if wrong else []
    return sorted(lines)


def _drivable(cases: Sequence[Case]) -> str:
    verdicts = [verdict for case in cases for verdict in case.physical]
    whole = sum(verdict.whole for verdict in verdicts)
    recorded = _known(verdict.recorded for verdict in verdicts)
    agree = sum(verdict.closed_form == verdict.whole for verdict in verdicts)
    return (
        f"whole {whole} of {len(verdicts)}; recorded {sum(recorded)} of {len(recorded)}; closed form agrees on {agree}"
    )


def _settled(cases: Sequence[Case], task: str | None = None) -> list[bool]:
    """Return verdicts from 1 s after the hand-over on, for vehicles that a task's edits name or for the others."""
    verdicts = [verdict for case in cases if task in (None, case.task) for verdict in case.physical]
    return _known(verdict.settled for verdict in verdicts if verdict.handed_over == (task is None))


def _is_smooth(jump_m: float, step_mps: float) -> bool:
    return jump_m <= LARGEST_JUMP_M and step_mps <= LARGEST_STEP_MPS


def _known(values: Iterable[bool | None]) -> list[bool]:
    """Return the values without those that were not measured."""
    return [value for value in values if value is not None]


def _interval(values: Iterable[bool | None]) -> str:
    """Return a count with the 95 % interval of its share, or nothing if it was not measured."""
    known = _known(values)
    if not known:
        return "not measured"
    low, high = wilson_interval(sum(known), len(known))
    return f"{sum(known)} of {len(known)} ({low:.3f} … {high:.3f})"


def _in_short(reason: str) -> str:
    """Return a fault without its figures and the text after it."""
    wrong = re.split(r"[.] (?:Valid|Next):", reason.partition("] ")[2] or reason)[0]
    return re.sub(r"-?\d[\d.]*", "N", wrong)[:REASON_LETTERS]


def _checks(cases: Sequence[Case]) -> dict[str, list[bool]]:
    """Return the verdicts by check; the refusal of a feasible request fails the headline of its task.

    An attempt followed by another request counts only if the bench knows that its refusal was wrong. Attempts that
    physics prevents do not count.
    """
    checks: dict[str, list[bool]] = defaultdict(list)
    for case in cases:
        for name, passed in case.checks.items():
            checks[name].append(passed)
        wrong = sum(refusal.is_right is False for refusal in case.tries)
        last = case.tries[-1].is_right if case.tries else None
        excused = last is False or (case.task == "T" and last is True)
        failed = wrong + (1 if case.refused and not excused else 0)
        for name in (name for name in HEADLINES if name.startswith(f"{case.task}_")):
            checks[name] += [False] * failed
    return checks


def _least(cases: Sequence[Case], judge: Callable[[Case], bool | None]) -> float:
    """Return the lowest share over the tasks, ignoring unmeasured ones."""
    verdicts = [_known(judge(case) for case in cases if case.task == task) for task in CORPUS]
    return min((share(values) for values in verdicts if values), default=0.0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=1, help="only every n-th file and request")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--fresh", type=int, nargs="+", metavar="SEED", help="use new scenarios from these seeds")
    parser.add_argument("--count", type=int, default=50, help="with --fresh: scenarios of each seed")
    asked = parser.parse_args()
    if asked.fresh is not None:
        results = _measure_fresh(asked.fresh, asked.count, asked.workers)
        print_figures("Modification", fresh_figures(asked.fresh, results), more_rows=rows_of(results))
        sys.exit()
    scenarios = sorted(existing(shared_scenarios()).glob("*.xml"))[:: asked.every]
    corpora = [shared_folder() / "corpora" / "dev" / f"modification_{task}.jsonl" for task in CORPUS]
    requests = [line for path in corpora for line in path.read_text(encoding="utf-8").splitlines()][:: asked.every]
    results = _measure(scenarios, requests, asked.workers)
    print_figures("Modification", figures_of(results), more_rows=rows_of(results))
