"""Planted weaknesses: how soon each is found as itself.

A weakness is found as itself by a failure that a careful driver avoids and that the healthy planner does not have at
the same point. It is planted into IDM, on a drawn road or in a drawn public scenario that the weak planner passes and
in which random points (other than any search's) reach it at all. Weaknesses take turns with the bases, so that not all
of them stand in the first.

Keys:

- ``planted_common``: share of weaknesses and seeds found within 60 runs; ``planted_common_weaknesses``: their number.
- ``planted_rare``: the same within 300 runs, for weaknesses that at most .2 % of random runs hit;
  ``planted_rare_weaknesses``. ``planted_rare_rates``: the share of random runs that hit each, in percent, with its 95 %
  interval. A random point has a random stratum and random parameters. Only strata in which a weakness changes what
  the planner sees in some of 40 points are drawn from, 600 points in all; their share of the strata is a factor of
  the rate.
- ``planted_median_run``: the run that found a common one.
- ``planted_unreached``: weaknesses that no base shows, or that are not rare in any.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np

from plannerforge.engine.analysis.statistics import wilson_interval
from plannerforge.engine.exploration import Point

from ..harness import Figures, share
from .bench import FailuresBench
from .cases import Base, Case
from .peers import SEARCHES
from .weaknesses import NAMES, PRACTICE, RARE, RARE_PRACTICE

_COMMON_RUNS, _RARE_RUNS = 60, 300
_SCANNED = 80
_LOOKED_AT, _RARE_SCANNED = 40, 600
"""Points of each stratum that show whether a weakness matters there, and points in those in which it does."""
_RARE_RATE = 0.002
_SCAN_SEED = 987_654_321


def measure(bench: FailuresBench) -> Figures:
    """Search for every planted weakness with every seed."""
    common = tuple(PRACTICE) if bench.practice else NAMES
    rare = tuple(RARE_PRACTICE if bench.practice else RARE)
    watched = (*common, *rare)
    wanted = bench.weaknesses or watched
    bases = [*bench.road_bases, *bench.idm_bases]
    for base in bases:
        base.watched = wanted
    places = {
        name: _place(bases, number, name, is_rare=name in rare) for number, name in enumerate(watched) if name in wanted
    }
    found: dict[str, list[int | None]] = {}
    for base in bases:
        for name, place in places.items():
            if place is not None and place.base is base:
                found[name] = _firsts(Case(base, name, shares=True), bench.all_seeds, is_rare=name in rare)
        base.close()
    rates = [f"{name}={place.rate.stated}" for name, place in places.items() if place is not None and name in rare]
    firsts = [run for name in common for run in found.get(name, ())]
    rare_firsts = [run for name in rare for run in found.get(name, ())]
    runs = [run for run in firsts if run is not None]
    return {
        "planted_common": share(run is not None for run in firsts),
        "planted_common_weaknesses": sum(name in found for name in common),
        "planted_rare": share(run is not None for run in rare_firsts),
        "planted_rare_weaknesses": sum(name in found for name in rare),
        "planted_rare_rates": " ".join(rates) or "none",
        "planted_median_run": median(runs) if runs else "none",
        "planted_unreached": " ".join(name for name in wanted if name not in found) or "none",
        "planted_seeds": bench.seeds,
    }


def _firsts(case: Case, seeds: Sequence[int], *, is_rare: bool) -> list[int | None]:
    begun = time.monotonic()
    firsts = [first_as_itself(case, seed, _RARE_RUNS if is_rare else _COMMON_RUNS) for seed in seeds]
    sys.stderr.write(f"{case.weakness} in {case.path.stem}: {firsts} ({time.monotonic() - begun:.0f} s)\n")
    return firsts


@dataclass(frozen=True)
class _Rate:
    """The share of random runs that hit a weakness.

    ``hits`` of ``points`` that were drawn; ``share`` turns their share into that of all random runs.
    """

    hits: int
    points: int
    share: float = 1.0

    @property
    def value(self) -> float:
        """The estimate."""
        return self.hits / self.points * self.share

    @property
    def stated(self) -> str:
        """The estimate with its 95 % interval, in percent."""
        low, high = wilson_interval(self.hits, self.points)
        return f"{100 * self.value:.3f}[{100 * low * self.share:.3f},{100 * high * self.share:.3f}]"


@dataclass(frozen=True)
class _Place:
    """The base in which a weakness is planted, and how often random runs hit it there."""

    base: Base
    rate: _Rate


def _place(bases: Sequence[Base], number: int, weakness: str, *, is_rare: bool) -> _Place | None:
    """Return the first base, from the weakness's own turn on, that shows it; for a rare one, rarely enough."""
    for turn in range(len(bases)):
        base = bases[(number + turn) % len(bases)]
        case = Case(base, weakness, shares=True)
        if case.is_possible:
            rate = _rare_rate(case) if is_rare else _shown(case)
            sys.stderr.write(f"{weakness}: hit by {rate.stated} % of random runs, {base.path.stem}\n")
            if rate.hits and (not is_rare or rate.value <= _RARE_RATE):
                return _Place(base, rate)
        else:
            sys.stderr.write(f"{weakness}: fails in the unchanged {base.path.stem}\n")
    return None


def _shown(case: Case) -> _Rate:
    """Return the hit rate of random points up to the first hit."""
    for number, point in enumerate(_random_points(case, _SCANNED, ())):
        if _is_hit(case, point):
            return _Rate(1, number + 1)
    return _Rate(0, _SCANNED)


def _rare_rate(case: Case) -> _Rate:
    """Return the hit rate of random runs, from points in strata in which the weakness changes what the planner sees.

    It can fail as itself in no other stratum.
    """
    looked_at = [point for one in case.strata for point in _random_points(case, _LOOKED_AT, [one.name])]
    ran = [point for point in looked_at if case.base.evaluated(point).score.value is not None]
    matter = {point.stratum for point in ran if case.base.is_altered(point, case.weakness)}
    if not matter:
        return _Rate(0, len(looked_at))
    points = _random_points(case, _RARE_SCANNED, sorted(matter))
    hits = sum(_is_hit(case, point) for point in points)
    # Implausible points cost no run, so a random run is a plausible point.
    return _Rate(hits, len(points), len(matter) / len(case.strata) * len(looked_at) / len(ran))


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
    if not case.base.is_altered(point, case.weakness):
        return False
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
