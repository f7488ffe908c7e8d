"""Values of parameters give an ordinary list of edits."""

from typing import Any

import pytest

from plannerforge.engine.exploration.concrete import concrete_edits
from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.exploration import LogicalScenario, Parameter

SPEED, GAP = Parameter(name="speed_mps", low=5.0, high=20.0, unit="m/s"), Parameter(name="gap_s", low=0.5, high=2.5)


def logical(*edits: dict[str, Any], **given: Any) -> LogicalScenario:
    return LogicalScenario(name="braking", summary="", base="road", parameters=(SPEED, GAP), edits=edits, **given)


LEAD = {"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "gap_s": "$gap_s", "speed": "${speed_mps}m/s"}


def test_parameters_are_filled_in_as_numbers_and_in_texts() -> None:
    edit = concrete_edits(logical(LEAD), {"speed_mps": 12.34567, "gap_s": 1.5})[0]
    assert (edit.gap_s, edit.speed, edit.at) == (1.5, "12.3457m/s", "ego")


def test_a_missing_parameter_has_its_base_value() -> None:
    assert concrete_edits(logical(LEAD), {})[0].speed == "12.5m/s"


def test_derived_values_follow_from_formulas() -> None:
    edits = concrete_edits(
        logical({**LEAD, "gap_s": "$far"}, derived={"double": "2 * gap_s", "far": "double - (gap_s - 1) / 2"}),
        {"gap_s": 2.0},
    )
    assert edits[0].gap_s == pytest.approx(3.5)


def test_formulas_have_the_functions_of_openscenario() -> None:
    found = concrete_edits(
        logical(
            {**LEAD, "gap_s": "$x"},
            derived={"x": "max(sqrt(pow(3, 2)), abs(0 - 2)) + 7 % 4 + sign(0 - 5) + round(2.5)"},
        ),
        {},
    )
    assert found[0].gap_s == 3 + 3 - 1 + 3


@pytest.mark.parametrize(
    "formula",
    [
        "sqrt(0 - 1)",
        "sqrt()",
        "pow(1, 2, 3)",
        "eval('1')",
        "pow(9, 999)",
        "(" * 300 + "1" + ")" * 300,
        "1+" * 1500 + "1",
    ],
)
def test_a_formula_that_cannot_be_computed_is_refused(formula: str) -> None:
    with pytest.raises(InvalidRequest):
        concrete_edits(logical({**LEAD, "gap_s": "$x"}, derived={"x": formula}), {})


@pytest.mark.parametrize("formula", ["__import__('os')", "gap_s ** 2", "unknown + 1", "1 / 0", "gap_s +"])
def test_a_formula_with_anything_else_is_refused(formula: str) -> None:
    with pytest.raises(InvalidRequest):
        concrete_edits(logical({**LEAD, "gap_s": "$x"}, derived={"x": formula}), {})


def test_an_unknown_parameter_is_refused_with_the_valid_ones() -> None:
    with pytest.raises(InvalidRequest) as refusal:
        concrete_edits(logical(LEAD), {"speed": 5.0})
    assert list(refusal.value.valid) == ["speed_mps", "gap_s"]


@pytest.mark.parametrize("edit", [{**LEAD, "gap_s": "$gap"}, {**LEAD, "wheels": 4}, {**LEAD, "offset_m": "far"}])
def test_a_template_that_does_not_fit_is_refused(edit: dict[str, Any]) -> None:
    with pytest.raises(InvalidRequest, match="braking"):
        concrete_edits(logical(edit), {})
