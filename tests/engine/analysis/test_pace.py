"""Why an ego stood and braked, and what a collision from behind is laid to then."""

import random
from pathlib import Path

import pytest

from plannerforge.evals.loop.standing import Answer, Made, asked, braking, is_right, standing


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
def test_a_stand_has_the_code_of_its_reason(kind: str, codes: list[str], tmp_path: Path) -> None:
    answer = asked(made_of(kind), tmp_path, 1)
    assert [one.code for one in answer.moments if one.code.startswith("stood")] == codes


def test_a_slower_vehicle_beyond_the_time_gap_of_followers_holds_nothing_up(tmp_path: Path) -> None:
    behind, alone = (
        asked(made_of(kind), tmp_path, number) for number, kind in enumerate(("late behind", "late alone"), 1)
    )
    assert [one.code for one in behind.moments] == ["held_up"]
    assert "held_up" in behind.findings
    assert not alone.moments
    assert "held_up" not in alone.findings


@pytest.mark.parametrize(("kind", "laid_to"), [("hit, nothing", "ego"), ("hit, leader", "recording")])
def test_hit_from_behind_is_laid_to_the_ego_if_it_braked_for_nothing(kind: str, laid_to: str, tmp_path: Path) -> None:
    answer = asked(made_of(kind), tmp_path, 1)
    assert answer.laid_to == laid_to
    assert any(one.is_the_egos for one in answer.moments) == (laid_to == "ego")


def test_a_follower_is_no_reason_to_brake(tmp_path: Path) -> None:
    answer = asked(made_of("hit, nothing"), tmp_path, 1)
    assert [one.code for one in answer.moments] == ["braked_without_cause"]


def test_the_bench_finds_a_wrong_answer() -> None:
    assert not is_right(made_of("red"), Answer((), None, ()), is_braking=False)
