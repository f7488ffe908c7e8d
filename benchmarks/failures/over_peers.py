"""Distinct failures within a budget, over those of other searches on the same space.

Cells are fixed by the product's archive: counterpart and manoeuvre, contact, speed band and cause. Bases are drawn, and
IDM drives with a weakness that each base shows, because healthy IDM has nearly no failure that a careful driver avoids;
FISS drives as it is.

Keys: ``over_best_peer`` (mean distinct failures of ours over those of the best peer, in which 0 counts as 1);
``cells_ours``, ``cells_PEER``; ``over_cases``, ``over_runs``. ``cells_150`` is the share of all cells found in a case,
by any search, that ours finds in 150 runs.
"""

import sys
from collections import defaultdict
from statistics import fmean

from ..harness import Figures
from .bench import FailuresBench
from .cases import Case
from .peers import SEARCHES, cells_after, searched

_WEAKNESSES = ("blind_on_the_left", "blind_to_crossing", "slow_to_notice", "blind_to_slow")
_PART = 150


def measure(bench: FailuresBench) -> Figures:
    """Search every case with every search and seed."""
    counts: dict[str, list[int]] = defaultdict(list)
    shares, cases = [], 0
    for number, base in enumerate(bench.idm_bases):
        path = base.path
        for planner, weakness in (("idm", _WEAKNESSES[number % len(_WEAKNESSES)]), ("fiss", "")):
            case = Case(bench.base_of(base, planner), weakness)
            if not case.is_possible:
                sys.stderr.write(f"{path.stem} {planner} {weakness}: no base\n")
                case.base.close()
                continue
            cases += 1
            own, union = [], set[str]()
            for name in SEARCHES:
                for seed in bench.all_seeds:
                    found = searched(name, case.strata, seed, case.judge, bench.runs)
                    cells = cells_after(found, bench.runs)
                    counts[name].append(len(cells))
                    union.update(cells)
                    if name == "ours":
                        own.append(set(cells_after(found, _PART)))
                seeds = counts[name][-bench.seeds :]
                sys.stderr.write(f"{path.stem} {planner} {weakness} {name}: {seeds}\n")
            if union:
                shares.append(fmean(len(one) / len(union) for one in own))
            case.base.close()
    means = {name: fmean(values) for name, values in counts.items() if values}
    best = max((mean for name, mean in means.items() if name != "ours"), default=0.0)
    return {
        "over_best_peer": round(means.get("ours", 0.0) / max(best, 1.0), 3),
        **{f"cells_{name}": round(mean, 2) for name, mean in means.items()},
        "cells_150": round(fmean(shares), 3) if shares else 0.0,
        "over_cases": cases,
        "over_runs": bench.runs,
    }
