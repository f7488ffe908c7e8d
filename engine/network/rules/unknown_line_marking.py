"""A line marking that CommonRoad does not know."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

MARKINGS = frozenset(
    [
        "dashed",
        "solid",
        "solid_solid",
        "dashed_dashed",
        "solid_dashed",
        "dashed_solid",
        "curb",
        "lowered_curb",
        "broad_dashed",
        "broad_solid",
        "unknown",
        "no_marking",
    ]
)


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.lanelets:
        for word in sorted(set(lanelet.markings) - MARKINGS):
            yield Defect(f"there is no line marking {word!r}", (lanelet.lanelet_id,))


RULE = Rule(
    rule_id="unknown_line_marking",
    severity="error",
    meaning="The marking of a bound is none of the twelve of CommonRoad 2020a.",
    why="The reader refuses the file.",
    find=_find,
)
