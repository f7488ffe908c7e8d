"""Road users with a motion that a file scripts in response to the ego: triggers evaluate the driven ego.

Each follows its script on its own clock. The clock runs with time, except that it waits for a trigger that lets the
road user set off, and that a dodging road user slows it down, which makes it brake along its path.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ....schemas.runs import TriggerOutcome
from ...commonroad import LoadedScenario, Track
from ...cosimulation import Script, ScriptPart, SpeedAct, beyond, scripted_track
from ...geometry import Points, oriented_rectangle, rectangles_overlap
from ...scene import Scene
from ...vehicles import STANDING_MPS, VehicleParameters
from ..interface import EgoState
from .recorded import GrowingTrack

_LOOK_S, _LOOK_EVERY_S = 1.0, 0.2
"""A dodging road user looks this far beyond its braking time, at this interval (chosen)."""
_ROOM_M = 1.0
"""Total clearance in length and width that a dodging road user keeps around the ego (chosen)."""


def scripts_of(loaded: LoadedScenario) -> dict[int, Script]:
    """Return the scripts of a file by the road user's id.

    Raises:
        UnsafeInput: The file has an unreadable script.
    """
    found = (Script.read(text, loaded.tracks) for text in loaded.script_texts)
    return {script.base.obstacle_id: script for script in found if script is not None}


@dataclass(frozen=True)
class _Ego:
    """The ego at one step: its state, and the same state as a track with the ego's size."""

    state: EgoState
    track: Track

    @classmethod
    def of(cls, state: EgoState, vehicle: VehicleParameters) -> "_Ego":
        track = Track(
            obstacle_id=-1,
            kind="car",
            length_m=vehicle.length_m,
            width_m=vehicle.width_m,
            first_step=state.step,
            positions=np.asarray(state.position, dtype=float)[None],
            headings_rad=np.array([state.heading_rad]),
            speeds_mps=np.array([state.speed_mps]),
        )
        return cls(state, track)


class ScriptedActor:
    """One road user that follows its script, up to the current step of the run."""

    def __init__(self, script: Script, scene: Scene, vehicle: VehicleParameters) -> None:
        self._scene, self._vehicle, self._dodges = scene, vehicle, script.dodges
        self._motion = script.base
        self._pending: list[ScriptPart] = list(script.parts)
        self._clock, self._pace = 0.0, 1.0
        self._begun: list[tuple[ScriptPart, int]] = []
        self._grown: GrowingTrack | None = None

    def triggers(self, first_step: int) -> list[TriggerOutcome]:
        """Return the triggers of the script and whether they have fired; times count from a step."""
        step_s, pending = self._scene.step_s, [(part, None) for part in self._pending]
        return [
            TriggerOutcome(
                obstacle_id=self._motion.obstacle_id,
                code="trigger_not_fired" if step is None else "trigger_fired",
                begins=_begun_kind(part),
                trigger=part.trigger.in_words(),
                time_s=None if step is None else round((step - first_step) * step_s, 9),
            )
            for part, step in [*self._begun, *pending]
            if part.trigger is not None
        ]

    @property
    def key(self) -> str:
        """The road user's SUMO id."""
        return str(self._motion.obstacle_id)

    @property
    def motion(self) -> Track:
        """The known part of its motion without slowing down."""
        return self._motion

    @property
    def driven(self) -> Track | None:
        """The actor's motion up to the present step; None before it is present."""
        return None if self._grown is None else self._grown.track()

    def state_at(self, step: int) -> tuple[Points, float, float] | None:
        """Return the actor's centre (2,), heading and speed at a step, or None if it is absent."""
        track = self.driven
        index = None if track is None else track.index_at(step)
        if track is None or index is None:
            return None
        return track.positions[index], float(track.headings_rad[index]), float(track.speeds_mps[index])

    @property
    def index(self) -> int:
        """The index of the state of the motion that is nearest to the present state."""
        return min(round(self._clock), len(self._motion.positions) - 1)

    def advance(self, ego: EgoState) -> None:
        """Advance to the step of the ego's new state, and start the parts that it triggers."""
        if self._grown is not None:
            self._clock += 0.0 if self._waits else self._pace
        elif self._waits:
            self._grown = GrowingTrack(self._motion, ego.step)
        elif ego.step >= self._motion.first_step:
            self._clock = float(ego.step - self._motion.first_step)
            self._grown = GrowingTrack(self._motion, ego.step)
        if self._grown is None or self._clock > len(self._motion.positions) - 1:
            return
        position, heading, speed = self._pose(self._clock)
        self._grown.add(float(position[0]), float(position[1]), heading, 0.0 if self._waits else speed * self._pace)
        seen = _Ego.of(ego, self._vehicle)
        self._set_off(seen, position)
        if self._dodges:
            self._choose_pace(seen)

    @property
    def _waits(self) -> bool:
        """True if the actor stands until a trigger lets it set off."""
        return any(part.trigger is not None and not part.acts for part in self._pending)

    def _set_off(self, ego: _Ego, place: Points) -> None:
        """Start the parts of the script that are due by their time or their trigger."""
        now = self._motion.first_step + round(self._clock)
        for part in list(self._pending):
            if part.trigger is None:
                is_due = now >= part.step
            else:
                is_due = part.trigger.holds(ego.track, 0, place, self._center_of)
            if not is_due:
                continue
            self._pending.remove(part)
            self._begun.append((part, ego.state.step))
            acts = part.acts_from(max(now, part.step) if part.trigger is None else now)
            scene = self._scene
            changed = scripted_track(self._motion, acts, beyond(scene, self._motion), scene.last_step, scene.step_s)
            self._motion = changed or self._motion

    def _center_of(self, lanelet_id: int) -> Points | None:
        lane = self._scene.layout.table.lanes.get(lanelet_id)
        return None if lane is None else lane.center

    def _pose(self, clock: float) -> tuple[Points, float, float]:
        """Return centre, heading and speed of the motion at a time between two of its states, in steps."""
        motion = self._motion
        low = min(math.floor(clock), len(motion.positions) - 1)
        high, share = min(low + 1, len(motion.positions) - 1), clock - low
        turn = math.remainder(float(motion.headings_rad[high] - motion.headings_rad[low]), math.tau)
        position: Points = motion.positions[low] * (1.0 - share) + motion.positions[high] * share
        speed = float(motion.speeds_mps[low] * (1.0 - share) + motion.speeds_mps[high] * share)
        return position, float(motion.headings_rad[low]) + share * turn, speed

    def _choose_pace(self, ego: _Ego) -> None:
        """Brake if that delays contact with the ego, otherwise return gently to the script's pace.

        If it meets the ego at the same time with either option, it brakes for an ego ahead, but not for one that comes
        from behind.
        """
        step_s, hardest = self._scene.step_s, self._vehicle.hardest_braking_mps2
        speed = max(float(self._motion.speeds_mps[self.index]), STANDING_MPS)
        faster = min(self._pace + self._vehicle.comfortable_mps2 * step_s / speed, 1.0)
        going_s, braking_s = (self._meets_after_s(ego, faster), self._meets_after_s(ego, self._pace, hardest))
        place, heading, _ = self._pose(self._clock)
        away = np.asarray(ego.state.position) - place
        is_ahead = float(away[0]) * math.cos(heading) + float(away[1]) * math.sin(heading) > 0.0
        if going_s < braking_s or (going_s == braking_s < math.inf and is_ahead):
            self._pace = max(self._pace - hardest * step_s / speed, 0.0)
        else:
            self._pace = faster

    def _meets_after_s(self, ego: _Ego, pace: float, braking_mps2: float = 0.0) -> float:
        """Return the time until it meets the ego at constant speed and heading; infinite beyond the braking time."""
        step_s, state, motion = self._scene.step_s, ego.state, self._motion
        speed = max(float(motion.speeds_mps[self.index]) * pace, STANDING_MPS)
        forward = np.array([math.cos(state.heading_rad), math.sin(state.heading_rad)])
        own_size = (motion.length_m + _ROOM_M, motion.width_m + _ROOM_M)
        reach_m = math.hypot(*own_size) / 2 + math.hypot(*ego.track.size_m) / 2
        for ahead_s in np.arange(_LOOK_EVERY_S, speed / self._vehicle.hardest_braking_mps2 + _LOOK_S, _LOOK_EVERY_S):
            rolling_s = min(ahead_s, speed / braking_mps2) if braking_mps2 else ahead_s
            rolled_s = rolling_s - braking_mps2 * rolling_s**2 / (2.0 * speed)
            clock = min(self._clock + pace * rolled_s / step_s, len(motion.positions) - 1.0)
            position, heading, _ = self._pose(clock)
            there = np.asarray(state.position) + forward * state.speed_mps * ahead_s
            if float(np.linalg.norm(there - position)) > reach_m:
                continue
            body = oriented_rectangle(there, state.heading_rad, ego.track.size_m)
            if rectangles_overlap(oriented_rectangle(position, heading, own_size), body):
                return float(ahead_s)
        return math.inf


def _begun_kind(part: ScriptPart) -> Literal["speed_change", "lateral_motion", "speed_and_lateral", "setting_off"]:
    kinds = {type(act) for act in part.acts}
    if not kinds:
        return "setting_off"
    if len(kinds) > 1:
        return "speed_and_lateral"
    return "speed_change" if SpeedAct in kinds else "lateral_motion"


def actors_of(scripts: Mapping[int, Script], scene: Scene, vehicle: VehicleParameters) -> dict[int, ScriptedActor]:
    """Return an actor for each script, by id."""
    return {key: ScriptedActor(script, scene, vehicle) for key, script in sorted(scripts.items())}
