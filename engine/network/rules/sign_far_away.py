"""A traffic sign stands far from the road that it holds for."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule
from plannerforge.engine.network.sign_numbers import SPEED_LIMITS

FARTHEST_M = 50.0


def _find(document: RoadDocument) -> Iterator[Defect]:
    from shapely import Point

    for sign in document.signs:
        if any(number in SPEED_LIMITS for number, _ in sign.plates):
            continue
        holders = [lanelet for lanelet in document.drawn if sign.sign_id in lanelet.sign_ids]
        if sign.position is None or not holders or not np.isfinite(sign.position).all():
            continue
        distance = min(float(lanelet.polygon.distance(Point(*sign.position))) for lanelet in holders)
        if distance > FARTHEST_M:
            keys = tuple(lanelet.lanelet_id for lanelet in holders)
            yield Defect(f"stands {distance:.0f} m from its lanelets", (sign.sign_id, *keys), sign.position)


RULE = Rule(
    rule_id="sign_far_away",
    severity="warning",
    meaning="A traffic sign (but a speed limit, which holds on) stands more than 50 m from all its lanelets.",
    why="Its position or the reference is wrong.",
    find=_find,
)
