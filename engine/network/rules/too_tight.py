"""A bend that no car can follow."""

from collections.abc import Iterator

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length, headings, wrap_angles
from plannerforge.engine.network.road_document import RoadDocument
from plannerforge.engine.network.rules.rule import Defect, Rule

TIGHTEST_M = 1.0


def _find(document: RoadDocument) -> Iterator[Defect]:
    for lanelet in document.drawn:
        radius, place = _tightest_quarter_turn(lanelet.path)
        if radius < TIGHTEST_M:
            yield Defect(f"a quarter turn of {radius:.1f} m radius", (lanelet.lanelet_id,), place)


def _tightest_quarter_turn(center: Points) -> tuple[float, Points]:
    """Radius and beginning of the shortest piece that turns by 90°; infinite where there is none."""
    best, place = float("inf"), center[0]
    if len(center) < 3:
        return best, place
    turned = np.concatenate([[0.0], np.cumsum(wrap_angles(np.diff(headings(center))))])
    if np.ptp(turned) < np.pi / 2:
        return best, place
    ends = arc_length(center)
    stations = (ends[:-1] + ends[1:]) / 2
    for begin in range(len(turned)):
        enough = np.flatnonzero(np.abs(turned[begin:] - turned[begin]) >= np.pi / 2)
        if len(enough):
            way = stations[begin + enough[0]] - stations[begin]
            radius = float(way / abs(turned[begin + enough[0]] - turned[begin]))
            if radius < best:
                best, place = radius, center[begin + 1]
    return best, place


RULE = Rule(
    rule_id="too_tight",
    severity="warning",
    meaning="The centre line bends more tightly than 1 m of radius over a quarter turn.",
    why="Even a car that cuts the corner needs a wider turn (about 5 m at its centre).",
    find=_find,
)
