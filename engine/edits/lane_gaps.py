"""Who leaves a driven vehicle no room in the lane beside, when an edit sends it there.

SUMO's own drivers change where the one behind keeps a second's headway and could brake with ease for a leader that
stops: on a motorway 30 m behind a car that is as fast. An edit that asks for a cut-in means less than that: there is
room where whoever comes behind still can brake for it.
"""

from typing import Any

INTO_LANE_S = 0.8
"""So long after it began to change a vehicle is over the line; until then nobody behind brakes for it."""

REACTION_S, HARD_BRAKING_MPS2 = 0.35, 6.0
"""What is asked of who is cut in on: UN Regulation 157 (automated lane keeping), 5.2.5.2."""

FOLLOWERS, LEADERS = 0, 2
"""SUMO's modes of asking for neighbours on the left; those on the right are one more."""


class LaneGaps:
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
                if gap_m < least_gap_m(closing_mps):
                    found.append(str(other))
        return tuple(found)


def least_gap_m(closing_mps: float) -> float:
    """The gap in m, beyond that kept when standing, that a driver needs who comes closer at a speed in m/s."""
    closing = max(closing_mps, 0.0)
    return closing * (INTO_LANE_S + REACTION_S) + closing**2 / (2 * HARD_BRAKING_MPS2)
