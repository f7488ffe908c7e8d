"""The two bounds of a lanelet have different numbers of points."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.lanelets:
        left, right = len(lanelet.left), len(lanelet.right)
        if left != right:
            yield Defect(f"{left} points on the left bound, {right} on the right one", (lanelet.lanelet_id,))


RULE = Rule(
    rule_id="unequal_bounds",
    severity="error",
    meaning="The left and the right bound have different numbers of points.",
    why="The centre line is the middle of points with the same number; commonroad-io refuses such a lanelet.",
    find=_find,
)
