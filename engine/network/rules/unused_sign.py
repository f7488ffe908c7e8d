"""A traffic sign holds for no lanelet."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    used = {key for lanelet in document.lanelets for key in lanelet.sign_ids}
    for sign in document.signs:
        if sign.sign_id not in used:
            yield Defect("no lanelet refers to this sign", (sign.sign_id,), sign.position)


RULE = Rule(
    rule_id="unused_sign",
    severity="error",
    meaning="No lanelet refers to a traffic sign.",
    why="The sign has no effect on anybody; commonroad-io does not read such a file.",
    find=_find,
)
