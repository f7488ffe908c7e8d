"""The reduction of failures on sets and values whose needed parts are known."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plannerforge.engine.exploration.shrinking import Trials, minimal_subset, nearest_values, smallest


@given(st.integers(0, 25), st.sets(st.integers(0, 24), max_size=4))
def test_a_subset_contains_exactly_what_is_needed(count: int, needed: set[int]) -> None:
    wanted = {item for item in needed if item < count}
    found = minimal_subset(range(count), lambda items: wanted <= set(items))
    assert set(found.items) == wanted
    assert found.is_minimal


@given(st.integers(1, 12), st.data())
def test_no_single_item_of_a_minimal_subset_can_be_left_out(count: int, data: st.DataObject) -> None:
    sets = data.draw(st.lists(st.sets(st.integers(0, count - 1), min_size=1), min_size=1, max_size=3))

    def remains(items: tuple[int, ...]) -> bool:
        return any(one <= set(items) for one in sets)

    if not remains(tuple(range(count))):
        return
    items = minimal_subset(range(count), remains).items
    assert remains(items)
    assert not any(remains(tuple(other for other in items if other != one)) for one in items)


def test_a_failure_that_needs_no_one_else_takes_one_run() -> None:
    trials: Trials[tuple[int, ...]] = Trials(lambda items: True, most=20)
    assert minimal_subset(range(19), trials).items == ()
    assert trials.runs == 1


def test_a_reduction_without_runs_left_returns_the_smallest_so_far() -> None:
    trials: Trials[tuple[int, ...]] = Trials(lambda items: {2, 3} <= set(items), most=2)
    found = minimal_subset(range(8), trials)
    assert {2, 3} <= set(found.items)
    assert not found.is_minimal
    assert trials.runs == 2


def test_a_candidate_is_run_once() -> None:
    seen: list[int] = []
    trials: Trials[int] = Trials(lambda candidate: bool(seen.append(candidate)) or True, most=1)
    assert trials(1)
    assert trials(1)
    assert seen == [1]


def test_values_return_to_their_base_unless_the_failure_needs_them() -> None:
    near = nearest_values((5.0, 2.0, 9.0), (0.0, 0.0, 0.0), lambda values: values[0] >= 2.0, halvings=3)
    assert near.values == (2.5, 0.0, 0.0)
    assert near.changed == (0,)


def test_values_without_runs_left_stay_where_the_failure_is() -> None:
    trials: Trials[tuple[float, ...]] = Trials(lambda values: values[0] + values[1] >= 3.0, most=1)
    assert nearest_values((3.0, 3.0), (0.0, 0.0), trials).values == (0.0, 3.0)


@pytest.mark.parametrize(("limit", "expected"), [(100, None), (30, 60), (1, 15)])
def test_the_smallest_option_that_keeps_the_failure_is_taken(limit: int, expected: int | None) -> None:
    assert smallest([60, 30, 15], lambda option: option > limit) == expected
