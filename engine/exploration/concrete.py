"""Concrete scenarios: values of a logical scenario's parameters give a list of ordinary edits."""

import re
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import ValidationError

from ...schemas.errors import InvalidRequest
from ...schemas.exploration import Curve, LogicalScenario
from ...schemas.modification import Edit
from .formulas import value_of

DECIMALS = 4
"""Values are rounded to this many decimals, below what any actor's motion shows, so that they are short in edits."""
Known = TypeVar("Known", bound=float | str)
_REFERENCE = re.compile(r"\$(?:\{(\w+)\}|(\w+))")


def concrete_edits(logical: LogicalScenario, values: Mapping[str, float]) -> tuple[Edit, ...]:
    """Return the edits of a logical scenario for values of its parameters; a missing parameter gets its base value.

    Raises:
        InvalidRequest: there is no such parameter, or a template does not give a valid edit.
    """
    unknown = sorted(values.keys() - {one.name for one in logical.parameters})
    if unknown:
        raise InvalidRequest(
            f"{logical.name} has no parameter {', '.join(unknown)}", valid=[one.name for one in logical.parameters]
        )
    known = {one.name: round(values.get(one.name, one.base_value), DECIMALS) for one in logical.parameters}
    texts: dict[str, str] = {}
    for name, rule in logical.derived.items():
        found = (
            rule.value(_known(rule.of, known, logical))
            if isinstance(rule, Curve)
            else value_of(rule, known, logical.name)
        )
        if isinstance(found, str):
            texts[name] = found
        else:
            known[name] = round(found, DECIMALS)
    words: dict[str, float | str] = {**known, **texts}
    edits = []
    for number, template in enumerate(logical.edits):
        filled = {name: _filled(value, words, logical) for name, value in template.items()}
        try:
            edits.append(Edit.model_validate(filled))
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise InvalidRequest(
                f"edit {number} of {logical.name} does not fit: {where}: {first['msg']}",
                next_step="correct the template or the parameter's range",
            ) from error
    return tuple(edits)


def _filled(value: Any, known: Mapping[str, float | str], logical: LogicalScenario) -> Any:
    if isinstance(value, list | tuple):
        return [_filled(one, known, logical) for one in value]
    if not isinstance(value, str):
        return value
    whole = _REFERENCE.fullmatch(value)
    if whole is not None:
        return _known(whole[1] or whole[2], known, logical)
    return _REFERENCE.sub(lambda found: _text(_known(found[1] or found[2], known, logical)), value)


def _known(name: str, known: Mapping[str, Known], logical: LogicalScenario) -> Known:
    if name not in known:
        raise InvalidRequest(f"{logical.name} refers to ${name}, which is not a parameter", valid=list(known))
    return known[name]


def _text(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".") or "0"
