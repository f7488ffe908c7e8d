"""Who may use a lanelet: no bicycles or walkers on motorways, walkers along footpaths and across other roads."""

from plannerforge.engine.edits.scene import Scene
from plannerforge.schemas.errors import NotPossible

MOTORWAY_WORDS = frozenset({"highway", "interstate", "mainCarriageWay"})
"""Lanelet types and scenario tags that say motorway; some recordings carry only the tag."""

FOOTPATH_TYPES = frozenset({"sidewalk", "crosswalk"})
SLOW_CLASSES = ("bicycle", "pedestrian")


def check_allowed(class_name: str, lanelet_id: int, scene: Scene) -> None:
    """Refuse a road user that the road at a lanelet is not open to.

    Raises:
        NotPossible: a bicycle or pedestrian on a motorway.
    """
    if class_name in SLOW_CLASSES and is_motorway(scene, lanelet_id):
        elsewhere = [key for key in scene.layout.table.lanes if not is_motorway(scene, key)]
        raise NotPossible(
            f"a {class_name} is not allowed on lanelet {lanelet_id}: it belongs to a motorway",
            valid=elsewhere,
            next_step="choose another class" if not elsewhere else "choose another lanelet or class",
        )


def is_motorway(scene: Scene, lanelet_id: int) -> bool:
    """Whether a lanelet belongs to a motorway by its own types or, where it has none of its own, by the tags."""
    kinds = _kinds(scene, lanelet_id)
    if kinds & FOOTPATH_TYPES:
        return False
    tags = {str(tag.value) for tag in scene.loaded.scenario.tags or ()}
    return bool((kinds | tags) & MOTORWAY_WORDS)


def is_footpath(scene: Scene, lanelet_id: int) -> bool:
    """Whether a lanelet is there to walk along."""
    users = {str(user.value) for user in scene.network.find_lanelet_by_id(lanelet_id).user_one_way or ()}
    return bool(_kinds(scene, lanelet_id) & FOOTPATH_TYPES) or users == {"pedestrian"}


def _kinds(scene: Scene, lanelet_id: int) -> set[str]:
    return {str(kind.value) for kind in scene.network.find_lanelet_by_id(lanelet_id).lanelet_type or ()}
