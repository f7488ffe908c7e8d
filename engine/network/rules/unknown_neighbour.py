"""A lanelet lies beside one that is not there."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.lanelets:
        for side, beside in (("left", lanelet.left_neighbour), ("right", lanelet.right_neighbour)):
            if beside is not None and beside.lanelet_id not in document.by_id:
                message = f"neighbour {beside.lanelet_id} on the {side} is not in the file"
                yield Defect(message, (lanelet.lanelet_id, beside.lanelet_id))


RULE = Rule(
    rule_id="unknown_neighbour",
    severity="error",
    meaning="A neighbour on the left or right is not in the file.",
    why="A lane change is offered into nothing.",
    find=_find,
)
