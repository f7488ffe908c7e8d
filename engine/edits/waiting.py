"""Vehicles that find no gap into the lane of their target wait beside it for one, instead of driving past it."""

from typing import Any

from plannerforge.engine.edits.braking import next_speed_mps
from plannerforge.engine.edits.manoeuvring import LANE_CHANGE_S
from plannerforge.engine.edits.participants import Participant

LAST_M = 0.5
"""So far before its end a lane counts as over; on a shorter one, half of it."""

TO_STEER_OVER_M = 15.0
"""A slow vehicle needs so much road to get into the lane beside; it waits so far before the end of its own.

One that needs several changes of lane waits so far for each of them.
"""

STEERING_OVER_MPS = 5.0
"""A vehicle with a gap beside it rolls on so fast on that road: SUMO begins no change of lane while it brakes hard."""

STEERING_OVER_M = 0.3
"""A vehicle so far beside the middle of its lane is not yet wholly in it."""

PASSING_MPS = "100"
"""The speed of a stop that is passed and not stopped at: above all that vehicles drive."""

SLOWER_MPS = 1.0
"""A speed limit lower by so little changes nobody's drive much."""


class Waiting:
    """Tells the driven vehicles of one simulation, step by step, how fast they may be so that they can still wait."""

    def __init__(self, sumo: Any) -> None:
        self._sumo, self._vehicle, self._lane = sumo, sumo.vehicle, sumo.lane
        self._told: set[str] = set()
        self._there: set[str] = set()
        self._first_lane: dict[str, str] = {}

    def highest_speed(self, one: Participant, lane_id: str) -> float | None:
        """The speed in m/s to brake to in the next step; None while a vehicle may drive as it likes.

        It looks for a gap until it has to brake with the driver's own deceleration, and stands where there is still
        road to steer over. One that comes too fast for that brakes as hard as it has to.
        """
        if one.target is None or not one.lanes_to_target or one.key in self._there:
            return None
        edge, _, index = lane_id.rpartition("_")
        if edge == one.target[0] and lane_id in one.lanes_to_target:
            self._there.add(one.key)
            return None
        self._tell(one, one.target, lane_id)
        if lane_id in one.lanes_to_target or not (edge in one.edges_to_target or edge.startswith(":")):
            return None
        left_m = self._left_m(one.key, *one.target)
        if left_m < -LAST_M:
            return None
        lane, wanted = int(index), _nearest_lane(one, edge, int(index))
        goes_on = wanted != lane and self._steers_over(one.key, lane_id, 1 if wanted > lane else -1)
        highest_mps = self._braked(one, left_m, abs(wanted - lane), goes_on=goes_on)
        if highest_mps is not None and wanted != lane:
            self._vehicle.changeLane(one.key, wanted, LANE_CHANGE_S)
        return highest_mps

    def _left_m(self, key: str, edge: str, index: int) -> float:
        """The way in m to the end of the target; far below 0 for a vehicle that is past it."""
        end_m = float(self._lane.getLength(f"{edge}_{index}"))
        return float(self._vehicle.getDrivingDistance(key, edge, end_m, index)) - min(LAST_M, end_m / 2)

    def _steers_over(self, key: str, lane_id: str, direction: int) -> bool:
        """Whether a vehicle has a gap beside it, or is not yet wholly over: it needs the rest of the road then."""
        comes_over = self._first_lane.setdefault(key, lane_id) != lane_id
        beside_m = abs(float(self._vehicle.getLateralLanePosition(key)))
        return (comes_over and beside_m > STEERING_OVER_M) or bool(self._vehicle.couldChangeLane(key, direction))

    def _braked(self, one: Participant, left_m: float, changes: int, *, goes_on: bool) -> float | None:
        """The next speed of a vehicle that has some way left for its changes of lane; if it goes on, one begins now."""
        speed, step_s = float(self._vehicle.getSpeed(one.key)), float(self._sumo.simulation.getDeltaT())
        usual, wait_m = one.behaviour.values["decel"], left_m - changes * TO_STEER_OVER_M
        if not goes_on:
            return next_speed_mps(speed, usual, step_s, wait_m, left_m)
        over_m = wait_m + TO_STEER_OVER_M
        if over_m > LAST_M:
            return next_speed_mps(speed, usual, step_s, wait_m, over_m, STEERING_OVER_MPS)
        return next_speed_mps(speed, usual, step_s, over_m, left_m)

    def _tell(self, one: Participant, target: tuple[str, int], lane_id: str) -> None:
        """Have SUMO look for gaps into the target's lane from far on, by a stop there that is passed.

        The speed limit of a stop's lane holds on the whole way there, so that a much slower one has its stop only when
        the vehicle is beside it, and one that may take several lanes has none. SUMO takes none for which the vehicle
        could not brake with ease.
        """
        if one.key in self._told:
            return
        edge, index = target
        limits = [self._lane.getMaxSpeed(f"{key}_0") for key in one.edges_to_target if key != edge]
        slower = max(limits, default=0.0) > self._lane.getMaxSpeed(f"{edge}_{index}") + SLOWER_MPS
        is_only = sum(key.rpartition("_")[0] == edge for key in one.lanes_to_target) == 1
        if not is_only or (slower and lane_id.rpartition("_")[0] != edge):
            return
        self._told.add(one.key)
        end_m = max(self._lane.getLength(f"{edge}_{index}") - LAST_M, LAST_M)
        try:
            self._vehicle.setStop(one.key, edge, end_m, index, 0.0)
        except self._sumo.TraCIException:
            return
        self._vehicle.setStopParameter(one.key, 0, "speed", PASSING_MPS)


def _nearest_lane(one: Participant, edge: str, index: int) -> int:
    """The nearest lane of an edge that leads to the target; the one named where none does."""
    found = [int(key.rpartition("_")[2]) for key in one.lanes_to_target if key.rpartition("_")[0] == edge]
    return min(found, key=lambda other: (abs(other - index), other), default=index)
