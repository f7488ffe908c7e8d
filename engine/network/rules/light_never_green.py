"""A traffic light that lets nobody pass."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for light in document.lights:
        colours = {colour for _, colour in light.phases}
        if light.active and colours and not colours & {"green", "inactive"}:
            yield Defect(f"shows only {', '.join(sorted(colours))}", (light.light_id,), light.position)


RULE = Rule(
    rule_id="light_never_green",
    severity="warning",
    meaning="The cycle of an active traffic light shows neither green nor inactive.",
    why="Whoever obeys it stands there for ever.",
    find=_find,
)
