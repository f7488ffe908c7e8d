"""The branches of the next fork and how they bend, as seen in driving direction."""

import math
from dataclasses import dataclass

from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import point_at, wrap_angle
from plannerforge.schemas.errors import NotPossible

TURN_RAD, STRAIGHT_RAD = math.radians(50.0), math.radians(20.0)
BRANCH_M = 60.0
"""A branch is looked at no farther than this, so that a later bend of the road is no turn."""


@dataclass(frozen=True)
class Branch:
    """One way on at a fork: its lanelets up to the next fork, and its change of heading in rad (left positive)."""

    lanelets: tuple[int, ...]
    bend_rad: float

    @property
    def turn(self) -> str:
        """``left``, ``right``, ``straight``, or "" for a bend in between."""
        if abs(self.bend_rad) < STRAIGHT_RAD:
            return "straight"
        if abs(self.bend_rad) > TURN_RAD:
            return "left" if self.bend_rad > 0 else "right"
        return ""

    def __str__(self) -> str:
        """What the branch is, for an error that lists it."""
        side = "left" if self.bend_rad > 0 else "right"
        how = self.turn or f"slightly {side}"
        return f"{how} ({math.degrees(abs(self.bend_rad)):.0f}° {side}) on lanelet {self.lanelets[0]}"


def branches_at_next_fork(scene: Scene, start: int) -> tuple[Branch, ...]:
    """The branches of the first fork of a lanelet's own lane; none where the lane ends without one."""
    successors = scene.layout.table.successors
    current, seen = start, {start}
    while len(successors[current]) == 1 and successors[current][0] not in seen:
        current = successors[current][0]
        seen.add(current)
    if len(successors[current]) < 2:
        return ()
    arriving = _end_heading(scene, current)
    return tuple(_branch(scene, first, arriving) for first in successors[current])


def branch_for(scene: Scene, start: int, turn: str, who: str) -> Branch:
    """The branch that turns left or right or goes straight at the next fork.

    Raises:
        NotPossible: no fork ahead, or none of its branches goes that way; those there are are listed.
    """
    branches = branches_at_next_fork(scene, start)
    if not branches:
        raise NotPossible(f"{who} has no fork ahead in its lane", next_step="name a lanelet with 'to'")
    fitting = [branch for branch in branches if branch.turn == turn]
    if not fitting:
        raise NotPossible(f"{who} cannot go {turn} at the next fork", valid=branches, next_step="choose one of these")
    sign = {"left": -1.0, "right": 1.0}.get(turn)
    rank = (lambda branch: abs(branch.bend_rad)) if sign is None else (lambda branch: sign * branch.bend_rad)
    return min(fitting, key=rank)


def _branch(scene: Scene, first: int, arriving_rad: float) -> Branch:
    successors, lanes = scene.layout.table.successors, scene.layout.table.lanes
    chain, length = [first], lanes[first].length_m
    while len(successors[chain[-1]]) == 1 and successors[chain[-1]][0] not in chain and length < BRANCH_M:
        chain.append(successors[chain[-1]][0])
        length += lanes[chain[-1]].length_m
    return Branch(tuple(chain), wrap_angle(_end_heading(scene, first) - arriving_rad))


def _end_heading(scene: Scene, key: int) -> float:
    lane = scene.layout.table.lanes[key]
    return point_at(lane.center, lane.length_m)[1]
