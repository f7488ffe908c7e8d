"""How the growth of work is measured, and that the inputs are what they say."""

from pathlib import Path

import pytest

from benchmarks.growth.inputs import rings, stack, star, town
from benchmarks.growth.measurement import Growth, Subject, Timed, Work, measured, slope
from benchmarks.growth.subjects import SUBJECTS
from plannerforge.engine.commonroad import read_road_document
from plannerforge.engine.network import check_file
from plannerforge.schemas.errors import NotPossible


def test_the_exponent_is_the_slope_over_doubled_sizes() -> None:
    assert slope([(size, 0.1 * size**2) for size in (1, 2, 4, 8)]) == pytest.approx(2.0)
    timed = [Timed(100, 0.01), *(Timed(size, size / 1000) for size in (200, 400, 800))]
    assert Growth("linear", tuple(timed)).figure == 1.0


def test_a_time_too_short_to_measure_has_no_exponent() -> None:
    timed = [Timed(size, size / 10_000) for size in (100, 200, 400, 800)]
    assert Growth("short", tuple(timed)).figure == "below 0.05 s"


def test_sizes_that_are_refused_are_reported(tmp_path: Path) -> None:
    def prepared(size: int, folder: Path) -> Work:
        def work() -> None:
            if size > 2:
                raise NotPossible("too many")

        return work

    growth = measured(Subject("few: only", (1, 2, 4, 8), prepared), tmp_path, repeats=2)
    assert [one.refused for one in growth.timed] == ["", "", "not_possible", "not_possible"]
    assert growth.figure == "refused from 4 on"
    assert growth.exponent is None


def test_each_subject_doubles_its_input_three_times() -> None:
    assert len({subject.name for subject in SUBJECTS}) == len(SUBJECTS)
    for subject in SUBJECTS:
        assert [size // subject.sizes[0] for size in subject.sizes] == [1, 2, 4, 8], subject.name


def test_inputs_are_valid_and_as_large_as_requested(tmp_path: Path) -> None:
    path = town(tmp_path / "town.xml", crossings=3, vehicles=4, steps=5)
    assert not [finding for finding in check_file(path).findings if finding.severity == "error"]
    assert len(read_road_document(path).lanelets) == 18
    assert path.read_text().count("<dynamicObstacle ") == 4
    assert len(read_road_document(stack(tmp_path / "stack.xml", 7)).lanelets) == 7
    assert len(read_road_document(star(tmp_path / "star.xml", 12)).lanelets) == 4 * 2 + 4 * 3
    assert rings(tmp_path / "rings.osm", 5).read_text().count('v="roundabout"') == 5
