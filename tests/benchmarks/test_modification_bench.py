"""The modification bench asks for what the corpus says, and sees what went wrong."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.builders import town_road
from support.modification_bench import carried_out, verdicts

from benchmarks.modification.__main__ import failures_of, figures_of
from benchmarks.modification.cases import Case, Measured, Physical, is_refused
from benchmarks.modification.judges import is_untouched_identical, unreported_collisions
from benchmarks.modification.safety import Shift, difference_interval, new_id, safety_rows
from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.commonroad.tracks import Track
from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.scene.scene import Scene
from plannerforge.evals.ground_truth.modification import (
    CORPUS,
    EditRequest,
    corpus_refusal,
    drawn_refusals,
    drawn_requests,
    edit_of,
)

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

EVERYBODY = {"selector": {"by": "ids", "ids": [31]}, "vehicle_ids": [31], "preset": "eco", "expected_params": {}}
PRESETS = {"eco": {"tau": 1.8, "accel": 1.2}}


@pytest.mark.parametrize(("truth", "expected"), TRUTHS, ids=lambda one: str(one["op"]))
def test_ground_truth_becomes_the_arguments_of_an_edit(truth: dict[str, Any], expected: dict[str, Any]) -> None:
    assert edit_of(truth).model_dump(exclude_defaults=True) == expected


@pytest.fixture
def base(tmp_path: Path) -> Path:
    return town_road().cut(80).write(tmp_path / "base.xml")


def test_drawn_requests_pass_their_own_checks(base: Path) -> None:
    drawn = list(drawn_requests(Scene.of(read_scenario(base)), "seed", PRESETS))
    assert [task for task, asked in drawn if asked] == ["B", "T", "P", "G"]
    for _, asked in drawn:
        one = carried_out(base, *asked[0].truths)
        assert all(verdicts(one).values())
        assert is_untouched_identical(one)
        assert unreported_collisions(one) == 0


def test_the_same_seed_draws_the_same_requests(base: Path) -> None:
    scene = Scene.of(read_scenario(base))
    assert list(drawn_requests(scene, "a", PRESETS)) == list(drawn_requests(scene, "a", PRESETS))
    assert list(drawn_requests(scene, "a", PRESETS)) != list(drawn_requests(scene, "b", PRESETS))


def test_drawn_reroutes_lead_off_the_recorded_way(base: Path) -> None:
    drawn = dict(drawn_requests(Scene.of(read_scenario(base)), "seed", PRESETS))
    targets = {(one.truths[0]["vehicle_id"], one.truths[0]["target_lanelets"][0]) for one in drawn["T"]}
    assert targets
    assert not targets & {(31, 1), (32, 1), (33, 2), (34, 3), (35, 1)}


CRASH = {"op": "add_vehicle", "class": "car", "count": 1, "where": {"lanelet": 1, "s_m": 50.0}, "speed_mps": 30}


def test_a_collision_that_the_report_keeps_to_itself_is_seen(base: Path) -> None:
    one = carried_out(base, CRASH)
    silent_outcome = one.outcome.model_copy(update={"collisions": ()})
    assert unreported_collisions(one) == 0
    assert unreported_collisions(replace(one, outcome=silent_outcome)) == len(one.outcome.collisions)


def test_a_recorded_overlap_excuses_a_pair_about_then_only(base: Path) -> None:
    one = carried_out(base, {"op": "set_behaviour", **EVERYBODY})
    silent_outcome, still = one.outcome.model_copy(update={"collisions": ()}), one.old[31]
    first = replace(still, obstacle_id=1)
    second = replace(still, obstacle_id=2, positions=still.positions + np.array([0.0, 9.0]))
    meets = {step: replace(second, positions=_once_at(second, first, step)) for step in (5, 12, 60)}
    moved = replace(one, outcome=silent_outcome, old={1: first, 2: meets[5]})
    assert unreported_collisions(replace(moved, new={1: first, 2: meets[12]})) == 0
    assert unreported_collisions(replace(moved, new={1: first, 2: meets[60]})) == 1


def test_every_refusal_names_the_error(base: Path) -> None:
    names = [word for one in drawn_refusals(Scene.of(read_scenario(base))) for word in one.must_name]
    assert {"drives the ego", "'tram'", "'furious'", "'hornLevel'", "sigma=1.5 is out of range"} <= set(names)
    assert any("cannot be reached" in name for name in names)


def test_a_refusal_for_another_reason_is_not_right(base: Path) -> None:
    for one in drawn_refusals(Scene.of(read_scenario(base))):
        assert is_refused(base, one), one.must_name
        assert not is_refused(base, replace(one, must_name=("the moon",)))
        assert not is_refused(base, replace(one, must_name=()))


def test_a_finished_edit_is_not_refused(base: Path) -> None:
    done = EditRequest("refuse", (edit_of(TRUTHS[3][0] | {"time": None}),), must_name=("",))
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


def test_an_edited_file_of_the_bench_keeps_the_country_of_its_signs() -> None:
    assert new_id(Path("USA_Lanker-1_11_T-1.xml")).startswith("USA_Lanker-1_11_T-")


def test_the_safety_table_gives_means_with_an_interval() -> None:
    shifts = [Shift("B", 4, after, 3, 3) for after in (0, 2, 4, 4)]
    rows = dict(safety_rows(shifts))
    assert rows["risk B, ordinary ego"].startswith("4.00 → 2.50")
    assert "1 new collisions, 2 more and 0 less critical of 4 (0 collide before)" in rows["risk B, ordinary ego"]
    assert rows["risk T, ordinary ego"] == "not measured"
    low, high = difference_interval([after - 4 for after in (0, 2, 4, 4)])
    assert low <= -1.5 <= high


def _once_at(away: Track, here: Track, step: int) -> Points:
    """The places of one vehicle, but for one step those of another."""
    found = away.positions.copy()
    found[step] = here.positions[step]
    return found


def test_vehicles_are_drawn_to_enter_at_once_and_later(base: Path) -> None:
    scene = Scene.of(read_scenario(base))
    drawn = [dict(drawn_requests(scene, str(seed), PRESETS))["P"][0].truths[0] for seed in range(40)]
    added = [truth for truth in drawn if truth["op"] == "add_vehicle"]
    assert {truth.get("depart_s", 0.0) for truth in added} == {0.0, 1.0}
    assert {"lanelet" in truth["where"] for truth in added} == {True, False}
