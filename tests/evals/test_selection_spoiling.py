"""Spoiled slots, and the score that says how spoiled they are."""

import pytest

from plannerforge.evals.ground_truth.selection import extract_score, spoiled
from plannerforge.schemas.catalog import FindScenariosArguments

ASKED = FindScenariosArguments(country="DEU", tags=["urban"], road_net=["lanes>=2"], ego_speed="13m/s")


def test_the_same_seed_spoils_in_the_same_way() -> None:
    assert spoiled(ASKED, "one/0") == spoiled(ASKED, "one/0")
    assert len({spoiled(ASKED, f"one/{seed}").model_dump_json() for seed in range(20)}) > 10


@pytest.mark.parametrize("seed", range(20))
def test_spoiling_adds_tags_and_keeps_places_and_counts(seed: int) -> None:
    given = spoiled(ASKED, str(seed))
    assert 2 <= len(set(given.tags)) <= 3
    assert "urban" in given.tags
    assert (given.country, given.city, given.obstacles) == ("DEU", None, [])
    assert set(ASKED.road_net) <= set(given.road_net)
    assert extract_score(ASKED, given) < 1.0


def test_extract_is_the_mean_over_five_slots() -> None:
    assert extract_score(ASKED, ASKED) == 1.0
    assert extract_score(ASKED, ASKED.model_copy(update={"tags": ["urban", "critical"]})) == pytest.approx(0.9)
    assert extract_score(ASKED, ASKED.model_copy(update={"ego_speed": None})) == pytest.approx(0.8)
