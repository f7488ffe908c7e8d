"""A lanelet is wide enough for several lanes."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

WIDEST_M = 12.0


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.drawn:
        width = float(np.median(lanelet.widths_m))
        if width > WIDEST_M:
            yield Defect(f"{width:.1f} m wide", (lanelet.lanelet_id,), lanelet.center[len(lanelet.center) // 2])


RULE = Rule(
    rule_id="too_wide",
    severity="warning",
    meaning="A lanelet is wider than 12 m over most of its length.",
    why="Its centre line is no lane that anybody drives; probably a lane in between is missing or a bound is wrong.",
    find=_find,
)
