"""Arguments that do not belong to an operation are refused, and all edits or none are carried out."""

from typing import get_args

import pytest
from support.edits import Apply

from plannerforge.engine.edits.apply import OPERATIONS
from plannerforge.engine.edits.world import TRANSFORMS
from plannerforge.schemas.errors import InvalidRequest, NotPossible
from plannerforge.schemas.modification import EDITS, Edit, EditOperation


def test_every_operation_of_the_schema_is_carried_out_by_a_function() -> None:
    assert {*OPERATIONS, *TRANSFORMS} == set(get_args(EditOperation)) == set(EDITS)
    assert OPERATIONS.keys().isdisjoint(TRANSFORMS)
    names = {function.__name__ for function in OPERATIONS.values()}
    assert names == (OPERATIONS.keys() - {"replace"}) | {"replace_vehicle"}


def test_every_argument_is_used_by_some_operation() -> None:
    belonging = {name for kind in EDITS.values() for name in kind.arguments}
    assert belonging == set(Edit.model_fields) - {"op"}


@pytest.mark.parametrize(
    ("edit", "foreign"),
    [
        ({"op": "reroute", "vehicles": ["31"], "to": ["2"], "preset": "eco"}, "preset"),
        ({"op": "set_goal", "to": ["11"], "vehicles": ["31"]}, "vehicles"),
        ({"op": "remove_vehicle", "vehicles": ["31"], "speed": "5m/s"}, "speed"),
        ({"op": "add_vehicle", "vehicle_class": "car", "at": "3", "turn": "left"}, "turn"),
    ],
)
def test_an_argument_of_another_operation_is_refused_with_the_valid_ones(
    apply: Apply, edit: dict[str, object], foreign: str
) -> None:
    with pytest.raises(InvalidRequest, match=f"{foreign} is not an argument of op {edit['op']}") as caught:
        apply(edit)
    assert set(caught.value.valid) == set(EDITS[edit["op"]].arguments)  # type: ignore[index]


def test_one_refused_edit_refuses_all(apply: Apply) -> None:
    with pytest.raises(NotPossible, match=r"edit 1 \(set_goal\): lanelet 3"):
        apply({"op": "remove_vehicle", "vehicles": ["31"]}, {"op": "set_goal", "to": ["3"]})


@pytest.mark.parametrize(
    ("edit", "moved"),
    [
        ({"op": "close_lane", "at": "11"}, {"to": ["11"], "at": None}),
        ({"op": "close_lane", "at": "vehicle:31"}, {"to": ["lanelet_of:31"], "at": None}),
        ({"op": "stop_at", "vehicles": ["31"], "to": ["1"]}, {"at": "1", "to": None}),
    ],
)
def test_a_lanelet_in_the_argument_of_another_operation_is_proposed_for_the_right_one(
    apply: Apply, edit: dict[str, object], moved: dict[str, object]
) -> None:
    with pytest.raises(InvalidRequest) as caught:
        apply(edit)
    assert caught.value.remedies[0].changes[0].values == moved
