"""A metric is a field of RunMetrics, computed by the operation that drives, and a stored measure."""

from dataclasses import replace
from typing import get_args

import pytest
from support.builders import town_road
from support.runs import record as invalid
from support.runs import source

from plannerforge.engine.analysis import analyse
from plannerforge.engine.analysis.measures import measures_of
from plannerforge.engine.analysis.run_set import METRICS, RunSet
from plannerforge.engine.execution import silent
from plannerforge.engine.planners import run_planner
from plannerforge.engine.tuning import named_configuration
from plannerforge.schemas import results
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.measures import MEASURES, RunMetrics
from plannerforge.schemas.planning import RunRequest
from plannerforge.schemas.results import AnalyseRequest
from plannerforge.schemas.runs import RunRecord, RunSource, ScenarioSource
from plannerforge.server.tokens import count_tokens


def test_every_field_of_run_metrics_has_one_line_and_a_name_in_the_schema() -> None:
    assert sorted(spec.name for spec in METRICS) == sorted(RunMetrics.model_fields)
    assert get_args(results.MetricName) == tuple(RunMetrics.model_fields)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunRecord, RunSet]:
    """A run of the default planner on a town road, with its steps and its scenario."""
    folder = tmp_path_factory.mktemp("town")
    path = str(town_road().write(folder / "town.xml"))
    request = RunRequest(
        run_id="run_a",
        scenario_path=path,
        scenario_id="ZAM_Builder-1_1_T-1",
        configuration=named_configuration("idm"),
        prediction="constant_velocity",
    )
    response = run_planner(request, silent)
    (folder / "steps.json").write_text(response.steps.model_dump_json(), encoding="utf-8")
    source = RunSource(record=response.record, steps_path=str(folder / "steps.json"))
    scenario = ScenarioSource(scenario_id=response.record.scenario_id, path=path)
    return response.record, RunSet((source,), scenarios=(scenario,))


def test_a_run_computes_every_metric(driven: tuple[RunRecord, RunSet]) -> None:
    metrics = driven[0].metrics
    assert metrics is not None
    assert metrics.model_fields_set == set(RunMetrics.model_fields)


def test_the_analysis_measures_the_values_stored_with_the_run(driven: tuple[RunRecord, RunSet]) -> None:
    record, runs = driven
    nothing = RunMetrics.model_construct(**dict.fromkeys(RunMetrics.model_fields))
    computed = {one.name: one.value for one in measures_of(runs, record.model_copy(update={"metrics": nothing}))}
    stored = record.metrics.model_dump() if record.metrics is not None else {}
    without_costs = {name: value for name, value in stored.items() if name != "mean_total_cost"}
    assert {name: computed[name] for name in without_costs} == pytest.approx(without_costs)
    assert all(one.time_s is not None for one in measures_of(runs, record) if one.obstacle_id is not None)


def test_progress_is_the_share_of_the_path_to_the_goal(driven: tuple[RunRecord, RunSet]) -> None:
    record, runs = driven
    found = {one.name: one for one in measures_of(runs, record)}
    assert 0.0 < (found["progress"].value or 0.0) <= 1.0
    assert (found["progress"].value == 1.0) == (record.outcome == "goal_reached")
    gone = runs.with_sources(runs.sources)
    elsewhere = {one.name: one for one in measures_of(replace(gone, scenarios=()), record)}
    assert elsewhere["progress"].why == "the goal has no position, or its path is not known"
    assert elsewhere["maximum_braking_mps2"].value == found["maximum_braking_mps2"].value


def test_one_run_and_several_are_reported_with_all_measures(driven: tuple[RunRecord, RunSet]) -> None:
    record, runs = driven
    request = AnalyseRequest(results=("run_a",), runs=runs.sources, scenarios=runs.scenarios, detail="measures")
    one = analyse(request, silent)
    assert [item.name for item in one.measures] == [measure.name for measure in MEASURES]
    text = one.answer().to_text()
    assert "\n- hardest braking " in text
    assert "- undefined: " in text
    assert count_tokens(text) < 1500
    other = RunSource(record=record.model_copy(update={"run_id": "run_b"}), steps_path=runs.sources[0].steps_path)
    several = analyse(request.model_copy(update={"runs": (*runs.sources, other)}), silent)
    assert [item.name for item in several.spreads] == [measure.name for measure in MEASURES]
    assert {item.runs for item in several.spreads if item.median is not None} == {2}
    assert count_tokens(several.answer().to_text()) < 1800


def test_a_run_without_steps_is_reported_with_its_stored_metrics(driven: tuple[RunRecord, RunSet]) -> None:
    record, _ = driven
    found = {one.name: one for one in measures_of(RunSet((RunSource(record=record),)), record)}
    assert record.metrics is not None
    assert found["maximum_braking_mps2"].value == record.metrics.maximum_braking_mps2
    assert found["time_to_brake_s"].why == "the steps of the run were not kept"


def test_an_impossible_measure_is_not_computed() -> None:
    run = source(invalid("ZAM_Town-1_1_T-1", "invalid"))
    with pytest.raises(NotPossible, match="nothing to measure"):
        analyse(AnalyseRequest(results=("x",), runs=(run,), detail="measures"), silent)
