"""Left and right of a lanelet are swapped."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

SHORTEST_M = 0.2
"""Shorter lanelets have no direction to speak of; another rule names them."""


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.drawn:
        ahead = np.diff(lanelet.center, axis=0)
        if np.linalg.norm(ahead, axis=1).sum() < SHORTEST_M:
            continue
        across = ((lanelet.left - lanelet.right)[:-1] + (lanelet.left - lanelet.right)[1:]) / 2
        turned = ahead[:, 0] * across[:, 1] - ahead[:, 1] * across[:, 0]
        if turned.sum() < 0 and (turned < 0).mean() > 0.5:
            yield Defect("the left bound lies on the right", (lanelet.lanelet_id,), lanelet.center[0])


RULE = Rule(
    rule_id="bounds_swapped",
    severity="error",
    meaning="The left bound lies on the right of the right bound, seen in driving direction.",
    why="The lanelet leads against its own points: vehicles drive the wrong way.",
    find=_find,
)
