"""The modification bench asks for what the corpus says, and sees what went wrong."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from builders import town_road

from plannerforge.engine.edits.apply import apply_edits
from plannerforge.engine.edits.operations import resolve_edits
from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.execution.progress import silent
from plannerforge.engine.scenarios.reader import read_scenario
from plannerforge.evals.bench_modification import failures_of, figures_of
from plannerforge.evals.modification_cases import Case, Measured, Physical, is_refused
from plannerforge.evals.modification_checks import Written, checks_of, is_untouched_identical, unreported_collisions
from plannerforge.evals.modification_refusals import CORPUS, corpus_refusal, drawn_refusals
from plannerforge.evals.modification_requests import Asked, drawn_requests, edit_of
from plannerforge.evals.modification_safety import Shift, difference_interval, new_id, safety_rows
from plannerforge.schemas.modification import ModificationRequest

TRUTHS: list[tuple[dict[str, Any], dict[str, Any]]] = [
    (
        {"op": "reroute", "vehicle_id": 7, "target_lanelets": [3, 4]},
        {"op": "reroute", "vehicles": ["7"], "to": ["3", "4"]},
    ),
    (
        {"op": "set_behaviour", "selector": {"by": "all", "except": [5]}, "preset": "eco", "params": {"tau": 0.5}},
        {"op": "set_behaviour", "vehicles": ["all", "!5"], "preset": "eco", "params": ["tau=0.5"]},
    ),
    (
        {"op": "add_vehicle", "class": "bus", "count": 2, "where": {"lanelet": 1, "s_m": 12.5}, "speed_mps": 8},
        {"op": "add_vehicle", "vehicle_class": "bus", "count": 2, "at": "1", "position": "12.5m", "speed": "8m/s"},
    ),
    (
        {"op": "set_goal", "lanelet": 2, "position": "middle", "time": {"start_s": 3.0, "end_s": 6.0}},
        {"op": "set_goal", "to": ["2"], "position": "middle", "goal_time": "3.0..6.0s"},
    ),
]

PRESETS = {"eco": {"tau": 1.8, "accel": 1.2}}


@pytest.mark.parametrize(("truth", "expected"), TRUTHS, ids=lambda one: str(one["op"]))
def test_ground_truth_becomes_the_arguments_of_an_edit(truth: dict[str, Any], expected: dict[str, Any]) -> None:
    assert edit_of(truth).model_dump(exclude_defaults=True) == expected


@pytest.fixture
def base(tmp_path: Path) -> Path:
    return town_road().cut(80).write(tmp_path / "base.xml")


def written(base: Path, asked: Asked, **request: Any) -> Written:
    """What a request makes of the base."""
    scene = Scene.of(read_scenario(base))
    changes, _ = resolve_edits(asked.edits, scene, 1000)
    made = ModificationRequest(
        xml=base, edits=asked.edits, benchmark_id="ZAM_Bench-1_1_T-1", output=base.parent / "out", **request
    )
    return Written.of(base, scene, changes, apply_edits(made, silent))


def test_drawn_requests_pass_their_own_checks(base: Path) -> None:
    scene = Scene.of(read_scenario(base))
    drawn = list(drawn_requests(scene, "seed", PRESETS))
    assert [task for task, asked in drawn if asked] == ["B", "T", "P", "G"]
    for _, asked in drawn:
        one = written(base, asked[0])
        assert all(checks_of(one, asked[0].truths[0], one.outcome.edits[0]).values())
        assert is_untouched_identical(one)
        assert unreported_collisions(one) == 0


def test_the_same_seed_draws_the_same_requests(base: Path) -> None:
    scene = Scene.of(read_scenario(base))
    assert list(drawn_requests(scene, "a", PRESETS)) == list(drawn_requests(scene, "a", PRESETS))
    assert list(drawn_requests(scene, "a", PRESETS)) != list(drawn_requests(scene, "b", PRESETS))


def test_a_wrong_target_or_preset_is_seen(base: Path) -> None:
    scene = Scene.of(read_scenario(base))
    for _, asked in drawn_requests(scene, "seed", PRESETS):
        one, truth = written(base, asked[0]), dict(asked[0].truths[0])
        if truth["op"] == "reroute":
            truth["target_lanelets"] = [3]
        elif truth["op"] == "set_behaviour":
            truth["expected_params"] = {"tau": 99.0}
        elif truth["op"] == "set_goal":
            truth["lanelet"] = 3
        elif truth["op"] == "remove_vehicle":
            truth["vehicle_ids"] = [999]
        else:
            truth["count"] = 7
        assert not all(checks_of(one, truth, one.outcome.edits[0]).values())


def test_a_collision_that_the_report_keeps_to_itself_is_seen(base: Path) -> None:
    crash = Asked(
        "P",
        (edit_of(TRUTHS[2][0] | {"count": 1, "class": "car", "speed_mps": 30, "where": {"lanelet": 1, "s_m": 50.0}}),),
    )
    one = written(base, crash)
    silent_outcome = one.outcome.model_copy(update={"collisions": ()})
    told = unreported_collisions(one)
    kept = unreported_collisions(Written(one.base, one.scene, one.changes, silent_outcome, one.xml, one.new))
    assert told == 0
    assert kept == len(one.outcome.collisions)


def test_every_refusal_names_what_is_wrong(base: Path) -> None:
    names = [word for one in drawn_refusals(Scene.of(read_scenario(base))) for word in one.must_name]
    assert {"is the ego", "'tram'", "'furious'", "'hornLevel'", "sigma=1.5 is out of range"} <= set(names)
    assert any("cannot be reached" in name for name in names)


def test_a_refusal_for_another_reason_is_not_right(base: Path) -> None:
    for one in drawn_refusals(Scene.of(read_scenario(base))):
        assert is_refused(base, one), one.must_name
        assert not is_refused(base, replace(one, must_name=("the moon",)))
        assert not is_refused(base, replace(one, must_name=()))


def test_what_is_done_is_not_refused(base: Path) -> None:
    done = Asked("refuse", (edit_of(TRUTHS[3][0] | {"time": None}),), must_name=("",))
    assert not is_refused(base, done)


def test_a_line_of_the_corpus_that_has_to_be_refused_becomes_arguments_and_words() -> None:
    truth = {"reason": "unreachable_target", "requested": [{"op": "set_goal", "lanelet": 5}]}
    asked = corpus_refusal({"id": "x", "truth": truth})
    assert asked is not None
    assert asked.must_name == ("5 cannot be reached by the ego",)
    assert corpus_refusal({"id": "x", "truth": truth | {"also_accept": ["ok"]}}) is None
    assert all(words for _, words in CORPUS.values())


def test_figures_count_refusals_as_failed_and_name_failures() -> None:
    gone = Physical(None, True, True, True)
    other = Physical(True, True, True, None, handed_over=True)
    verdicts = (Physical(False, False, True, None), gone, other)
    good = Case("T", "one", checks={"T_ends": True}, valid=True, untouched_identical=True, touched=1, edit_s=0.1)
    first = Case("T", "zero", checks={"T_ends": True}, valid=True, untouched_identical=True, edit_s=0.2, is_first=True)
    bad = Case("T", "two", refused="no")
    stuck = Case("B", "three", checks={"B_preset": False}, physical=verdicts, handovers=((0.0, 1.2),), edit_s=0.3)
    measured = [Measured((good, bad, stuck, first), (("x", True), ("y", False)), ""), Measured(round_trip_error="off")]
    figures = figures_of(measured)
    assert figures["T_ends"] == pytest.approx(2 / 3, abs=1e-4)
    assert figures["checks_min"] == 0.0
    assert figures["refused_right"] == 0.5
    assert figures["round_trip"] == 0.5
    assert figures["physical_B"] == 0.0
    assert figures["physical_handed_over"] == 1.0
    assert figures["handovers_smooth"] == 0.0
    assert figures["edit_median_s"] == pytest.approx(0.2)
    assert figures["edit_first_median_s"] == pytest.approx(0.2)
    assert len(failures_of(measured)) == 4
    assert "hand-over 0.000 m, 1.20 m/s" in failures_of(measured)[0]


def test_an_edited_file_of_the_bench_keeps_its_country_whose_signs_a_planner_reads() -> None:
    assert new_id(Path("USA_Lanker-1_11_T-1.xml")).startswith("USA_Lanker-1_11_T-")


def test_the_safety_table_gives_means_with_an_interval() -> None:
    shifts = [Shift("B", 4, after, 3, 3) for after in (0, 2, 4, 4)]
    rows = dict(safety_rows(shifts))
    assert rows["risk B, ordinary ego"].startswith("4.00 → 2.50")
    assert "1 new collisions, 2 more and 0 less critical of 4 (0 collide before)" in rows["risk B, ordinary ego"]
    assert rows["risk T, ordinary ego"] == "not measured"
    low, high = difference_interval([after - 4 for after in (0, 2, 4, 4)])
    assert low <= -1.5 <= high
