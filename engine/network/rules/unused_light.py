"""A traffic light holds for no lanelet."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    used = {key for lanelet in document.lanelets for key in lanelet.light_ids}
    for light in document.lights:
        if light.light_id not in used:
            yield Defect("no lanelet refers to this light", (light.light_id,), light.position)


RULE = Rule(
    rule_id="unused_light",
    severity="warning",
    meaning="No lanelet refers to a traffic light.",
    why="It is drawn, but nobody stops at it.",
    find=_find,
)
