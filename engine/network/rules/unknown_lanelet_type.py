"""A lanelet type that CommonRoad does not know."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

TYPES = frozenset(
    [
        "urban",
        "interstate",
        "country",
        "highway",
        "sidewalk",
        "crosswalk",
        "busLane",
        "bicycleLane",
        "exitRamp",
        "mainCarriageWay",
        "accessRamp",
        "shoulder",
        "driveWay",
        "busStop",
        "intersection",
        "border",
        "parking",
        "restricted",
        "restricted_area",
        "unknown",
    ]
)


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.lanelets:
        for word in sorted(set(lanelet.types) - TYPES):
            yield Defect(f"there is no lanelet type {word!r}", (lanelet.lanelet_id,))


RULE = Rule(
    rule_id="unknown_lanelet_type",
    severity="error",
    meaning="The type of a lanelet is none of the twenty of CommonRoad 2020a.",
    why="The reader refuses the file.",
    find=_find,
)
