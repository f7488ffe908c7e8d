"""A neighbour leads another way than is said."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.drawn:
        for beside in lanelet.neighbours:
            other = document.by_id.get(beside.lanelet_id)
            if other is None or not other.is_drawn:
                continue
            ahead, ahead_there = (one.center[-1] - one.center[0] for one in (lanelet, other))
            if float(ahead @ ahead_there) * (1 if beside.same_direction else -1) < 0:
                said = "same" if beside.same_direction else "opposite"
                message = f"neighbour {other.lanelet_id} does not lead the {said} way"
                yield Defect(message, (lanelet.lanelet_id, other.lanelet_id), lanelet.center[0])


RULE = Rule(
    rule_id="neighbour_direction",
    severity="error",
    meaning="A neighbour said to lead the same way leads the other way, or the other way round.",
    why="A planner changes into oncoming traffic, or refuses a lane that it may use.",
    find=_find,
)
