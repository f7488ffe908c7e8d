"""An arm of an intersection leads nowhere."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for intersection in document.intersections:
        for incoming in intersection.incomings:
            if incoming.lanelet_ids and not incoming.exit_ids:
                message = f"arm {incoming.incoming_id} names no way on"
                yield Defect(message, (intersection.intersection_id, incoming.incoming_id))


RULE = Rule(
    rule_id="incoming_without_exit",
    severity="warning",
    meaning="An arm of an intersection names no lanelet to the right, straight on or to the left.",
    why="Turning directions cannot be told: whoever comes from there seems to have no way on.",
    find=_find,
)
