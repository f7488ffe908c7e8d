"""Lanelets in words and ids: what follows, what lies beside, and who is on them."""

import numpy as np

from plannerforge.engine.edits.scene import Scene
from plannerforge.engine.geometry.polyline import Points, arc_length, point_at, wrap_angle
from plannerforge.engine.scenarios.ego_route import TURN_RAD, center_line
from plannerforge.engine.scenarios.road_facts import limits_kmh, signs_of
from plannerforge.schemas.scenarios import DescribedEgo, DescribedLanelet

STRAIGHT_RAD = TURN_RAD


def describe_lanelets(
    scene: Scene, ego: DescribedEgo | None, center: Points, radius_m: float, most: int
) -> tuple[tuple[DescribedLanelet, ...], int]:
    """The lanelets within the radius, those of the ego's way first, then the nearest; and how many there are."""
    distances = {
        lanelet.lanelet_id: float(np.min(np.linalg.norm(lanelet.center_vertices - center, axis=1)))
        for lanelet in scene.network.lanelets
    }
    own = set(ego.route or ego.lanelets) if ego else set()
    near = [key for key, distance in distances.items() if distance <= radius_m]
    near.sort(key=lambda key: (key not in own, distances[key], key))
    standing = _vehicles_by_lanelet(scene)
    described = tuple(_lanelet(scene, ego, key, standing.get(key, ())) for key in near[:most])
    return described, len(distances)


def _lanelet(scene: Scene, ego: DescribedEgo | None, key: int, vehicles: tuple[int, ...]) -> DescribedLanelet:
    lanelet, graph = scene.network.find_lanelet_by_id(key), scene.lanelet_graph
    limits = limits_kmh(signs_of(scene.network, [key]))
    opposite = lanelet.adj_left if lanelet.adj_left is not None and not lanelet.adj_left_same_direction else None
    return DescribedLanelet(
        lanelet_id=key,
        edge=scene.layout.lane_of.get(key, (None, 0))[0],
        length_m=round(graph.length_m[key], 1),
        role=_role(ego, key),
        successors=tuple(f"{_direction(scene, following)} {following}" for following in graph.successors[key]),
        left=lanelet.adj_left if lanelet.adj_left is not None and lanelet.adj_left_same_direction else None,
        right=lanelet.adj_right if lanelet.adj_right is not None and lanelet.adj_right_same_direction else None,
        opposite=opposite,
        limit_kmh=limits[0] if limits else None,
        vehicles=vehicles,
    )


def _role(ego: DescribedEgo | None, key: int) -> str:
    if ego is None:
        return ""
    roles = ["ego starts here"] if key in ego.lanelets else []
    roles += ["goal"] if key in ego.goal_lanelets else []
    roles += ["on the ego's way"] if key in ego.route and not roles else []
    return ", ".join(roles)


def _direction(scene: Scene, key: int) -> str:
    """Where a lanelet turns from its beginning to its end."""
    line = center_line(scene.network, key)
    if len(line) < 2:
        return "straight"
    turned = wrap_angle(point_at(line, float(arc_length(line)[-1]))[1] - point_at(line, 0.0)[1])
    if abs(turned) < STRAIGHT_RAD:
        return "straight"
    return "left" if turned > 0 else "right"


def _vehicles_by_lanelet(scene: Scene) -> dict[int, tuple[int, ...]]:
    found: dict[int, list[int]] = {}
    for key, match in sorted(scene.matches.items()):
        found.setdefault(match.lanelets[0], []).append(key)
    return {lanelet: tuple(keys) for lanelet, keys in found.items()}
