"""Ways through a junction are looked at closely only where they may cross."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.network.sumo_export.layout import JunctionPath, crossing_of
from plannerforge.engine.network.sumo_export.writer import Link

SHAPES = st.integers(2, 6).flatmap(lambda count: arrays(float, (count, 2), elements=st.integers(-20, 20).map(float)))


def link(shape: Points) -> Link:
    return Link(JunctionPath(1, (2,), 3), shape, "s")


@given(SHAPES, SHAPES)
def test_crossing_paths_always_count_as_crossing(first: Points, second: Points) -> None:
    crosses = crossing_of(first, second) is not None
    assert link(first).may_cross(link(second)) >= crosses
    assert link(first).may_cross(link(second)) == link(second).may_cross(link(first))


def test_parallel_routes_cannot_cross() -> None:
    lane = np.array([[0.0, 0.0], [50.0, 1.0]])
    assert not link(lane).may_cross(link(lane + np.array([0.0, 3.5])))
    assert not link(lane).may_cross(link(lane + np.array([51.0, 0.0])))
