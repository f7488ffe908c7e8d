"""A lanelet has practically no length."""

from collections.abc import Iterator

from plannerforge.engine.geometry.polyline import length_m
from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

SHORTEST_M = 0.1


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.drawn:
        length = length_m(lanelet.center)
        if length < SHORTEST_M:
            yield Defect(f"{length:.3f} m long", (lanelet.lanelet_id,), lanelet.center[0])


RULE = Rule(
    rule_id="too_short",
    severity="warning",
    meaning="The centre line is shorter than 0.1 m.",
    why="Neither a position nor a heading on it means anything; it only splits the road.",
    find=_find,
)
