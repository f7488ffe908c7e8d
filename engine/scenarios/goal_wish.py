"""The goal as asked, and the step of a recorded car at which it is there."""

import math
import re
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.geometry.polyline import Points, Values, arc_length, point_at, wrap_angle
from plannerforge.engine.network.lanelet_lookup import WIDEST_TURN_RAD
from plannerforge.engine.network.positions import station_m
from plannerforge.engine.network.road_network import RoadLanelet, RoadNetwork
from plannerforge.engine.traffic.motions import Participant
from plannerforge.schemas.errors import InvalidRequest, UnknownName, closest

SHORTEST_WAY_M = 10.0
SHORTEST_ASKED_WAY_M = 4.0
LARGEST_GAP_M = 3.0
"""Half the way of a car between two steps, at most: one that is recorded farther before or behind stops short of it."""

FARTHEST_ASIDE_M = 1.5
MIDDLE = "middle"
FORMS = (
    "steps:N (10 to 1000)",
    "distance_m:X (5 to 2000)",
    "lanelet:ID:POSITION, also lanelet:ID:POSITION:LENGTHxWIDTH",
)


@dataclass(frozen=True)
class LaneletGoal:
    """A goal on a lanelet: a position word, fraction or metres along it, and the rectangle (length, width) in m."""

    lanelet_id: int
    position: str
    size_m: tuple[float, float] | None


@dataclass(frozen=True)
class GoalWish:
    """The goal as asked: after a number of steps, after a distance in m on the ego's own way, or on a lanelet."""

    steps: int | None = None
    distance_m: float | None = None
    lanelet: LaneletGoal | None = None

    @property
    def shortest_way_m(self) -> float:
        """So far a car has to drive to the goal at least."""
        return SHORTEST_WAY_M if self.steps is not None else SHORTEST_ASKED_WAY_M

    def __str__(self) -> str:
        if self.lanelet is not None:
            return f"on lanelet {self.lanelet.lanelet_id} ({self.lanelet.position})"
        return f"{self.steps} steps ahead" if self.steps is not None else f"{self.distance_m:g} m ahead"


@dataclass(frozen=True)
class Passage:
    """Where a car is when it is at the goal: the step, the goal's middle (2,) in m and heading."""

    step: int
    center: Points
    heading_rad: float


def parse_goal(text: str) -> GoalWish:
    """Read ``steps:N``, ``distance_m:X`` or ``lanelet:ID[:POSITION[:LENGTHxWIDTH]]``; the usual position is the middle.

    Raises:
        InvalidRequest: none of these, or outside 10 … 1000 steps, 5 … 2000 m, or a rectangle of 0.5 … 500 m.
    """
    if (match := re.fullmatch(r"steps:(\d{1,5})", text)) and 10 <= int(match[1]) <= 1000:
        return GoalWish(steps=int(match[1]))
    if (match := re.fullmatch(r"distance_m:(\d{1,5}(?:\.\d+)?)", text)) and 5 <= float(match[1]) <= 2000:
        return GoalWish(distance_m=float(match[1]))
    if match := re.fullmatch(r"lanelet:(\d{1,9})(?::([a-z_]+|[\d.]+m?))?(?::([\d.]+)x([\d.]+))?", text):
        try:
            size = (float(match[3]), float(match[4])) if match[3] else None
        except ValueError:
            size = (0.0, 0.0)
        if size is None or all(0.5 <= side <= 500 for side in size):
            return GoalWish(lanelet=LaneletGoal(int(match[1]), match[2] or MIDDLE, size))
    raise InvalidRequest(f"goal {text!r} cannot be read", valid=FORMS)


def check_lanelet(goal: GoalWish, network: RoadNetwork) -> None:
    """Refuse a lanelet that the network does not have, or a place beyond it.

    Raises:
        UnknownName: there is no such lanelet; ids are known only once a scenario of the site is made.
        InvalidRequest: the position is none, or lies beyond the lanelet.
    """
    if goal.lanelet is None:
        return
    key = goal.lanelet.lanelet_id
    if key not in network.lanelets:
        raise UnknownName(
            f"the site has no lanelet {key}: ids are known once a scenario of it is made",
            valid=closest(str(key), [str(one) for one in sorted(network.lanelets)]),
            next_step="generate with another goal and ask describe_scenario first, or use modify_scenario afterwards",
        )
    station_m(goal.lanelet.position, key, float(arc_length(network.lanelets[key].center)[-1]))


def passage(goal: GoalWish, car: Participant, network: RoadNetwork) -> Passage | None:
    """Where and when a car is at the goal; None if it is not there within its recording, or too near to its start."""
    gone = arc_length(car.motion.positions)
    if goal.lanelet is not None:
        return _on_lanelet(goal.lanelet, car, network.lanelets[goal.lanelet.lanelet_id], gone)
    step = _ahead(goal, gone)
    if step is None or gone[step] < goal.shortest_way_m:
        return None
    return Passage(step, car.motion.positions[step], float(car.motion.headings_rad[step]))


def _ahead(goal: GoalWish, gone: Values) -> int | None:
    if goal.steps is not None:
        return goal.steps if goal.steps < len(gone) else None
    reached = np.flatnonzero(gone >= (goal.distance_m or 0.0))
    return int(reached[0]) if len(reached) else None


def _on_lanelet(goal: LaneletGoal, car: Participant, lanelet: RoadLanelet, gone: Values) -> Passage | None:
    """The step at which the car is nearest to the place, if it drives over it along the lanelet.

    A rectangle that already holds the car at its start is no goal.
    """
    station = station_m(goal.position, lanelet.lanelet_id, float(arc_length(lanelet.center)[-1]))
    center, heading = point_at(lanelet.center, station)
    offsets = car.motion.positions - center
    step = int(np.argmin(np.linalg.norm(offsets, axis=1)))
    forward = np.array([math.cos(heading), math.sin(heading)])
    leftward = np.array([-forward[1], forward[0]])
    ahead, aside = offsets[step] @ forward, offsets[step] @ leftward
    length, width = goal.size_m or (0.0, 0.0)
    if abs(offsets[0] @ forward) <= length / 2 and abs(offsets[0] @ leftward) <= width / 2:
        return None
    turned = wrap_angle(float(car.motion.headings_rad[step]) - heading)
    passes = abs(ahead) < LARGEST_GAP_M and abs(aside) < FARTHEST_ASIDE_M and abs(turned) < WIDEST_TURN_RAD
    return Passage(step, center, heading) if passes and gone[step] >= SHORTEST_ASKED_WAY_M else None
