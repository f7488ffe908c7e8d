"""Is ``responsibility`` another measure than ``prediction``? Rank correlation over candidates, and its time.

Runs Safety-Conservative on the starter scenarios and on some files of a folder, and pools all feasible candidates of
every planning step: ``python -m plannerforge.evals.bench_responsibility [FOLDER_OF_XML [FILES]]``.
"""

import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from plannerforge.engine.planners.candidate_batch import CandidateBatch
from plannerforge.engine.planners.frenetix import Frenetix
from plannerforge.engine.planners.interface import PlanningTask
from plannerforge.engine.planners.responsibility import responsibility
from plannerforge.engine.planners.simulation import simulate
from plannerforge.engine.scenarios.reader import read_scenario
from plannerforge.engine.tuning.configurations import named_configuration
from plannerforge.evals.bench_output import print_figures

if TYPE_CHECKING:
    import frenetix

    from plannerforge.engine.geometry.polyline import Values

FILES = 15
STARTER = Path(__file__).resolve().parent.parent / "engine" / "catalog" / "starter.zip"


class ListeningFrenetix(Frenetix):
    """Frenetix that keeps the raw values of both terms of every feasible candidate."""

    def reset(self, task: PlanningTask) -> None:
        """Prepare for a new run."""
        super().reset(task)
        self.prediction: list[float] = []
        self.responsibility: list[float] = []
        self.seconds: list[float] = []
        self._own_terms["responsibility"] = self._timed

    def _timed(self, batch: CandidateBatch) -> "Values":
        began = perf_counter()
        values = responsibility(batch)
        self.seconds.append(perf_counter() - began)
        return values

    def _ranked(self, feasible: Any, inputs: Any, step: Any) -> Iterator["frenetix.TrajectorySample"]:
        ranked = list(super()._ranked(feasible, inputs, step))
        self.prediction += [sample.costMap["prediction"][0] for sample in ranked]
        self.responsibility += [sample.costMap["responsibility"][0] for sample in ranked]
        return iter(ranked)


def scenario_files(folder: Path | None, count: int, scratch: Path) -> Iterator[Path]:
    """All starter scenarios, then ``count`` files spread evenly over the folder."""
    with zipfile.ZipFile(STARTER) as archive:
        for name in sorted(archive.namelist()):
            if name.endswith(".xml") and not name.endswith(".net.xml"):
                yield Path(archive.extract(name, scratch))
    if folder is not None:
        found = sorted(folder.glob("*.xml"))
        yield from found[:: max(len(found) // count, 1)][:count]


def main() -> None:
    """Measure and print."""
    from scipy.stats import spearmanr

    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    count = int(sys.argv[2]) if len(sys.argv) > 2 else FILES
    configuration = named_configuration("frenetix:Safety-Conservative")
    if configuration is None:
        raise RuntimeError("the preset is not here")
    danger: list[float] = []
    blame: list[float] = []
    seconds: list[float] = []
    scenarios = 0
    with tempfile.TemporaryDirectory() as scratch:
        for path in scenario_files(folder, count, Path(scratch)):
            loaded = read_scenario(path)
            planner = ListeningFrenetix()
            run = simulate(loaded.scenario, loaded.problem(), configuration, planner, "constant_velocity", _silent)
            if run.plans:
                scenarios += 1
                danger += planner.prediction
                blame += planner.responsibility
                seconds += planner.seconds
    either = (np.array(danger) > 0) | (np.array(blame) > 0)
    figures: dict[str, float | int | str] = {
        "scenarios": scenarios,
        "candidates": len(danger),
        "candidates_with_either": int(either.sum()),
        "spearman": round(float(spearmanr(danger, blame).statistic), 3),
        "spearman_with_either": round(float(spearmanr(np.array(danger)[either], np.array(blame)[either]).statistic), 3),
        "step_median_ms": round(1000 * median(seconds), 2),
        "step_p95_ms": round(1000 * float(np.quantile(seconds, 0.95)), 2),
    }
    print_figures("responsibility against prediction", [(key, str(value)) for key, value in figures.items()], figures)


def _silent(share: float, message: str = "") -> None:
    del share, message


if __name__ == "__main__":
    main()
