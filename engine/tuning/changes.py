"""Changes of named numbers: ``jerk=0.5``, ``jerk*2``, ``jerk+0.1``, ``jerk=lateral_jerk``."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from plannerforge.schemas.errors import InvalidRequest, UnknownName, closest
from plannerforge.schemas.grammar import Assignment, parse_assignment

LARGEST_WEIGHT = 1e6
NO_NAMES: Mapping[str, str] = {}
NO_LIMITS: Mapping[str, tuple[float, float]] = {}


@dataclass(frozen=True)
class ChangedWeights:
    """All values after the changes, and remarks on changes that changed nothing."""

    weights: dict[str, float]
    notes: tuple[str, ...]


def apply_changes(
    weights: Mapping[str, float],
    changes: Iterable[str],
    *,
    limits: Mapping[str, tuple[float, float]] = NO_LIMITS,
    kind: str = "cost weight",
    elsewhere: Mapping[str, str] = NO_NAMES,
) -> ChangedWeights:
    """The weights (or settings) after all changes in their order; all are applied or none.

    ``jerk=lateral_jerk`` copies the value that the other weight has at that point. ``limits``: ranges of single names,
    0 to 1e6 otherwise; ``elsewhere``: names that do not belong here → where they do.

    Raises:
        UnknownName: a weight that does not exist, with the nearest.
        InvalidRequest: malformed, or a result outside its range or not finite.
    """
    result = dict(weights)
    notes: list[str] = []
    for text in changes:
        change = parse_assignment(text)
        name = _known(change.name, result, kind, elsewhere)
        before = result[name]
        if change.copied_from is not None:
            after = result[_known(change.copied_from, result, kind, elsewhere)]
        else:
            after = _value(change, before, text)
        lowest, highest = limits.get(name, (0.0, LARGEST_WEIGHT))
        if not math.isfinite(after) or not lowest <= after <= highest:
            valid = f"{name} from {lowest:g} to {highest:g}" if name in limits else f"a weight from 0 to {highest:g}"
            raise InvalidRequest(f"'{text}' would set {name} to {after:g}", valid=[valid])
        result[name] = after
        if after == before:
            zero = " (0 times anything stays 0; set a value instead)" if before == 0 and change.operator == "*" else ""
            notes.append(f"'{text}' leaves {name} at {before:g}{zero}")
    return ChangedWeights(result, tuple(notes))


def _value(change: Assignment, before: float, text: str) -> float:
    operand = change.operand
    if operand is None:
        raise InvalidRequest(f"'{text}' assigns no value", valid=["name=0.5", "name*2", "name+0.1"])
    if change.operator == "*":
        return before * operand
    if change.operator == "+":
        return round(before + operand, 12)  # 0.1 + 0.2 shall read 0.3
    return round(before - operand, 12) if change.operator == "-" else operand


def _known(name: str, values: Mapping[str, float], kind: str, elsewhere: Mapping[str, str]) -> str:
    folded = name if name in values else name.lower()
    if folded in values:
        return folded
    if folded in elsewhere:
        raise UnknownName(f"'{folded}' is no {kind} here: {elsewhere[folded]}", valid=list(values)[:5])
    raise UnknownName(
        f"there is no {kind} '{name}'",
        valid=closest(name, values) or list(values)[:5],
        next_step=f"call list_planners for all {kind}s",
    )
