"""Formulas of logical scenarios: numbers, names, ``+ - * / %``, parentheses and a few functions."""

import ast
import math
import operator
from collections.abc import Callable, Mapping

from ...schemas.errors import InvalidRequest

_OPERATORS: Mapping[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: math.fmod,
}
FUNCTIONS: Mapping[str, tuple[Callable[..., float], tuple[int, ...]]] = {
    "sqrt": (math.sqrt, (1,)),
    "abs": (abs, (1,)),
    "round": (lambda value: float(math.floor(value + 0.5)), (1,)),
    "floor": (math.floor, (1,)),
    "ceil": (math.ceil, (1,)),
    "sign": (lambda value: math.copysign(1.0, value) if value else 0.0, (1,)),
    "pow": (math.pow, (2,)),
    "min": (min, (2,)),
    "max": (max, (2,)),
}
"""The functions of a formula, those of OpenSCENARIO's expressions among them, with their numbers of arguments."""
_LONGEST = 4_000
"""Characters of a formula (chosen): a longer one is not written by hand."""


def value_of(formula: str, known: Mapping[str, float], owner: str) -> float:
    """Return the value of a formula.

    Args:
        formula: its text.
        known: the values of names.
        owner: the logical scenario or file with the formula, for errors.

    Raises:
        InvalidRequest: the formula cannot be computed, or refers to an unknown name.
    """
    if len(formula) > _LONGEST:
        raise InvalidRequest(f"{owner}: a formula has {len(formula):,} characters", valid=[f"at most {_LONGEST:,}"])
    try:
        value = float(_computed(ast.parse(formula, mode="eval").body, known, owner))
    except (SyntaxError, ValueError, ArithmeticError, RecursionError, MemoryError) as error:
        raise InvalidRequest(f"{owner}: the formula '{formula}' cannot be computed: {error}") from error
    if not math.isfinite(value):
        raise InvalidRequest(f"{owner}: the formula '{formula}' has no finite value")
    return value


def names_in(formula: str) -> set[str]:
    """Return the names in a formula; empty if it is not a formula."""
    try:
        return {node.id for node in ast.walk(ast.parse(formula, mode="eval")) if isinstance(node, ast.Name)}
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return set()


def _computed(node: ast.expr, known: Mapping[str, float], owner: str) -> float:
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_computed(node.left, known, owner), _computed(node.right, known, owner))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        value = _computed(node.operand, known, owner)
        return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS:
        function, counts = FUNCTIONS[node.func.id]
        if len(node.args) in counts and not node.keywords:
            return float(function(*(_computed(one, known, owner) for one in node.args)))
    if isinstance(node, ast.Name):
        if node.id not in known:
            raise InvalidRequest(f"{owner} refers to ${node.id}, which is not a parameter", valid=list(known))
        return known[node.id]
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    raise InvalidRequest(
        f"{owner}: '{ast.unparse(node)}' is not allowed in a formula",
        valid=["numbers, parameters, + - * / % ( )", *FUNCTIONS],
    )
