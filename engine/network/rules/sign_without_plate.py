"""A traffic sign says nothing."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for sign in document.signs:
        if not sign.plates:
            yield Defect("holds no sign element", (sign.sign_id,), sign.position)


RULE = Rule(
    rule_id="sign_without_plate",
    severity="error",
    meaning="A traffic sign holds no sign element.",
    why="The schema asks for one, and without it the sign has no meaning.",
    find=_find,
)
