"""Words of lanelets that CommonRoad knows."""

from collections.abc import Iterator

from ...commonroad import RoadDocument
from .rule import Defect, rule

_LANELET_TYPES = frozenset(
    [
        "urban",
        "interstate",
        "country",
        "highway",
        "sidewalk",
        "crosswalk",
        "busLane",
        "bicycleLane",
        "exitRamp",
        "mainCarriageWay",
        "accessRamp",
        "shoulder",
        "driveWay",
        "busStop",
        "intersection",
        "border",
        "parking",
        "restricted",
        "restricted_area",
        "unknown",
    ]
)
"""CommonRoad 2020a's."""


@rule("error", why="The reader refuses the file.")
def unknown_lanelet_type(document: RoadDocument) -> Iterator[Defect]:
    """The type of a lanelet is none of the twenty of CommonRoad 2020a."""
    for lanelet in document.lanelets:
        for word in sorted(set(lanelet.types) - _LANELET_TYPES):
            yield Defect(f"there is no lanelet type {word!r}", (lanelet.lanelet_id,))


_LANELET_USERS = frozenset(
    ["vehicle", "car", "truck", "bus", "motorcycle", "bicycle", "pedestrian", "priorityVehicle", "train", "taxi"]
)
"""CommonRoad 2020a's."""


@rule("error", why="The reader refuses the file.")
def unknown_user(document: RoadDocument) -> Iterator[Defect]:
    """A road user to whom a lanelet is open is none of the ten of CommonRoad 2020a."""
    for lanelet in document.lanelets:
        for word in sorted(set(lanelet.users) - _LANELET_USERS):
            yield Defect(f"there is no road user {word!r}", (lanelet.lanelet_id,))


_LINE_MARKINGS = frozenset(
    [
        "dashed",
        "solid",
        "solid_solid",
        "dashed_dashed",
        "solid_dashed",
        "dashed_solid",
        "curb",
        "lowered_curb",
        "broad_dashed",
        "broad_solid",
        "unknown",
        "no_marking",
    ]
)
"""CommonRoad 2020a's."""


@rule("error", why="The reader refuses the file.")
def unknown_line_marking(document: RoadDocument) -> Iterator[Defect]:
    """The marking of a bound is none of the twelve of CommonRoad 2020a."""
    for lanelet in document.lanelets:
        for word in sorted(set(lanelet.markings) - _LINE_MARKINGS):
            yield Defect(f"there is no line marking {word!r}", (lanelet.lanelet_id,))
