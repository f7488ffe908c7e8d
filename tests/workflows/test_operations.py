"""Entry points and names that are strings lead to what they say, with the types that stand beside them."""

import inspect
from typing import Any, get_type_hints

import pytest

from plannerforge.engine.execution import Operation, ProgressReporter
from plannerforge.schemas.base import Arguments, Result
from plannerforge.tools.call import ImageAnswer, ToolCall
from plannerforge.tools.registry import TOOLS, ToolSpec
from plannerforge.workflows import operations

OPERATIONS: dict[str, Operation[Any, Any]] = {
    name: value for name, value in vars(operations).items() if isinstance(value, Operation)
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_operation_has_the_types_that_are_declared(name: str) -> None:
    operation = OPERATIONS[name]
    function: Any = operation.load()
    hints = get_type_hints(function)
    assert list(inspect.signature(function).parameters) == ["request", "report"]
    assert hints == {"request": operation.request_type, "report": ProgressReporter, "return": operation.response_type}
    assert function.__name__ == operation.name


def test_every_function_has_one_operation() -> None:
    assert len({operation.entry_point for operation in OPERATIONS.values()}) == len(OPERATIONS) >= 16


@pytest.mark.parametrize("spec", TOOLS, ids=lambda spec: spec.name)
def test_a_tool_declares_its_input_and_output(spec: ToolSpec) -> None:
    hints = get_type_hints(spec.load_function())
    assert set(hints) == {"arguments", "call", "return"}
    assert issubclass(hints["arguments"], Arguments)
    assert hints["call"] is ToolCall
    assert issubclass(hints["return"], Result | ImageAnswer)
