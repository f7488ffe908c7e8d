"""A traffic light shows a colour that there is not."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

COLOURS = frozenset({"red", "yellow", "redYellow", "green", "inactive"})


def _find(document: RoadDocument) -> Iterator[Defect]:
    for light in document.lights:
        for colour in sorted({colour for _, colour in light.phases} - COLOURS):
            yield Defect(f"shows {colour!r}", (light.light_id,), light.position)


RULE = Rule(
    rule_id="unknown_colour",
    severity="error",
    meaning="A phase of a traffic light shows a colour that CommonRoad does not know.",
    why="The reader refuses the file.",
    find=_find,
)
