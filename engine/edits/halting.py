"""Driven vehicles that stop for others where their orders say so."""

from typing import Any

from plannerforge.engine.edits.braking import next_speed_mps
from plannerforge.engine.edits.participants import Participant


class Halting:
    """Tells the driven vehicles of one simulation, step by step, how fast they may be so that they stop in time."""

    def __init__(self, sumo: Any) -> None:
        self._sumo, self._vehicle = sumo, sumo.vehicle
        self._steps: dict[str, int] = {}
        self._rolled_m: dict[str, float] = {}

    def highest_speed(self, one: Participant, lane_id: str) -> float | None:  # noqa: ARG002 - halts are on any lane
        """The speed in m/s to brake to in the next step; None while a vehicle may drive as it likes."""
        if not one.halts or one.drive_from is None:
            return None
        speed_mps, step_s = float(self._vehicle.getSpeed(one.key)), float(self._sumo.simulation.getDeltaT())
        step = self._steps[one.key] = self._steps.get(one.key, one.drive_from - 1) + 1
        if step > one.drive_from:
            self._rolled_m[one.key] = self._rolled_m.get(one.key, 0.0) + speed_mps * step_s
        holding = [halt.rolled_m for halt in one.halts if halt.from_step <= step < halt.until_step]
        left_m = min(holding, default=None)
        if left_m is None:
            return None
        left_m -= self._rolled_m.get(one.key, 0.0)
        return next_speed_mps(speed_mps, one.behaviour.values["decel"], step_s, left_m, left_m)
