"""The time series of a run in addition to its motion: its position on the route, its steering, and debug values."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ...schemas.planning import LONGEST_NAME
from ...schemas.runs import (
    MOST_DEBUG_POINTS,
    MOST_DEBUG_POINTS_A_RUN,
    MOST_DEBUG_POLYGONS,
    MOST_DEBUG_VALUES,
    DebugPolygon,
    RunSeries,
)
from ...schemas.text import LONGEST_TEXT, one_line
from ..geometry import Values
from ..vehicles import VehicleParameters
from .driving.route_place import RoutePlaces
from .driving.solution import steering_of
from .interface import DebugValues

if TYPE_CHECKING:
    from .simulation import DrivenRun

_DIGITS = 4
"""Series are stored to 0.1 mm, 0.1 mm/s and 0.1 mrad, like the motion of others."""
_T = TypeVar("_T")


def run_series(driven: "DrivenRun", vehicle: VehicleParameters, step_s: float) -> RunSeries | None:
    """Return the series of a run, or None for a run that never started along a route."""
    task, states = driven.task, driven.states
    if task is None:
        return None
    places = RoutePlaces(task)
    headings_rad = np.array([state.heading_rad for state in states])
    offsets_m, errors_rad = places.deviations(np.array([state.position for state in states]), headings_rad)
    speeds_mps = np.array([state.speed_mps for state in states])
    steering_rad = driven.steering_rad
    if steering_rad is None:
        steering_rad = steering_of(headings_rad, speeds_mps, step_s, vehicle.wheelbase_m)
    planned = [states[step - states[0].step] for step in driven.plan_steps]
    desired = places.desired_speeds(planned)
    numbers, texts, polygons, left_out = _bounded_debug_values([plan.debug for plan in driven.plans], driven.plan_steps)
    return RunSeries(
        lateral_offset_m=_round(offsets_m),
        heading_error_rad=_round(errors_rad),
        steering_rad=_round(steering_rad),
        desired_speed_mps=_round(np.array([speed for speed, _ in desired])),
        desired_speed_reasons=tuple(reason for _, reason in desired),
        numbers=numbers,
        texts=texts,
        polygons=polygons,
        left_out=left_out,
    )


def _round(values: Values) -> tuple[float, ...]:
    return tuple((np.round(values, _DIGITS) + 0.0).tolist())


def _bounded_debug_values(
    reported: Sequence[DebugValues], steps: Sequence[int]
) -> tuple[dict[str, tuple[float | None, ...]], dict[str, tuple[str, ...]], tuple[DebugPolygon, ...], int]:
    """Return the debug values of all planning steps within the bounds, and the number of values beyond them."""
    numbers, no_numbers = _columns([each.numbers for each in reported], _number, None)
    texts, no_texts = _columns([each.texts for each in reported], _text, "")
    polygons, no_polygons = _polygons(reported, steps)
    return numbers, texts, polygons, no_numbers + no_texts + no_polygons


def _columns(
    reported: Sequence[Mapping[str, object]], read: Callable[[object], _T], absent: _T
) -> tuple[dict[str, tuple[_T, ...]], int]:
    """Return one column per name with a value for each step, and the number of values beyond the bounds."""
    columns: dict[str, list[_T]] = {}
    left_out = 0
    for row, values in enumerate(reported):
        for name, value in values.items():
            key = _name(name)
            if key not in columns and len(columns) >= MOST_DEBUG_VALUES:
                left_out += 1
                continue
            columns.setdefault(key, [absent] * len(reported))[row] = read(value)
    return {name: tuple(values) for name, values in columns.items()}, left_out


def _polygons(reported: Sequence[DebugValues], steps: Sequence[int]) -> tuple[tuple[DebugPolygon, ...], int]:
    kept: list[DebugPolygon] = []
    points, left_out = 0, 0
    for step, values in zip(steps, reported, strict=True):
        for place, (name, outline) in enumerate(values.polygons.items()):
            corners = np.asarray(outline, dtype=float)
            fits = corners.ndim == 2 and corners.shape[1:] == (2,) and 2 <= len(corners) <= MOST_DEBUG_POINTS
            points += len(corners) if fits else 0
            if place >= MOST_DEBUG_POLYGONS or not fits or points > MOST_DEBUG_POINTS_A_RUN:
                left_out += 1
            elif np.isfinite(corners).all():
                x_m, y_m = _round(corners[:, 0]), _round(corners[:, 1])
                kept.append(DebugPolygon(step=step, name=_name(name), x_m=x_m, y_m=y_m))
            else:
                left_out += 1
    return tuple(kept), left_out


def _name(name: object) -> str:
    return one_line(str(name), LONGEST_NAME)


def _text(text: object) -> str:
    return one_line(str(text), LONGEST_TEXT)


def _number(value: object) -> float | None:
    """Return a number, or None if it is not finite, such as the time to a collision that never happens."""
    number = float(value) if isinstance(value, int | float | np.number | np.bool_) else math.nan
    return number if math.isfinite(number) else None
