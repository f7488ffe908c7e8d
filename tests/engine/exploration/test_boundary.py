"""The search for edges spends its points at the edges and says how sure it is of an area."""

from collections.abc import Callable

import pytest

from plannerforge.engine.exploration.boundary import SIZE, BoundarySearch, Place, area_of, label_at


def _disc(x: float, y: float) -> str:
    return "in" if (x - 0.55) ** 2 + (y - 0.45) ** 2 < 0.3**2 else "out"


def _slope(x: float, y: float) -> str:
    return "in" if y > 0.2 + 0.5 * x * x else "out"


def _three(x: float, y: float) -> str:
    return "never" if x + y < 0.3 else _slope(x, y)


FUNCTIONS: dict[str, Callable[[float, float], str]] = {"disc": _disc, "slope": _slope, "three": _three}


def searched(function: Callable[[float, float], str], budget: int, seed: int = 0) -> BoundarySearch:
    search = BoundarySearch(budget, seed=seed)
    while places := search.ask():
        search.tell({place: function(place[0] / SIZE, place[1] / SIZE) for place in places})
    return search


def error_of(answer: Callable[[float, float], str | None], function: Callable[[float, float], str]) -> float:
    """Return the share of a fine grid, off the lattice, on which an answer is wrong."""
    at = [(index + 0.37) / 80 for index in range(80)]
    return sum(answer(x, y) != function(x, y) for x in at for y in at) / len(at) ** 2


def grid_answer(side: int, function: Callable[[float, float], str]) -> Callable[[float, float], str]:
    """Return what a grid of side × side points says: the label of the nearest one."""

    def answer(x: float, y: float) -> str:
        return function(round(x * (side - 1)) / (side - 1), round(y * (side - 1)) / (side - 1))

    return answer


@pytest.mark.parametrize("name", FUNCTIONS)
def test_it_needs_at_most_two_fifths_of_a_grids_points_at_equal_error(name: str) -> None:
    function = FUNCTIONS[name]
    search = searched(function, 150)
    error = error_of(lambda x, y: label_at(x, y, search), function)
    needed = next(side for side in range(4, 80) if error_of(grid_answer(side, function), function) <= error)
    assert len(search.labels) <= 0.4 * needed**2


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_bounds_contain_the_area(name: str) -> None:
    function = FUNCTIONS[name]
    at = [(index + 0.5) / 200 for index in range(200)]
    true = sum(function(x, y) == "in" for x in at for y in at) / 200**2
    area = area_of("in", searched(function, 150))
    assert area.low <= true <= area.high
    assert area.share == pytest.approx(true, abs=0.03)
    assert area.high - area.low < 0.3


def _one(x: float, y: float) -> str:
    return "out"


@pytest.mark.parametrize("function", [*FUNCTIONS.values(), _one])
@pytest.mark.parametrize("budget", [30, 40, 150])
def test_shares_add_up_and_bounds_of_one_map_do_not_contradict_one_another(
    function: Callable[[float, float], str], budget: int
) -> None:
    search = searched(function, budget)
    areas = {label: area_of(label, search) for label in ("in", "out", "never")}
    assert sum(area.share for area in areas.values()) == pytest.approx(1.0)
    for label, area in areas.items():
        assert area.low <= area.share <= area.high
        assert area.high <= 1.0 - sum(other.low for name, other in areas.items() if name != label) + 1e-9


def test_uniform_cells_are_certain_only_as_far_as_they_were_checked() -> None:
    search = searched(_one, 40)
    checked, odd = search.checks
    assert (checked, odd) == (4, 0)
    assert area_of("out", search).low == pytest.approx(1.0 - area_of("never", search).high)


def test_the_budget_is_kept_and_mostly_used() -> None:
    assert 120 <= len(searched(_disc, 150).labels) <= 150
    assert len(searched(_disc, 10).labels) <= 10


def test_a_single_class_ends_early() -> None:
    search = searched(lambda x, y: "out", 150)
    assert len(search.labels) < 50
    area = area_of("in", search)
    assert (area.share, area.low) == (0.0, 0.0)
    assert 0.0 < area.high < 0.5


def test_an_island_between_the_corners_is_found_by_a_check() -> None:
    def island(x: float, y: float) -> str:
        return "in" if abs(x - 0.375) < 0.1 and abs(y - 0.625) < 0.1 else "out"

    found = [area_of("in", searched(island, 150, seed)).share > 0.0 for seed in range(10)]
    assert sum(found) >= 5


def test_edges_that_matter_are_refined_first() -> None:
    def two(x: float, y: float) -> str:
        return "a" if x < 0.3 else "b" if x < 0.7 else "c"

    search = BoundarySearch(60, {("a", "b"): 0, ("b", "c"): 2})
    while places := search.ask():
        search.tell({place: two(place[0] / SIZE, place[1] / SIZE) for place in places})

    def points(low: float, high: float) -> int:
        return sum(low <= place[0] / SIZE < high for place in search.labels)

    assert points(0.26, 0.37) > 2 * points(0.63, 0.74)


def test_an_interrupted_search_continues_with_the_labels_that_it_has() -> None:
    whole = searched(_disc, 120)
    asked: list[Place] = []
    again = BoundarySearch(120)
    while places := again.ask():
        asked += [place for place in places if place not in whole.labels]
        again.tell({place: whole.labels[place] for place in places})
    assert asked == []
    assert again.cells == whole.cells


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_bounds_of_a_weighted_area_contain_it(name: str) -> None:
    function = FUNCTIONS[name]
    at = [(index + 0.5) / 200 for index in range(200)]
    true = sum(4 * x * y * (function(x, y) == "in") for x in at for y in at) / 200**2
    area = area_of(
        "in", searched(function, 150), (lambda place: (place / SIZE) ** 2, lambda place: (place / SIZE) ** 2)
    )
    assert area.low <= true <= area.high
    assert area.share == pytest.approx(true, abs=0.02)
    assert area.high - area.low < 0.35


def test_equal_frequencies_weigh_like_the_area() -> None:
    search = searched(_three, 100)
    weighted = area_of("in", search, (lambda place: place / SIZE, lambda place: place / SIZE))
    assert weighted.share == pytest.approx(area_of("in", search).share)
    assert weighted.low <= area_of("in", search).low
