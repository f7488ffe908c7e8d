"""Who may use a lanelet: what its users and its type say, no bicycles or walkers on motorways.

Walkers cross any other road, and walk along footpaths. An emergency vehicle may drive everywhere.
"""

from collections.abc import Mapping

from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.traffic.vehicle_classes import vehicle_classes
from plannerforge.schemas.errors import NotPossible

MOTORWAY_WORDS = frozenset({"highway", "interstate", "mainCarriageWay"})
"""Lanelet types and scenario tags that say motorway; some recordings carry only the tag."""

FOOTPATH_TYPES = frozenset({"sidewalk", "crosswalk"})
USERS_OF_TYPE: Mapping[str, frozenset[str]] = {
    "busLane": frozenset({"bus", "taxi"}),
    "bicycleLane": frozenset({"bicycle"}),
}
"""Types of lanelets that are there for some vehicles only, where the file does not name the users itself."""

ANY_VEHICLE = "vehicle"
"""CommonRoad's road user that stands for all vehicles."""

SLOW_CLASSES, EVERYWHERE = ("bicycle", "pedestrian"), "priorityVehicle"


def check_allowed(class_name: str, lanelet_id: int, scene: Scene) -> None:
    """Refuse a road user that the road at a lanelet is not open to.

    Raises:
        NotPossible: users or type of the lanelet leave the class out, or a bicycle or pedestrian on a motorway.
    """
    reason = _closed_because(class_name, lanelet_id, scene)
    if reason:
        elsewhere = [key for key in scene.layout.table.lanes if not _closed_because(class_name, key, scene)]
        raise NotPossible(
            f"a {class_name} is not allowed on lanelet {lanelet_id}: {reason}",
            valid=elsewhere,
            next_step="choose another class" if not elsewhere else "choose another lanelet or class",
        )


def is_footpath(scene: Scene, lanelet_id: int) -> bool:
    """Whether a lanelet is there to walk along."""
    return bool(_kinds(scene, lanelet_id) & FOOTPATH_TYPES) or _users(scene, lanelet_id) == {"pedestrian"}


def _closed_because(class_name: str, lanelet_id: int, scene: Scene) -> str:
    """Why a class may not use a lanelet; empty if it may. Its users say it, else its type, else the kind of road."""
    one, kinds, users = _user(class_name), _kinds(scene, lanelet_id), _users(scene, lanelet_id)
    if one == EVERYWHERE or one in users:
        return ""
    if users and ANY_VEHICLE not in users and one != "pedestrian":
        return f"it is for {', '.join(sorted(users))}"
    special = sorted(kinds & USERS_OF_TYPE.keys())
    if special and not users and one != "pedestrian":
        return "" if any(one in USERS_OF_TYPE[kind] for kind in special) else f"it is a {' and '.join(special)}"
    return "it belongs to a motorway" if one in SLOW_CLASSES and not special and _is_motorway(scene, kinds) else ""


def _is_motorway(scene: Scene, kinds: set[str]) -> bool:
    tags = {str(tag.value) for tag in scene.loaded.scenario.tags or ()}
    return bool((kinds | tags) & MOTORWAY_WORDS)


def _user(class_name: str) -> str:
    """CommonRoad's word for a class."""
    found = vehicle_classes().get(class_name)
    return class_name if found is None else found.commonroad_type


def _kinds(scene: Scene, lanelet_id: int) -> set[str]:
    return {str(kind.value) for kind in scene.network.find_lanelet_by_id(lanelet_id).lanelet_type or ()}


def _users(scene: Scene, lanelet_id: int) -> set[str]:
    """Who is named as a user of a lanelet, in its direction or in both; nobody where the file does not say."""
    lanelet = scene.network.find_lanelet_by_id(lanelet_id)
    return {str(user.value) for user in {*(lanelet.user_one_way or ()), *(lanelet.user_bidirectional or ())}}
