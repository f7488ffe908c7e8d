"""Driver behaviour: the six presets of the paper and the eleven parameters of SUMO that they set.

The presets' values come from the paper's published modification code. Meanings and units are those of SUMO's vehicle
type attributes (https://sumo.dlr.de/docs/Definition_of_Vehicles%2C_Vehicle_Types%2C_and_Routes.html).
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ...schemas.errors import InvalidRequest, UnknownName, closest, instead
from ...schemas.grammar import Assignment, parse_assignment
from ..vehicles import GRAVITY_MPS2, VehicleClass, vehicle_classes


@dataclass(frozen=True)
class _ParameterRange:
    """The meaning of a parameter and its valid values; ``low`` itself is valid unless ``above`` is set."""

    meaning: str
    low: float
    high: float
    above: bool = False

    def contains(self, value: float) -> bool:
        """Return True if the value is allowed."""
        return (value > self.low if self.above else value >= self.low) and value <= self.high

    def nearest(self, value: float) -> float:
        """Return the valid value nearest to an invalid value; an excluded lower end gives 1 % of the range above it."""
        if value > self.high:
            return self.high
        return self.low + (self.high - self.low) / 100 if self.above else self.low

    def __str__(self) -> str:
        """Return the range in words."""
        return f"{'above' if self.above else 'from'} {self.low:g} {'up ' if self.above else ''}to {self.high:g}"


PARAMETERS: Mapping[str, _ParameterRange] = {
    "accel": _ParameterRange("largest acceleration in m/s²", 0.0, 15.0, above=True),
    "decel": _ParameterRange("comfortable deceleration in m/s²", 0.0, 15.0, above=True),
    "sigma": _ParameterRange("imperfection of the driver", 0.0, 1.0),
    "minGap": _ParameterRange("gap when standing in m", 0.0, 50.0),
    "tau": _ParameterRange("desired time headway in s", 0.0, 10.0, above=True),
    "speedFactor": _ParameterRange("desired speed over the lane's speed", 0.0, 5.0, above=True),
    "impatience": _ParameterRange("willingness to impede others at junctions", 0.0, 1.0),
    "lcStrategic": _ParameterRange("eagerness to change lanes for the route", 0.0, 100.0),
    "lcCooperative": _ParameterRange("willingness to let others change into its lane", 0.0, 1.0),
    "lcSpeedGain": _ParameterRange("eagerness to change lanes for speed", 0.0, 100.0),
    "lcKeepRight": _ParameterRange("eagerness to keep right", 0.0, 100.0),
}
_NAMES = tuple(PARAMETERS)
_PRESET_VALUES = {
    "aggressive": (3.0, 5.0, 0.6, 1.5, 0.8, 1.05, 0.7, 1.0, 0.0, 1.0, 0.3),
    "cautious": (1.5, 3.0, 0.4, 4.0, 2.0, 0.95, 0.1, 0.3, 0.9, 0.2, 0.8),
    "emergency": (4.0, 6.0, 0.2, 1.0, 0.5, 1.3, 0.8, 0.9, 0.0, 1.0, 0.2),
    "eco": (1.2, 2.5, 0.3, 3.0, 1.8, 0.95, 0.1, 0.3, 0.8, 0.1, 0.9),
    "balanced": (2.5, 4.5, 0.5, 2.0, 1.2, 1.0, 0.3, 0.5, 0.5, 0.5, 0.7),
    "speeder": (2.5, 4.5, 0.5, 2.0, 1.0, 1.1, 0.4, 0.5, 0.5, 0.5, 0.6),
}


@dataclass(frozen=True)
class Behaviour:
    """The eleven parameters of a driver, by SUMO's names, and the preset that they are based on (or "")."""

    preset: str
    values: Mapping[str, float]

    def on_road(self, friction: float | None) -> "Behaviour":
        """Return the driver on a road with the given friction, which limits acceleration and braking by the tyres."""
        if friction is None:
            return self
        most = friction * GRAVITY_MPS2
        limited = {name: min(self.values[name], most) for name in ("accel", "decel")}
        return replace(self, values={**self.values, **limited})


def presets() -> dict[str, dict[str, float]]:
    """Return the six presets: name → parameter → value."""
    return {name: dict(zip(_NAMES, values, strict=True)) for name, values in _PRESET_VALUES.items()}


def usual_behaviour(vehicle_class: VehicleClass) -> Behaviour:
    """Return an ordinary driver of a class: SUMO's defaults with little imperfection and the class's own limits."""
    values = dict.fromkeys(_NAMES, 1.0) | {
        "accel": vehicle_class.acceleration_mps2,
        "decel": vehicle_class.deceleration_mps2,
        "sigma": 0.2,  # SUMO's default is 0.5: more random braking
        "minGap": vehicle_class.minimum_gap_m,
        "impatience": 0.0,
    }
    return Behaviour("", values)


def own_minimum_gap_m(vehicle_class: VehicleClass) -> float | None:
    """Return the gap in m that a class keeps regardless of the preset; None for classes that keep the gap of cars."""
    usual = vehicle_classes()["car"].minimum_gap_m
    return None if vehicle_class.minimum_gap_m == usual else vehicle_class.minimum_gap_m


def behaviour_from(
    base: Behaviour, preset: str | None, params: Sequence[str], own_gap_m: float | None = None
) -> Behaviour:
    """Return a base changed by a preset (which replaces all but a class's own gap), and then by single parameters.

    Raises:
        UnknownName: there is no such preset or parameter.
        InvalidRequest: a value is outside its range, or a parameter is given twice.
    """
    values, name = dict(base.values), base.preset
    if preset is not None:
        name = preset.strip().lower()
        if name not in _PRESET_VALUES:
            raise UnknownName(
                f"there is no behaviour preset '{preset}'",
                valid=closest(preset, _PRESET_VALUES),
                next_step="use one of these, or set individual parameters with 'params'",
                complete=True,
            )
        values = presets()[name] | ({} if own_gap_m is None else {"minGap": own_gap_m})
    assignments = [_read(text, values) for text in params]
    assigned = [assignment.name for assignment in assignments]
    twice = sorted({parameter for parameter in assigned if assigned.count(parameter) > 1})
    if twice:
        raise InvalidRequest(f"{', '.join(twice)} is set twice in params", next_step="give every parameter once")
    for assignment, text in zip(assignments, params, strict=True):
        values[assignment.name] = _assigned(values, assignment, text)
    return Behaviour(name, values)


def parameters_set(preset: str | None, params: Sequence[str]) -> dict[str, bool]:
    """Return, for each parameter that is set, whether its new value is independent of the old value."""
    assignments = [parse_assignment(text) for text in params]
    return dict.fromkeys(_NAMES if preset else (), True) | {
        assignment.name: preset is not None or assignment.operator == "=" for assignment in assignments
    }


def values_set(params: Sequence[str], resulting: Sequence[Behaviour]) -> list[str]:
    """Return parameters as given; a relative parameter has its resulting value, or the range of several values."""
    notes = []
    for text in params:
        assignment = parse_assignment(text)
        relative = assignment.operator != "="
        values = sorted({behaviour.values[assignment.name] for behaviour in resulting}) if relative else []
        acting = " … ".join(f"{value:g}" for value in (values if len(values) < 3 else (values[0], values[-1])))
        notes.append(f"{text} ({acting})" if acting else text)
    return notes


def _read(text: str, values: Mapping[str, float]) -> Assignment:
    """Parse the assignment in a text.

    Raises:
        InvalidRequest: the text is not an assignment; for a parameter without a value, the error proposes its current
            value.
    """
    name = text.strip()
    if name in PARAMETERS:
        raise InvalidRequest(
            f"{name} needs a number",
            valid=[f"{name} {PARAMETERS[name]}"],
            next_step=f"write '{name}=NUMBER'",
            remedies=[instead(text, f"{name}={values[name]:g}")],
        )
    try:
        return parse_assignment(text)
    except InvalidRequest as refusal:
        named = re.split(r"[\s=*+:-]", name, maxsplit=1)[0]
        if named not in PARAMETERS:
            raise
        raise refusal.with_valid(f"{named} {PARAMETERS[named]}") from refusal


def _assigned(values: Mapping[str, float], assignment: Assignment, text: str) -> float:
    allowed = PARAMETERS.get(assignment.name)
    if allowed is None:
        raise UnknownName(
            f"there is no behaviour parameter '{assignment.name}'",
            valid=[f"{name} {PARAMETERS[name]}" for name in closest(assignment.name, PARAMETERS)],
            next_step="set one of these",
        )
    if assignment.operand is None:
        raise InvalidRequest(
            f"{assignment.name} needs a number",
            valid=[f"{assignment.name} {allowed}"],
            next_step=f"write '{assignment.name}=NUMBER'",
            remedies=[instead(text, f"{assignment.name}={values[assignment.name]:g}")],
        )
    before = values[assignment.name]
    operations = {"=": assignment.operand, "*": before * assignment.operand, "+": before + assignment.operand}
    value = operations.get(assignment.operator, before - assignment.operand)
    if not math.isfinite(value) or not allowed.contains(value):
        raise InvalidRequest(
            f"{assignment.name}={value:g} is out of range ({allowed.meaning})",
            valid=[f"{assignment.name}={allowed.nearest(value):g}", f"{assignment.name} {allowed}"],
            next_step="choose a value within the range",
            given=text,
        )
    return value
