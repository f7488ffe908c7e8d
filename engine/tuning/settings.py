"""The numeric values of a configuration (weights and settings), and assignments that change them.

An assignment has the form ``jerk=0.5``, ``jerk*2``, ``jerk+0.1`` or ``jerk=lateral_jerk``.
"""

import math
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from ...schemas.errors import Faults, InvalidRequest, UnknownName, closest, instead, misspelt_names
from ...schemas.grammar import Assignment, parse_assignment
from ...schemas.planning import PlannerSettings
from ..vehicles import VEHICLES, fits_together, parameter_values
from .tunings import LARGEST_WEIGHT


@dataclass(frozen=True)
class _ChangedValues:
    """All values after the changes, and remarks on changes without effect."""

    values: dict[str, float]
    notes: tuple[str, ...]


def apply_assignments(
    values: Mapping[str, float],
    changes: Iterable[str],
    *,
    limits: Mapping[str, tuple[float, float]] | None = None,
    kind: str = "cost weight",
    owner: str = "",
    elsewhere: Mapping[str, str] | None = None,
    idle: Collection[str] = (),
) -> _ChangedValues:
    """Return the weights (or settings) after all changes, in order; apply no change if one is refused.

    ``jerk=lateral_jerk`` copies the other weight's value at that point. ``limits``: ranges of single names, otherwise 0
    to 1e6; ``elsewhere``: maps names that do not belong to the ``owner`` to an explanation;
    ``idle``: names with values that are kept, but have no effect. A refusal offers one only for its misspelling.

    Raises:
        UnknownName: A weight does not exist; the error lists the nearest names.
        InvalidRequest: A change is malformed, or its result is out of range or not finite; the error lists all faults.
    """
    limits, elsewhere = limits or {}, elsewhere or {}
    result, faults = dict(values), Faults()
    notes: list[str] = []
    for text in changes:
        with faults.collecting():
            if text.strip() in result:
                raise _without_value(text.strip(), result[text.strip()], limits)
            change = _parse(text, result, limits)
            name = _known(change.name, result, kind, owner, elsewhere, idle)
            before = result[name]
            if change.copied_from is not None:
                after = result[_copied(name, change.copied_from, text, result, limits)]
            else:
                after = _value(change, before)
            lowest, highest = limits.get(name, (0.0, LARGEST_WEIGHT))
            if not math.isfinite(after) or not lowest <= after <= highest:
                most = _range_text(name, limits)
                nearest = lowest if not after > lowest else highest
                raise InvalidRequest(
                    f"'{text}' would set {name} to {after:g}",
                    valid=[most],
                    remedies=[instead(text, f"{name}={nearest:g}")],
                )
            result[name] = after
            if after == before:
                is_idle = before == 0 and change.operator == "*"
                zero = " (0 times a number is 0; set a value instead)" if is_idle else ""
                notes.append(f"'{text}' leaves {name} at {before:g}{zero}")
    faults.raise_all()
    return _ChangedValues(result, tuple(notes))


def _parse(text: str, names: Iterable[str], limits: Mapping[str, tuple[float, float]]) -> Assignment:
    """Return the assignment that a text makes.

    Raises:
        InvalidRequest: the text is not an assignment; the error gives the range if the text begins with a name.
    """
    try:
        return parse_assignment(text)
    except InvalidRequest as refusal:
        begins = re.match(r"\s*(\w+)", text)
        if begins is None or begins[1] not in names:
            raise
        raise refusal.with_only(_forms(begins[1], limits), complete=True) from refusal


def _forms(name: str, limits: Mapping[str, tuple[float, float]]) -> list[str]:
    """Return the assignments that suit a name: its range or, if any value suits it, every form."""
    if name in limits:
        return [_range_text(name, limits)]
    return [_range_text(name, limits), f"{name}=0.5", f"{name}*2", f"{name}+0.1", f"{name}=other_name"]


def _range_text(name: str, limits: Mapping[str, tuple[float, float]]) -> str:
    if name not in limits:
        return f"a weight from 0 to {LARGEST_WEIGHT:,.0f}"
    lowest, highest = limits[name]
    return f"{name} from {lowest:g} to {highest:g}"


def _without_value(name: str, before: float, limits: Mapping[str, tuple[float, float]]) -> InvalidRequest:
    """Return the refusal of a name without a value, which suggests an assignment with the current value."""
    return InvalidRequest(
        f"'{name}' assigns no value; {name} is {before:g} now",
        valid=_forms(name, limits),
        remedies=[instead(name, f"{name}={before:g}")],
        complete=True,
    )


def _value(change: Assignment, before: float) -> float:
    operand = before if change.operand is None else change.operand
    if change.operator == "*":
        return before * operand
    if change.operator == "+":
        return round(before + operand, 12)  # 0.1 + 0.2 must read 0.3
    return round(before - operand, 12) if change.operator == "-" else operand


def _copied(
    name: str, word: str, text: str, values: Mapping[str, float], limits: Mapping[str, tuple[float, float]]
) -> str:
    """Return the name of the value to copy to a name, in place of a number."""
    folded = word if word in values else word.lower()
    if folded not in values:
        meant = misspelt_names(word, (other for other in values if other != name))[:3]
        raise UnknownName(
            f"{name} cannot be '{word}'",
            valid=[_range_text(name, limits), *meant],
            next_step=f"set a number{', or copy another value by its name' if meant else ''}",
            complete=True,
        ).also(instead(text, f"{name}={values[name]:g}"))
    return folded


def _known(
    name: str, values: Mapping[str, float], kind: str, owner: str, elsewhere: Mapping[str, str], idle: Collection[str]
) -> str:
    folded = name if name in values else name.lower()
    if folded in values:
        return folded
    acting = [other for other in values if other not in idle]
    if folded in elsewhere:
        raise UnknownName(
            f"{owner} has no {kind} '{folded}'; {elsewhere[folded]}",
            valid=acting,
            next_step="use one of these names" if values else "change its settings instead",
        )
    raise UnknownName(
        f"there is no {kind} '{name}'",
        valid=[*misspelt_names(name, idle), *(closest(name, acting) or acting)],
        next_step=f"call list_planners for all {kind}s",
    )


@dataclass(frozen=True)
class Setting:
    """One setting: its unit, range (ends included), and meaning; ``whole`` for counts and ids."""

    name: str
    unit: str
    lowest: float
    highest: float
    meaning: str
    whole: bool = False

    @property
    def range_text(self) -> str:
        """The range as shown in tables and errors, such as ``1.5 to 6 s``."""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.lowest:g} to {self.highest:g}{unit}"


_SETTINGS = (
    Setting(
        "vehicle", "of CommonRoad's vehicles", 1, 4, "CommonRoad vehicle; replaces all vehicle parameters", whole=True
    ),
    Setting("length_m", "m", 1.0, 20.0, "length of the ego"),
    Setting("width_m", "m", 0.5, 3.0, "width of the ego"),
    Setting("wheelbase_m", "m", 0.8, 12.0, "distance between the axles"),
    Setting("rear_axle_behind_center_m", "m", 0.2, 8.0, "rear axle to centre"),
    Setting("maximum_acceleration_mps2", "m/s²", 1.0, 15.0, "limit of acceleration and braking"),
    Setting("maximum_speed_mps", "m/s", 1.0, 70.0, "top speed"),
    Setting("switching_speed_mps", "m/s", 1.0, 30.0, "above it the power limits the acceleration"),
    Setting("maximum_steering_rad", "rad", 0.1, 1.4, "largest steering angle"),
    Setting("maximum_steering_rate_radps", "rad/s", 0.05, 2.0, "largest steering rate"),
    Setting("horizon_s", "s", 1.5, 6.0, "duration of a plan and its prediction"),
    Setting("replan_steps", "steps", 1, 10, "time steps driven before the next plan", whole=True),
    Setting("sampling_level", "", 0, 3, "candidates: 3, 5, 9 or 17 speeds and offsets", whole=True),
    Setting("search", "", 0, 3, "of fiss: 0 fop, 1 fop_plus, 2 fiss, 3 fiss_plus", whole=True),
)


def known_settings() -> dict[str, Setting]:
    """Return all settings by name, in order."""
    return {setting.name: setting for setting in _SETTINGS}


def setting_values(settings: PlannerSettings) -> dict[str, float]:
    """Return every setting with its effective value, in order."""
    own = parameter_values(VEHICLES[settings.vehicle])
    stated = {name: value for name, value in settings if value is not None}
    return {name: stated.get(name, own.get(name, 0.0)) for name in known_settings()}


def changed_settings(settings: PlannerSettings, changes: Iterable[str]) -> tuple[PlannerSettings, tuple[str, ...]]:
    """Return the settings after the changes, in order, and remarks; ``vehicle`` replaces all its parameters.

    Raises:
        UnknownName: A setting does not exist.
        InvalidRequest: A change is malformed or out of its range, or the vehicle's parameters do not fit together.
    """
    values, notes, known = setting_values(settings), list[str](), known_settings()
    limits = {name: (setting.lowest, setting.highest) for name, setting in known.items()}
    names_vehicle, faults = settings.states_vehicle, Faults()
    for text in changes:
        with faults.collecting():
            changed = apply_assignments(values, [text], limits=limits, kind="setting")
            name = parse_assignment(text).name.lower()
            if known[name].whole and changed.values[name] != int(changed.values[name]):
                raise InvalidRequest(
                    f"'{text}': {name} must be a whole number",
                    valid=[known[name].range_text],
                    remedies=[instead(text, f"{name}={round(changed.values[name])}")],
                )
            values, notes = changed.values, [*notes, *changed.notes]
            if name == "vehicle":
                values |= parameter_values(VEHICLES[int(values[name])])
                names_vehicle = True
    faults.raise_all()
    _fits_together(values)
    own = parameter_values(VEHICLES[int(values["vehicle"])])
    stated = {name: value for name, value in values.items() if name not in own or value != own[name]}
    made = PlannerSettings.model_validate(stated)
    return made.model_copy(update={"vehicle_stated": names_vehicle and made.vehicle == 2}), tuple(notes)


def _fits_together(values: dict[str, float]) -> None:
    length, wheelbase, rear = (values[name] for name in ("length_m", "wheelbase_m", "rear_axle_behind_center_m"))
    if not fits_together(length, wheelbase, rear):
        raise InvalidRequest(
            f"length_m={length:g}, wheelbase_m={wheelbase:g} and rear_axle_behind_center_m={rear:g}"
            " do not form a vehicle",
            valid=["wheelbase_m <= length_m", "rear_axle_behind_center_m <= length_m / 2 and <= wheelbase_m"],
            next_step="set the three together",
        )
