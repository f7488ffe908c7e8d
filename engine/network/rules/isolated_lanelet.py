"""A lanelet hangs together with nothing."""

from collections.abc import Iterator

from plannerforge.engine.geometry.polyline import length_m
from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

LONGEST_M = 50.0
"""A longer one may be a road of its own that was cut out at both ends."""


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.lanelets if len(document.lanelets) > 1 else ():
        connected = lanelet.predecessors or lanelet.successors or lanelet.neighbours
        if not connected and lanelet.is_drawn and length_m(lanelet.center) < LONGEST_M:
            yield Defect("has neither predecessor, successor nor neighbour", (lanelet.lanelet_id,), lanelet.center[0])


RULE = Rule(
    rule_id="isolated_lanelet",
    severity="warning",
    meaning="A lanelet shorter than 50 m, one of several, has neither predecessor, successor nor neighbour.",
    why="Nobody can get there or away; mostly a connection was forgotten.",
    find=_find,
)
