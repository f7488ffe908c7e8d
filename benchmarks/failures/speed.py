"""What evaluations and maps cost, in processor time of this process and its children.

Evaluations: a search by the product's operations near each scenario of the experiment that the search was designed
with, recorded traffic, horizon 6 s, stopping once the encounter is over. The choice of points and the first look at the
base do not count; edits of points that turn out to be implausible do. A first batch warms up caches and imports, as in
a worker, and does not count.

Keys: ``evaluations_frenetix``, ``evaluations_fiss``, ``evaluations_idm`` (runs per minute and core),
``boundary_frenetix_s``, ``boundary_idm_s`` (a map of 150 points of ``lead_braking``).
"""

import sys
import tempfile
from pathlib import Path

from plannerforge.engine.execution import silent
from plannerforge.engine.exploration.finding import evaluate_in_space, open_space, propose_points
from plannerforge.engine.tuning import preset_configuration
from plannerforge.schemas.exploration import EncounterSetting
from plannerforge.schemas.failures import EvaluatedPoint, ProposalsRequest, SpacePointsRequest, SpaceRequest

from ..harness import Figures, Spent
from .bench import FailuresBench
from .maps import MapCase

_SCENARIOS = ("DEU_Lohmar-32_1_T-1", "BEL_Antwerp-14_3_T-1", "ESP_Bilbao-6_9_T-1")
"""Those of the experiment in which the planners mostly pass."""
_RUNS = {"frenetix": 20, "fiss": 40, "idm": 40}
"""Runs near each scenario: enough for figures that repeat within a few percent."""
_POINTS, _WARM = 150, 4
_BATCH = 8
"""Points of a worker's task, as in the workflows."""


def measure(bench: FailuresBench) -> Figures:
    """Measure each planner, one after the other."""
    figures: dict[str, float | int | str] = {}
    for planner, runs in _RUNS.items():
        spent, done = Spent(), 0
        for name in _SCENARIOS:
            took, count = _evaluations(bench.folder / f"{name}.xml", planner, runs)
            sys.stderr.write(f"{name} {planner}: {count} runs in {took.processor_s:.1f} s of processor time\n")
            spent, done = spent + took, done + count
        figures[f"evaluations_{planner}"] = round(60.0 * done / spent.processor_s, 1) if done else 0.0
    with tempfile.TemporaryDirectory() as folder:
        for planner in ("frenetix", "idm"):
            case = MapCase("lead_braking", planner, Path(folder))
            case.evaluate([(0, 0), (64, 64), (32, 32), (16, 48)])
            begun = Spent.now()
            case.adaptive(_POINTS)
            figures[f"boundary_{planner}_s"] = round((Spent.now() - begun).processor_s, 1)
    return figures


def _evaluations(path: Path, planner: str, runs: int) -> tuple[Spent, int]:
    """Return the time of the evaluations of a search, and their number, 0 if the planner fails in the base."""
    configuration = preset_configuration(planner, None)
    setting = EncounterSetting(xml=path, configuration=configuration, horizon_s=6.0)
    space = open_space(SpaceRequest(setting=setting, base_id=path.stem), silent)
    sizes = tuple((stratum.name, len(stratum.parameters)) for stratum in space.strata)
    known: list[EvaluatedPoint] = []
    spent, counted = Spent(), 0
    while space.strata and sum(one.score.value is not None for one in known) < runs + _WARM:
        scores = tuple(one.score for one in known)
        points = propose_points(ProposalsRequest(strata=sizes, seed=0, scores=scores), silent).points
        for begin in range(0, len(points), _BATCH):
            request = SpacePointsRequest(
                setting=setting,
                strata=space.strata,
                points=points[begin : begin + _BATCH],
                recorded=space.recorded,
                drive=space.drive,
            )
            begun = Spent.now()
            done = evaluate_in_space(request, silent).points
            if known:  # the first batch warms up
                spent = spent + (Spent.now() - begun)
                counted += sum(one.score.value is not None for one in done)
            known += done
    return spent, counted
