"""The two bounds of a lanelet cross."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    from shapely import LineString

    for lanelet in document.drawn:
        left, right = LineString(lanelet.left), LineString(lanelet.right)
        if left.crosses(right):
            place = left.intersection(right).representative_point()
            yield Defect("the bounds cross", (lanelet.lanelet_id,), np.array([place.x, place.y]))


RULE = Rule(
    rule_id="bounds_cross",
    severity="error",
    meaning="The left and the right bound cross each other.",
    why="Behind the crossing left is right: the drivable area is twisted.",
    find=_find,
)
