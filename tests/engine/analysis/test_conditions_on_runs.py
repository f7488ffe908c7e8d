"""Conditions on runs: a field without a value, a value without a field, and an unknown field each get a way out."""

import pytest
from support.runs import record, source

from plannerforge.engine.analysis.filters import matching
from plannerforge.engine.analysis.run_set import RunSet
from plannerforge.schemas.errors import InvalidRequest, UnknownName

RUNS = RunSet((source(record(outcome="goal_reached")), source(record("ZAM_B-1_1_T-1", "collision"))))


@pytest.mark.parametrize(
    ("text", "valid"),
    [
        ("collision", ("outcome=collision",)),
        ("outcome", ("outcome=collision", "outcome=goal_reached")),
        ("outcome>3", ("outcome=collision", "outcome=goal_reached")),
    ],
)
def test_valid_conditions_are_whole_and_can_be_met(text: str, valid: tuple[str, ...]) -> None:
    with pytest.raises(InvalidRequest) as refusal:
        matching(RUNS, [text])
    assert refusal.value.valid == valid
    assert all(matching(RUNS, [condition]).records for condition in refusal.value.valid)
    assert [word for remedy in refusal.value.remedies for word in remedy.changes[0].words.values()] == [valid[0]]


@pytest.mark.parametrize(("text", "first"), [("colour=red", "outcome"), ("scenaro=ZAM_B-1_1_T-1", "scenario")])
def test_an_unknown_field_is_refused_with_all_fields(text: str, first: str) -> None:
    with pytest.raises(UnknownName) as refusal:
        matching(RUNS, [text])
    assert refusal.value.valid[0] == first
    assert {"outcome", "config", "seed"} < {*refusal.value.valid}
    assert refusal.value.complete
