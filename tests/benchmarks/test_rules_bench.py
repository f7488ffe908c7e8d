"""The bench of traffic rules: the product agrees with its truth, and its drives both break and keep each rule."""

import math
import random

import pytest

from benchmarks.analysis.rules import EAST, Case, are_rules_reported, compared, crossing, drawn, eastward, even, moving


def test_the_product_tells_the_rules_as_the_truth_has_them() -> None:
    figures = compared(seed=3, each=2)
    assert figures == {"rules_right": 1.0, "rules_silent": 1.0, "rule_cases": 30}


def test_drives_that_break_and_that_keep_rules_are_drawn() -> None:
    choice = random.Random(5)
    cases = [case for _ in range(12) for case in drawn(choice)]
    broken = {case.rule for case in cases if min(case.truth) < -0.01}
    kept = {case.rule for case in cases if min(case.truth) >= -0.01}
    assert broken == {"R_G1", "R_G2", "R_G3", "R_L1", "R_IN1", "R_IN2", "R_IN3", "R_IN4", "R_IN5"}
    assert kept == broken


def test_a_wrong_truth_is_noticed(capsys: pytest.CaptureFixture[str]) -> None:
    ego = moving(-140, even(12.0, 2.0), eastward)
    assert are_rules_reported(Case("R_G3", ego, [-2.0] * len(ego.x), limit_mps=10.0)) == (True, True)
    assert are_rules_reported(Case("R_G3", ego, [-3.0] * len(ego.x), limit_mps=10.0)) == (False, True)
    assert are_rules_reported(Case("R_G1", ego, [math.inf] * len(ego.x), limit_mps=10.0)) == (True, False)
    assert "told to break R_G3" in capsys.readouterr().err


def test_the_crossing_has_all_features_of_a_case() -> None:
    ego = moving(-140, even(12.0, 2.0), eastward)
    network = crossing(Case("R_G3", ego, [0.0], limit_mps=10.0, solid=True))
    lanelet = network.find_lanelet_by_id(EAST)
    assert lanelet.line_marking_left_vertices.value == "solid"
    assert len(lanelet.traffic_signs) == 1
    assert not lanelet.traffic_lights
