"""The lines between lanes, dashed.

The dashes are pieces of the road and no style of a line: a style's begin where a renderer cuts a line off, so that the
same road would look different in two pictures beside one another.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from plannerforge.engine.geometry.polyline import Points, arc_length, interpolate, without_repeats
from plannerforge.engine.rendering.scene_content import LaneletShape
from plannerforge.engine.rendering.viewport import Viewport

DASH_SHARE, GAP_SHARE = 1 / 54, 1 / 75
"""Of the picture's width."""


def dividers(lanelets: Sequence[LaneletShape]) -> Iterator[Points]:
    """The borders (n, 2) that lanelets have in common with a neighbour, each once."""
    known = {lanelet.lanelet_id: lanelet for lanelet in lanelets}
    for lanelet in lanelets:
        for side, neighbour in ((lanelet.left, lanelet.left_neighbour), (lanelet.right, lanelet.right_neighbour)):
            other = None if neighbour is None else known.get(neighbour)
            is_other_way_round = other is not None and lanelet.lanelet_id in (
                other.left_neighbour,
                other.right_neighbour,
            )
            if neighbour is not None and not (is_other_way_round and neighbour < lanelet.lanelet_id):
                yield side


def dashes(lines: Iterable[Points], viewport: Viewport) -> list[Points]:
    """The dashes (n, 2) of lines, which begin at a line's first point, as far as a viewport shows them."""
    dash_m, gap_m = DASH_SHARE * viewport.width_m, GAP_SHARE * viewport.width_m
    return [dash for line in lines for dash in _dashes(without_repeats(line), dash_m, gap_m) if viewport.contains(dash)]


def _dashes(line: Points, dash_m: float, gap_m: float) -> Iterator[Points]:
    stations = arc_length(line)
    for begin_m in np.arange(0.0, stations[-1], dash_m + gap_m).tolist():
        end_m = min(begin_m + dash_m, float(stations[-1]))
        between = stations[(begin_m < stations) & (stations < end_m)]
        yield interpolate(line, stations, np.array([begin_m, *between, end_m]))
