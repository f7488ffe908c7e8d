"""Neighbours share no bound."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

LARGEST_M = 2.0


def _find(document: RoadDocument) -> Iterator[Defect]:
    from shapely import LineString, distance, points

    for lanelet in document.drawn:
        for side, beside in (("left", lanelet.left_neighbour), ("right", lanelet.right_neighbour)):
            other = None if beside is None else document.by_id.get(beside.lanelet_id)
            if beside is None or other is None or not other.is_drawn:
                continue
            bound = lanelet.left if side == "left" else lanelet.right
            facing = other.right if (side == "left") == beside.same_direction else other.left
            apart = float(np.median(distance(points(bound), LineString(facing))))
            if apart > LARGEST_M:
                message = f"its {side} bound and that of neighbour {other.lanelet_id} lie {apart:.1f} m apart"
                yield Defect(message, (lanelet.lanelet_id, other.lanelet_id), bound[len(bound) // 2])


RULE = Rule(
    rule_id="neighbour_apart",
    severity="warning",
    meaning="The bounds of two neighbours that should be one lie more than 2 m apart over most of their length.",
    why="A lane change crosses ground that belongs to no lanelet, or the lanelets overlap.",
    find=_find,
)
