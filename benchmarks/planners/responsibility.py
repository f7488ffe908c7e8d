"""Measures whether ``responsibility`` differs from ``prediction``: rank correlation over candidates, and its time.

Runs Safety-Conservative on the starter scenarios and on some files of a folder, and pools all feasible candidates of
every planning step: ``python -m benchmarks.planners.responsibility [FOLDER_OF_XML [FILES]]``.
"""

import sys
import tempfile
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from plannerforge.engine.catalog import ARCHIVE
from plannerforge.engine.commonroad import read_scenario
from plannerforge.engine.execution import silent
from plannerforge.engine.planners import Observation, Plan, PlanningTask, simulate
from plannerforge.engine.planners.frenetix.costs import CandidateBatch, responsibility
from plannerforge.engine.planners.frenetix.planner import Frenetix
from plannerforge.evals.scoring.common import built_in

from ..harness import print_figures

if TYPE_CHECKING:
    import frenetix

    from plannerforge.engine.geometry import Values

FILES = 15
ALL_PLANS = sys.maxsize


@dataclass
class Collected:
    """Raw values of both terms, one a candidate, and the seconds that ``responsibility`` took, one a planning step."""

    scenarios: int = 0
    prediction: list[float] = field(default_factory=list)
    responsibility: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    @property
    def either(self) -> NDArray[np.bool_]:
        """The candidates for which at least one of the terms is above 0."""
        return (np.array(self.prediction) > 0) | (np.array(self.responsibility) > 0)

    def spearman(self) -> float:
        """Return the rank correlation over all candidates."""
        return float(spearmanr(self.prediction, self.responsibility).statistic)

    def spearman_with_either(self) -> float:
        """Return the rank correlation without the candidates for which both terms are 0."""
        chosen = self.either
        return float(spearmanr(np.array(self.prediction)[chosen], np.array(self.responsibility)[chosen]).statistic)


class _ListeningFrenetix(Frenetix):
    """Frenetix that keeps the raw values of both terms of every feasible candidate, and gives up after some plans."""

    def __init__(self, most_plans: int) -> None:
        super().__init__()
        self._plans_left = most_plans

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        super().reset(task)
        self.prediction: list[float] = []
        self.responsibility: list[float] = []
        self.seconds: list[float] = []
        self._own_terms["responsibility"] = self._timed

    def plan(self, observation: Observation) -> Plan:
        """Return Frenetix's plan, or None once the requested number of plans exists."""
        self._plans_left -= 1
        return Plan(None) if self._plans_left < 0 else super().plan(observation)

    def _timed(self, batch: CandidateBatch) -> "Values":
        began = perf_counter()
        values = responsibility(batch)
        self.seconds.append(perf_counter() - began)
        return values

    def _ranked(self, feasible: Any, step: Any) -> Iterator["frenetix.TrajectorySample"]:
        ranked = list(super()._ranked(feasible, step))
        self.prediction += [sample.costMap["prediction"][0] for sample in ranked]
        self.responsibility += [sample.costMap["responsibility"][0] for sample in ranked]
        return iter(ranked)


def starter_and_spread_files(folder: Path | None, count: int, scratch: Path) -> Iterator[Path]:
    """Yield all starter scenarios, then ``count`` files spread evenly over the folder."""
    with (files("plannerforge.engine.catalog") / ARCHIVE).open("rb") as stream, zipfile.ZipFile(stream) as archive:
        for name in sorted(archive.namelist()):
            if name.endswith(".xml") and not name.endswith(".net.xml"):
                yield Path(archive.extract(name, scratch))
    if folder is not None:
        paths = sorted(folder.glob("*.xml"))
        yield from paths[:: max(len(paths) // count, 1)][:count]


def collected_terms(paths: Iterable[Path], most_plans: int = ALL_PLANS) -> Collected:
    """Drive Safety-Conservative through the files, at most ``most_plans`` steps of each, and collect both terms."""
    configuration = built_in("frenetix:Safety-Conservative")
    collected = Collected()
    for path in paths:
        loaded = read_scenario(path)
        planner = _ListeningFrenetix(most_plans)
        run = simulate(loaded.scenario, loaded.problem(), configuration, planner, "constant_velocity", silent)
        if run.plans:
            collected.scenarios += 1
            collected.prediction += planner.prediction
            collected.responsibility += planner.responsibility
            collected.seconds += planner.seconds
    return collected


def _measure(folder: Path | None, count: int) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        collected = collected_terms(starter_and_spread_files(folder, count, Path(scratch)))
    figures = {
        "scenarios": collected.scenarios,
        "candidates": len(collected.prediction),
        "candidates_with_either": int(collected.either.sum()),
        "spearman": round(collected.spearman(), 3),
        "spearman_with_either": round(collected.spearman_with_either(), 3),
        "step_median_ms": round(1000 * median(collected.seconds), 2),
        "step_p95_ms": round(1000 * float(np.quantile(collected.seconds, 0.95)), 2),
    }
    print_figures("responsibility against prediction", figures)


if __name__ == "__main__":
    _measure(
        folder=Path(sys.argv[1]) if len(sys.argv) > 1 else None, count=int(sys.argv[2]) if len(sys.argv) > 2 else FILES
    )
