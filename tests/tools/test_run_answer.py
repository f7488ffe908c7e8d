"""What run_planner says beside the runs themselves."""

from support.runs import record

from plannerforge.engine.tuning.configurations import named_configuration
from plannerforge.tools.runs import Cell, CellResult, answer


def test_obstacles_that_a_lane_prediction_could_not_follow_are_counted() -> None:
    configuration = named_configuration("frenetix:Default")
    assert configuration is not None
    runs = [record(prediction="lane", seed=seed) for seed in range(3)]
    runs = [run.model_copy(update={"off_the_lanes": off}) for run, off in zip(runs, ((), (4,), (4, 9)), strict=True)]
    cells = [Cell(run.scenario_id, None, configuration, "lane") for run in runs]
    said = answer(cells, [CellResult(run) for run in runs])
    assert said.notes == ("lane prediction: 3 obstacles in 2 runs were off the lanes: constant velocity there",)
    assert said.notes[0] in said.to_text()
    assert answer(cells[:1], [CellResult(runs[0])]).notes == ()
