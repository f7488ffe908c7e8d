"""Which rows a coverage plan makes next: never what is there, never what cannot be, alone what was refused."""

from collections import Counter
from collections.abc import Callable
from itertools import combinations

import pytest

from plannerforge.engine.execution import silent
from plannerforge.engine.generation import TRIES, combinations_in, plan_coverage
from plannerforge.schemas.generation import Combination, CoverageReport, CoverageRequest, PlanFactor

FACTORS = tuple(
    PlanFactor(name=name, levels=tuple(levels.split()))
    for name, levels in (
        ("type", "ring ramp road town"),
        ("density", "low high"),
        ("class", "car bus bike"),
        ("turn", "l r s"),
    )
)
PAIRS = 4 * 2 + 4 * 3 + 4 * 3 + 2 * 3 + 2 * 3 + 3 * 3


def asked(**changes: object) -> CoverageReport:
    request = CoverageRequest(factors=FACTORS, strength=2, most=1000)
    return plan_coverage(request.model_copy(update=changes), silent)


def key(**levels: str) -> Combination:
    found = [(index, factor) for index, factor in enumerate(FACTORS) if factor.name in levels]
    return tuple((index, factor.levels.index(levels[factor.name])) for index, factor in found)


def pairs_of(rows: tuple[tuple[int, ...], ...]) -> set[Combination]:
    """All pairs in some rows, counted apart from the product."""
    return {((one, row[one]), (two, row[two])) for row in rows for one, two in combinations(range(4), 2)}


def carried_out(can_be: Callable[[dict[str, str]], bool]) -> tuple[CoverageReport, int, int]:
    """A plan in a world where only some rows can be made: its end, how many rows were made and were refused."""
    covered: set[Combination] = set()
    refused: Counter[Combination] = Counter()
    made = lost = 0
    while (report := asked(covered=tuple(sorted(covered)), refused=tuple(sorted(refused.items())))).left:
        for row in report.rows:
            if can_be({factor.name: factor.levels[level] for factor, level in zip(FACTORS, row, strict=True)}):
                covered.update(combinations_in(row, 2))
                made += 1
            else:
                refused.update(combinations_in(row, 2))
                lost += 1
    return report, made, lost


def test_an_array_has_all_pairs_in_few_rows_and_is_deterministic() -> None:
    report = asked()
    assert pairs_of(report.rows) == set(report.left)
    assert (report.allowed, report.covered, len(report.left)) == (PAIRS, 0, PAIRS)
    assert 4 * 3 <= len(report.rows) <= 20
    assert asked() == report


def test_covered_combinations_are_not_repeated() -> None:
    first = asked().rows
    there = first[: len(first) - 3]
    report = asked(covered=tuple(sorted(pairs_of(there))))
    assert len(report.rows) <= 3
    assert pairs_of((*there, *report.rows)) == pairs_of(first)


def test_no_row_has_a_combination_that_the_maps_lack() -> None:
    no_bikes = key(**{"type": "ramp", "class": "bike"})
    report = asked(barred=(no_bikes, key(turn="s")))
    assert not any(set(no_bikes) <= set(enumerate(row)) or row[3] == 2 for row in report.rows)
    assert report.allowed == PAIRS - 1 - (4 + 2 + 3)
    assert pairs_of(report.rows) == set(report.left)


def test_impossible_combinations_are_found_without_further_cost() -> None:
    def can_be(row: dict[str, str]) -> bool:
        return not (row["type"] == "ramp" and row["class"] == "bike") and not (
            row["turn"] == "l" and row["type"] != "town"
        )

    report, made, lost = carried_out(can_be)
    assert set(report.cannot) == {key(**{"type": "ramp", "class": "bike"})} | {
        key(type=name, turn="l") for name in ("ring", "ramp", "road")
    }
    assert report.covered == report.allowed == PAIRS - 4
    assert lost <= TRIES * (4 + 4 + 3)
    assert made < 40


def test_combinations_that_imply_an_impossible_one_are_reported_too() -> None:
    report, _, _ = carried_out(lambda row: row["class"] != "bike" or row["type"] == "ring")
    missing = {key(**{"type": name, "class": "bike"}) for name in ("ramp", "road", "town")}
    assert set(report.cannot) == missing
    lonely = asked(barred=tuple(missing), refused=((key(**{"type": "ring", "class": "bike"}), TRIES),))
    assert {part for pair in lonely.cannot for part in pair} >= {(2, 2)}
    assert all((2, 2) in pair for pair in lonely.cannot)
    assert len(lonely.cannot) == 1 + 2 + 3


def test_after_full_coverage_every_lap_has_the_requested_number_of_new_rows() -> None:
    everything = tuple(sorted(pairs_of(asked().rows)))
    one, two = (asked(covered=everything, lap=lap, most=20).rows for lap in (1, 2))
    assert pairs_of(one) == pairs_of(two) == set(everything)
    assert set(one) != set(two)
    assert len(asked(covered=everything, lap=1, most=200).rows) == 200
    assert asked(covered=everything, most=0).rows == ()


@pytest.mark.parametrize("strength", [1, 3])
def test_other_strengths_join_as_many_factors(strength: int) -> None:
    report = asked(strength=strength)
    held = {one for row in report.rows for one in combinations_in(row, strength)}
    assert held == set(report.left)
    assert all(len(one) == strength for one in held)
