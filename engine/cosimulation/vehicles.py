"""Vehicles in a running SUMO simulation: put somewhere by hand, let drive, read."""

import math
from typing import Any

import numpy as np

from ..geometry import Points
from .actors import Actor, Hint
from .manoeuvres import DRIVEN_LANE_CHANGES, DRIVEN_SPEED_MODE
from .replay import KEEP_POSE, KEEP_ROUTE, MATCH_REACH_M, REPLAYED_LANE_CHANGES, REPLAYED_SPEED_MODE

# ---------- sumo_vehicles
# Vehicles in a running SUMO simulation: put somewhere by hand, let drive, read.


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

    def place_recorded(self, one: Actor, index: int) -> None:
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

    def is_astray(self, one: Actor) -> bool:
        """Whether SUMO took a placed vehicle for one on another road than its route."""
        return bool(self._sumo.vehicle.getRoute(one.key)[-1] != one.edges[-1])

    def state(self, one: Actor) -> tuple[float, float, float, float]:
        """Centre x and y in m, heading in rad and speed in m/s."""
        vehicle = self._sumo.vehicle
        x, y = vehicle.getPosition(one.key)
        heading = math.remainder(math.radians(90.0 - vehicle.getAngle(one.key)), math.tau)
        back = one.track.length_m / 2
        return x - back * math.cos(heading), y - back * math.sin(heading), heading, float(vehicle.getSpeed(one.key))


# ---------- shown_vehicle
# A vehicle that SUMO does not drive but shows to those that it drives: the ego, or a replayed road user.
#
# It is put by hand before every step, where the step ends. SUMO works out which lanes a vehicle laps into when that
# enters a lane, and not again while it is put elsewhere on the same lane: whoever drives on the next lane would never
# see it come over the line. So a vehicle that has come over a line, or back, enters anew: another entry of it is put
# where it is now, and the one that the others saw until then leaves after the step. Only then, because who enters a
# junction anew counts as the last there, and whoever follows would take itself for the first.


class ShownVehicle:
    """A road user of the type ``t<key>`` and its present entry in the simulation.

    Args:
        vehicles: those of the simulation.
        key: SUMO's id of its type.
        edges: its route.
    """

    def __init__(self, vehicles: SumoVehicles, key: str, edges: tuple[str, ...]) -> None:
        self._vehicles, self._key = vehicles, key
        self._entry, self._entry_before, self._entries = "", "", 0
        self._is_seen_elsewhere = False
        self._over: tuple[str, frozenset[str]] = "", frozenset()
        vehicles.add_route(key, edges)

    def place(
        self, center: Points, heading_rad: float, length_m: float, hint: Hint, width_m: float | None = None
    ) -> None:
        """Put its centre (2,) where the next step ends; ``width_m`` stands for the one of its type."""
        if not self._entry or self._is_seen_elsewhere:
            self._enter_anew()
        if width_m is not None:
            self._vehicles.set_width(self._entry, width_m)
        self._vehicles.place(self._entry, center, heading_rad, length_m, hint)

    def settle(self, speed_mps: float, there: frozenset[str]) -> None:
        """After the step: tell the others its speed, and let the entry before leave; ``there``: who is in SUMO."""
        self._vehicles.remove(self._entry_before)
        self._entry_before = ""
        if self._entry in there:
            self._vehicles.show_speed(self._entry, speed_mps)
            self._vehicles.hold(self._entry)
            self._look()
        else:
            self._entry = ""

    def leave(self) -> None:
        """Take it out of the simulation."""
        self._vehicles.remove(self._entry)

    def _look(self) -> None:
        """Compare the lines that it is over with those that it was over when it entered its lane."""
        lane, lines = self._vehicles.lines_lapped(self._entry)
        if lane != self._over[0]:
            self._over = lane, lines
        self._is_seen_elsewhere = lines != self._over[1]

    def _enter_anew(self) -> None:
        self._entry_before, self._entry = self._entry, f"{self._key}:{self._entries}"
        self._entries += 1
        self._over, self._is_seen_elsewhere = ("", frozenset()), False
        self._vehicles.add(self._entry, self._key)
