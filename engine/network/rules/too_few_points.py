"""A bound is no line."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.lanelets:
        for side, bound in (("left", lanelet.left), ("right", lanelet.right)):
            if len(bound) < 2:
                yield Defect(f"the {side} bound has {len(bound)} point(s)", (lanelet.lanelet_id,))


RULE = Rule(
    rule_id="too_few_points",
    severity="error",
    meaning="A bound has fewer than two points.",
    why="One point has no direction: there is no way along the lanelet.",
    find=_find,
)
