"""Vehicles that were sent round a bend for which their driver's own deceleration comes too late."""

from typing import Any

from plannerforge.engine.edits.participants import Participant
from plannerforge.engine.edits.turn_speed import HARDEST_BRAKING_MPS2

SHORTEST_M = 0.1


class EarlyBraking:
    """Tells those of one simulation, step by step, how fast they may be for the lanes ahead.

    SUMO plans with the driver's own deceleration: whoever is handed over nearer to a bend than that takes comes to it
    too fast, and gets slow in it within a step or two.
    """

    def __init__(self, sumo: Any) -> None:
        self._sumo, self._vehicle, self._lane = sumo, sumo.vehicle, sumo.lane
        self._done: set[str] = set()

    def highest_speed(self, one: Participant, lane_id: str) -> float | None:
        """The speed in m/s to brake to in the next step; None for a driver whom the own deceleration suffices."""
        if one.key in self._done or not one.is_sent or not lane_id:
            return None
        speed, step_s = float(self._vehicle.getSpeed(one.key)), float(self._sumo.simulation.getDeltaT())
        needed = self._needed(one.key, lane_id, speed)
        if needed <= one.behaviour.values["decel"]:
            self._done.add(one.key)
            return None
        return max(speed - min(needed, HARDEST_BRAKING_MPS2) * step_s, 0.0)

    def _needed(self, key: str, lane_id: str, speed_mps: float) -> float:
        """The deceleration in m/s² that brings a vehicle to the limit of every lane ahead where that begins."""
        ahead_m = float(self._lane.getLength(lane_id) - self._vehicle.getLanePosition(key))
        needed = 0.0
        for link in self._vehicle.getNextLinks(key):
            for lane in (link[4], link[0]):
                if lane:
                    over = speed_mps**2 - float(self._lane.getMaxSpeed(lane)) ** 2
                    needed = max(needed, over / (2 * max(ahead_m, SHORTEST_M)))
                    ahead_m += float(self._lane.getLength(lane))
        return needed
