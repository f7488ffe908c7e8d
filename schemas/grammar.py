"""The small grammar of tool arguments: conditions, assignments, selectors, quantities and intervals.

    condition    truck>=1 · bus=2 · car=2..5 · bicycle · !yield · traffic_light@map · speed_limit=50km/h@map
    assignment   tau=0.7 · jerk*2 · jerk+0.1 · jerk-0.1 · jerk=lateral_jerk
    selector     12 · all · one:truck · class:truck · nearest:3 · lead · new:0 · !12
    quantity     50km/h · 30mph · 13.9 · 35m · 8s · 90steps
    interval     8..12s · 30-40 mph · 5 km/h ± 1 m/s · <=90steps · >=20mph · 50km/h

Hosts drop patterns and bounds from schemas, so every error here states what is allowed.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from .errors import InvalidRequest, UnknownName, closest, instead, misspelt_names

_LETTER = r"[^\W\d]|[^\x00-\xbf\xd7\xf7\u2000-\u2bff\u3000-\u303f\uff00-\uffef\s]"
"""A letter of any script or a mark that combines with it, which is not \\w; the ranges are spaces and symbols."""
_NAME = rf"(?:{_LETTER})(?:{_LETTER}|[0-9.\-])*"
_NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_UNSIGNED = r"\d+(?:\.\d*)?"
"""A number without a sign, so a dash or a word may follow."""
_UNIT = r"[A-Za-z][A-Za-z/0-9]*"
BaseUnit = Literal["m/s", "m", "s", ""]
_TO_BASE: dict[str, dict[str, float]] = {
    "m/s": {
        "m/s": 1.0,
        "mps": 1.0,
        "km/h": 1 / 3.6,
        "kmh": 1 / 3.6,
        "kph": 1 / 3.6,
        "kmph": 1 / 3.6,
        "mph": 0.44704,
        **dict.fromkeys(("knots", "knot", "kn"), 1852 / 3600),
    },
    "m": {"m": 1.0, "cm": 0.01, "km": 1000.0, "ft": 0.3048},
    "s": {"s": 1.0, "ms": 0.001, "min": 60.0},
    "": {},
}
"""Factors from units to the base unit: a mile is 1609.344 m, a foot 0.3048 m (international yard and pound, 1959).

A knot is 1852 m per hour (SI brochure, 9th edition, table 8)."""


@dataclass(frozen=True)
class Interval:
    """A closed interval; None on a side means unbounded. ``exact`` is True if one value was written."""

    low: float | None
    high: float | None
    exact: bool = False

    def contains(self, value: float) -> bool:
        """Return whether the value is in the interval, ends included."""
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)


@dataclass(frozen=True)
class Condition:
    """A condition on a named quantity.

    ``value`` is the right-hand side as written if it is not a number (``outcome=collision``), otherwise None. ``scope``
    is the part after ``@``. Without an operator, the interval is "at least one".
    """

    name: str
    interval: Interval
    value: str | None = None
    negated: bool = False
    scope: str | None = None


@dataclass(frozen=True)
class Assignment:
    """A change of a named number: ``=`` sets, ``*`` multiplies, ``+`` and ``-`` add, or it copies another name."""

    name: str
    operator: Literal["=", "*", "+", "-"]
    operand: float | None
    copied_from: str | None = None


@dataclass(frozen=True)
class Selector:
    """A selection of vehicles: a kind (``id``, ``all``, ``class``, ``nearest``, …), its argument, and exclusion."""

    kind: str
    argument: str = ""
    negated: bool = False

    def __str__(self) -> str:
        """Return the selector in the notation of a call, such as ``nearest:3`` or ``!12``."""
        body = self.argument if self.kind == "id" else f"{self.kind}:{self.argument}" if self.argument else self.kind
        return f"!{body}" if self.negated else body


def parse_quantity(text: str, unit: BaseUnit = "", *, step_s: float | None = None) -> float:
    """Return a quantity as a number in the base unit, which a bare number is assumed to have.

    ``step_s`` allows ``steps`` if the base unit is seconds.

    Raises:
        InvalidRequest: the text is not a finite number, or has a unit of another kind.
    """
    match = re.fullmatch(rf"\s*({_NUMBER})\s*({_UNIT})?\s*", text)
    units = dict(_TO_BASE[unit])
    if unit == "s" and step_s is not None:
        units |= {"steps": step_s, "step": step_s}
    if match is None or not math.isfinite(float(match[1])):
        raise InvalidRequest(
            f"'{text}' is not a quantity",
            valid=[f"a number{_or_units(units)}"],
            next_step="write a number and its unit",
            complete=True,
        )
    if match[2] is None:
        return float(match[1])
    factor = units.get(match[2].lower())
    if factor is None:
        raise InvalidRequest(
            f"'{text}' has the unit '{match[2]}', which is not valid here",
            valid=list(units) or ["a number without a unit"],
            next_step="write it in one of these units" if units else "leave the unit out",
            remedies=[
                *(instead(text, f"{match[1]}{one}") for one in _units_meant(match[2].lower(), units)),
                *([] if units else [instead(text, match[1])]),
            ],
        )
    value = float(match[1]) * factor
    if not math.isfinite(value):
        raise InvalidRequest(
            f"'{text}' is too large", valid=[f"a number{_or_units(units)}"], next_step="choose a smaller number"
        )
    return value


def _units_meant(word: str, units: Mapping[str, float]) -> list[str]:
    """Return the units that a wrong one may stand for: its quotient, such as ``km/h`` for ``km``, else similar ones.

    If the word only begins units, as ``m`` begins ``ms`` and ``min``, the base unit comes first.
    """
    quotients = [one for one in units if one.startswith(f"{word}/")]
    begun = [next(iter(units))] if any(one.startswith(word) for one in units) else []
    alike = misspelt_names(word, units)
    return quotients or begun or (alike if len({units[one] for one in alike}) == 1 else [])


def parse_interval(text: str, unit: BaseUnit = "", *, step_s: float | None = None) -> Interval:
    """Parse ``8..12s``, ``30-40 mph``, ``5 km/h ± 1 m/s``, ``<=90steps``, ``>=20mph``, ``=3`` or a value.

    The ends are inclusive. A unit that occurs once applies to both numbers.

    Raises:
        InvalidRequest: the text is malformed, or the ends are in the wrong order.
    """
    body = text.strip()
    is_one = re.fullmatch(rf"=?\s*{_NUMBER}\s*(?:{_UNIT})?", body)
    around = re.fullmatch(rf"=?\s*({_NUMBER}\s*(?:{_UNIT})?)\s*(?:±|\+/-|\+-)\s*({_NUMBER}\s*(?:{_UNIT})?)", body)
    if around:
        value, tolerance = (
            parse_quantity(part, unit, step_s=step_s)
            for part in (_with_unit(around[1], around[2]), _with_unit(around[2], around[1]))
        )
        return Interval(value - abs(tolerance), value + abs(tolerance))
    between = re.fullmatch(rf"=?\s*({_NUMBER}\s*(?:{_UNIT})?)\s*\.\.\s*({_NUMBER}\s*(?:{_UNIT})?)", body)
    between = between or re.fullmatch(
        rf"=?\s*({_UNSIGNED}\s*(?:{_UNIT})?)\s*(?:-|–|\bto\b)\s*({_UNSIGNED}\s*(?:{_UNIT})?)", body
    )
    if between and not is_one:
        first = _with_unit(between[1], between[2])
        low, high = (parse_quantity(part, unit, step_s=step_s) for part in (first, between[2]))
        if low > high:
            raise InvalidRequest(
                f"'{text}' is reversed: its start is above its end",
                valid=[f"{between[2]}..{first}"],
                next_step="swap its ends",
                given=text,
            )
        return Interval(low, high)
    for operator in (">=", "<="):
        if body.startswith(operator):
            bound = parse_quantity(body[2:], unit, step_s=step_s)
            return Interval(bound, None) if operator == ">=" else Interval(None, bound)
    value = parse_quantity(body.removeprefix("="), unit, step_s=step_s)
    return Interval(value, value, exact=True)


def is_without_unit(text: str) -> bool:
    """Return whether a text is a number alone, for which the base unit is assumed."""
    return re.fullmatch(rf"\s*{_NUMBER}\s*", text) is not None


def is_unit(word: str) -> bool:
    """Return whether a word is the unit of a quantity, written as in a name (``mps`` for ``m/s``)."""
    return word in {unit.replace("/", "p") for units in _TO_BASE.values() for unit in units} | {"mps2"}


def _with_unit(quantity: str, other: str) -> str:
    """Return the quantity as written, with the unit of ``other`` if it has none."""
    unit = re.search(rf"(?<![A-Za-z]){_UNIT}$", other.strip())
    return quantity if unit is None or re.search(r"[A-Za-z]$", quantity.strip()) else quantity + unit[0]


def scope_first(text: str) -> str:
    """Return a condition such as ``speed_limit=50km/h@map`` with its scope after its name, not its value."""
    found = re.fullmatch(rf"(\s*!?\s*{_NAME})\s*((?:>=|<=|==|=|>|<)[^@]+?)(@[a-z]+)\s*", text)
    return text if found is None else f"{found[1]}{found[3]}{found[2]}"


_FORMS = (">=2", "=2", "=2..5", "")
"""What may follow the name in a condition."""


def parse_condition(
    text: str, unit: BaseUnit = "", *, whole: bool = False, words: bool = False, example: str = "car"
) -> Condition:
    """Parse a condition: ``truck>=1``, ``car=2..5``, ``!yield``, ``speed_limit=50km/h`` or ``outcome=collision``.

    Args:
        text: the condition as written.
        unit: the base unit for a quantity on the right.
        whole: counts: ``>`` and ``<`` mean at least one more or less, and a fraction is refused.
        words: whether a word may be on the right, as in ``outcome=collision``.
        example: a name that is valid here, for the refusal.

    Raises:
        InvalidRequest: the condition is malformed; the error shows valid ones.
    """
    match = re.fullmatch(rf"\s*(!?)\s*({_NAME})(?:@([a-z]+))?\s*(?:(>=|<=|==|=|>|<)\s*(.+?))?\s*", scope_first(text))
    if match is None:
        raise InvalidRequest(
            f"'{text}' is not a condition",
            valid=["outcome=collision", "!outcome=collision"] if words else [f"{example}{one}" for one in _FORMS],
            next_step="write it like these",
        )
    negated, name, scope, operator, right = bool(match[1]), match[2], match[3], match[4], match[5]
    if operator is None:
        return Condition(name, Interval(1.0, None), negated=negated, scope=scope)
    if not re.match(r"[+-]?\.?\d", right):
        if not words or operator not in ("=", "=="):
            raise InvalidRequest(
                f"'{text}' compares with '{right}', which is not a number",
                valid=[f"{name}{'=' if operator == '==' else operator}2"],
                next_step="compare with a number",
                remedies=[instead(text, f"{'!' if negated else ''}{name}{f'@{scope}' if scope else ''}")],
            )
        return Condition(name, Interval(None, None), right, negated, scope)
    interval = _compared(text, operator, right, unit, whole)
    return Condition(name, interval, None, negated, scope)


def as_exclusion(text: str) -> str:
    """Return ``!trucks`` for ``no trucks`` or ``without trucks``; any other condition stays as it is."""
    denied = re.fullmatch(rf"\s*(?:no|without)\s+({_NAME})\s*", text, re.IGNORECASE)
    return text if denied is None else f"!{denied[1]}"


def parse_assignment(text: str) -> Assignment:
    """Parse a change such as ``jerk=0.5``, ``jerk*2``, ``jerk+0.1`` or ``jerk=lateral_jerk``.

    Raises:
        InvalidRequest: the text is malformed, or its number is not finite.
    """
    examples = ["name=0.5", "name*2", "name+0.1", "name-0.1", "name=other_name"]
    unit_of: dict[str, BaseUnit] = {"m": "m", "s": "s", "mps": "m/s"}
    match = re.fullmatch(r"\s*([A-Za-z_]\w*)\s*([=*+\-])\s*(\S.*?)\s*", text)
    if match is None:
        apart = re.fullmatch(rf"\s*([A-Za-z_]\w*)\s*[:\s]\s*({_NUMBER})\s*", text)
        raise InvalidRequest(
            f"'{text}' is not an assignment",
            valid=examples,
            next_step="write it in one of these forms",
            remedies=[] if apart is None else [instead(text, f"{apart[1]}={apart[2]}")],
        )
    name, operator, right = match[1], match[2], match[3]
    if re.fullmatch(_NUMBER, right) and math.isfinite(float(right)):
        return Assignment(name, operator, float(right))  # type: ignore[arg-type]
    if operator == "=" and re.fullmatch(r"[A-Za-z_]\w*", right) and right.lower() not in ("nan", "inf", "infinity"):
        return Assignment(name, "=", None, copied_from=right)
    if re.fullmatch(rf"{_NUMBER}\s*{_UNIT}", right):
        unit = unit_of.get(name.lower().rpartition("_")[2], "")
        converted = [] if not unit else _converted(right, unit)
        raise InvalidRequest(
            f"'{right}' has a unit, but {name} takes a number{f' in {unit}' if unit else ''} without its unit",
            valid=[f"{name}{operator}{value:g}" for value in converted] or examples,
            next_step="leave the unit out",
            remedies=[instead(text, f"{name}{operator}{value:g}") for value in converted],
            complete=True,
        )
    raise InvalidRequest(
        f"'{text}' does not assign a finite number",
        valid=examples,
        next_step="assign a number",
        remedies=[],
        complete=True,
    )


def _converted(text: str, unit: BaseUnit) -> list[float]:
    """Return a quantity in the unit of a name, or nothing if the text has another unit."""
    try:
        return [parse_quantity(text, unit)]
    except InvalidRequest:
        return []


_PLAIN = ("all", "farthest", "lead", "follow", "fastest", "slowest", "standing", "leftmost", "rightmost")
_WITH_ARGUMENT = ("one", "class", "nearest", "only", "new", "lane")
SELECTORS = ("an id", *_PLAIN, "nearest:3", "one:truck", "class:truck", "only:bus", "new:0", "!12")


def parse_selector(text: str) -> Selector:
    """Parse a selector of vehicles.

    Raises:
        UnknownName: the word is not a selector.
        InvalidRequest: an argument does not fit, such as ``nearest:many``.
    """
    body = text.strip()
    negated = body.startswith("!")
    body = body.removeprefix("!").strip()
    if re.fullmatch(r"\d+", body):
        return Selector("id", str(int(body)), negated)
    kind, colon, argument = body.partition(":")
    if kind == "nearest" and not colon:
        argument = "1"
    if not colon and kind in _PLAIN:
        return Selector(kind, "", negated)
    if kind in _WITH_ARGUMENT and argument:
        if kind in ("nearest", "new") and not re.fullmatch(r"\d+", argument):
            raise InvalidRequest(
                f"'{text}' needs a whole number after '{kind}:'",
                valid=[f"{kind}:1"],
                next_step="give the number of vehicles",
                given=text,
            )
        return Selector(kind, argument, negated)
    nearest = [SELECTORS[0], *closest(kind, SELECTORS[1:])]
    raise UnknownName(
        f"'{text}' selects no vehicles", valid=nearest, next_step="select vehicles in one of the valid forms"
    )


def _compared(text: str, operator: str, right: str, unit: BaseUnit, whole: bool) -> Interval:
    if operator in ("=", "=="):
        interval = parse_interval(right, unit)
    else:
        bound = parse_quantity(right, unit)
        strict = 1.0 if whole else 0.0
        if operator in (">", ">="):
            interval = Interval(bound + (strict if operator == ">" else 0.0), None)
        else:
            interval = Interval(None, bound - (strict if operator == "<" else 0.0))
    if whole and any(end is not None and end != int(end) for end in (interval.low, interval.high)):
        raise InvalidRequest(
            f"'{text}' compares a count with a fraction",
            valid=["a whole number"],
            next_step="write a whole number",
            remedies=[instead(right, _whole(right))],
        )
    if whole and any(end is not None and end < 0 for end in (interval.low, interval.high)):
        raise InvalidRequest(
            f"'{text}' compares a count with a negative number, but no count is below 0",
            valid=["0 or a greater whole number"],
            next_step="compare with one of these",
            remedies=[instead(right, right.lstrip("-").strip())] if right.startswith("-") and ".." not in right else [],
        )
    return interval


def _whole(text: str) -> str:
    """Return the text with its numbers rounded to integers."""
    return re.sub(_NUMBER, lambda found: f"{round(float(found[0]))}", text)


def _or_units(units: dict[str, float]) -> str:
    return f" in {', '.join(units)}, or without a unit" if units else ""
