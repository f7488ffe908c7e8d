"""The search on functions with planted regions of failures; it knows them only by their scores."""

import math
from collections.abc import Callable

import pytest

from plannerforge.engine.exploration import FailureSearch, Point, Score, Stratum

STRATA = [Stratum("walker", 4), Stratum("cyclist", 3), Stratum("lead", 3), Stratum("merge", 5), Stratum("oncoming", 4)]
Judge = Callable[[Point], Score]


def margin(point: Point, center: float, radius: float) -> float:
    return math.dist(point.values, [center] * len(point.values)) - radius


def rare(point: Point) -> Score:
    """One stratum fails in .2 % of its volume; the others come near, and never fail."""
    if point.stratum != "merge":
        return Score(0.05 + min(abs(margin(point, 0.4, 0.2)), 1.0) / 2)
    away = margin(point, 0.7, 0.2)
    return Score(min(away, 1.0)) if away > 0 else Score(-1.0, "merge|front")


def bands(point: Point) -> Score:
    """A third of each stratum fails, in six cells per stratum; a corner is implausible."""
    if sum(point.values) < 0.3:
        return Score(None)
    if point.values[0] > 1 / 3:
        return Score(point.values[0] - 1 / 3)
    return Score(-1.0, f"{point.stratum}|{int(point.values[1] * 3)}|{int(point.values[2] * 2)}")


def overlooked(point: Point) -> Score:
    """A planner that overlooks one kind of road user: where it has to react, no score leads to its failures."""
    reacts = point.values[0] < 0.3
    if point.way == "demand" and not reacts:
        return Score(None, demand=0.0)
    if point.stratum == "merge" and reacts and abs(point.values[1] - 0.5) < 0.1:
        return Score(-1.0, "merge|front", 1.0)
    return Score(0.4, demand=1.0 if reacts else 0.0)


def searched(judge: Judge, runs: int, seed: int, batch: int = 4) -> tuple[FailureSearch, list[Point], list[Score]]:
    search, points, scores = FailureSearch(STRATA, seed, batch), list[Point](), list[Score]()
    while search.runs < runs:
        asked = search.ask()
        search.tell([judge(point) for point in asked])
        points += asked
        scores += [judge(point) for point in asked]
    return search, points, scores


def test_the_same_seed_proposes_the_same_points_and_another_seed_others() -> None:
    _, first, _ = searched(bands, 40, seed=1)
    _, again, _ = searched(bands, 40, seed=1)
    _, other, _ = searched(bands, 40, seed=2)
    assert first == again
    assert first != other


def test_an_interrupted_search_continues_as_if_it_had_not_been_interrupted() -> None:
    _, points, scores = searched(bands, 60, seed=3)
    for stop in (0, 4, 28, 30):
        resumed = FailureSearch(STRATA, 3).resumed(scores[:stop])
        whole = stop - stop % 4
        assert resumed.evaluated == whole
        assert resumed.ask() == points[whole : whole + 4]


def test_every_stratum_is_examined_before_any_is_examined_closely() -> None:
    _, points, _ = searched(rare, 15, seed=0)
    assert {point.stratum for point in points[:15]} == {stratum.name for stratum in STRATA}
    assert all(point.way == "start" for point in points[:15])


def test_points_lie_in_the_unit_cube_of_their_stratum() -> None:
    _, points, _ = searched(bands, 80, seed=5)
    dimensions = {stratum.name: stratum.dimensions for stratum in STRATA}
    for point in points:
        assert len(point.values) == dimensions[point.stratum]
        assert all(0.0 <= value <= 1.0 for value in point.values)


def test_implausible_points_cost_no_runs() -> None:
    search, points, scores = searched(bands, 60, seed=4)
    assert search.runs == sum(score.value is not None for score in scores)
    assert search.evaluated == len(points)


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_a_rare_failure_is_found_where_chance_would_need_thousands_of_runs(seed: int) -> None:
    search, _, _ = searched(rare, 150, seed)
    assert "merge|front" in search.archive.cells


@pytest.mark.parametrize("seed", range(4))
def test_points_at_which_the_planner_has_to_react_are_covered_although_no_score_leads_to_a_failure(seed: int) -> None:
    search, points, scores = searched(overlooked, 200, seed)
    assert list(search.archive.cells) == ["merge|front"]
    ran = [score.demand for point, score in zip(points, scores, strict=True) if point.way == "demand" and score.value]
    assert len(ran) > 30
    assert set(ran) == {1.0}


def test_points_at_which_the_planner_need_not_react_cost_no_runs_and_are_not_implausible() -> None:
    search, points, scores = searched(overlooked, 100, seed=5)
    idle = sum(score.value is None for score in scores)
    assert idle
    assert search.evaluated - search.runs == idle
    assert all(point.way == "demand" for point, score in zip(points, scores, strict=True) if score.value is None)


def test_a_cell_with_enough_hits_is_left_for_others() -> None:
    search, _, _ = searched(bands, 150, seed=6)
    assert len(search.archive) >= 25  # of 30
    assert search.archive.is_exhausted(next(iter(search.archive.cells)))


def test_a_space_in_which_nothing_is_plausible_ends_no_search_with_an_error() -> None:
    search = FailureSearch(STRATA[:2], seed=0)
    for _ in range(10):
        search.tell([Score(None) for _ in search.ask()])
    assert search.runs == 0
    assert len(search.archive) == 0


def test_scores_of_one_batch_are_due_before_the_next() -> None:
    search = FailureSearch(STRATA, seed=0)
    search.ask()
    with pytest.raises(RuntimeError, match="have not been told"):
        search.ask()
    with pytest.raises(RuntimeError, match="4 scores"):
        search.tell([Score(0.1)])
