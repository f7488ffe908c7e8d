"""``make bench-maps``: which parts are measured, and what is told of those that are not."""

import math
from pathlib import Path

import pytest

from benchmarks.harness import Figures, as_measured
from benchmarks.maps.__main__ import PARTS
from benchmarks.maps.bench import MapsBench
from benchmarks.maps.plan import End, slope_mb


def test_a_key_or_the_name_of_a_part_chooses_the_part() -> None:
    assert PARTS.chosen(["coverage_2way"]) == ("plan",)
    assert PARTS.chosen(["people", "cache_same_bytes"]) == ("online", "people")
    assert PARTS.chosen([]) == tuple(PARTS.keys)


def test_an_unknown_key_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"coverage_3way; valid are .*coverage_2way"):
        PARTS.chosen(["coverage_3way"])


def test_a_part_that_is_not_there_or_fails_is_reported_and_the_others_are_measured(tmp_path: Path) -> None:
    def country(bench: MapsBench) -> Figures:
        raise RuntimeError(f"no maps in {bench.maps.name}")

    def plan(bench: MapsBench) -> Figures:
        return {"coverage_2way": 1.0, "batch_memory_slope_mb": 2.5, "batch_lost": bench.scenarios}

    parts = {"country": country, "plan": plan}
    figures, faults = PARTS.measured(
        ["online", "country", "plan"], MapsBench(tmp_path, tmp_path, scenarios=7), parts.get
    )
    assert figures == {"coverage_2way": 1.0, "batch_memory_slope_mb": 2.5, "batch_lost": 7}
    assert faults == [
        "online: left out, it is not there yet",
        "country: failed: no maps in osm",
        "plan: batch_per_min was not measured",
    ]


def test_a_slope_of_memory_needs_two_looks_at_one_server() -> None:
    assert slope_mb([[(60, 300.0), (1060, 302.5)], [(1100, 400.0)]]) == 2.5
    for unmeasured in ([], [[(60, 300.0)], [(90, 310.0)]], [[(60, 300.0), (60, 301.0)]]):
        assert slope_mb(unmeasured) is None
    assert as_measured({"batch_memory_slope_mb": slope_mb([]), "batch_lost": 0}) == {"batch_lost": 0}


def test_a_server_of_the_plan_is_killed_at_its_number_or_when_its_time_is_up() -> None:
    assert End(made=10, moment_s=None).is_reached(10)
    assert not End(made=10, moment_s=math.inf).is_reached(9)
    assert End(made=10, moment_s=-math.inf).is_reached(0)
    assert not End(made=None, moment_s=None).is_reached(10**6)
