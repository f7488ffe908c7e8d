"""A lanelet folds back on itself."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.geometry.polyline import headings, wrap_angles
from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

SHARPEST_RAD = np.radians(120)


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.drawn:
        center = lanelet.path
        turns = np.abs(wrap_angles(np.diff(headings(center)))) if len(center) > 2 else np.zeros(0)
        for index in np.flatnonzero(turns > SHARPEST_RAD):
            turn = np.degrees(turns[index])
            yield Defect(f"turns by {turn:.0f}° at one point", (lanelet.lanelet_id,), center[index + 1])


RULE = Rule(
    rule_id="folds_back",
    severity="warning",
    meaning="The centre line turns by more than 120° at one point.",
    why="No vehicle can follow it, and the arc length along it does not grow with the way made.",
    find=_find,
)
