"""A lanelet refers to a traffic light that is not there."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    known = {light.light_id for light in document.lights}
    for lanelet in document.lanelets:
        at_line = lanelet.stop_line.light_ids if lanelet.stop_line is not None else ()
        for key in sorted({*lanelet.light_ids, *at_line} - known):
            yield Defect(f"traffic light {key} is not in the file", (lanelet.lanelet_id, key))


RULE = Rule(
    rule_id="unknown_light",
    severity="error",
    meaning="A lanelet or stop line refers to a traffic light that is not in the file.",
    why="The reader fails, or the junction is taken for one without lights.",
    find=_find,
)
