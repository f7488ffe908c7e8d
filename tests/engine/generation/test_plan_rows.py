"""The rows of a plan: what became of those beyond the ones that cover all."""

from pathlib import Path

import pytest

from plannerforge.engine.generation import PlanRow, PlanRows, RowState
from plannerforge.engine.workspace import Database


def row(number: int, lap: int) -> PlanRow:
    return PlanRow(number, lap, (0, 1), "ramp", "Neuland", "map_1", number, 0)


@pytest.fixture
def rows(tmp_path: Path) -> PlanRows:
    rows = PlanRows(Database(tmp_path / "workspace.sqlite"), "plan_1")
    rows.prepare([])
    return rows


def test_refusals_count_from_the_last_row_that_was_made_and_only_beyond_the_cover(rows: PlanRows) -> None:
    states: list[tuple[int, RowState]] = [(0, "made"), (0, "refused"), (1, "refused"), (2, "made"), (3, "refused")]
    counts = []
    for number, (lap, state) in enumerate([*states, (3, "failed"), (4, "refused")]):
        planned = row(number, lap)
        rows.add([planned])
        rows.end(planned, state)
        counts.append(rows.refused_in_a_row())
    assert counts == [0, 0, 1, 0, 1, 2, 3]
    assert rows.last_lap() == 4


def test_rows_of_other_plans_do_not_count(rows: PlanRows, tmp_path: Path) -> None:
    other = PlanRows(Database(tmp_path / "workspace.sqlite"), "plan_2")
    for number in range(3):
        for plan in (rows, other):
            plan.add([row(number, 1)])
        rows.end(row(number, 1), "refused")
        other.end(row(number, 1), "made")
    assert (rows.refused_in_a_row(), other.refused_in_a_row()) == (3, 0)


def test_a_plan_without_rows_has_no_lap(rows: PlanRows) -> None:
    assert (rows.last_lap(), rows.refused_in_a_row()) == (0, 0)
