"""A stop line lies where the lanelet begins."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.geometry.polyline import length_m, project
from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

SHORTEST_M = 10.0


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.drawn:
        line = lanelet.stop_line
        if line is None or len(line.points) < 2 or not np.isfinite(line.points).all():
            continue
        length = length_m(lanelet.center)
        station, _ = project(lanelet.center, line.points.mean(axis=0))
        if length >= SHORTEST_M and station < length / 2:
            message = f"its stop line lies {station:.1f} m behind the beginning of {length:.1f} m"
            yield Defect(message, (lanelet.lanelet_id,), line.points[0])


RULE = Rule(
    rule_id="stop_line_at_beginning",
    severity="warning",
    meaning="The middle of a stop line lies nearer to the beginning than to the end of a lanelet of 10 m and more.",
    why="Vehicles would stop far from the junction that the line is for, or behind it.",
    find=_find,
)
