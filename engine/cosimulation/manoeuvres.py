"""Manoeuvres in a running simulation: a speed that is kept, and changes to the lane beside."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

from ..network import USUAL_SPEED_MPS

# ---------- lane_gaps
# Who leaves a driven vehicle no room in the lane beside, when an edit sends it there.
#
# SUMO's own drivers change where the one behind keeps a second's headway and could brake with ease for a leader that
# stops: on a motorway 30 m behind a car that is as fast. An edit that asks for a cut-in means less than that: there is
# room where whoever comes behind still can brake for it.

INTO_LANE_S = 0.8
"""So long after it began to change a vehicle is over the line; until then nobody behind brakes for it."""
REACTION_S, HARD_BRAKING_MPS2 = 0.35, 6.0
"""What is asked of who is cut in on: UN Regulation 157 (automated lane keeping), 5.2.5.2."""
FOLLOWERS, LEADERS = 0, 2
"""SUMO's modes of asking for neighbours on the left; those on the right are one more."""


class _LaneGaps:
    """Looks beside the vehicles of one simulation."""

    def __init__(self, sumo: Any) -> None:
        self._vehicle = sumo.vehicle

    def in_the_way(self, key: str, lanes_left: int) -> tuple[str, ...]:
        """SUMO's ids of those in the lane to the left (above 0) or right who are too near for a change into it."""
        side, speed_mps = 0 if lanes_left > 0 else 1, float(self._vehicle.getSpeed(key))
        found = []
        for mode, sign in ((FOLLOWERS, 1.0), (LEADERS, -1.0)):
            for other, gap_m in self._vehicle.getNeighbors(key, mode + side):
                closing_mps = sign * (float(self._vehicle.getSpeed(other)) - speed_mps)
                if gap_m < required_gap_m(closing_mps):
                    found.append(str(other))
        return tuple(found)


def required_gap_m(closing_mps: float) -> float:
    """The gap in m, beyond that kept when standing, that a driver needs who comes closer at a speed in m/s."""
    closing = max(closing_mps, 0.0)
    return closing * (INTO_LANE_S + REACTION_S) + closing**2 / (2 * HARD_BRAKING_MPS2)


# ---------- manoeuvring
# Manoeuvres in a running simulation: a speed that is kept, and changes to the lane beside.

LANE_CHANGE_S = 2.5
DRIVEN_SPEED_MODE = 31
ABOVE_THE_BRAKES = 27
"""SUMO's speed mode with all checks (gaps, power, right of way, lights) but that of the driver's own deceleration."""
ABOVE_THE_LIMIT = 95
"""SUMO's speed mode with all checks (gaps, power, brakes, right of way, lights) but that of the speed limit."""
ROUNDING_MPS = 1e-6
DRIVEN_LANE_CHANGES = 1621
"""SUMO's lane change mode with its drivers' own changes; it obeys an order to change where their gaps are kept."""
INTO_ANY_ROOM = 1365
"""SUMO's lane change mode that changes on an order wherever nobody is beside; who gives it looks for room himself."""
ONLY_FOR_THE_ROUTE = 1537
"""SUMO's lane change mode for a vehicle that was sent to its lane: it leaves it for its route alone, and safely."""


@dataclass(frozen=True)
class Manoeuvre:
    """An order from a step on: drive at ``speed_mps``, or change ``lanes_left`` lanes (1 left, -1 right)."""

    from_step: int
    speed_mps: float | None = None
    lanes_left: int = 0


@dataclass(frozen=True)
class Halt:
    """An order from a step on until another one: to roll no more than ``rolled_m`` from the hand-over on."""

    from_step: int
    until_step: int
    rolled_m: float


class Manoeuvring:
    """Gives the orders of all driven vehicles, step by step, to one simulation.

    A change of lane goes on until it is done: it waits for room, to which SUMO adapts the speed, and where the lane
    beside is not there yet (inside a junction, say) it is asked for on the next edge.
    """

    def __init__(self, sumo: Any) -> None:
        self._sumo, self._vehicle, self._edge, self._lane = sumo, sumo.vehicle, sumo.edge, sumo.lane
        self._gaps = _LaneGaps(sumo)
        self._begun: dict[tuple[str, Manoeuvre], tuple[str, int]] = {}
        self._done: set[tuple[str, Manoeuvre]] = set()
        self._waited_for: dict[tuple[str, Manoeuvre], Counter[str]] = {}
        self._braking: set[str] = set()

    def act(self, key: str, manoeuvres: tuple[Manoeuvre, ...], step: int, highest_mps: float | None = None) -> None:
        """Give the orders that hold at a step to a vehicle on the road; of several speeds, the latest holds.

        ``highest_mps``: the speed that it has to brake to in the next step, however hard that is.
        """
        if highest_mps is None and key in self._braking:
            self._let_go(key)
        for one in manoeuvres:
            if step < one.from_step:
                continue
            if one.speed_mps is None:
                self._change_lane(key, one)
            else:
                self._hold(key, one.speed_mps)
        if highest_mps is not None:
            self._brake(key, highest_mps)

    def in_the_way(self, key: str) -> tuple[str, ...]:
        """Who left a vehicle no room for a change of lane that is not done, SUMO's ids, the longest first."""
        found = sum((steps for (who, _), steps in self._waited_for.items() if who == key), Counter[str]())
        return tuple(sorted(found, key=lambda other: (-found[other], other)))

    def _brake(self, key: str, speed_mps: float) -> None:
        self._braking.add(key)
        self._vehicle.setSpeedMode(key, ABOVE_THE_BRAKES)
        self._vehicle.setSpeed(key, speed_mps)

    def _let_go(self, key: str) -> None:
        self._braking.discard(key)
        self._vehicle.setSpeedMode(key, DRIVEN_SPEED_MODE)
        self._vehicle.setSpeed(key, -1)

    def _hold(self, key: str, speed_mps: float) -> None:
        """Keep a speed, faster than the limit too, but no faster through a bend than its lane says.

        A speed that is kept keeps SUMO from braking harder than the driver likes: it is let go where that is too soft.
        """
        if self._needs_hard_braking(key):
            self._let_go(key)
            return
        limit = float(self._lane.getMaxSpeed(self._vehicle.getLaneID(key)))
        self._vehicle.setSpeedMode(key, ABOVE_THE_LIMIT)
        self._vehicle.setSpeed(key, min(speed_mps, limit) if limit < USUAL_SPEED_MPS else speed_mps)

    def _needs_hard_braking(self, key: str) -> bool:
        """Whether the driver's own deceleration does not keep a vehicle off the one ahead."""
        vehicle = self._vehicle
        ahead, gap_m = vehicle.getLeader(key) or ("", 0.0)
        if not ahead:
            return False
        speed_mps, ahead_mps = float(vehicle.getSpeed(key)), float(vehicle.getSpeed(ahead))
        safe_mps = vehicle.getFollowSpeed(key, speed_mps, gap_m, ahead_mps, vehicle.getApparentDecel(ahead), ahead)
        return bool(safe_mps < speed_mps - vehicle.getDecel(key) * self._sumo.simulation.getDeltaT() - ROUNDING_MPS)

    def _change_lane(self, key: str, one: Manoeuvre) -> None:
        edge, _, index = self._vehicle.getLaneID(key).rpartition("_")
        if (key, one) in self._done or not edge or edge.startswith(":"):
            return
        if self._begun.get((key, one), ("", 0))[0] != edge:
            wanted = int(index) + one.lanes_left
            if not 0 <= wanted < self._edge.getLaneNumber(edge):
                return
            self._begun[key, one] = (edge, wanted)
        wanted = self._begun[key, one][1]
        if int(index) == wanted:
            self._done.add((key, one))
            self._waited_for.pop((key, one), None)
            self._vehicle.setLaneChangeMode(key, ONLY_FOR_THE_ROUTE)
            return
        in_the_way = self._gaps.in_the_way(key, wanted - int(index))
        self._waited_for.setdefault((key, one), Counter()).update(in_the_way)
        self._vehicle.setLaneChangeMode(key, DRIVEN_LANE_CHANGES if in_the_way else INTO_ANY_ROOM)
        self._vehicle.changeLane(key, wanted, LANE_CHANGE_S)
