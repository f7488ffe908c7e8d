"""The judges of ``make bench-tuning``: what they count on made cases."""

import random

from benchmarks.tuning import optimised, weight_files


def test_endings_are_counted_by_scenario_and_only_if_all_sides_ran() -> None:
    base = {"A": (False, True), "B": (True, False), "C": (True, False)}
    best = {"A": (True, False), "B": (True, False), "C": (True, False)}
    rows = optimised._rows(base, best, {"A": (False, True), "B": (True, False)})
    assert rows == {"A": (0.0, 1.0, 0.0, 1.0, 1.0, 0.0), "B": (1.0, 0.0, 1.0, 0.0, 1.0, 0.0)}


def test_the_interval_contains_the_mean_and_is_over_places() -> None:
    spread = optimised.place_interval({f"DEU_P{number}-1_1_T-1": float(number % 2) for number in range(40)}, 1)
    one_place = optimised.place_interval({f"DEU_P-{number}_1_T-1": float(number % 2) for number in range(40)}, 1)
    assert 0.3 < spread[0] < 0.5 < spread[1] < 0.7
    assert one_place == (0.5, 0.5)


def test_a_created_file_differs_from_the_expected_one_only_in_the_changed_lines() -> None:
    choice = random.Random(1)
    for _ in range(30):
        before, changes, after = weight_files._made(choice)
        lines = list(zip(before.split("\n"), after.split("\n"), strict=True))
        assert sum(old != new for old, new in lines) == len(changes)
