"""Who yields to whom where ways through a junction meet: turn rule for oncoming traffic, else right before left."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from plannerforge.engine.geometry.polyline import Points, wrap_angle
from plannerforge.engine.network.sumo_net_junctions import JunctionPath, crossing_of
from plannerforge.engine.network.sumo_net_layout import NetLayout

Table = NDArray[np.bool_]
_TURN_RANK = {"s": 0, "r": 0, "l": 1, "t": 2}
ONCOMING_COSINE = -0.7


@dataclass(frozen=True)
class Link:
    """A way through a junction with its shape (n, 2) in m and SUMO's direction letter."""

    path: JunctionPath
    shape: Points
    direction: str

    @cached_property
    def box(self) -> tuple[float, float, float, float]:
        """Least and greatest coordinates of the shape: x, y, x, y in m."""
        low, high = self.shape.min(axis=0), self.shape.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def may_cross(self, other: "Link") -> bool:
        """Whether the boxes around both shapes overlap, without which the shapes cannot cross."""
        mine, theirs = self.box, other.box
        return mine[0] <= theirs[2] and theirs[0] <= mine[2] and mine[1] <= theirs[3] and theirs[1] <= mine[3]


@dataclass(frozen=True)
class RightOfWay:
    """For the links of one junction: ``foes`` meet (symmetric), ``yields[i, j]``: link i lets link j go first."""

    foes: Table
    yields: Table


def direction_letter(shape: Points) -> str:
    """SUMO's letter for the turn along a way: s(traight), l(eft), r(ight) or t(urn around)."""
    first, last = shape[1] - shape[0], shape[-1] - shape[-2]
    turn = math.degrees(wrap_angle(math.atan2(last[1], last[0]) - math.atan2(first[1], first[0])))
    if abs(turn) > 150:
        return "t"
    if abs(turn) < 25:
        return "s"
    return "l" if turn > 0 else "r"


def decide_right_of_way(layout: NetLayout, links: list[Link]) -> RightOfWay:
    """Foes and priorities among the links of one junction."""
    count = len(links)
    foes, yields = np.zeros((count, count), dtype=bool), np.zeros((count, count), dtype=bool)
    for i in range(count):
        for j in range(i + 1, count):
            if _meet(layout, links[i], links[j]):
                foes[i, j] = foes[j, i] = True
                first_yields = _first_yields(links[i], links[j])
                yields[i, j], yields[j, i] = first_yields, not first_yields
    return RightOfWay(foes, yields)


def _meet(layout: NetLayout, first: Link, second: Link) -> bool:
    one, two = first.path, second.path
    if one.entry == two.entry:
        return False
    if one.exit == two.exit:
        return True
    if not (one.through and two.through):
        return False
    if set(one.through) & set(two.through):
        return True
    crossings = layout.interior.crossings
    if any(key in crossings.get(other, ()) for other in one.through for key in two.through):
        return True
    return first.may_cross(second) and crossing_of(first.shape, second.shape) is not None


def _first_yields(first: Link, second: Link) -> bool:
    if bool(first.path.through) != bool(second.path.through):
        return bool(first.path.through)
    one, two = first.shape[1] - first.shape[0], second.shape[1] - second.shape[0]
    cosine = float(one @ two) / (float(np.linalg.norm(one) * np.linalg.norm(two)) + 1e-9)
    ranks = _TURN_RANK[first.direction], _TURN_RANK[second.direction]
    if ranks[0] != ranks[1] and cosine < ONCOMING_COSINE:
        return ranks[0] > ranks[1]
    comes_from_right = float(one[0] * two[1] - one[1] * two[0])
    if abs(comes_from_right) < 1e-6:
        return first.path.entry > second.path.entry
    return comes_from_right > 0
