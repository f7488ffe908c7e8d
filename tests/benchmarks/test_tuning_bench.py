"""The judges of ``make bench-tuning``: what they count on made cases."""

import random

from benchmarks.tuning import optimised, random_search, safety, weight_files
from plannerforge.schemas.runs import RunSteps


def test_ends_are_counted_by_scenario_and_only_where_all_sides_ran() -> None:
    base = {"A": (False, True), "B": (True, False), "C": (True, False)}
    best = {"A": (True, False), "B": (True, False), "C": (True, False)}
    rows = optimised._rows(base, best, {"A": (False, True), "B": (True, False)})
    assert rows == {"A": (0.0, 1.0, 0.0, 1.0, 1.0, 0.0), "B": (1.0, 0.0, 1.0, 0.0, 1.0, 0.0)}


def test_the_interval_holds_the_mean_and_is_that_of_places() -> None:
    spread = optimised.place_interval({f"DEU_P{number}-1_1_T-1": float(number % 2) for number in range(40)}, 1)
    one_place = optimised.place_interval({f"DEU_P-{number}_1_T-1": float(number % 2) for number in range(40)}, 1)
    assert 0.3 < spread[0] < 0.5 < spread[1] < 0.7
    assert one_place == (0.5, 0.5)


def test_a_made_file_differs_from_what_must_come_out_in_the_changed_lines_only() -> None:
    choice = random.Random(1)
    for _ in range(30):
        before, changes, after = weight_files._made(choice)
        lines = list(zip(before.split("\n"), after.split("\n"), strict=True))
        assert sum(old != new for old, new in lines) == len(changes)


def test_random_weights_are_off_or_within_their_range() -> None:
    choice = random.Random(1)
    anywhere = [random_search.drawn_anywhere(choice) for _ in range(400)]
    near = [random_search.drawn_near(0.2, choice) for _ in range(400)]
    assert 60 < anywhere.count(0.0) < 140
    assert all(value == 0 or 0.01 <= value <= 100 for value in anywhere)
    assert 15 < near.count(0.0) < 75
    assert all(value == 0 or 0.02 <= value <= 2 for value in near)


def test_a_bounded_search_finds_the_best_of_running_everything() -> None:
    for seed in range(40):
        choice = random.Random(seed)
        names = [f"DEU_P{number // 2}-{number}_1_T-1" for number in range(40)]
        failed, solved = names[:12], names[12:]
        mended = {f"cfg_{n}": frozenset(choice.sample(failed, choice.randrange(6))) for n in range(60)}
        lost = {config: frozenset(choice.sample(solved, choice.randrange(8))) for config in mended}
        halves = [half for number in range(3) for half in random_search.split(names, number)]
        chosen_on = [frozenset(names), *(half.training for half in halves)]
        search = random_search.Search(solved, mended, chosen_on)
        while to_run := search.to_run():
            search.lost |= {config: lost[config] for config in to_run}
        assert len(search.lost) < len(mended)
        for among in chosen_on:
            gains = {config: len(mended[config] & among) - len(lost[config] & among) for config in mended}
            best = search.best(among)
            assert max(0, *gains.values()) == (0 if best is None else gains[best])


def test_halves_share_no_place_and_are_chosen_on_in_turn() -> None:
    names = [f"DEU_P{number // 3}-{number}_1_T-1" for number in range(60)]
    first, second = random_search.split(names, 5)
    assert first.training == second.held_out
    assert first.held_out == second.training
    assert first.training | first.held_out == set(names)
    assert not {road.split("-")[0] for road in first.training} & {road.split("-")[0] for road in first.held_out}


def test_courses_are_compared_while_both_drive() -> None:
    short = RunSteps.model_construct(x_m=(0.0, 1.0), y_m=(0.0, 0.0))
    long = RunSteps.model_construct(x_m=(0.0, 1.0, 50.0), y_m=(0.0, 0.3, 0.0))
    assert safety._apart_m(short, long) == 0.3
