"""Searches on synthetic landscapes: what the product's search was tuned on, which is not what is reported of it.

A landscape has fourteen strata with three to five parameters. In some of them a region fails, around a centre of its
own; in the others the score has a lowest value above that. Scores far away are flat, a part of the space is
implausible, and a part of each region fails where nothing could help. Cells divide a region by direction and by its
first parameter. In rare landscapes a single small region fails.

``python -m benchmarks.failures.landscapes --first 1000 --count 10`` prints, for each search, the cells found after 60,
150 and 300 runs, and in how many landscapes it found any. The constants of ``engine/exploration/search.py`` were chosen
with these seeds.
"""

import argparse
import sys
from dataclasses import dataclass
from statistics import fmean

import numpy as np

from plannerforge.engine.exploration import Point, Score, Stratum

from ..harness import print_figures
from .peers import Judged, cells_after, searched

_STRATA = 14
_RUNS = (60, 150, 300)


@dataclass(frozen=True)
class _Region:
    """A stratum's region around a centre, in axes of its own; distances below ``radius`` fail if it is ``weak``."""

    weak: bool
    center: np.ndarray
    axes: np.ndarray
    radius: float
    plausible: tuple[np.ndarray, float]
    hopeless: tuple[np.ndarray, float]
    floor: float
    flat: float
    phase: np.ndarray

    def score(self, name: str, values: np.ndarray) -> Score:
        if (values - 0.5) @ self.plausible[0] > self.plausible[1]:
            return Score(None)
        away = self.axes @ (values - self.center)
        wave = 0.03 * float(np.sin(9 * values + self.phase).mean())
        margin = min(float(np.linalg.norm(away)) - self.radius + wave, self.flat)
        if not self.weak:
            return Score(max(margin, 0.0) / 2 + self.floor)
        if margin >= 0.0:
            return Score(margin / 2)
        if (values - self.center) @ self.hopeless[0] > self.hopeless[1]:
            return Score(0.6)
        return Score(-1.0 + 0.1 * float(values[0]), f"{name}|{int(np.argmax(away[:3]))}|{int(values[0] * 3)}")


class Landscape:
    """A landscape by its seed."""

    def __init__(self, seed: int, *, rare: bool) -> None:
        drawn = np.random.default_rng(seed)
        self.strata = [Stratum(str(index), int(drawn.integers(3, 6))) for index in range(_STRATA)]
        weak = {int(drawn.integers(_STRATA))} if rare else set(drawn.choice(_STRATA, _STRATA // 2, False).tolist())
        self._regions = {
            stratum.name: self._region(drawn, stratum.dimensions, weak=index in weak, rare=rare)
            for index, stratum in enumerate(self.strata)
        }

    def _region(self, drawn: np.random.Generator, dimensions: int, *, weak: bool, rare: bool) -> _Region:
        turned = np.linalg.qr(drawn.normal(size=(dimensions, dimensions)))[0]
        widths = np.exp(drawn.uniform(np.log(1.0 if rare else 0.5), np.log(2.0 if rare else 3.0), dimensions))
        normals = [normal / np.linalg.norm(normal) for normal in drawn.normal(size=(2, dimensions))]
        return _Region(
            weak=weak,
            center=drawn.uniform(0.1, 0.9, dimensions),
            axes=widths[:, None] * turned,
            radius=0.12 if rare else float(drawn.uniform(0.15, 0.5)),
            plausible=(normals[0], float(drawn.uniform(0.2, 0.6))),
            hopeless=(normals[1], float(drawn.uniform(0.0, 0.3))),
            floor=float(drawn.uniform(0.02, 0.3)),
            flat=float(drawn.uniform(0.6, 1.5)),
            phase=drawn.uniform(0, 6, dimensions),
        )

    def judge(self, point: Point) -> Judged:
        """Return the score of a point; the second objective is the same."""
        score = self._regions[point.stratum].score(point.stratum, np.array(point.values))
        return Judged(score, 1.0 if score.value is None else score.value)


def _main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=1000, help="seed of the first landscape")
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--searches", nargs="+", default=["ours", "random", "cma", "tpe"])
    given = parser.parse_args()
    figures: dict[str, float | int | str] = {"first": given.first, "count": given.count}
    for name in given.searches:
        for kind in ("usual", "rare"):
            cells = []
            for seed in range(given.first, given.first + given.count):
                land = Landscape(seed, rare=kind == "rare")
                found = searched(name, land.strata, seed, land.judge, _RUNS[-1])
                cells.append([len(cells_after(found, runs)) for runs in _RUNS])
            for index, runs in enumerate(_RUNS):
                figures[f"{kind}_cells_{runs}_{name}"] = round(fmean(row[index] for row in cells), 2)
            figures[f"{kind}_found_{name}"] = round(fmean(row[-1] > 0 for row in cells), 2)
    print_figures("Searches on synthetic landscapes", figures)
    return 0


if __name__ == "__main__":
    sys.exit(_main())
