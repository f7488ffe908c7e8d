"""Manoeuvres of driven vehicles: a speed that is kept, lane changes, and a halt.

:class:`ManoeuvreExecutor` gives the orders of all driven vehicles to one simulation, step by step, and brakes vehicles
that a speed controller slows down.

SUMO's own drivers change lanes if the vehicle behind keeps a second's headway and could brake comfortably for a leader
that stops: on a motorway, that is 30 m ahead of an equally fast car. A cut-in that an edit requests needs less: there
is room if the vehicle behind can still brake for it (:func:`required_gap_m`).
"""

from collections import Counter
from dataclasses import dataclass

from ..network import USUAL_SPEED_MPS
from ..traffic import LaneChanges, Sumo
from ..vehicles import CUT_IN_REACTION_S

LANE_CHANGE_S = 2.5
"""Duration of a lane change, and how long an order to change lanes holds (chosen)."""
INTO_LANE_S = 0.8
"""Time from the start of a lane change until the vehicle is over the line (chosen): others then brake for it."""
HARD_BRAKING_MPS2 = 6.0
"""Deceleration required of a vehicle that is cut in on: UN Regulation 157 (automated lane keeping), 5.2.5.2."""
ROUNDING_MPS = 1e-6
"""Differences of speed below this are rounding errors."""


@dataclass(frozen=True)
class Manoeuvre:
    """An order that starts at a step: drive at ``speed_mps``, or change ``lanes_left`` lanes (1 left, -1 right).

    ``profile_mps``: the speeds of the first steps; then ``speed_mps`` is kept. An order without a speed is a lane
    change, here and in ``motion_of`` of ``engine/edits/scripted.py``. A new kind of order is a field here and a branch
    in :meth:`ManoeuvreExecutor.act`. A controller (``controllers.py``) can only make a vehicle slower.
    """

    from_step: int
    speed_mps: float | None = None
    lanes_left: int = 0
    profile_mps: tuple[float, ...] = ()

    def speed_at(self, step: int) -> float | None:
        """Return the ordered speed for a step."""
        since = step - self.from_step
        return self.profile_mps[since] if 0 <= since < len(self.profile_mps) else self.speed_mps


@dataclass(frozen=True)
class Halt:
    """An order to stop after driving at most ``rolled_m`` from the place where SUMO takes over.

    The order applies from ``from_step`` up to, but not including, ``until_step``, and at most until the vehicle has
    stood for ``stands_steps`` at that place (None: no such end).
    """

    from_step: int
    until_step: int
    rolled_m: float
    stands_steps: int | None = None


@dataclass(frozen=True)
class StopOrder:
    """An order to stop with the front at a place on the route, and to stand there for a number of steps.

    The place is given by lanelet and arc length, so it stays the same if a later edit hands the vehicle over earlier
    or changes its route. ``stands_steps`` is None if the vehicle stands until the scenario ends.
    """

    lanelet_id: int
    station_m: float
    stands_steps: int | None = None


def required_gap_m(closing_mps: float) -> float:
    """Return the gap in m, in addition to the standstill gap, that a driver needs at a closing speed in m/s."""
    closing = max(closing_mps, 0.0)
    return closing * (INTO_LANE_S + CUT_IN_REACTION_S) + closing**2 / (2 * HARD_BRAKING_MPS2)


_Order = tuple[str, int]
"""A vehicle and the index of one of its orders: two orders may be equal and are still two."""


class ManoeuvreExecutor:
    """Gives the orders of all driven vehicles, step by step, to one simulation.

    A lane change is requested until it is done: it waits for room, and SUMO adapts the speed to find it. If the
    adjacent lane does not exist yet (for example inside a junction), the change is requested on the next edge. If there
    are several changes, each one starts when the previous one is done.
    """

    def __init__(self, sumo: Sumo) -> None:
        self._sumo = sumo
        self._begun: dict[_Order, tuple[str, int]] = {}
        self._done: set[_Order] = set()
        self._waited_for: dict[_Order, Counter[str]] = {}
        self._braking: set[str] = set()

    def act(self, key: str, manoeuvres: tuple[Manoeuvre, ...], step: int, highest_mps: float | None = None) -> None:
        """Give a vehicle on the road the orders that apply at a step; if there are several speeds, the latest applies.

        ``highest_mps``: the speed that the vehicle must brake to in the next step, however hard it must brake.
        """
        if highest_mps is None and key in self._braking:
            self._release(key)
        is_changing = False
        for place, manoeuvre in enumerate(manoeuvres):
            if step < manoeuvre.from_step:
                continue
            if manoeuvre.speed_mps is None:
                if not is_changing:
                    self._change_lane((key, place), manoeuvre)
                is_changing = is_changing or (key, place) not in self._done
            else:
                self._keep_speed(key, manoeuvre.speed_at(step) or 0.0)
        if highest_mps is not None:
            self._braking.add(key)
            self._sumo.slow_down(key, highest_mps)

    def blocking(self, key: str) -> tuple[str, ...]:
        """Return the SUMO ids of vehicles that left no room for an unfinished lane change, longest-blocking first."""
        steps = sum((waited for (waiting, _), waited in self._waited_for.items() if waiting == key), Counter[str]())
        return tuple(sorted(steps, key=lambda other: (-steps[other], other)))

    def _release(self, key: str) -> None:
        self._braking.discard(key)
        self._sumo.release_speed(key)

    def _keep_speed(self, key: str, speed_mps: float) -> None:
        """Keep a speed, even above the limit, but no faster through a curve than its lane allows.

        A kept speed prevents SUMO from braking harder than the driver's deceleration. The speed is therefore released
        if that deceleration is too small.
        """
        if self._needs_hard_braking(key):
            self._release(key)
            return
        limit = self._sumo.limit_mps(self._sumo.lane(key))
        self._sumo.keep_speed(key, min(speed_mps, limit) if limit < USUAL_SPEED_MPS else speed_mps)

    def _needs_hard_braking(self, key: str) -> bool:
        """Return True if the driver's own deceleration is too small to avoid hitting the vehicle ahead."""
        leader = self._sumo.leader(key)
        if leader is None:
            return False
        slowest_mps = self._sumo.speed_mps(key) - self._sumo.decel_mps2(key) * self._sumo.step_s() - ROUNDING_MPS
        return self._sumo.safe_speed_mps(key, *leader) < slowest_mps

    def _change_lane(self, order: _Order, manoeuvre: Manoeuvre) -> None:
        key = order[0]
        edge, _, index = self._sumo.lane(key).rpartition("_")
        if order in self._done or not edge or edge.startswith(":"):
            return
        if self._begun.get(order, ("", 0))[0] != edge:
            wanted = int(index) + manoeuvre.lanes_left
            if not 0 <= wanted < self._sumo.lane_count(edge):
                return
            self._begun[order] = (edge, wanted)
        wanted = self._begun[order][1]
        if int(index) == wanted:
            self._done.add(order)
            self._waited_for.pop(order, None)
            self._sumo.allow_lane_changes(key, LaneChanges.FOR_THE_ROUTE)
            return
        blocking = self._too_near_in_next_lane(key, left=wanted > int(index))
        self._waited_for.setdefault(order, Counter()).update(blocking)
        self._sumo.allow_lane_changes(key, LaneChanges.DRIVERS_OWN if blocking else LaneChanges.INTO_ANY_ROOM)
        self._sumo.change_lane(key, wanted, LANE_CHANGE_S)

    def _too_near_in_next_lane(self, key: str, *, left: bool) -> tuple[str, ...]:
        """Return the vehicles in the adjacent lane that leave less than the required gap, followers first."""
        speed_mps = self._sumo.speed_mps(key)
        return tuple(
            str(other)
            for ahead in (False, True)
            for other, gap_m in self._sumo.neighbours(key, left=left, ahead=ahead)
            if gap_m < required_gap_m((-1.0 if ahead else 1.0) * (self._sumo.speed_mps(other) - speed_mps))
        )
