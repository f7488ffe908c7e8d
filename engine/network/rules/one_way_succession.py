"""Only one of two lanelets knows that one follows the other."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    known = document.by_id
    for lanelet in document.lanelets:
        for key in lanelet.successors:
            if key in known and lanelet.lanelet_id not in known[key].predecessors:
                yield Defect(f"successor {key} does not name it as predecessor", (lanelet.lanelet_id, key))
        for key in lanelet.predecessors:
            if key in known and lanelet.lanelet_id not in known[key].successors:
                yield Defect(f"predecessor {key} does not name it as successor", (lanelet.lanelet_id, key))


RULE = Rule(
    rule_id="one_way_succession",
    severity="error",
    meaning="A lanelet names a successor that does not name it as predecessor, or the other way round.",
    why="Searching forwards and backwards gives different routes.",
    find=_find,
)
