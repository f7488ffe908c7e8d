"""An arm leads to a lanelet that does not follow it."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    known = document.by_id
    for intersection in document.intersections:
        for incoming in intersection.incomings:
            behind = {key for own in incoming.lanelet_ids if own in known for key in known[own].successors}
            for key in sorted(set(incoming.exit_ids) & set(known) - behind):
                message = f"lanelet {key} follows no lanelet of arm {incoming.incoming_id}"
                yield Defect(message, (intersection.intersection_id, incoming.incoming_id, key))


RULE = Rule(
    rule_id="exit_not_behind_incoming",
    severity="error",
    meaning="A lanelet to the right, straight on or to the left follows none of the lanelets of its arm.",
    why="The turning direction that the intersection states cannot be driven.",
    find=_find,
)
