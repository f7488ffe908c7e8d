"""Only one of two lanelets knows that they lie side by side."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    known = document.by_id
    for lanelet in document.lanelets:
        for side, beside in (("left", lanelet.left_neighbour), ("right", lanelet.right_neighbour)):
            if beside is None or beside.lanelet_id not in known:
                continue
            other = known[beside.lanelet_id]
            facing = other.left_neighbour if (side == "left") != beside.same_direction else other.right_neighbour
            if facing is None or facing.lanelet_id != lanelet.lanelet_id:
                message = f"{beside.lanelet_id} on its {side} does not name it as neighbour on the side where it lies"
                yield Defect(message, (lanelet.lanelet_id, beside.lanelet_id))


RULE = Rule(
    rule_id="one_way_neighbour",
    severity="error",
    meaning="A lanelet names a neighbour that does not name it on the side where it lies.",
    why="A lane change is possible in one direction only, or back into another lane.",
    find=_find,
)
