"""One lanelet lies on both sides of another."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.lanelets:
        keys = [beside.lanelet_id for beside in lanelet.neighbours]
        if len(keys) == 2 and keys[0] == keys[1]:
            yield Defect(f"neighbour {keys[0]} is named on both sides", (lanelet.lanelet_id, keys[0]))


RULE = Rule(
    rule_id="neighbour_on_both_sides",
    severity="error",
    meaning="A lanelet has the same neighbour on its left and on its right.",
    why="One of the two sides is wrong, and a lane change to it leads to the other side.",
    find=_find,
)
