"""Two elements have one id."""

from collections.abc import Iterator

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule


def _find(document: RoadDocument) -> Iterator[Defect]:
    names: dict[int, list[str]] = {}
    for key, name in document.ids:
        names.setdefault(key, []).append(name)
    for key, holders in names.items():
        if len(holders) > 1:
            yield Defect(f"id {key} is given to {len(holders)} elements: {', '.join(holders)}", (key,))


RULE = Rule(
    rule_id="repeated_id",
    severity="error",
    meaning="An id is given to two elements of the file.",
    why="References to it are ambiguous; commonroad-io refuses the file or keeps one of the two.",
    find=_find,
)
