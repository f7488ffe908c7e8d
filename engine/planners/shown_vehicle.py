"""A vehicle that SUMO does not drive but shows to those that it drives: the ego, or a replayed road user.

It is put by hand before every step, where the step ends. SUMO works out which lanes a vehicle laps into when that
enters a lane, and not again while it is put elsewhere on the same lane: whoever drives on the next lane would never see
it come over the line. So a vehicle that has come over a line, or back, enters anew: another entry of it is put where it
is now, and the one that the others saw until then leaves after the step. Only then, because who enters a junction anew
counts as the last there, and whoever follows would take itself for the first.
"""

from plannerforge.engine.edits.participants import Hint
from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.planners.sumo_vehicles import SumoVehicles


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
