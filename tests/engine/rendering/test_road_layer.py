"""Edges of the road are drawn, edges of lanelets that cross it are not."""

import numpy as np

from plannerforge.engine.geometry.polyline import Points
from plannerforge.engine.rendering.content import LaneletShape
from plannerforge.engine.rendering.road import outer_edges


def lanelet(lanelet_id: int, start: tuple[float, float], end: tuple[float, float]) -> LaneletShape:
    center = np.linspace(start, end, 11)
    along = (np.array(end) - start) / np.linalg.norm(np.array(end) - start)
    across = np.array([-along[1], along[0]]) * 2.0
    sides: tuple[Points, Points] = (center + across, center - across)
    return LaneletShape(
        lanelet_id, *sides, center, left_neighbour=None, right_neighbour=None, inside_intersection=False
    )


def test_edges_on_a_crossing_lanelet_vanish_and_the_rest_stays() -> None:
    first, second = lanelet(1, (-50, 0), (50, 0)), lanelet(2, (0, -50), (0, 50))
    pieces = outer_edges([first.left, second.left], [first, second])
    middles = np.array([piece.mean(axis=0) for piece in pieces])
    assert not np.any((np.abs(middles) < 1.5).all(axis=1))
    assert sum(np.linalg.norm(piece[1] - piece[0]) for piece in pieces) > 180


def test_edges_of_lone_lanelets_stay_whole() -> None:
    alone = lanelet(1, (0, 0), (30, 10))
    pieces = outer_edges([alone.left], [alone])
    length = sum(np.linalg.norm(piece[1] - piece[0]) for piece in pieces)
    assert np.isclose(length, np.linalg.norm([30, 10]))
