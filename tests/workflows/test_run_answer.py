"""What run_planner says beside the runs themselves."""

from support.runs import record

from plannerforge.engine.tuning.configurations import named_configuration
from plannerforge.schemas.reviews import Contact, Encounter, LargestMotion, RuleVerdict, RunReview
from plannerforge.schemas.runs import Outcome, RunRecord
from plannerforge.workflows.runs import Cell, CellResult, answer


def test_obstacles_that_a_lane_prediction_could_not_follow_are_counted() -> None:
    configuration = named_configuration("frenetix:Default")
    assert configuration is not None
    runs = [record(prediction="lane", seed=seed) for seed in range(3)]
    runs = [run.model_copy(update={"off_the_lanes": off}) for run, off in zip(runs, ((), (4,), (4, 9)), strict=True)]
    cells = [Cell(run.scenario_id, None, configuration, "lane") for run in runs]
    said = answer(cells, [CellResult(run) for run in runs])
    assert said.notes == ("lane prediction: constant velocity for 3 obstacles off the lanes, in 2 runs",)
    assert said.notes[0] in said.to_text()
    assert answer(cells[:1], [CellResult(runs[0])]).notes == ()


def cells_of(runs: list[RunRecord]) -> list[Cell]:
    configuration = named_configuration("frenetix:Default")
    assert configuration is not None
    return [Cell(run.scenario_id, None, configuration) for run in runs]


def test_one_run_is_reported_with_its_ending_its_closest_moment_and_links() -> None:
    run = record(outcome="collision")
    hit = Contact(kind="rear_end_by_other", time_s=4.0, ego_speed_mps=2.0, obstacle_id=1, obstacle_class="car",
                  other_speed_mps=9.0, ego_side="rear", other_side="front")  # fmt: skip
    near = Encounter(time_s=1.0, obstacle_id=3, obstacle_class="bus", gap_m=2.0, side="left", direction="oncoming",
                     ego_speed_mps=8.0, other_speed_mps=7.0, time_to_collision_s=None)  # fmt: skip
    motion = LargestMotion(name="braking", value=2.0, unit="m/s²", time_s=3.0)
    reviews = {run.run_id: RunReview(run_id=run.run_id, contact=hit, closest=near, largest=(motion,))}
    lines = answer(cells_of([run]), [CellResult(run)], reviews=reviews).to_text().splitlines()
    assert lines[0].endswith(
        ": collision: hit from behind by car 1 at 4.0 s (ego 2.0 m/s, not braking; car 1: 9.0 m/s)."
    )
    assert (
        lines[1]
        == f"Next: analyze_results with results ['{run.run_id}'], detail timeline, or render it as an animation"
    )
    calm = record()
    reviews = {calm.run_id: RunReview(run_id=calm.run_id, closest=near, largest=(motion,))}
    said = answer(cells_of([calm]), [CellResult(calm)], reviews=reviews).to_text()
    assert "Closest: 2.00 m to bus 3 oncoming on the left at 1.0 s (ego 8.0, other 7.0 m/s)" in said


def test_one_run_states_that_it_ran_a_red_light_and_keeps_all_rules_that_it_broke() -> None:
    run = record()
    light = RuleVerdict(rule="R_IN2", name="red light", unit="m", robustness=-3.0, time_s=4.0, first_s=3.0)
    (one,) = answer(cells_of([run]), [CellResult(run)], broken={run.run_id: (light,)}).runs
    assert one.broken_rules == (light,)
    speed = RuleVerdict(rule="R_G3", name="speed limit", unit="m/s", robustness=-1.0, time_s=2.0, first_s=2.0)
    said = answer(cells_of([run]), [CellResult(run)], broken={run.run_id: (speed, light)}).to_text()
    assert light.in_words() in said
    assert speed.in_words() not in said
    assert "rules" not in answer(cells_of([run]), [CellResult(run)], broken={run.run_id: ()}).to_text()


def test_a_grid_is_reported_with_rates_and_then_failures_only() -> None:
    outcomes: list[Outcome] = ["goal_reached", "collision", "timeout", "off_road", "collision", "invalid"]
    runs = [record(f"ZAM_T-{n}_1_T-1", outcome) for n, outcome in enumerate(outcomes)]
    said = answer(cells_of(runs), [CellResult(run) for run in runs], batch_id="batch_1")
    lines = said.to_text().splitlines()
    assert lines[0] == "batch_1: 6 of 6 runs finished."
    assert lines[1].endswith("goal 1 of 5; collision 2; timeout 1; off road 1; invalid, not counted: 1")
    assert lines[2] == "4 failed:"
    assert [line.split()[3] for line in lines[3:6]] == ["ZAM_T-1_1_T-1", "ZAM_T-2_1_T-1", "ZAM_T-3_1_T-1"]
    assert lines[6] == "… 1 more: analyze_results with where=['!outcome=goal_reached'], detail=rows"
    assert len(said.runs) == 6
