"""Vehicles on a long lane, whose limit is that of its straights, slow down where it bends."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from plannerforge.engine.edits.braking import next_speed_mps
from plannerforge.engine.edits.participants import Participant
from plannerforge.engine.geometry.polyline import Values

BESIDE_M = 1.0
"""A place so little behind the bumper still counts: places are so far apart."""


class LongBends:
    """Tells the driven vehicles of one simulation, step by step, how fast they may be for the bends of long lanes.

    SUMO has one limit for all of a lane. That of its sharpest bend would slow the vehicles all along it.
    """

    def __init__(self, sumo: Any) -> None:
        self._sumo, self._vehicle, self._lane = sumo, sumo.vehicle, sumo.lane

    def highest_speed(self, one: Participant, lane_id: str) -> float | None:
        """The speed in m/s to brake to in the next step; None while a vehicle may drive as it likes.

        It brakes with the driver's own deceleration, and harder only where that comes too late.
        """
        if not one.slow_places or not lane_id:
            return None
        speed, step_s = float(self._vehicle.getSpeed(one.key)), float(self._sumo.simulation.getDeltaT())
        usual = one.behaviour.values["decel"]
        ahead = list(self._places_ahead(one, lane_id, speed * step_s + speed**2 / (2 * usual)))
        if not ahead:
            return None
        away_m, allowed_mps = (np.concatenate(column) for column in zip(*ahead, strict=True))
        return next_speed_mps(speed, usual, step_s, away_m, away_m, allowed_mps)

    def _places_ahead(self, one: Participant, lane_id: str, reach_m: float) -> Iterator[tuple[Values, Values]]:
        """Distances in m to the bends within reach on the route, and the speeds for them, lane by lane.

        A driver who is faster than others is so in bends too, as far as tyres hold.
        """
        factor = one.behaviour.values["speedFactor"]
        begin_m = -float(self._vehicle.getLanePosition(one.key))
        for lane in self._lanes_ahead(one, lane_id):
            if begin_m > reach_m:
                return
            if lane in one.slow_places:
                places = one.slow_places[lane]
                away_m = places.stations_m + begin_m
                near = away_m >= -BESIDE_M
                if near.any():
                    yield away_m[near], np.minimum(places.speeds_mps * factor, places.hardest_mps)[near]
            begin_m += float(self._lane.getLength(lane))

    def _lanes_ahead(self, one: Participant, lane_id: str) -> Iterator[str]:
        """The lane of a vehicle and those that follow it as SUMO sees them, ways through junctions included."""
        yield lane_id
        for link in self._vehicle.getNextLinks(one.key):
            yield from (lane for lane in (link[4], link[0]) if lane)
