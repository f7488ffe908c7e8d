"""The comparison with the public loop around Frenetix: its driver, and how runs that end otherwise are classed."""

import json
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from support.builders import Problem, Vehicle, driving, town_road

from benchmarks.harness import LeftOut, LineProcess, Spent
from benchmarks.tuning import reference_driver, reference_presets
from benchmarks.tuning.optimised import DEFAULT
from benchmarks.tuning.reference import (
    Judged,
    Loops,
    OwnRun,
    Pair,
    PlanLog,
    ReferenceRun,
    TuningBench,
    cause_of,
    drive_alike_here,
    drive_here,
    figures,
    judge_here,
    measure,
)
from plannerforge.schemas.runs import CollisionRecord, Outcome, RunSteps

CAR = CollisionRecord(obstacle_id=7, kind="car", step=12, time_s=1.2)
EDGE = CollisionRecord(obstacle_id=None, kind="road_boundary", step=12, time_s=1.2)
WRAP = {"yaw_rate": 800, "curvature_rate": 200, "collision": 0, "road_edge": 0}
CURVE = {"yaw_rate": 10, "curvature_rate": 800, "collision": 0, "road_edge": 0}


def own(outcome: Outcome, **rejected: int) -> OwnRun:
    steps = RunSteps.model_construct(rejected={name: (0, count) for name, count in rejected.items()})
    return OwnRun(outcome, outcome, steps, Spent(3.0, 1.0))


def plan(step: int, kind: str = "regular", **rejected: int) -> PlanLog:
    return PlanLog(step, cast("Any", kind), 800, 400, rejected, 8.0)


def theirs(status: str, *plans: PlanLog, fault: str = "", met: str = "") -> ReferenceRun:
    return ReferenceRun(fault, status, status.lower(), met, plans, spent=Spent(4.0, 3.0))


def pair(ours: OwnRun, reference: ReferenceRun, judged: Judged | None = None) -> Pair:
    return Pair(Path("A.xml"), ours, reference, judged or Judged())


def met(missed_m: float | None, *plans: PlanLog) -> Pair:
    judged = Judged("collision", CAR, missed_m={one.step: missed_m for one in plans})
    return pair(own("goal_reached"), theirs("COLLISION", *plans), judged)


@pytest.mark.parametrize(
    ("cause", "case"),
    [
        ("trap", pair(own("goal_reached"), theirs("", fault="ValueError: no route (in plan)"))),
        ("trap", pair(own("goal_reached"), theirs("ERROR", plan(9, "none", **WRAP)))),
        ("sampling", pair(own("goal_reached"), theirs("ERROR", plan(9, "none", **CURVE)))),
        ("goal_rule", pair(own("goal_reached"), theirs("COMPLETED_FASTER", plan(9)), Judged("goal reached"))),
        ("goal_rule", pair(own("goal_reached"), theirs("COMPLETED_FASTER", plan(9)))),
        ("goal_rule", pair(own("goal_reached"), theirs("COMPLETED_FASTER", plan(9)), Judged("goal passed"))),
        ("road_check", pair(own("goal_reached"), theirs("COLLISION", plan(9), met="still"))),
        ("trap", pair(own("goal_reached"), theirs("COLLISION", plan(9), met="moving"))),
        ("trap", pair(own("collision"), theirs("COMPLETED_SUCCESS", plan(9)), Judged("collision", CAR))),
        ("road_check", pair(own("goal_reached"), theirs("COLLISION", plan(9)), Judged("collision", EDGE))),
        ("road_check", pair(own("off_road"), theirs("COMPLETED_SUCCESS", plan(9)), Judged("collision", EDGE))),
        ("prediction", met(None, plan(9))),
        ("prediction", met(0.9, plan(6), plan(9, "fallback"))),
        ("sampling", met(0.1, plan(6), plan(9, "fallback"))),
        ("sampling", met(None, plan(9, "fallback"))),
        ("sampling", pair(own("collision"), theirs("COMPLETED_SUCCESS", plan(9)), Judged("goal reached"))),
        ("road_check", pair(own("infeasible", road_edge=9), theirs("COMPLETED_SUCCESS"), Judged("goal reached"))),
    ],
)
def test_every_pair_with_different_endings_has_its_cause(cause: str, case: Pair) -> None:
    assert not case.agrees
    assert cause_of(case)[0] == cause


def test_agreement_causes_and_times_are_counted_over_all_pairs() -> None:
    same = pair(own("off_road"), theirs("COLLISION"))
    found = figures([same, same, same, met(None, plan(9))], [same] * 4, [same, same, *[met(None, plan(9))] * 2])
    assert (found["reference_scenarios"], found["reference_agree"], found["reference_prediction"]) == (4, 0.75, 1)
    assert (found["reference_seeing_agree"], found["reference_seeing_prediction"]) == (1.0, 0)
    assert (found["reference_alike_agree"], found["reference_alike_prediction"]) == (0.5, 2)
    assert (found["reference_time_ratio"], found["reference_time_ratio_clock"]) == (3.0, 1.33)
    assert (found["reference_success"], found["own_success"]) == (0.0, 0.25)


def test_presets_are_compared_on_the_same_scenarios() -> None:
    found = reference_presets.figures(
        {
            ("reference", "guessed", "default"): ["collision", "goal reached", "infeasible", "goal reached"],
            ("reference", "guessed", "safety"): ["goal reached", "goal passed", "collision", "goal reached"],
        }
    )
    assert (found["reference_guessed_to_success"], found["reference_guessed_to_failure"]) == (1, 1)
    assert (found["reference_guessed_default_collisions"], found["reference_guessed_default_other"]) == (0.25, 0.25)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, OwnRun]:
    problem = Problem(goal=(90.0, 0.0, 20.0, 3.0), steps=(20, 80))
    path = replace(town_road(), problems=(problem,)).write(tmp_path_factory.mktemp("reference") / "a.xml")
    return path, drive_here(path, DEFAULT, "ground_truth")


def alone(tmp_path: Path, problem: Problem, *others: Vehicle) -> Path:
    return replace(town_road(), problems=(problem,), vehicles=others).write(tmp_path / "a.xml")


def test_by_the_rules_of_the_reference_our_loop_does_not_wait_in_a_goal(tmp_path: Path) -> None:
    path = alone(tmp_path, Problem(goal=(50.0, 0.0, 30.0, 3.0), steps=(60, 70)))
    assert drive_here(path, DEFAULT, "ground_truth").ending == "goal reached"
    assert drive_alike_here(path).ending == "goal passed"


def test_by_the_rules_of_the_reference_our_loop_does_not_see_followers(tmp_path: Path) -> None:
    follower = driving(7, (25.0, 0.0), 20.0, 90)
    path = alone(tmp_path, Problem(goal=(120.0, 0.0, 20.0, 3.0), steps=(80, 90)), follower)
    assert drive_here(path, DEFAULT, "ground_truth").ending == "goal reached"
    assert drive_alike_here(path).ending == "collision"


def logged(steps: RunSteps, count: int) -> ReferenceRun:
    cut = {name: getattr(steps, name)[:count] for name in ("x_m", "y_m", "heading_rad", "speed_mps")}
    return ReferenceRun("", "COLLISION", "", steps=steps.model_copy(update=cut))


def test_a_logged_drive_is_judged_as_if_it_were_ours(driven: tuple[Path, OwnRun]) -> None:
    path, run = driven
    assert run.ending == "goal reached"
    assert judge_here(path, logged(run.steps, len(run.steps.x_m))) == Judged("goal reached")
    assert judge_here(path, logged(run.steps, 5)) == Judged()


def test_a_contact_in_a_logged_drive_knows_how_it_was_foreseen(driven: tuple[Path, OwnRun], tmp_path: Path) -> None:
    _, run = driven
    at = 6
    place = (run.steps.x_m[at] + 4.4, run.steps.y_m[at])
    standing = Vehicle(7, tuple((*place, 0.0, 0.0) for _ in range(90)))
    problem = Problem(goal=(90.0, 0.0, 20.0, 3.0), steps=(20, 80))
    path = replace(town_road(), problems=(problem,)).with_vehicles(standing).write(tmp_path / "a.xml")
    before = [plan(0), replace(plan(3), predicted={"7": [(place[0] - 2.0, place[1])] * 30})]
    judged = judge_here(path, replace(logged(run.steps, 9), plans=tuple(before)))
    assert judged.contact is not None
    assert (judged.ending, judged.contact.obstacle_id, judged.from_behind) == ("collision", 7, False)
    assert judged.missed_m == {0: None, 3: pytest.approx(2.0)}


ANSWER = {
    "fault": "",
    "status": "COMPLETED_FASTER",
    "message": "goal reached faster",
    "met": "",
    "plans": [{"step": 0, "kind": "regular", "candidates": 800, "feasible": 9, "rejected": {}, "desired_mps": 8.0}],
    "first_step": 0,
    **{name: [0.0, 1.0] for name in ("x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2")},
    "processor_s": 2.0,
    "wall_s": 3.0,
}
SCRIPT = f"""
import json, sys
for line in sys.stdin:
    asked = json.loads(line)
    assert asked["weights"]["velocity_offset"] == 1.0 and asked["prediction"] == "walenet" and not asked["sees_behind"]
    if "dies" in asked["scenario"]:
        sys.exit(3)
    print({json.dumps(ANSWER)!r}, flush=True)
"""


@pytest.fixture
def loops(tmp_path: Path) -> Iterator[Loops]:
    """The driver replaced by a script, and nothing of ours."""
    with (tmp_path / "log").open("w") as log, LineProcess([sys.executable, "-c", SCRIPT], log, 60.0) as reference:
        yield Loops(reference, cast("ProcessPoolExecutor", None))


def test_the_driver_s_answer_is_a_run(loops: Loops) -> None:
    run = loops.theirs(Path("a.xml"), DEFAULT, "walenet")
    assert (run.ending, run.reason, run.spent) == ("goal passed", "goal reached faster", Spent(3.0, 2.0))
    assert run.steps is not None
    assert (run.plans[0].kind, run.steps.x_m) == ("regular", (0.0, 1.0))


def test_a_driver_that_dies_is_a_fault_and_the_next_run_begins_again(loops: Loops) -> None:
    run = loops.theirs(Path("dies.xml"), DEFAULT, "walenet")
    assert (run.ending, run.fault) == ("infeasible", "its process ended with 3")
    assert loops.theirs(Path("a.xml"), DEFAULT, "walenet").ending == "goal passed"


@pytest.mark.parametrize("part", [measure, reference_presets.measure])
def test_without_a_checkout_the_comparison_is_left_out(part: Any, tmp_path: Path) -> None:
    with pytest.raises(LeftOut, match="--reference-python"):
        part(TuningBench(tmp_path, tmp_path))


def test_the_driver_notes_how_the_candidates_of_each_plan_fared() -> None:
    samples = [SimpleNamespace(boundary_harm=harm) for harm in (0.3, 0.0, 0.4)]
    found = [None, samples[1]]
    planner = SimpleNamespace(
        x_0=SimpleNamespace(time_step=6),
        all_traj=[None] * 5,
        predictions={7: {"pos_list": [(1.0, 2.0)]}},
        desired_velocity=8.0,
        infeasible_count_collision=1,
        _infeasible_count_kinematics=[0, 0, 0, 0, 0, 1, 2, 0, 0],
        trajectory_collision_check=lambda feasible: found.pop(),
    )
    planner.plan = lambda: planner.trajectory_collision_check(samples) or samples[0]
    plans: list[dict[str, Any]] = []
    reference_driver._watch(planner, plans)
    assert [planner.plan(), planner.plan()] == [samples[1], samples[0]]
    noted = PlanLog(**plans[0])
    assert (noted.step, noted.kind, noted.candidates, noted.feasible) == (6, "regular", 5, 3)
    assert noted.rejected == {
        "curvature": 1,
        "yaw_rate": 2,
        "curvature_rate": 0,
        "acceleration": 0,
        "collision": 1,
        "road_edge": 1,
    }
    assert noted.predicted == {"7": [[1.0, 2.0]]}
    assert (plans[1]["kind"], plans[1]["rejected"]["road_edge"]) == ("fallback", 2)


def test_the_driver_hands_over_the_centre_of_the_ego() -> None:
    state = SimpleNamespace(time_step=3, position=(1.0, 2.0), orientation=0.0, velocity=5.0, acceleration=0.0)
    assert reference_driver._states([state], 1.4)["x_m"] == [2.4]
