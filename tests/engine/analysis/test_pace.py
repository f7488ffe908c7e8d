"""Why an ego stood and braked, and what a collision from behind is laid to then."""

import random
from pathlib import Path

import pytest

from benchmarks.loop.standing import Answer, Made, Other, asked, braking, is_right, slowing, standing, steady, stopping
from plannerforge.schemas.reviews import Contact, EgoFault, PaceMoment, Prevention


def made_of(kind: str) -> Made:
    """A drawn run of a kind."""
    choice = random.Random(7)
    return next(made for family in (standing, braking) for name, made in family(choice) if name == kind)


@pytest.mark.parametrize(
    ("kind", "codes"),
    [
        ("red", ["stood_at_red"]),
        ("turned green", ["stood_at_red", "stood_at_green"]),
        ("queue at red", ["stood_in_queue"]),
        ("nobody near", ["stood_without_cause"]),
        ("gives way", ["stood_to_give_way"]),
        ("goal", ["stood_in_goal"]),
    ],
)
def test_standing_has_the_code_of_its_reason(kind: str, codes: list[str], tmp_path: Path) -> None:
    answer = asked(made_of(kind), tmp_path, 1)
    assert [one.code for one in answer.moments if one.code.startswith("stood")] == codes


def test_later_crossing_traffic_does_not_excuse_a_stop_without_a_cause(tmp_path: Path) -> None:
    stop = stopping(8.0, 9.5, 1.6)  # stands 2 m before the crossing from 15 s on
    later = tuple(Other(7 + n, -8.0 * passes, steady(8.0), "across") for n, passes in enumerate((26.0, 31.0, 36.0)))
    made = Made(stop, 40.0, (), later, goal_m=(180.0, 200.0), goal_steps=(100, 150), late=True)
    answer = asked(made, tmp_path, 1)
    assert [one.code for one in answer.moments if one.code.startswith("stood")] == ["stood_without_cause"]
    assert "stood_late" in answer.findings
    assert "waited_late" not in answer.findings


def test_a_slower_vehicle_beyond_the_time_gap_of_followers_does_not_hold_up_the_ego(tmp_path: Path) -> None:
    behind, alone = (
        asked(made_of(kind), tmp_path, number) for number, kind in enumerate(("late behind", "late alone"), 1)
    )
    assert [one.code for one in behind.moments] == ["held_up"]
    assert "held_up" in behind.findings
    assert not alone.moments
    assert "held_up" not in alone.findings


@pytest.mark.parametrize(("kind", "laid_to"), [("hit, nothing", "ego"), ("hit, leader", "recording")])
def test_a_hit_from_behind_is_attributed_to_the_ego_if_it_braked_without_cause(
    kind: str, laid_to: str, tmp_path: Path
) -> None:
    answer = asked(made_of(kind), tmp_path, 1)
    assert answer.laid_to == laid_to
    assert any(one.is_the_egos for one in answer.moments) == (laid_to == "ego")


def test_a_follower_is_not_a_reason_to_brake(tmp_path: Path) -> None:
    answer = asked(made_of("hit, nothing"), tmp_path, 1)
    assert [one.code for one in answer.moments] == ["braked_without_cause"]


@pytest.mark.parametrize(("by_mps2", "is_the_egos"), [(2.5, False), (7.5, True)])
def test_a_goal_explains_gentle_braking_but_never_hard_braking(
    by_mps2: float, is_the_egos: bool, tmp_path: Path
) -> None:
    made = Made(slowing(12.0, 3.0, by_mps2, 3.0), 9.0, (), goal_m=(150.0, 170.0), goal_steps=(300, 400))
    answer = asked(made, tmp_path, 1)
    assert [one.is_the_egos for one in answer.moments] == [is_the_egos]


def test_braking_too_hard_for_no_one_in_particular_names_no_other() -> None:
    moment = PaceMoment(code="braked_too_hard", since_s=1.0, until_s=2.0, largest_mps2=8.0)
    assert "None" not in moment.in_words()


def test_the_bench_finds_a_wrong_answer() -> None:
    assert not is_right(made_of("red"), Answer((), None, ()), is_braking=False)


def test_preventability_is_not_stated_for_a_collision_that_the_ego_caused() -> None:
    never = Prevention(by_braking_until_s=None, by_careful_driver=False, by_rss=False)
    hit = Contact(kind="rear_end_by_other", time_s=3.0, ego_speed_mps=1.0, other_speed_mps=9.0, prevention=never)
    moment = PaceMoment(code="braked_without_cause", since_s=1.0, until_s=2.0, largest_mps2=10.3)
    fault = EgoFault(code="slowed", time_s=1.0, moment=moment)
    own = hit.model_copy(update={"laid_to": "ego", "fault": fault})
    assert hit.is_unpreventable
    assert not own.is_unpreventable
    assert "reference driver" in hit.in_words()
    assert "reference driver" not in own.in_words()
    assert moment.in_words() in own.in_words()
