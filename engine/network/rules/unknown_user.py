"""A road user that CommonRoad does not know."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

USERS = frozenset(
    ["vehicle", "car", "truck", "bus", "motorcycle", "bicycle", "pedestrian", "priorityVehicle", "train", "taxi"]
)


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.lanelets:
        for word in sorted(set(lanelet.users) - USERS):
            yield Defect(f"there is no road user {word!r}", (lanelet.lanelet_id,))


RULE = Rule(
    rule_id="unknown_user",
    severity="error",
    meaning="A road user to whom a lanelet is open is none of the ten of CommonRoad 2020a.",
    why="The reader refuses the file.",
    find=_find,
)
