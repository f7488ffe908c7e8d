"""Planted weaknesses: how soon each is found as itself.

A weakness is found as itself by a failure that a careful driver avoids and that the healthy planner does not have at
the same point. It is planted into IDM, in the first drawn base that the weak planner passes and in which random points
(other than any search's) reach it at all.

Keys: ``planted_common`` (share of weaknesses and seeds found within 60 runs), ``planted_common_weaknesses``,
``planted_rare`` (within 300 runs, for weaknesses that at most .2 % of random points hit), ``planted_rare_weaknesses``,
``planted_median_run`` and ``planted_unreached`` (weaknesses that no base shows).
"""

import sys
from statistics import median

import numpy as np

from plannerforge.engine.exploration import Point

from ..harness import Figures, share
from .bench import FailuresBench
from .cases import Case
from .peers import SEARCHES
from .weaknesses import NAMES, RARE

_COMMON_RUNS, _RARE_RUNS = 60, 300
_SCANNED, _RARE_SCANNED = 150, 1000
_SCAN_SEED = 987_654_321


def measure(bench: FailuresBench) -> Figures:
    """Search for every planted weakness with every seed."""
    found, unreached = _found(bench, NAMES, _COMMON_RUNS, _SCANNED, rare=False)
    rare, unreached_rare = _found(bench, tuple(RARE), _RARE_RUNS, _RARE_SCANNED, rare=True)
    runs = [run for run in found if run is not None]
    return {
        "planted_common": share(run is not None for run in found),
        "planted_common_weaknesses": len(NAMES) - len(unreached),
        "planted_rare": share(run is not None for run in rare),
        "planted_rare_weaknesses": len(RARE) - len(unreached_rare),
        "planted_median_run": median(runs) if runs else "none",
        "planted_unreached": " ".join((*unreached, *unreached_rare)) or "none",
        "planted_seeds": bench.seeds,
    }


def _found(
    bench: FailuresBench, weaknesses: tuple[str, ...], runs: int, scanned: int, *, rare: bool
) -> tuple[list[int | None], list[str]]:
    """Return the run that found each weakness with each seed, and the weaknesses that no base shows."""
    found: list[int | None] = []
    unreached = []
    for weakness in weaknesses:
        case = _case(bench, weakness, scanned, rare=rare)
        if case is None:
            unreached.append(weakness)
            continue
        firsts = [first_as_itself(case, seed, runs) for seed in range(bench.first_seed, bench.first_seed + bench.seeds)]
        sys.stderr.write(f"{weakness} in {case.path.stem}: {firsts}\n")
        found += firsts
        case.close()
    return found, unreached


def _case(bench: FailuresBench, weakness: str, scanned: int, *, rare: bool) -> Case | None:
    """Return the first base in which the weakness can be reached; for a rare one, rarely enough."""
    for path in bench.idm_bases:
        case = bench.case(path, "idm", weakness)
        if case.strata and not case.evaluator.evaluate(()).has_failed:
            hits, runs = _scan(case, scanned, to_first=not rare)
            if hits and (not rare or hits / runs <= 0.002):
                sys.stderr.write(f"{weakness}: {hits} of {runs} random runs in {path.stem}\n")
                return case
        case.close()
    return None


def _scan(case: Case, points: int, *, to_first: bool) -> tuple[int, int]:
    """Return how many of some random points show the weakness, and how many were run."""
    drawn, hits, runs = np.random.default_rng(_SCAN_SEED), 0, 0
    for _ in range(points):
        stratum = case.strata[int(drawn.integers(len(case.strata)))]
        point = Point(stratum.name, tuple(round(float(one), 6) for one in drawn.random(stratum.dimensions)))
        judged = case.judge(point)
        runs += judged.score.value is not None
        hits += judged.score.cell is not None and case.is_planted(point)
        if hits and to_first:
            break
    return hits, runs


def first_as_itself(case: Case, seed: int, runs: int, search: str = "ours") -> int | None:
    """Return the number of the first run that shows the weakness, or None."""
    used = 0
    for tried, (point, judged) in enumerate(SEARCHES[search](case.strata, seed, case.judge)):
        used += judged.score.value is not None
        if used > runs or tried > 10 * runs:
            return None
        if judged.score.cell is not None and case.is_planted(point):
            return used
    return None
