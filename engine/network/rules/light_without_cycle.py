"""A traffic light that never shows anything."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for light in document.lights:
        if light.active and not light.phases:
            yield Defect("is active but has no cycle", (light.light_id,), light.position)


RULE = Rule(
    rule_id="light_without_cycle",
    severity="warning",
    meaning="An active traffic light has no cycle.",
    why="Its colour at any time is undefined.",
    find=_find,
)
