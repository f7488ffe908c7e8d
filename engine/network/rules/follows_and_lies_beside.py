"""A lanelet lies both ahead and beside."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.lanelets:
        beside = {neighbour.lanelet_id for neighbour in lanelet.neighbours}
        for key in sorted(beside & {*lanelet.successors, *lanelet.predecessors} - {lanelet.lanelet_id}):
            yield Defect(f"{key} lies both in line with it and beside it", (lanelet.lanelet_id, key))


RULE = Rule(
    rule_id="follows_and_lies_beside",
    severity="error",
    meaning="A lanelet is successor or predecessor and also neighbour of the same other lanelet.",
    why="One of the two is wrong: what lies ahead cannot lie beside.",
    find=_find,
)
