"""Changes of cost weights: ``jerk=0.5``, ``jerk*2``, ``jerk+0.1``, ``jerk=lateral_jerk``."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from plannerforge.schemas.errors import InvalidRequest, UnknownName, closest
from plannerforge.schemas.grammar import Assignment, parse_assignment

LARGEST_WEIGHT = 1e6


@dataclass(frozen=True)
class ChangedWeights:
    """All weights after the changes, and remarks on changes that changed nothing."""

    weights: dict[str, float]
    notes: tuple[str, ...]


def apply_changes(weights: Mapping[str, float], changes: Iterable[str]) -> ChangedWeights:
    """The weights after all changes in their order; all are applied or none.

    ``jerk=lateral_jerk`` copies the value that the other weight has at that point.

    Raises:
        UnknownName: a weight that does not exist, with the nearest.
        InvalidRequest: malformed, or a result that is negative or not finite.
    """
    result = dict(weights)
    notes: list[str] = []
    for text in changes:
        change = parse_assignment(text)
        name = _known(change.name, result)
        before = result[name]
        after = _value(change, before, result, text)
        if not math.isfinite(after) or after < 0 or after > LARGEST_WEIGHT:
            raise InvalidRequest(
                f"'{text}' would set {name} to {after:g}", valid=[f"a weight from 0 to {LARGEST_WEIGHT:g}"]
            )
        result[name] = after
        if after == before:
            zero = " (0 times anything stays 0; set a value instead)" if before == 0 and change.operator == "*" else ""
            notes.append(f"'{text}' leaves {name} at {before:g}{zero}")
    return ChangedWeights(result, tuple(notes))


def _value(change: Assignment, before: float, weights: Mapping[str, float], text: str) -> float:
    if change.copied_from is not None:
        return weights[_known(change.copied_from, weights)]
    operand = change.operand
    if operand is None:
        raise InvalidRequest(f"'{text}' assigns no value", valid=["name=0.5", "name*2", "name+0.1"])
    if change.operator == "*":
        return before * operand
    if change.operator == "+":
        return round(before + operand, 12)  # 0.1 + 0.2 shall read 0.3
    return round(before - operand, 12) if change.operator == "-" else operand


def _known(name: str, weights: Mapping[str, float]) -> str:
    if name in weights:
        return name
    folded = name.lower()
    if folded in weights:
        return folded
    raise UnknownName(
        f"there is no cost weight '{name}'",
        valid=closest(name, weights),
        next_step="call list_planners for all weights",
    )
