"""Benches on fresh data: problems and requests are drawn by a seed, and what goes wrong is counted."""

import random
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.builders import driving, town_road
from support.catalog import catalogue, facts, funnel
from support.modification_bench import carried_out

from benchmarks.modification.__main__ import failures_of, fresh_figures
from benchmarks.modification.cases import Case, Measured, Physical
from benchmarks.modification.judges import unreported_collisions
from benchmarks.planners.__main__ import fresh_figures as planner_figures
from benchmarks.planners.fresh import Drive, drawn_problem
from benchmarks.selection.fresh import Known, fresh_requests
from benchmarks.symmetries.fresh_data import fresh_scenario
from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.evals.ground_truth.selection import arguments_of
from plannerforge.schemas.scenarios import RoadFacts
from plannerforge.schemas.vocabulary import FEATURES, TAGS


def test_a_recorded_car_becomes_the_ego_and_drives_to_its_last_place(tmp_path: Path) -> None:
    path = replace(town_road(), vehicles=(driving(31, (20.0, 0.0), 10.0, 60),), parked=()).write(tmp_path / "a.xml")
    loaded = drawn_problem(read_scenario(path), random.Random(3), lambda problem, others: not others)
    assert loaded is not None
    problem = loaded.problem()
    step = int(problem.initial_state.time_step)
    assert np.allclose(problem.initial_state.position, (20.0 + step, 0.0))
    assert np.allclose(problem.goal.state_list[0].position.center, (80.0, 0.0), atol=1.1)
    assert not loaded.scenario.dynamic_obstacles
    assert drawn_problem(read_scenario(path), random.Random(3), lambda problem, others: False) is None


def test_runs_that_raise_are_lost_and_count_as_failures() -> None:
    configs = ("frenetix:Default", "frenetix:Safety-Conservative")
    drives = [
        Drive("one", config, prediction, outcome, "", trapped=outcome == "infeasible")
        for config in configs
        for prediction in ("ground_truth", "constant_velocity")
        for outcome in ("goal_reached", "infeasible", "lost", "invalid")
    ]
    figures, rows = planner_figures(drives)
    assert figures["fresh_problems"] == 4
    assert figures["fresh_solvable"] == 3
    assert figures["fresh_lost"] == 4
    assert figures["fresh_success_safety_cv"] == round(1 / 3, 4)
    assert figures["fresh_trap_infeasible"] == 4
    assert ("frenetix:Default, ground_truth", "33.3% (6.1% to 79.2%)") in rows


def test_a_refusal_at_reading_is_not_a_failure_and_a_crash_is_one() -> None:
    done = Case("T", "a", checks={"T_ends": True}, physical=(Physical(True, True, True, None),))
    rough = Case("B", "a", checks={"B_preset": True}, physical=(Physical(False, False, True, None),))
    measured = [Measured((done, rough), round_trip_error=""), Measured(unread="b: gap"), Measured(crashed="c: defect")]
    figures = fresh_figures([7, 8], measured)
    assert figures["seeds"] == "7 8"
    assert (figures["fresh_files"], figures["fresh_refused"], figures["fresh_crashed"]) == (3, 1, 1)
    assert figures["fresh_edits"] == 2
    assert figures["fresh_T_ends"] == figures["fresh_round_trip"] == 1.0
    assert figures["fresh_physical_min"] == 0.0
    assert "crashed: c: defect" in failures_of(measured)


def _known() -> list[Known]:
    """A catalogue of all kinds of facts, drawn by a fixed seed."""
    draw = random.Random(1)
    found = []
    for number in range(60):
        tags, features = draw.sample(sorted(TAGS), 3), draw.sample(sorted(FEATURES), 3)
        counts = {kind: draw.randint(0, 6) for kind in ("car", "truck", "bus", "bicycle")}
        limits = tuple(sorted(draw.sample([30.0, 50.0, 70.0, 100.0], 2)))
        lights = draw.randint(0, 2)
        roads = RoadFacts(
            lanelets=3,
            signs_map=("speed_limit", "yield"),
            signs_ego=("speed_limit",),
            traffic_light_ego=lights > 1,
            traffic_lights_map=lights,
            limits_map_kmh=limits,
            limits_ego_kmh=limits[:1],
        )
        one = facts(
            f"{draw.choice(['DEU_Bonn', 'ITA_Siena', 'USA_Peach'])}-{number}_1_T-1",
            tags=tags,
            features=features,
            counts={kind: count for kind, count in counts.items() if count},
            speed_mps=draw.uniform(0.0, 30.0),
            lanes=draw.randint(1, 4),
            roads=roads,
        )
        country, place = one.location.country, one.location.place
        speed_mps = one.egos[0].speed_mps
        found.append(Known(one.scenario_id, country, place, frozenset(tags), Counter(counts), speed_mps, lights, one))
    return found


def test_searches_find_the_same_scenarios_as_the_predicates() -> None:
    known = _known()
    connection = catalogue([one.facts for one in known])
    requests = fresh_requests(known, 3, 400)
    for request in requests:
        numbers = funnel(connection, arguments_of(request.truth)).matches
        assert {known[number - 1].scenario_id for number in numbers} == request.matching
    assert 50 < sum(request.expect == "ok" for request in requests) < 350


def test_drawn_requests_name_the_stage_without_matches() -> None:
    known = _known()
    connection = catalogue([one.facts for one in known])
    empty = [one for one in fresh_requests(known, 4, 200) if one.expect == "empty"]
    assert empty
    for request in empty:
        emptied = funnel(connection, arguments_of(request.truth)).emptied_by()
        assert emptied is not None
        assert emptied.stage == request.truth["emptied_by"]["stage"]


def test_the_same_seed_draws_the_same_requests_of_selection() -> None:
    known = _known()
    assert fresh_requests(known, 5, 20) == fresh_requests(known, 5, 30)[:20]
    assert fresh_requests(known, 5, 20) != fresh_requests(known, 6, 20)


@pytest.mark.shared_data
@pytest.mark.usefixtures("shared_data")
def test_a_vehicle_handed_over_late_hits_no_other_on_its_recording(tmp_path: Path) -> None:
    path = fresh_scenario(3, 30, tmp_path)
    selector = {"by": "ids", "ids": [30199]}
    truth = {"selector": selector, "vehicle_ids": [30199], "preset": "cautious", "expected_params": {}}
    one = carried_out(path, {"op": "set_behaviour", **truth})
    assert {30200, 30201} <= set(one.outcome.handed_over)
    assert unreported_collisions(one) == 0
