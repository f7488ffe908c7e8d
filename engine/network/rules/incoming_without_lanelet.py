"""An arm of an intersection has no lanelet."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for intersection in document.intersections:
        for incoming in intersection.incomings:
            if not incoming.lanelet_ids:
                message = f"arm {incoming.incoming_id} names no lanelet that leads in"
                yield Defect(message, (intersection.intersection_id, incoming.incoming_id))


RULE = Rule(
    rule_id="incoming_without_lanelet",
    severity="error",
    meaning="An arm of an intersection names no lanelet that leads in.",
    why="Nobody can come from there, so the arm has no meaning.",
    find=_find,
)
