"""Rules on the values that CommonRoad 2020a defines for lanelets: those that commonroad-io's reader accepts."""

from collections.abc import Iterable, Iterator
from typing import Any

from commonroad.scenario.lanelet import LaneletType, LineMarking, RoadUser

from ....schemas.text import cited
from ...commonroad import RoadDocument
from .rule import Defect, rule


@rule("error", why="The reader rejects the file.")
def unknown_lanelet_type(document: RoadDocument) -> Iterator[Defect]:
    """The type of a lanelet is not one of the twenty of CommonRoad 2020a."""
    for lanelet in document.lanelets:
        for word in _unknown(lanelet.types, LaneletType):
            yield Defect(f"there is no lanelet type {cited(word)}", (lanelet.lanelet_id,))


@rule("error", why="The reader rejects the file.")
def unknown_user(document: RoadDocument) -> Iterator[Defect]:
    """A permitted road user of a lanelet is not one of the ten of CommonRoad 2020a."""
    for lanelet in document.lanelets:
        for word in _unknown(lanelet.users, RoadUser):
            yield Defect(f"there is no road user {cited(word)}", (lanelet.lanelet_id,))


@rule("error", why="The reader rejects the file.")
def unknown_line_marking(document: RoadDocument) -> Iterator[Defect]:
    """The marking of a bound is not one of the twelve of CommonRoad 2020a."""
    for lanelet in document.lanelets:
        for word in _unknown(lanelet.markings, LineMarking):
            yield Defect(f"there is no line marking {cited(word)}", (lanelet.lanelet_id,))


def _unknown(words: Iterable[str], known: Any) -> list[str]:
    return sorted(set(words) - {member.value for member in known})
