"""A metric is a field of RunMetrics, computed by the operation that drives, with a line in METRICS."""

from pathlib import Path
from typing import get_args

from support.builders import town_road

from plannerforge.engine.analysis.run_set import METRICS
from plannerforge.engine.execution import silent
from plannerforge.engine.planners import run_planner
from plannerforge.engine.tuning import named_configuration
from plannerforge.schemas import results
from plannerforge.schemas.planning import RunRequest
from plannerforge.schemas.runs import RunMetrics


def test_every_field_of_run_metrics_has_one_line_and_a_name_in_the_schema() -> None:
    assert sorted(spec.name for spec in METRICS) == sorted(RunMetrics.model_fields)
    assert get_args(results.MetricName) == tuple(RunMetrics.model_fields)


def test_a_run_computes_every_metric(tmp_path: Path) -> None:
    request = RunRequest(
        run_id="run_a",
        scenario_path=str(town_road().write(tmp_path / "town.xml")),
        scenario_id="ZAM_Builder-1_1_T-1",
        configuration=named_configuration("idm"),
        prediction="constant_velocity",
    )
    metrics = run_planner(request, silent).record.metrics
    assert metrics is not None
    assert metrics.model_fields_set == set(RunMetrics.model_fields)
