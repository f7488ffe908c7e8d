"""A lanelet for motor vehicles is narrower than one."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

NARROWEST_M = 1.5
NOT_FOR_CARS = frozenset(
    {"sidewalk", "crosswalk", "bicycleLane", "border", "restricted", "restricted_area", "shoulder"}
)


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.drawn:
        width = float(np.median(lanelet.widths_m))
        if width < NARROWEST_M and not set(lanelet.types) & NOT_FOR_CARS:
            yield Defect(f"{width:.2f} m wide", (lanelet.lanelet_id,), lanelet.center[len(lanelet.center) // 2])


RULE = Rule(
    rule_id="too_narrow",
    severity="warning",
    meaning="A lanelet that is open to motor vehicles is narrower than 1.5 m over most of its length.",
    why="A car of 1.6 m and more cannot stay inside: every run there leaves the road.",
    find=_find,
)
