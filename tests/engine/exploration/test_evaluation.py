"""A point is evaluated in memory like the stored scenario's run, up to the step at which the encounter is resolved."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.builders import ScenarioBuilder, driving, town_road
from support.edits import apply_to

from plannerforge.engine.execution.executor import silent
from plannerforge.engine.exploration.evaluation import Evaluator
from plannerforge.engine.planners.runs import run_planner
from plannerforge.engine.tuning.configurations import named_configuration
from plannerforge.schemas.exploration import EncounterSetting
from plannerforge.schemas.modification import Edit
from plannerforge.schemas.planning import RunRequest
from plannerforge.schemas.runs import Traffic
from plannerforge.schemas.worlds import world_of

ALONE = town_road().with_vehicles(driving(32, (5, 3.5), 6.0, 151))
LEAD = {"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "offset_m": 20.0, "speed": "10m/s"}
BRAKES = {"op": "set_speed", "vehicles": ["new:0"], "speed": "0m/s", "rate_mps2": 4.0, "time_s": 1.0}
WALLED = {**LEAD, "offset_m": 6.0, "speed": "1m/s"}
TRIGGERED = {**BRAKES, "time_s": None, "when": "gap<=3s"}


def setting_of(path: Path, planner: str = "idm", **given: Any) -> EncounterSetting:
    configuration = named_configuration(planner)
    assert configuration is not None
    return EncounterSetting(xml=path, configuration=configuration, **{"horizon_s": 8.0, **given})


def edits_of(*edits: dict[str, Any]) -> tuple[Edit, ...]:
    return tuple(Edit.model_validate(edit) for edit in edits)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ALONE.write(tmp_path_factory.mktemp("base") / "base.xml")


@pytest.mark.parametrize(("traffic", "edits"), [("recorded", (LEAD, BRAKES)), ("reactive", (LEAD, TRIGGERED))])
def test_the_run_is_that_of_the_stored_scenario(
    traffic: Traffic, edits: tuple[dict[str, Any], ...], base: Path, tmp_path: Path
) -> None:
    written = apply_to(base, tmp_path / "out", *edits)
    setting = setting_of(base, traffic=traffic)
    request = RunRequest(
        run_id="run_1",
        scenario_path=str(written.xml),
        scenario_id="ZAM_Builder-1_1_T-1",
        configuration=setting.configuration,
        traffic=traffic,
    )
    stored = run_planner(request, silent)
    with Evaluator(setting) as evaluator:
        driven = evaluator.driven(edits_of(*edits))
        evaluation, run = driven.evaluation, driven.run
    assert run is not None
    assert evaluation.outcome == "safe"
    count = len(run.states)
    assert 20 < count <= len(stored.steps.x_m)
    states = np.array([[*one.position, one.heading_rad, one.speed_mps] for one in run.states])
    steps = stored.steps
    expected = np.column_stack([steps.x_m, steps.y_m, steps.heading_rad, steps.speed_mps])[:count]
    assert np.array_equal(states, expected)


def test_a_collision_is_judged_by_the_reference_drivers(base: Path) -> None:
    with Evaluator(setting_of(base, "keep_lane")) as evaluator:
        blind = evaluator.evaluate(edits_of(LEAD, BRAKES))
        too_late = evaluator.evaluate(edits_of(WALLED))
    assert (blind.outcome, blind.run_outcome, blind.contact) == ("failed_avoidably", "collision", "into_standing")
    assert blind.manoeuvre == "set_speed"
    assert {one.driver for one in blind.prevented_by} >= {"r157_careful"}
    assert blind.least_gap_m == 0.0
    assert too_late.outcome == "failed_unavoidably"
    assert too_late.prevented_by == ()


def test_the_verdict_is_that_of_the_stored_runs_review(base: Path) -> None:
    with Evaluator(setting_of(base, "r157_careful")) as evaluator:
        assert evaluator.evaluate(edits_of(LEAD, BRAKES)).outcome == "safe"


def test_an_encounter_that_is_over_ends_the_run(base: Path) -> None:
    with Evaluator(setting_of(base, horizon_s=30.0)) as evaluator:
        passed = evaluator.evaluate(())
    assert passed.end == "encounter_over"
    assert passed.steps < 60


def test_the_horizon_ends_a_run(base: Path) -> None:
    with Evaluator(setting_of(base, horizon_s=2.0)) as evaluator:
        short = evaluator.evaluate(edits_of(LEAD))
    assert (short.end, short.steps, short.outcome) == ("horizon", 20, "safe")


@pytest.mark.parametrize(
    ("edits", "words"),
    [
        ((LEAD, {**LEAD, "offset_m": 21.0}), "occupied"),
        ((LEAD, {**BRAKES, "vehicles": ["77"]}), "77"),
        ((LEAD, {**LEAD, "offset_m": 28.0, "speed": "0m/s"}, {**BRAKES, "speed": "12m/s"}), "collision"),
    ],
)
def test_an_implausible_point_is_named_and_not_run(edits: tuple[dict[str, Any], ...], words: str, base: Path) -> None:
    with Evaluator(setting_of(base)) as evaluator:
        driven = evaluator.driven(edits_of(*edits))
        evaluation, run = driven.evaluation, driven.run
    assert (evaluation.outcome, evaluation.end, evaluation.counts_as_run) == ("implausible", "not_run", False)
    assert words in evaluation.reason
    assert run is None


def test_edits_of_the_whole_scene_are_evaluated_too(base: Path) -> None:
    wet = {"op": "set_weather", "params": ["friction=0.3"]}
    with Evaluator(setting_of(base)) as evaluator:
        assert evaluator.evaluate(edits_of(wet, LEAD)).end in ("judged", "horizon", "encounter_over")


@pytest.mark.parametrize("planner", ["idm", "frenetix"])
def test_the_same_edits_have_the_same_evaluation(planner: str, base: Path) -> None:
    with Evaluator(setting_of(base, planner, traffic="reactive", horizon_s=3.0)) as evaluator:
        first = evaluator.evaluate(edits_of(LEAD, TRIGGERED))
        evaluator.evaluate(edits_of(WALLED))
        assert evaluator.evaluate(edits_of(LEAD, TRIGGERED)) == first


def test_earlier_edits_of_the_base_come_first(base: Path) -> None:
    with Evaluator(setting_of(base, "keep_lane", earlier=edits_of(LEAD))) as evaluator:
        later = evaluator.evaluate(edits_of({**LEAD, "offset_m": 40.0}, BRAKES))
    with Evaluator(setting_of(base, "keep_lane")) as evaluator:
        both = evaluator.evaluate(edits_of(LEAD, {**LEAD, "offset_m": 40.0}, {**BRAKES, "vehicles": ["new:1"]}))
    assert later == both


def test_an_infeasible_motion_of_the_base_is_the_planner_s_surroundings(tmp_path: Path) -> None:
    ahead = town_road().with_vehicles(driving(31, (100, 0), 10.0, 101)).write(tmp_path / "ahead.xml")
    abrupt = {"op": "change_lane", "vehicles": ["31"], "lane": "left", "time_s": 1.0, "lateral_s": 0.6}
    with Evaluator(setting_of(ahead, "keep_lane")) as evaluator:
        assert evaluator.evaluate(edits_of(abrupt)).outcome == "implausible"
    with Evaluator(setting_of(ahead, "keep_lane", earlier=edits_of(abrupt))) as evaluator:
        unchanged, further = evaluator.evaluate(()), evaluator.evaluate(edits_of(LEAD))
        assert unchanged.counts_as_run
        assert further.counts_as_run
        assert evaluator.evaluate(edits_of({**abrupt, "lane": "right", "time_s": 3.0})).outcome == "implausible"


def test_scripts_without_other_vehicles_move_as_among_others(tmp_path: Path) -> None:
    walker = {"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "1", "position": "120m", "side": "right"}
    edits = edits_of({**walker, "speed": "1.5m/s", "when": "gap<=3s"})
    paths = []
    for name, vehicles in (("alone", ()), ("far", (driving(34, (280, 7), 5.0, 151, heading_rad=3.14159),))):
        road = town_road().with_vehicles(*vehicles, driving(32, (5, 3.5), 6.0, 151))
        with Evaluator(setting_of(road.write(tmp_path / f"{name}.xml"), traffic="reactive")) as evaluator:
            run = evaluator.driven(edits).run
        assert run is not None
        walked = next(track for track in run.traffic.moving if track.kind == "pedestrian")
        paths.append((walked.positions.tolist(), [state.position.tolist() for state in run.states]))
    alone = ScenarioBuilder(town_road().lanes).write(tmp_path / "empty.xml")
    with Evaluator(setting_of(alone, traffic="reactive")) as evaluator:
        run = evaluator.driven(edits).run
    assert run is not None
    walked = next(track for track in run.traffic.moving if track.kind == "pedestrian")
    count = min(len(walked.positions), len(paths[0][0]))
    assert count > 20
    assert walked.positions[:count].tolist() == paths[0][0][:count] == paths[1][0][:count]


def test_what_the_sensors_do_not_report_is_not_braked_for(base: Path) -> None:
    short = world_of("range_m=8")
    with Evaluator(setting_of(base)) as evaluator:
        assert evaluator.evaluate(edits_of(LEAD, BRAKES)).outcome == "safe"
    with Evaluator(setting_of(base, world=short)) as evaluator:
        blind = evaluator.evaluate(edits_of(LEAD, BRAKES))
    assert blind.outcome == "failed_avoidably"
