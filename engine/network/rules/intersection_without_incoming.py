"""An intersection has no arm."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for intersection in document.intersections:
        if not intersection.incomings:
            yield Defect("has no incoming arm", (intersection.intersection_id,))


RULE = Rule(
    rule_id="intersection_without_incoming",
    severity="error",
    meaning="An intersection has no incoming arm.",
    why="The schema asks for one; the intersection says nothing.",
    find=_find,
)
