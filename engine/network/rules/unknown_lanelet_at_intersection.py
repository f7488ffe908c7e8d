"""An intersection refers to something that is not there."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for intersection in document.intersections:
        arms = {incoming.incoming_id for incoming in intersection.incomings}
        for incoming in intersection.incomings:
            for key in sorted({*incoming.lanelet_ids, *incoming.exit_ids} - set(document.by_id)):
                message = f"lanelet {key} of arm {incoming.incoming_id} is not in the file"
                yield Defect(message, (intersection.intersection_id, key))
            if incoming.left_of is not None and incoming.left_of not in arms:
                message = f"arm {incoming.left_of}, which arm {incoming.incoming_id} is left of, is not there"
                yield Defect(message, (intersection.intersection_id, incoming.left_of))


RULE = Rule(
    rule_id="unknown_lanelet_at_intersection",
    severity="error",
    meaning="An intersection names a lanelet or an arm that is not in the file.",
    why="Right of way and turning directions there are undefined; the reader may fail.",
    find=_find,
)
