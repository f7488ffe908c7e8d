"""The bench takes a file for valid only where its schema errors are the source's, or no way of writing avoids them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from support.builders import town_road
from support.modification_bench import TRUTHS, asked, carried_out, later_by, respelt, told

from benchmarks.modification.__main__ import figures_of, rows_of
from benchmarks.modification.cases import Case, Measured
from benchmarks.modification.written import Written, enter_later_on_request, is_strictly_valid, is_valid

ADDED = 101


@pytest.fixture(scope="module")
def later(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """A truck that was asked to enter at 1 s."""
    return carried_out(town_road().cut(100).write(tmp_path_factory.mktemp("later") / "base.xml"), TRUTHS["P"])


def test_a_vehicle_requested_to_enter_later_is_not_a_fault_of_the_file(later: Written) -> None:
    assert is_valid(later)
    assert not is_strictly_valid(later)
    assert enter_later_on_request(later) == {ADDED}


WRONG: dict[str, Callable[[Written], Written]] = {
    "a recorded one enters later": lambda one: later_by(one, 31, 10),
    "nobody asked for a departure": lambda one: asked(one, depart_s=0.0),
    "it was to enter later still": lambda one: asked(one, depart_s=2.0),
    "the report names somebody else": lambda one: told(one, vehicles=(31,)),
    "more enter than were asked": lambda one: asked(one, count=0),
    "its states are wrong besides": lambda one: respelt(
        one, f"dynamicObstacle[@id='{ADDED}']/trajectory/state/velocity/exact", "1e1"
    ),
    "somebody else's states are wrong": lambda one: respelt(
        one, "dynamicObstacle[@id='31']/trajectory/state/velocity/exact", "1e1"
    ),
}


@pytest.mark.parametrize("fault", WRONG)
def test_every_other_error_stays_one(later: Written, fault: str) -> None:
    assert not is_valid(WRONG[fault](later))


def test_a_file_as_valid_as_its_source_is_valid_by_both_rules(tmp_path: Path) -> None:
    made = carried_out(town_road().cut(100).write(tmp_path / "base.xml"), TRUTHS["G"])
    spoiled = tmp_path / "spoiled.xml"
    spoiled.write_text(made.xml.read_text(encoding="utf-8").replace("<type>car</type>", "<type>cow</type>", 1))
    assert is_valid(made)
    assert is_strictly_valid(made)
    assert not is_valid(replace(made, loaded=replace(made.loaded, path=spoiled)))


def test_the_figures_count_late_entries_and_give_the_share_without_them() -> None:
    measured = [
        Measured((Case("P", "one", valid=True, strictly_valid=True), Case("P", "two", valid=True, enter_later=1)))
    ]
    figures, rows = figures_of(measured), dict(rows_of(measured))
    assert (figures["valid_min"], figures["valid_strict_min"]) == (1.0, 0.5)
    assert rows["enter later, as requested"].startswith("1 files")
