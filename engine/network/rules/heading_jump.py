"""The road turns at once between two lanelets."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.geometry.polyline import headings, wrap_angle
from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

LARGEST_RAD = np.radians(45)


def _find(document: RoadDocument) -> Iterator[Defect]:
    for one, other in document.joins:
        before, after = one.path[-2:], other.path[:2]
        if len(before) < 2 or len(after) < 2:
            continue
        turn = abs(wrap_angle(float(headings(after)[0] - headings(before)[0])))
        if turn > LARGEST_RAD:
            message = f"turns by {np.degrees(turn):.0f}° into {other.lanelet_id}"
            yield Defect(message, (one.lanelet_id, other.lanelet_id), one.center[-1])


RULE = Rule(
    rule_id="heading_jump",
    severity="warning",
    meaning="The heading changes by more than 45° from the end of a lanelet to the beginning of its successor.",
    why="No vehicle can turn on the spot: the reference path has a corner.",
    find=_find,
)
