"""A coordinate is no finite number."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.lanelets:
        for side, bound in (("left", lanelet.left), ("right", lanelet.right)):
            wrong = int((~np.isfinite(bound)).any(axis=1).sum())
            if wrong:
                yield Defect(f"{wrong} point(s) of the {side} bound are not finite", (lanelet.lanelet_id,))


RULE = Rule(
    rule_id="coordinate_not_finite",
    severity="error",
    meaning="A coordinate of a bound is missing, infinite or no number.",
    why="Every length, distance and picture computed from it is undefined.",
    find=_find,
)
