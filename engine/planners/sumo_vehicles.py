"""Vehicles in a running SUMO simulation: put somewhere by hand, let drive, read."""

import math
from typing import Any

import numpy as np

from plannerforge.engine.edits.manoeuvring import DRIVEN_LANE_CHANGES, DRIVEN_SPEED_MODE
from plannerforge.engine.edits.participants import Hint, Participant
from plannerforge.engine.edits.resimulation import (
    KEEP_POSE,
    KEEP_ROUTE,
    MATCH_REACH_M,
    REPLAYED_LANE_CHANGES,
    REPLAYED_SPEED_MODE,
)
from plannerforge.engine.geometry.polyline import Points


class SumoVehicles:
    """The vehicles of the simulation in libsumo, which knows front bumpers and degrees clockwise from north."""

    def __init__(self, sumo: Any) -> None:
        self._sumo = sumo

    def step(self) -> frozenset[str]:
        """Simulate one step; the vehicles that are there after it.

        A pose far from every lane makes a vehicle vanish without an error.
        """
        self._sumo.simulationStep()
        return frozenset(self._sumo.vehicle.getIDList())

    def insert(self, key: str, edges: tuple[str, ...]) -> None:
        """Add a vehicle of the type ``t<key>``; it must be placed before the next step."""
        self.add_route(key, edges)
        self.add(key, key)

    def add_route(self, key: str, edges: tuple[str, ...]) -> None:
        """Add the route that vehicles of the type ``t<key>`` take."""
        self._sumo.route.add(f"r{key}", edges)

    def add(self, name: str, key: str) -> None:
        """Add one more vehicle of the type ``t<key>`` on that type's route; it must be placed before the next step."""
        self._sumo.vehicle.add(name, f"r{key}", f"t{key}", depart="now", departLane="0", departPos="0")

    def remove(self, key: str) -> None:
        """Take a vehicle out, if it is still there."""
        if key in self._sumo.vehicle.getIDList():
            self._sumo.vehicle.remove(key)

    def place_recorded(self, one: Participant, index: int) -> None:
        """Put a vehicle at a pose of its recording, where the next step ends."""
        track = one.track
        heading, keep = float(track.headings_rad[index]), KEEP_ROUTE if one.keep_to_route else KEEP_POSE
        self.place(one.key, track.positions[index], heading, track.length_m, one.hint_at(index), keep)

    def place(
        self, key: str, center: Points, heading_rad: float, length_m: float, hint: Hint, keep: int = KEEP_POSE
    ) -> None:
        """Put a vehicle's centre (2,) somewhere, where the next step ends."""
        x, y = center + length_m / 2 * np.array([math.cos(heading_rad), math.sin(heading_rad)])
        angle = (90.0 - math.degrees(heading_rad)) % 360.0
        self._sumo.vehicle.moveToXY(key, *hint, float(x), float(y), angle, keep, MATCH_REACH_M)

    def set_width(self, key: str, width_m: float) -> None:
        """Change how wide a vehicle is."""
        self._sumo.vehicle.setWidth(key, width_m)

    def lines_lapped(self, key: str) -> tuple[str, frozenset[str]]:
        """The lane of a vehicle, and over which of its lines (``left``, ``right``) the body sticks out."""
        lane = str(self._sumo.vehicle.getLaneID(key))
        aside, half = self._sumo.vehicle.getLateralLanePosition(key), self._sumo.vehicle.getWidth(key) / 2
        edge = self._sumo.lane.getWidth(lane) / 2 if lane else math.inf
        over = {"left": aside + half > edge, "right": aside - half < -edge}
        return lane, frozenset(side for side, is_over in over.items() if is_over)

    def show_speed(self, key: str, speed_mps: float) -> None:
        """Tell the others the speed of a vehicle that is placed by hand."""
        self._sumo.vehicle.setPreviousSpeed(key, max(speed_mps, 0.0))

    def hold(self, key: str) -> None:
        """Keep SUMO from driving a vehicle that is placed by hand."""
        self._sumo.vehicle.setSpeedMode(key, REPLAYED_SPEED_MODE)
        self._sumo.vehicle.setLaneChangeMode(key, REPLAYED_LANE_CHANGES)

    def let_drive(self, key: str, speed_mps: float) -> None:
        """SUMO drives from now on, beginning with this speed."""
        vehicle = self._sumo.vehicle
        vehicle.setPreviousSpeed(key, max(speed_mps, 0.0))
        vehicle.setSpeed(key, -1)
        vehicle.setSpeedMode(key, DRIVEN_SPEED_MODE)
        vehicle.setLaneChangeMode(key, DRIVEN_LANE_CHANGES)

    def is_astray(self, one: Participant) -> bool:
        """Whether SUMO took a placed vehicle for one on another road than its route."""
        return bool(self._sumo.vehicle.getRoute(one.key)[-1] != one.edges[-1])

    def state(self, one: Participant) -> tuple[float, float, float, float]:
        """Centre x and y in m, heading in rad and speed in m/s."""
        vehicle = self._sumo.vehicle
        x, y = vehicle.getPosition(one.key)
        heading = math.remainder(math.radians(90.0 - vehicle.getAngle(one.key)), math.tau)
        back = one.track.length_m / 2
        return x - back * math.cos(heading), y - back * math.sin(heading), heading, float(vehicle.getSpeed(one.key))
