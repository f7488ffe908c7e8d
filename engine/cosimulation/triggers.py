"""Scripts that depend on the ego: what a road user does once the ego has passed a point or comes near.

An edit writes the motion that results if an ordinary driver drives the ego. In addition, the file stores, as a
``Script``, what the road user does without the edit, what is prescribed, and what it waits for. In reactive traffic the
script is executed again, and its triggers respond to the planner's ego.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError

from ...schemas.base import Model
from ...schemas.errors import UnsafeInput
from ..commonroad import Track
from ..geometry import Points, project

_REACH_M = 4.0
"""The ego passes a place on a lanelet if it is no farther from its centre line (chosen): over half a wide lane."""
_DECIMALS = 5
"""Stored states are rounded to a hundredth of a millimetre (chosen)."""
_MOST_STATES, _MOST_PARTS, _MOST_ACTS = 20_000, 50, 10
"""Bounds of a stored script, which may come from a foreign file."""


@dataclass(frozen=True)
class SpeedAct:
    """Starting at a step, accelerate or brake at ``rate_mps2`` to ``speed_mps``, which is then kept."""

    from_step: int
    speed_mps: float
    rate_mps2: float


@dataclass(frozen=True)
class LateralAct:
    """Starting at a step, move to the side by ``aside_m`` (left positive) within ``duration_s``."""

    from_step: int
    aside_m: float
    duration_s: float


Act = SpeedAct | LateralAct


@dataclass(frozen=True)
class Trigger:
    """What the ego must do before a part of a script starts.

    With ``gap_s``, the ego must come near: it is behind the road user and, at its speed, would reach it in that time.
    Without ``gap_s``, the ego's centre must pass a point: ``station_m`` along a lanelet.
    """

    lanelet_id: int = 0
    station_m: float = 0.0
    gap_s: float | None = None

    def in_words(self) -> str:
        """Return text such as ``the ego comes within 2 s of it``, or ``the ego passes lanelet 5 at 35 m``."""
        if self.gap_s is not None:
            return f"the ego comes within {self.gap_s:g} s of it"
        return f"the ego passes lanelet {self.lanelet_id} at {self.station_m:.0f} m"

    def holds(self, ego: Track, index: int, place: Points | None, center_of: Callable[[int], Points | None]) -> bool:
        """Return True if the trigger holds at a state of the ego.

        Args:
            ego: the motion of the ego.
            index: the examined state.
            place: the road user's position at that time, (2,) in m; None if it is absent.
            center_of: returns the centre line (n, 2) of a lanelet, or None if there is no such lanelet.
        """
        if self.gap_s is not None:
            return place is not None and _is_within(ego, index, place, self.gap_s)
        line = center_of(self.lanelet_id)
        if line is None:
            return False
        here, aside = project(line, ego.positions[index])
        return here >= self.station_m and abs(aside) <= _REACH_M


def _is_within(ego: Track, index: int, place: Points, seconds: float) -> bool:
    away, heading = place - ego.front_at(index), float(ego.headings_rad[index])
    ahead_m = float(away[0]) * math.cos(heading) + float(away[1]) * math.sin(heading)
    return ahead_m >= 0.0 and float(np.linalg.norm(away)) <= seconds * float(ego.speeds_mps[index])


@dataclass(frozen=True)
class ScriptPart:
    """Acts, with the step at which they start for SUMO's ego, and their trigger (None: they start at a time).

    A part without acts starts the motion of a road user that has been standing at its first position.
    """

    step: int
    acts: tuple[Act, ...]
    trigger: Trigger | None = None

    def acts_from(self, step: int) -> tuple[Act, ...]:
        """Return the acts, shifted for a part that starts at a different step."""
        return tuple(replace(act, from_step=act.from_step + step - self.step) for act in self.acts)


@dataclass(frozen=True)
class Script:
    """A road user's motion without the prescribed acts, and the parts of its script in the order of the edits.

    ``dodges``: whether it brakes before it would hit the ego.
    """

    base: Track
    parts: tuple[ScriptPart, ...] = ()
    dodges: bool = False

    @property
    def depends_on_ego(self) -> bool:
        """Whether a run may move the road user differently from its file."""
        return self.dodges or any(part.trigger is not None for part in self.parts)

    def text(self) -> str:
        """Return the script as JSON for a scenario file, which already states the road user's class and size."""
        base = self.base
        stored = _StoredScript(
            id=base.obstacle_id,
            first=base.first_step,
            x=_rounded(base.positions[:, 0]),
            y=_rounded(base.positions[:, 1]),
            heading=_rounded(base.headings_rad),
            speed=_rounded(base.speeds_mps),
            parts=tuple(_stored_part(part) for part in self.parts),
            dodges=self.dodges,
        )
        return stored.model_dump_json(exclude_defaults=True)

    @classmethod
    def read(cls, text: str, tracks: "dict[int, Track]") -> "Script | None":
        """Return the script for a file's track, or None if the text belongs to a different road user.

        Raises:
            UnsafeInput: the text is not a script.
        """
        try:
            stored = _StoredScript.model_validate_json(text)
        except ValidationError:
            stored = None
        if stored is None or not len(stored.x) == len(stored.y) == len(stored.heading) == len(stored.speed):
            raise UnsafeInput(
                "the file contains an unreadable script of a road user's motion",
                next_step="apply the edit with 'when' or 'dodge' again, to the scenario before it",
            )
        own = tracks.get(stored.id)
        if own is None:
            return None
        base = replace(
            own,
            first_step=stored.first,
            positions=np.column_stack([stored.x, stored.y]),
            headings_rad=np.array(stored.heading),
            speeds_mps=np.array(stored.speed),
        )
        return cls(base, tuple(_part(part) for part in stored.parts), stored.dodges)


_Numbers = Annotated[tuple[float, ...], Field(min_length=1, max_length=_MOST_STATES)]


class _StoredAct(Model):
    kind: Literal["speed", "aside"]
    step: int
    value: float
    rate: float = Field(gt=0.0)


class _StoredPart(Model):
    step: int
    acts: tuple[_StoredAct, ...] = Field((), max_length=_MOST_ACTS)
    lanelet: int | None = None
    station: float = 0.0
    gap: float | None = None


class _StoredScript(Model):
    id: int
    first: int = Field(ge=0)
    x: _Numbers
    y: _Numbers
    heading: _Numbers
    speed: _Numbers
    parts: tuple[_StoredPart, ...] = Field((), max_length=_MOST_PARTS)
    dodges: bool = False


def _rounded(values: Points) -> tuple[float, ...]:
    return tuple(round(float(value), _DECIMALS) for value in values)


def _stored_part(part: ScriptPart) -> _StoredPart:
    acts = tuple(
        _StoredAct(kind="speed", step=act.from_step, value=act.speed_mps, rate=act.rate_mps2)
        if isinstance(act, SpeedAct)
        else _StoredAct(kind="aside", step=act.from_step, value=act.aside_m, rate=act.duration_s)
        for act in part.acts
    )
    if part.trigger is None:
        return _StoredPart(step=part.step, acts=acts)
    by_gap = part.trigger.gap_s is not None
    return _StoredPart(
        step=part.step,
        acts=acts,
        lanelet=None if by_gap else part.trigger.lanelet_id,
        station=part.trigger.station_m,
        gap=part.trigger.gap_s,
    )


def _part(stored: _StoredPart) -> ScriptPart:
    acts = tuple(
        SpeedAct(act.step, act.value, act.rate) if act.kind == "speed" else LateralAct(act.step, act.value, act.rate)
        for act in stored.acts
    )
    if stored.lanelet is None and stored.gap is None:
        return ScriptPart(stored.step, acts)
    return ScriptPart(stored.step, acts, Trigger(stored.lanelet or 0, stored.station, stored.gap))
