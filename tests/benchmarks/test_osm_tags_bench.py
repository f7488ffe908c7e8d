"""``make bench-osm-tags``: its cases are whole, and its judge tells a road that is wrong from one that is right."""

from pathlib import Path

import pytest

from benchmarks.maps.tags import drawn_cases, judged, legal_limits


def test_there_are_enough_cases_and_some_are_held_out() -> None:
    cases = drawn_cases()
    assert len(cases) >= 120
    assert sum(case["part"] == "held" for case in cases) >= 40
    assert all(case["right"] for case in cases)
    limits = legal_limits()
    assert len(limits) == 40
    assert all(20 <= int(row["town"]) <= 60 <= int(row["rural"]) <= 140 for row in limits)


@pytest.mark.parametrize(
    ("right", "is_right"),
    [("car !dead in=30 lanes_in=2 lanes_out=1", True), ("gone", False), ("in=50", False), ("lanes_in=1", False)],
)
def test_a_crossing_is_judged_by_its_lanelets(tmp_path: Path, right: str, is_right: bool) -> None:
    case = {
        "country": "DEU",
        "west": "lanes=3 & lanes:forward=2 & maxspeed=30",
        "nodes": "",
        "right": right,
        "told": "",
    }
    assert judged(case, tmp_path).right is is_right


def test_a_report_counts_only_with_its_own_word(tmp_path: Path) -> None:
    case = {"country": "DEU", "west": "lanes=1", "nodes": "", "right": "gone", "told": "one lane"}
    assert judged(case, tmp_path).told
    assert not judged(case | {"told": "bollard"}, tmp_path).told
