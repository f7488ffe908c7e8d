"""A lanelet stands still between two of its points."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

TOLERANCE_M = 1e-3


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.drawn:
        steps = np.linalg.norm(np.diff(lanelet.center, axis=0), axis=1)
        for index in np.flatnonzero(steps < TOLERANCE_M):
            message = f"points {index + 1} and {index + 2} of the centre line are the same"
            yield Defect(message, (lanelet.lanelet_id,), lanelet.center[index])


RULE = Rule(
    rule_id="repeated_points",
    severity="warning",
    meaning="Two consecutive points of the centre line are the same.",
    why="The heading between them is undefined; planners that divide by the distance fail there.",
    find=_find,
)
