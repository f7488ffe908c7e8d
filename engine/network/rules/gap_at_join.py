"""A lanelet does not begin where the one before it ends."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

LARGEST_M = 1.0


def _find(document: RoadDocument) -> Iterator[Defect]:
    for one, other in document.joins:
        gap = float(np.linalg.norm(other.center[0] - one.center[-1]))
        if gap > LARGEST_M:
            message = f"{gap:.2f} m between its end and the beginning of {other.lanelet_id}"
            yield Defect(message, (one.lanelet_id, other.lanelet_id), one.center[-1])


RULE = Rule(
    rule_id="gap_at_join",
    severity="warning",
    meaning="End and beginning of two consecutive lanelets lie more than 1 m apart.",
    why="Reference paths jump there, which no vehicle can follow.",
    find=_find,
)
