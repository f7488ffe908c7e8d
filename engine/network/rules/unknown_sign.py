"""A lanelet refers to a traffic sign that is not there."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    known = {sign.sign_id for sign in document.signs}
    for lanelet in document.lanelets:
        at_line = lanelet.stop_line.sign_ids if lanelet.stop_line is not None else ()
        for key in sorted({*lanelet.sign_ids, *at_line} - known):
            yield Defect(f"traffic sign {key} is not in the file", (lanelet.lanelet_id, key))


RULE = Rule(
    rule_id="unknown_sign",
    severity="error",
    meaning="A lanelet or stop line refers to a traffic sign that is not in the file.",
    why="The reader fails or drops the rule that the sign stands for.",
    find=_find,
)
