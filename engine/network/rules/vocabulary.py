"""Words of lanelets that CommonRoad 2020a knows: those that commonroad-io's reader takes."""

from collections.abc import Iterable, Iterator
from typing import Any

from commonroad.scenario.lanelet import LaneletType, LineMarking, RoadUser

from ....schemas.text import cited
from ...commonroad import RoadDocument
from .rule import Defect, rule


@rule("error", why="The reader refuses the file.")
def unknown_lanelet_type(document: RoadDocument) -> Iterator[Defect]:
    """The type of a lanelet is none of the twenty of CommonRoad 2020a."""
    for lanelet in document.lanelets:
        for word in _unknown(lanelet.types, LaneletType):
            yield Defect(f"there is no lanelet type {cited(word)}", (lanelet.lanelet_id,))


@rule("error", why="The reader refuses the file.")
def unknown_user(document: RoadDocument) -> Iterator[Defect]:
    """A road user to whom a lanelet is open is none of the ten of CommonRoad 2020a."""
    for lanelet in document.lanelets:
        for word in _unknown(lanelet.users, RoadUser):
            yield Defect(f"there is no road user {cited(word)}", (lanelet.lanelet_id,))


@rule("error", why="The reader refuses the file.")
def unknown_line_marking(document: RoadDocument) -> Iterator[Defect]:
    """The marking of a bound is none of the twelve of CommonRoad 2020a."""
    for lanelet in document.lanelets:
        for word in _unknown(lanelet.markings, LineMarking):
            yield Defect(f"there is no line marking {cited(word)}", (lanelet.lanelet_id,))


def _unknown(words: Iterable[str], known: Any) -> list[str]:
    return sorted(set(words) - {member.value for member in known})
