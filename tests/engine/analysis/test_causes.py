"""Collisions that no ego prevents and goals that ask for no driving: counted apart, beside the rate over all."""

from pathlib import Path

import pytest
from support.builders import Problem, ScenarioBuilder, town_road
from support.runs import metrics, record

from plannerforge.engine.analysis import causes
from plannerforge.engine.analysis.causes import collision_causes, look_at_runs, trivial_goals
from plannerforge.engine.analysis.run_set import METRICS, RunSet
from plannerforge.engine.analysis.summary import analyse
from plannerforge.engine.execution.executor import silent
from plannerforge.schemas.results import AnalyseRequest
from plannerforge.schemas.runs import (
    CollisionRecord,
    DrivenObstacle,
    ReviewRequest,
    RunRecord,
    RunSource,
    RunSteps,
    ScenarioSource,
)
from plannerforge.schemas.text import REFERENCE_DRIVERS_DO

STEPS = 41
MOST = 12
"""Collisions that are looked at in a test (60 outside of tests)."""


def driven(key: int, start_m: float, speed_mps: float) -> DrivenObstacle:
    """A car that goes straight on for four seconds and after them."""
    x = tuple(start_m + 0.1 * speed_mps * step for step in range(STEPS + 40))
    still = (0.0,) * len(x)
    return DrivenObstacle(
        obstacle_id=key,
        kind="car",
        length_m=4.5,
        width_m=1.8,
        first_step=0,
        x_m=x,
        y_m=still,
        heading_rad=still,
        speed_mps=(speed_mps,) * len(x),
    )


def hit_by(number: int, other_from_m: float, other_mps: float, folder: Path) -> RunSource:
    """A run whose ego drives at 5 m/s and touches another at step 40."""
    run = record(f"ZAM_Town-{number}_1_T-1", "collision").model_copy(
        update={"collision": CollisionRecord(obstacle_id=7, kind="car", step=40, time_s=4.0)}
    )
    ego = driven(-1, 0.0, 5.0)
    steps = RunSteps(
        first_step=0,
        x_m=ego.x_m[:STEPS],
        y_m=ego.y_m[:STEPS],
        heading_rad=ego.heading_rad[:STEPS],
        speed_mps=ego.speed_mps[:STEPS],
        acceleration_mps2=(0.0,) * STEPS,
        plan_steps=(),
        costs={},
        others=(driven(7, other_from_m, other_mps),),
    )
    path = folder / f"{run.run_id}.json"
    path.write_text(steps.model_dump_json(), encoding="utf-8")
    return RunSource(record=run, steps_path=str(path))


def followers_and_a_leader(folder: Path) -> list[RunSource]:
    """Two runs that a follower ends, one that drives into a slower leader, and one that reaches its goal."""
    behind = [hit_by(number, 20.0 - 4.4 - 60.0, 15.0, folder) for number in (1, 2)]
    leader = hit_by(3, 20.0 + 4.4 - 4.0, 1.0, folder)
    return [*behind, leader, RunSource(record=record("ZAM_Town-9_1_T-1"))]


def test_the_rate_is_given_with_and_without_unpreventable_collisions(tmp_path: Path) -> None:
    runs = followers_and_a_leader(tmp_path)
    found = collision_causes(RunSet(tuple(runs)))
    assert found is not None
    assert found.kinds == {"rear_end_by_other": 2, "rear_end_by_ego": 1}
    assert (found.collisions, found.judged, found.from_behind) == (3, 3, 2)
    assert set(found.not_preventable) == {runs[0].record.run_id, runs[1].record.run_id}
    assert found.success_without is not None
    assert (found.success_without.count, found.success_without.of) == (1, 2)
    assert [(one.run_id, one.time_s) for one in found.evidence] == [(one.record.run_id, 4.0) for one in runs[:3]]
    told = found.in_words()
    assert told.startswith(
        "Collisions: 2 rear-end by another vehicle, 1 rear-end by the ego; 2 attributed to the recording; "
    )
    assert REFERENCE_DRIVERS_DO in told
    assert "prevents 2 of 3 (" in told
    assert "goal 1/2" in told


def test_reactive_traffic_is_advised_if_followers_of_a_recording_decide(tmp_path: Path) -> None:
    runs = followers_and_a_leader(tmp_path)
    told = analyse(AnalyseRequest(results=("batch_x",), runs=tuple(runs)), silent).answer()
    assert "traffic=reactive" in told.next_step
    reactive = [one.model_copy(update={"record": reacting(one.record)}) for one in runs]
    told = analyse(AnalyseRequest(results=("batch_x",), runs=tuple(reactive)), silent).answer()
    assert "traffic=reactive" not in told.next_step


def reacting(run: RunRecord) -> RunRecord:
    return run.model_copy(update={"traffic": "reactive"})


def test_many_collisions_are_reported_as_a_random_sample_with_its_interval(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(causes, "MOST_COLLISIONS", MOST)
    behind = [hit_by(number, 20.0 - 4.4 - 60.0, 15.0, tmp_path) for number in range(10)]
    ahead = [hit_by(number, 20.0 + 4.4 - 4.0, 1.0, tmp_path) for number in range(10, 20)]
    goals = [RunSource(record=record(f"ZAM_G-{number}_1_T-1")) for number in range(20)]
    runs = RunSet((*behind, *ahead, *goals))
    found = collision_causes(runs)
    assert found is not None
    assert (found.collisions, found.looked_at, found.is_sample) == (20, MOST, True)
    share = found.unpreventable_share
    assert share.of == MOST
    assert share.low is not None
    assert share.high is not None
    assert share.low < 0.5 < share.high
    without = found.success_without
    assert without is not None
    assert without.low is not None
    assert without.high is not None
    assert without.low < 20 / 30 < without.high
    assert f"In a random {MOST} of 20 collisions" in found.in_words()
    assert len(found.evidence) == MOST
    assert found == collision_causes(RunSet((*reversed(ahead), *behind, *goals))).model_copy(  # type: ignore[union-attr]
        update={"evidence": found.evidence, "not_preventable": found.not_preventable}
    )


def test_with_looks_kept_all_collisions_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(causes, "MOST_COLLISIONS", MOST)
    sources = [hit_by(number, 20.0 - 4.4 - 60.0, 15.0, tmp_path) for number in range(MOST + 2)]
    looks = look_at_runs(ReviewRequest(runs=tuple(sources), scenarios=()), silent).looks
    kept = (one.model_copy(update={"look": look, "steps_path": None}) for one, look in zip(sources, looks, strict=True))
    found = collision_causes(RunSet(tuple(kept)))
    assert found is not None
    assert (found.collisions, found.looked_at, found.is_sample) == (MOST + 2, MOST + 2, False)
    assert found.laid_to == {"recording": MOST + 2}


def test_leaving_the_road_is_not_a_collision() -> None:
    edge = CollisionRecord(obstacle_id=None, kind="road_boundary", step=40, time_s=4.0)
    off = record(outcome="off_road").model_copy(update={"collision": edge})
    assert collision_causes(RunSet((RunSource(record=off),))) is None
    risk = next(spec for spec in METRICS if spec.name == "risk_score")
    assert risk.value(off) is None
    assert risk.value(record()) == 3


def test_collisions_without_stored_steps_give_no_statement() -> None:
    assert collision_causes(RunSet((RunSource(record=record(outcome="collision")),))) is None
    assert collision_causes(RunSet((RunSource(record=record()),))) is None


def test_goals_that_ask_for_no_driving_are_counted_apart(tmp_path: Path) -> None:
    timed = ScenarioBuilder(town_road().lanes, problems=(Problem(goal=None),)).write(tmp_path / "timed.xml")
    placed = ScenarioBuilder(town_road().lanes).write(tmp_path / "placed.xml")
    runs = [
        RunSource(record=record("A", figures=metrics(duration_s=0.1))),
        RunSource(record=record("B", figures=metrics(distance_m=0.2))),
        RunSource(record=record("C")),
        RunSource(record=record("D")),
        RunSource(record=record("E", outcome="timeout", figures=metrics(distance_m=0.1))),
    ]
    sources = ScenarioSource(scenario_id="C", path=str(timed)), ScenarioSource(scenario_id="D", path=str(placed))
    found = trivial_goals(RunSet(tuple(runs), scenarios=sources))
    assert found is not None
    assert found.kinds == {"at_the_start": 1, "by_time_alone": 1, "standing": 1}
    assert found.success_without is not None
    assert (found.success_without.count, found.success_without.of) == (1, 2)
    assert found.in_words().startswith(
        "3 goals required no driving "
        "(the start already met the goal: 1, only a time is set: 1, the ego stood still: 1); "
        "without these runs, goal 1/2"
    )


def test_without_trivial_goals_there_is_no_statement() -> None:
    assert trivial_goals(RunSet((RunSource(record=record()),))) is None
