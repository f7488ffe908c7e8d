"""How many points the adaptive search of boundaries needs, over those of a grid with the same error.

Truth is a grid of 33 × 33 points. A map's error is the share of these points at which it shows another outcome; maps
of grids are drawn in the same way as those of the search, by the edge inside each cell. The grids have 5, 9 and 17
points along each side. Between them, the number of points of a grid with the search's error is interpolated with the
logarithms of points and errors in proportion. Beyond them, it is that of the nearest grid.

Keys: ``adaptive_share`` (geometric mean over boundaries and budgets), ``adaptive_share_SCENARIO``,
``edges_processor_s``.
"""

import math
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from statistics import fmean

from plannerforge.engine.exploration import BoundarySearch
from plannerforge.engine.exploration.boundary import SIZE, Cell, label_at

from ..harness import Figures, Spent
from .bench import FailuresBench
from .maps import MapCase, Place

CASES = (("cut_in", "idm"), ("cut_out", "idm"), ("lead_braking", "r157_careful"))
"""Boundaries of planners that take little time."""
BUDGETS = (40, 60, 80)
_GRIDS = (4, 8, 16)
"""Cells along each side."""
_TRUTH = 32
_LEAST_ERROR = 1e-4


def measure(bench: FailuresBench) -> Figures:
    """Compare the search with grids on each boundary."""
    del bench
    begun = Spent.now()
    figures: dict[str, float | int | str] = {}
    shares: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        for scenario, planner in CASES:
            own = shares_of(MapCase(scenario, planner, Path(folder)))
            figures[f"adaptive_share_{scenario}"] = _mean(own)
            shares += own
    return {
        "adaptive_share": _mean(shares),
        **figures,
        "edges_processor_s": round((Spent.now() - begun).processor_s, 1),
    }


def shares_of(case: MapCase) -> list[float]:
    """Return the search's points over those of a grid with the same error, for each budget."""
    truth = case.evaluate(grid(_TRUTH))
    grids = [((cells + 1) ** 2, _error(_grid_map(case, cells), truth)) for cells in _GRIDS]
    found = []
    for budget in BUDGETS:
        search = case.adaptive(budget)
        error, points = _error(search, truth), len(search.labels)
        equal = _points_at(error, grids)
        found.append(points / equal)
        sys.stderr.write(
            f"{case.scenario} {case.planner}: {points} points, error {error:.4f}; a grid needs {equal:.0f} ({grids})\n"
        )
    return found


def grid(cells: int) -> list[Place]:
    """Return the points of a grid with so many cells along each side."""
    step = SIZE // cells
    return [(x * step, y * step) for x in range(cells + 1) for y in range(cells + 1)]


def _grid_map(case: MapCase, cells: int) -> BoundarySearch:
    """Return a grid as the search would have it if it stopped there."""
    search, step = BoundarySearch(0), SIZE // cells
    search.tell(case.evaluate(grid(cells)))
    search._cells = [Cell((x * step, y * step), step) for x in range(cells) for y in range(cells)]
    return search


def _error(search: BoundarySearch, truth: dict[Place, str]) -> float:
    wrong = sum(label_at(x / SIZE, y / SIZE, search) != label for (x, y), label in truth.items())
    return wrong / len(truth)


def _points_at(error: float, grids: list[tuple[int, float]]) -> float:
    """Return the number of points of a grid with an error, interpolated; grids are in ascending order of points."""
    error = max(error, _LEAST_ERROR)
    for (fewer, larger), (more, smaller) in pairwise(grids):
        large, small = max(larger, _LEAST_ERROR), max(smaller, _LEAST_ERROR)
        if small <= error <= large and small < large:
            share = math.log(large / error) / math.log(large / small)
            return float(fewer * (more / fewer) ** share)
    return float(grids[0][0] if error > grids[0][1] else grids[-1][0])


def _mean(shares: list[float]) -> float:
    return round(math.exp(fmean(math.log(one) for one in shares)), 3)
