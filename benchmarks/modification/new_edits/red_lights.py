"""Finds vehicles that cross the end of a lanelet at red, from the written file alone."""

import math
from dataclasses import dataclass

import numpy as np

from ..written_tracks import Lane, Light, RoadUser, WrittenFile

OVER_M = 1.0
"""A front this far past the line has crossed it; a nose over the line has not."""
YELLOW_EXCUSE_MPS2 = 4.5
"""A vehicle that cannot stop at this deceleration when the light ceases to be green is excused (SUMO's default)."""
HARDEST_MPS2 = 8.0
"""A vehicle taken over so close to the line that it cannot stop at this deceleration is excused."""
_TURNS = {
    "left": ("left",),
    "straight": ("straight",),
    "right": ("right",),
    "leftStraight": ("left", "straight"),
    "straightRight": ("straight", "right"),
    "leftRight": ("left", "right"),
    "all": ("left", "straight", "right"),
}
_STRAIGHT_RAD = math.radians(30.0)
_BLURRED_RAD = math.radians(20.0)
"""A turn this close to the border between two words counts as either."""


@dataclass(frozen=True)
class Crossing:
    """A road user that crosses the end of a lanelet at red, and the time step at which it does."""

    key: int
    lane: int
    step: int


def red_crossings(file: WrittenFile, key: int, since: int) -> list[Crossing]:
    """Return a road user's crossings at red after a time step (the last one at which it replays its recording)."""
    user, found = file.users[key], []
    for lane in file.lanes.values():
        lights = [file.lights[light] for light in lane.lights if light in file.lights]
        if not lights or len(lane.center) < 2:
            continue
        step = crossed(user, lane)
        if step is None or step <= since:
            continue
        holding = [light for light in lights if _holds(file, lane, user, step, light.direction)]
        colours = {light.colour(step) for light in holding}
        if colours and colours <= {"red", "redYellow"} and not _excused(user, lane, step, since, holding):
            found.append(Crossing(key, lane.key, step))
    return found


def crossed(user: RoadUser, lane: Lane) -> int | None:
    """Return the step at which the front passes the end of a lane on the road user's route, or None."""
    stations, offsets, directions = lane.along(user.fronts)
    aligned = np.abs(np.remainder(user.headings - directions + np.pi, 2 * np.pi) - np.pi) < math.radians(45.0)
    on = aligned & (np.abs(offsets) < lane.width_m / 2) & (stations > lane.length_m - 25.0)
    before, after = stations <= lane.length_m, stations > lane.length_m
    for index in range(len(stations) - 1):
        if on[index] and before[index] and after[index + 1] and stations[index + 1] < lane.length_m + 5.0:
            over = np.flatnonzero(stations[index + 1 :] > lane.length_m + OVER_M)
            return user.first + index + 1 + int(over[0]) if len(over) else None
    return None


def _holds(file: WrittenFile, lane: Lane, user: RoadUser, step: int, direction: str) -> bool:
    """Return True if a light for a direction applies to a road user's path after the lane."""
    if direction == "all":
        return True
    index = min(step - user.first + round(3.0 / file.step_s), len(user.headings) - 1)
    end = lane.center[-1] - lane.center[-2]
    turned = math.remainder(float(user.headings[index]) - math.atan2(end[1], end[0]), math.tau)
    words = set()
    for shift in (-_BLURRED_RAD, _BLURRED_RAD):
        angle = turned + shift
        words.add("straight" if abs(angle) < _STRAIGHT_RAD else "left" if angle > 0 else "right")
    return words <= set(_TURNS.get(direction, ()))


def _excused(user: RoadUser, lane: Lane, step: int, since: int, lights: list[Light]) -> bool:
    """Return True if it could stop neither when the light ceased to be green nor when its driving began."""
    last_green = next(
        (past for past in range(step, user.first - 1, -1) if any(light.colour(past) == "green" for light in lights)),
        None,
    )
    stations = lane.along(user.fronts)[0]

    def could_stop(at: int, mps2: float) -> bool:
        index = min(max(at - user.first, 0), len(stations) - 1)
        return float(user.speeds[index]) ** 2 / (2 * mps2) < lane.length_m - float(stations[index])

    begins = max(since, user.first)
    if last_green is not None and last_green >= begins:
        return not could_stop(last_green, YELLOW_EXCUSE_MPS2)
    return not could_stop(begins, HARDEST_MPS2)
