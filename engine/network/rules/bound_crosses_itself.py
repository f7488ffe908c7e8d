"""A bound crosses itself."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    from shapely import LineString

    for lanelet in document.drawn:
        for side, bound in (("left", lanelet.left), ("right", lanelet.right)):
            if not LineString(bound).is_simple:
                yield Defect(f"the {side} bound crosses itself", (lanelet.lanelet_id,), bound[0])


RULE = Rule(
    rule_id="bound_crosses_itself",
    severity="error",
    meaning="A bound of a lanelet crosses itself.",
    why="Inside and outside of the lanelet swap along the way, so that positions are assigned to the wrong lanelets.",
    find=_find,
)
