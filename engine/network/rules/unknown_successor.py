"""A lanelet leads to one that is not there."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.lanelets:
        for role, keys in (("successor", lanelet.successors), ("predecessor", lanelet.predecessors)):
            for key in sorted(set(keys) - set(document.by_id)):
                yield Defect(f"{role} {key} is not in the file", (lanelet.lanelet_id, key))


RULE = Rule(
    rule_id="unknown_successor",
    severity="error",
    meaning="A predecessor or successor is not in the file.",
    why="Routes end in nothing, or the reader silently drops the connection.",
    find=_find,
)
