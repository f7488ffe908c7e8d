"""A stop line lies outside its lanelet."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

FARTHEST_M = 3.0


def _find(document: RoadDocument) -> Iterator[Defect]:
    from shapely import LineString

    for lanelet in document.drawn:
        line = lanelet.stop_line
        if line is None or len(line.points) < 2 or not np.isfinite(line.points).all():
            continue
        distance = float(lanelet.polygon.distance(LineString(line.points)))
        if distance > FARTHEST_M:
            yield Defect(f"its stop line lies {distance:.1f} m outside", (lanelet.lanelet_id,), line.points[0])


RULE = Rule(
    rule_id="stop_line_misplaced",
    severity="warning",
    meaning="Both ends of a stop line lie more than 3 m outside the lanelet.",
    why="Vehicles would stop for a line that they do not cross.",
    find=_find,
)
