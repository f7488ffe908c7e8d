"""A phase of a traffic light takes no time."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for light in document.lights:
        for steps, colour in light.phases:
            if steps <= 0:
                yield Defect(f"{colour or 'a phase'} lasts {steps} steps", (light.light_id,), light.position)


RULE = Rule(
    rule_id="phase_without_duration",
    severity="error",
    meaning="A phase of a traffic light lasts 0 steps or fewer.",
    why="The cycle cannot be followed in time: the sum of the durations is wrong.",
    find=_find,
)
