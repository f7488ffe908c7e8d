"""A lanelet leads in by two arms."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for intersection in document.intersections:
        arms: dict[int, list[int]] = {}
        for incoming in intersection.incomings:
            for key in incoming.lanelet_ids:
                arms.setdefault(key, []).append(incoming.incoming_id)
        for key, named in arms.items():
            if len(named) > 1:
                message = f"lanelet {key} belongs to arms {', '.join(map(str, named))}"
                yield Defect(message, (intersection.intersection_id, key))


RULE = Rule(
    rule_id="lanelet_in_two_incomings",
    severity="warning",
    meaning="A lanelet is named by two arms of one intersection.",
    why="Which arm a vehicle comes from, and so who yields to whom, is ambiguous.",
    find=_find,
)
