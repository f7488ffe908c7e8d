"""The rows of a plan: what became of those beyond the ones that cover all."""

from dataclasses import replace
from pathlib import Path

import pytest

from plannerforge.engine.generation import PlanCounts, PlanRow, PlanRows, RowState
from plannerforge.engine.workspace import Database


def row(number: int, lap: int) -> PlanRow:
    return PlanRow(number, lap, (0, 1), "ramp", "Neuland", "map_1", number, 0)


@pytest.fixture
def rows(tmp_path: Path) -> PlanRows:
    rows = PlanRows(Database(tmp_path / "workspace.sqlite"), "plan_1")
    rows.prepare([])
    return rows


def test_refusals_count_from_the_last_generated_row_and_only_beyond_the_cover(rows: PlanRows) -> None:
    states: list[tuple[int, RowState]] = [(0, "made"), (0, "refused"), (1, "refused"), (2, "made"), (3, "refused")]
    counts = []
    for number, (lap, state) in enumerate([*states, (3, "failed"), (4, "refused")]):
        planned = row(number, lap)
        rows.add([planned])
        rows.end(planned, state)
        counts.append(rows.refused_in_a_row())
    assert counts == [0, 0, 1, 0, 1, 2, 3]
    assert rows.last_lap() == 4


def test_levels_are_hopeless_if_all_rows_with_them_were_refused(rows: PlanRows) -> None:
    tried: list[tuple[str, tuple[int, int], RowState]] = [
        *[("map_1", (0, 1), "refused")] * 3,
        ("map_1", (0, 0), "made"),
        *[("map_2", (0, 1), "refused")] * 2,
        *[("map_3", (1, 1), "refused")] * 3,
        ("map_3", (0, 1), "made"),
        *[("map_4", (1, 1), "failed")] * 3,
    ]
    for number, (map_id, levels, state) in enumerate(tried):
        planned = replace(row(number, 0), map_id=map_id, levels=levels)
        rows.add([planned])
        rows.end(planned, state)
    assert rows.hopeless(3) == {("ramp", "map_1", 1, 1), ("ramp", "map_3", 0, 1)}


def test_a_skipped_row_takes_its_turn_without_other_effects(rows: PlanRows) -> None:
    rows.add([replace(row(0, 1), state="passed"), row(1, 1)])
    assert (rows.turns(), rows.next_number(), rows.last_lap()) == ({"ramp": 2}, 2, 1)
    assert [planned.number for planned in rows.waiting(5)] == [1]
    assert rows.counts() == PlanCounts(waiting=1)
    assert not list(rows.refused())


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
