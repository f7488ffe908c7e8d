"""A lanelet refers to itself."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.lanelets:
        roles = {
            "successor": lanelet.successors,
            "predecessor": lanelet.predecessors,
            "neighbour": tuple(beside.lanelet_id for beside in lanelet.neighbours),
        }
        named = [role for role, keys in roles.items() if lanelet.lanelet_id in keys]
        if named:
            yield Defect(f"is its own {' and '.join(named)}", (lanelet.lanelet_id,))


RULE = Rule(
    rule_id="follows_itself",
    severity="error",
    meaning="A lanelet is its own successor, predecessor or neighbour.",
    why="Searches for a route can run in a circle without moving.",
    find=_find,
)
