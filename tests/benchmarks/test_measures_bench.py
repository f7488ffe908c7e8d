"""The judge of measures: closed forms agree, wrong values are seen, moments without a comparison are counted apart."""

from pathlib import Path
from typing import Any

import pytest

from benchmarks.analysis import measures
from benchmarks.analysis.measures import Moving, Tally, closed_forms, reported_measures, straight
from plannerforge.schemas.measures import MEASURES


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Tally:
    return closed_forms(3, 2, tmp_path_factory.mktemp("closed"))


def test_reported_values_agree_with_the_closed_forms(judged: Tally) -> None:
    assert judged.deviations == []
    assert judged.share == 1.0


def test_every_measure_of_an_encounter_has_a_closed_form(judged: Tally) -> None:
    judged_names = {name.rpartition(" ")[2] for name in judged.compared}
    left = {measure.name for measure in MEASURES} - judged_names
    # Of a planner and its scenario, and what the drivability checker judges (bench-drivable).
    assert left == {"progress", "drivable_share", "mean_total_cost"}


def test_a_value_that_is_off_by_two_per_cent_is_seen() -> None:
    tally = Tally()
    for told in (1.0, 1.009, 1.02, None):
        tally.compare("time", told, 1.0, 0.0, "here")
    assert (tally.agreeing["time"], tally.compared["time"], len(tally.deviations)) == (2, 4, 2)


def test_a_wrong_judge_is_not_satisfied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measures, "BRAKING_MPS2", 6.0)
    assert closed_forms(3, 1, tmp_path).share < 1.0


class Asked:
    """In CriMe's place: the same answer to whatever is asked."""

    def __init__(self, **answer: Any) -> None:
        self.answer, self.kinds = answer, list[str]()

    def ask(self, kind: str, **_: Any) -> dict[str, Any]:
        self.kinds.append(kind)
        return self.answer


ANSWER = {
    "turned_rad": 0.0,
    "one_lane": True,
    "leader_mps2": 0.0,
    "gap_m": 15.0,
    "collision_s": 5.0,
    "needed_mps2": -0.3,
    "threat": 0.0375,
    "closest_m": 15.0,
    "worst_s": 1.0,
}


@pytest.mark.parametrize(
    ("changes", "left_out", "agreeing"),
    [
        ({}, 0, 5),
        ({"turned_rad": 0.1}, 4, 1),
        ({"leader_mps2": -1.0}, 1, 4),
        ({"one_lane": False}, 4, 1),
        ({"collision_s": None}, 1, 4),
        ({"collision_s": 6.0}, 0, 4),
    ],
)
def test_moments_are_compared_or_counted_apart_by_class(
    changes: dict[str, Any], left_out: int, agreeing: int, tmp_path: Path
) -> None:
    ego, leader = straight(0, 0, 0, 13.0, 11), straight(22.508, 0, 0, 10.0, 11, size_m=(4.508, 1.61))
    tally, crime = Tally(), Asked(**ANSWER | changes)
    recorded = (ego, 0.1, [(0, leader)])
    measures._compare(Path("a.xml"), recorded, crime, tally, tmp_path)  # type: ignore[arg-type]
    assert sum(tally.left_out.values()) == left_out
    assert sum(count for name, count in tally.agreeing.items() if name != "worst_time_to_collision_s") == agreeing
    assert crime.kinds == ["leader", "closest", "worst"]


def test_a_run_of_the_judge_keeps_the_classes_and_sizes_of_the_others(tmp_path: Path) -> None:
    other = Moving(((20.0, 0.0, 0.0, 5.0),) * 3, (12.0, 2.5), "truck", 9)
    told = reported_measures(straight(0, 0, 0, 5.0, 3), [other], 0.1, tmp_path)
    assert told["minimum_distance_m"].partner == "truck 9 ahead"
    assert told["minimum_distance_m"].value == pytest.approx(20.0 - 1.0 - 6.0 - 4.508 / 2)
