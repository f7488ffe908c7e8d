"""Searches to compare ours with, on the same space and with the same scores: random, Optuna's TPE, CMA-ES, NSGA-II.

Each proposes one point after another and learns its score. The stratum is a category for TPE. The others know only
numbers, so it is one more of them; parameters that a stratum lacks are ignored.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plannerforge.engine.exploration import FailureSearch, Point, Score, Stratum

IMPLAUSIBLE = 3.0
"""The objective at an implausible point: worse than anything that was run."""
SECOND_LARGEST = 1.0


@dataclass(frozen=True)
class Judged:
    """The score of a point, and a second objective for searches with several: the time left in s, up to 1."""

    score: Score
    second: float = SECOND_LARGEST

    @property
    def objective(self) -> float:
        """The value that peers minimise."""
        return IMPLAUSIBLE if self.score.value is None else self.score.value


Judge = Callable[[Point], Judged]
Trace = Iterator[tuple[Point, Judged]]


def _decoded(strata: Sequence[Stratum], numbers: Sequence[float]) -> Point:
    """Return the point of numbers in [0, 1]: first the stratum, then its parameters."""
    stratum = strata[min(int(numbers[0] * len(strata)), len(strata) - 1)]
    return Point(stratum.name, tuple(round(float(value), 6) for value in numbers[1 : 1 + stratum.dimensions]))


def _numbers(strata: Sequence[Stratum]) -> int:
    return 1 + max(stratum.dimensions for stratum in strata)


def ours(strata: Sequence[Stratum], seed: int, judge: Judge) -> Trace:
    """Yield the points of the product's search, in its order."""
    search = FailureSearch(strata, seed)
    while True:
        points = search.ask()
        judged = [judge(point) for point in points]
        yield from zip(points, judged, strict=True)
        search.tell([one.score for one in judged])


def random(strata: Sequence[Stratum], seed: int, judge: Judge) -> Trace:
    """Yield independent points."""
    drawn, count = np.random.default_rng(seed), _numbers(strata)
    while True:
        point = _decoded(strata, drawn.random(count).tolist())
        yield point, judge(point)


def tpe(strata: Sequence[Stratum], seed: int, judge: Judge) -> Trace:
    """Yield the points of Optuna's tree-structured Parzen estimator, multivariate, after 20 random ones."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    by_name = {stratum.name: stratum for stratum in strata}
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed, n_startup_trials=20, multivariate=True))
    while True:
        trial = study.ask()
        stratum = by_name[str(trial.suggest_categorical("stratum", list(by_name)))]
        values = [trial.suggest_float(f"u{index}", 0.0, 1.0) for index in range(_numbers(strata) - 1)]
        point = Point(stratum.name, tuple(round(value, 6) for value in values[: stratum.dimensions]))
        judged = judge(point)
        study.tell(trial, judged.objective)
        yield point, judged


def cma(strata: Sequence[Stratum], seed: int, judge: Judge) -> Trace:
    """Yield the points of CMA-ES, restarted at a random point when it stops, after 8 generations at the latest."""
    from cmaes import CMA

    drawn, count, restarts = np.random.default_rng(seed), _numbers(strata), 0
    while True:
        bounds = np.array([[0.0, 1.0]] * count)
        search = CMA(mean=drawn.random(count), sigma=0.25, bounds=bounds, seed=seed * 1000 + restarts)
        restarts += 1
        while not search.should_stop() and search.generation < 8:
            told = []
            for _ in range(search.population_size):
                numbers = search.ask()
                point = _decoded(strata, numbers.tolist())
                judged = judge(point)
                told.append((numbers, judged.objective))
                yield point, judged
            search.tell(told)


def nsga2(strata: Sequence[Stratum], seed: int, judge: Judge) -> Trace:
    """Yield the points of pymoo's NSGA-II with 20 individuals, which minimises the score and the time left."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.evaluator import Evaluator
    from pymoo.core.problem import Problem
    from pymoo.problems.static import StaticProblem

    class Space(Problem):  # type: ignore[misc] # pymoo has no types
        def __init__(self) -> None:
            super().__init__(n_var=_numbers(strata), n_obj=2, xl=0.0, xu=1.0)

    problem = Space()
    algorithm: Any = NSGA2(pop_size=20)
    algorithm.setup(problem, termination=("n_gen", 10_000), seed=seed, verbose=False)
    while True:
        population = algorithm.ask()
        objectives = []
        for numbers in population.get("X"):
            point = _decoded(strata, numbers.tolist())
            judged = judge(point)
            objectives.append([judged.objective, judged.second])
            yield point, judged
        Evaluator().eval(StaticProblem(problem, F=np.array(objectives)), population)
        algorithm.tell(infills=population)


SEARCHES: Mapping[str, Callable[[Sequence[Stratum], int, Judge], Trace]] = {
    "ours": ours,
    "random": random,
    "tpe": tpe,
    "cma": cma,
    "nsga2": nsga2,
}
"""The searches by their name; all but ``ours`` are peers."""
_MOST_TRIED = 10
"""A search ends after this many points per run, if nearly all are implausible."""


def searched(name: str, strata: Sequence[Stratum], seed: int, judge: Judge, runs: int) -> list[tuple[Point, Judged]]:
    """Return the points of a search until it has used its runs; implausible points cost no run."""
    found: list[tuple[Point, Judged]] = []
    used = 0
    for point, judged in SEARCHES[name](strata, seed, judge):
        found.append((point, judged))
        used += judged.score.value is not None
        if used >= runs or len(found) >= _MOST_TRIED * runs:
            return found
    return found


def cells_after(found: Sequence[tuple[Point, Judged]], runs: int) -> list[str]:
    """Return the cells found within a number of runs, in their order."""
    cells: dict[str, None] = {}
    used = 0
    for _, judged in found:
        used += judged.score.value is not None
        if used > runs:
            break
        if judged.score.cell is not None:
            cells[judged.score.cell] = None
    return list(cells)


def first_run_in(found: Sequence[tuple[Point, Judged]], cells: Callable[[str], bool]) -> int | None:
    """Return the number of the first run (from 1) with a failure in a wanted cell, or None."""
    used = 0
    for _, judged in found:
        used += judged.score.value is not None
        if judged.score.cell is not None and cells(judged.score.cell):
            return used
    return None
