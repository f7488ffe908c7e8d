"""Planted weaknesses: how soon each is found as itself.

A weakness is found as itself by a failure that a careful driver avoids and that the healthy planner does not have at
the same point. It is planted into IDM, on a drawn road or in a drawn public scenario that the weak planner passes and
in which random points (other than any search's) reach it at all. Weaknesses take turns with the bases, so that not all
of them stand in the first.

Keys:

- ``planted_common``: share of weaknesses and seeds found within 60 runs; ``planted_common_weaknesses``: their number.
- ``planted_rare``: the same within 300 runs, for weaknesses that at most .2 % of random points hit;
  ``planted_rare_weaknesses``.
- ``planted_median_run``: the run that found a common one.
- ``planted_unreached``: weaknesses that no base shows, or that are not rare in any.
"""

import sys
import time
from collections.abc import Sequence
from statistics import median

import numpy as np

from plannerforge.engine.exploration import Point

from ..harness import Figures, share
from .bench import FailuresBench
from .cases import Base, Case
from .peers import SEARCHES
from .weaknesses import NAMES, PRACTICE, RARE

_COMMON_RUNS, _RARE_RUNS = 60, 300
_SCANNED, _RARE_SCANNED = 80, 200
_RARE_RATE = 0.002
_SCAN_SEED = 987_654_321


def measure(bench: FailuresBench) -> Figures:
    """Search for every planted weakness with every seed."""
    common = tuple(PRACTICE) if bench.practice else NAMES
    rare = () if bench.practice else tuple(RARE)
    watched = (*common, *rare)
    wanted = bench.weaknesses or watched
    bases = [*bench.road_bases, *bench.idm_bases]
    for base in bases:
        base.watched = wanted
    places = {
        name: _place(bases, number, name, is_rare=name in RARE) for number, name in enumerate(watched) if name in wanted
    }
    found: dict[str, list[int | None]] = {}
    for base in bases:
        for name in (name for name, place in places.items() if place is base):
            found[name] = _firsts(Case(base, name, shares=True), bench.all_seeds, is_rare=name in RARE)
        base.close()
    firsts = [run for name in common for run in found.get(name, ())]
    rare_firsts = [run for name in rare for run in found.get(name, ())]
    runs = [run for run in firsts if run is not None]
    return {
        "planted_common": share(run is not None for run in firsts),
        "planted_common_weaknesses": sum(name in found for name in common),
        "planted_rare": share(run is not None for run in rare_firsts),
        "planted_rare_weaknesses": sum(name in found for name in rare),
        "planted_median_run": median(runs) if runs else "none",
        "planted_unreached": " ".join(name for name in wanted if name not in found) or "none",
        "planted_seeds": bench.seeds,
    }


def _firsts(case: Case, seeds: Sequence[int], *, is_rare: bool) -> list[int | None]:
    begun = time.monotonic()
    firsts = [first_as_itself(case, seed, _RARE_RUNS if is_rare else _COMMON_RUNS) for seed in seeds]
    sys.stderr.write(f"{case.weakness} in {case.path.stem}: {firsts} ({time.monotonic() - begun:.0f} s)\n")
    return firsts


def _place(bases: Sequence[Base], number: int, weakness: str, *, is_rare: bool) -> Base | None:
    """Return the first base, from the weakness's own turn on, that shows it; for a rare one, rarely enough."""
    for turn in range(len(bases)):
        base = bases[(number + turn) % len(bases)]
        case = Case(base, weakness, shares=True)
        if case.is_possible:
            rate, points = _rare_rate(case) if is_rare else _shown(case)
            sys.stderr.write(f"{weakness}: hit rate about {rate:.4f} of {points} random points, {base.path.stem}\n")
            if rate and (not is_rare or rate <= _RARE_RATE):
                return base
        else:
            sys.stderr.write(f"{weakness}: fails in the unchanged {base.path.stem}\n")
    return None


def _shown(case: Case) -> tuple[float, int]:
    """Return the hit rate of random points up to the first hit, and their number."""
    for number, point in enumerate(_random_points(case, _SCANNED, ())):
        if _is_hit(case, point):
            return 1 / (number + 1), number + 1
    return 0.0, _SCANNED


def _rare_rate(case: Case) -> tuple[float, int]:
    """Return the hit rate of random points, and how many were drawn.

    They are drawn only in strata in which the weakness changes what the planner sees at all, because it can fail in no
    other one.
    """
    matter = {
        point.stratum for point in _random_points(case, _SCANNED, ()) if case.base.is_altered(point, case.weakness)
    }
    if not matter:
        return 0.0, _SCANNED
    points = list(_random_points(case, _RARE_SCANNED, sorted(matter)))
    hits = sum(_is_hit(case, point) for point in points)
    return hits / len(points) * len(matter) / len(case.strata), len(points)


def _random_points(case: Case, count: int, strata: Sequence[str]) -> Sequence[Point]:
    """Return random points in some strata, by default in all; the same ones for every weakness."""
    chosen = [stratum for stratum in case.strata if not strata or stratum.name in strata]
    drawn, points = np.random.default_rng(_SCAN_SEED), []
    for _ in range(count):
        stratum = chosen[int(drawn.integers(len(chosen)))]
        values = tuple(round(float(one), 6) for one in drawn.random(stratum.dimensions))
        points.append(Point(stratum.name, values))
    return points


def _is_hit(case: Case, point: Point) -> bool:
    return case.judge(point).score.cell is not None and case.is_planted(point)


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
