"""What is in view from a point, compared with rays that are cast one by one."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from commonroad.geometry.shape import Polygon
from commonroad.scenario.obstacle import EnvironmentObstacle, ObstacleType

from plannerforge.engine.geometry import oriented_rectangle
from plannerforge.engine.perception.visibility import NO_BODIES, Bodies, InView, seen_shares, walls_of
from tests.support.planning import scenario_on, straight_road

_ALL_ROUND = math.tau


def _bodies(*rectangles: Sequence[float], see_through: Sequence[int] = ()) -> Bodies:
    """Return rectangles (x, y, heading, length, width) in a single frame."""
    values = np.array(rectangles, dtype=float)
    hides = np.array([index not in see_through for index in range(len(values))])
    return Bodies(values[None, :, :2], values[None, :, 2], values[:, 3:], hides, np.ones((1, len(values)), dtype=bool))


def _seen(bodies: Bodies, view_rad: float = _ALL_ROUND, count: int | None = None) -> InView:
    number = bodies.centres.shape[1] if count is None else count
    return seen_shares(np.zeros((1, 2)), np.zeros(1), view_rad, bodies, count=number)


def _share_by_rays(rectangles: np.ndarray, target: int, rays: int = 4001) -> float:
    """Return the share of the rays towards a rectangle that meet it first."""
    shapes = [
        shapely.Polygon(oriented_rectangle(each[:2], float(each[2]), (float(each[3]), float(each[4]))))
        for each in rectangles
    ]
    bearing = math.atan2(rectangles[target][1], rectangles[target][0])
    corners = np.array(shapes[target].exterior.coords)
    off = [math.remainder(math.atan2(y, x) - bearing, math.tau) for x, y in corners]
    first = 0
    for angle in np.linspace(min(off) + 1e-6, max(off) - 1e-6, rays):
        ray = shapely.LineString([(0, 0), 500 * np.array([math.cos(bearing + angle), math.sin(bearing + angle)])])
        away = [
            ray.intersection(shape).distance(shapely.Point(0, 0)) if ray.intersects(shape) else math.inf
            for shape in shapes
        ]
        first += int(np.argmin(away)) == target
    return first / rays


def test_a_body_behind_a_wider_one_is_hidden_and_the_one_in_front_is_not() -> None:
    seen = _seen(_bodies((10, 0, 0, 4, 4), (30, 0, 0, 2, 2)))
    assert seen.visible[0].tolist() == [1.0, 0.0]
    assert seen.hidden_by[0].tolist() == [-1, 0]


def test_half_of_a_body_is_hidden_by_one_that_covers_half_of_its_angle() -> None:
    seen = _seen(_bodies((20, 0, math.pi / 2, 4, 0.01), (10, 5, 0, 0.01, 10)))
    assert seen.visible[0, 0] == pytest.approx(0.5, abs=1e-3)


def test_two_bodies_that_hide_the_same_part_count_once() -> None:
    once = _seen(_bodies((40, 0, 0, 4, 4), (10, 0.5, 0, 1, 0.4)))
    twice = _seen(_bodies((40, 0, 0, 4, 4), (10, 0.5, 0, 1, 0.4), (14, 0.7, 0, 1, 0.4)))
    assert twice.visible[0, 0] == pytest.approx(once.visible[0, 0], abs=1e-3)


def test_pedestrians_and_cyclists_hide_nothing() -> None:
    assert _seen(_bodies((10, 0, 0, 4, 4), (30, 0, 0, 2, 2), see_through=[0])).visible[0, 1] == 1.0


def test_a_body_outside_the_field_of_view_is_not_in_it_and_one_at_its_edge_is_in_part() -> None:
    seen = _seen(_bodies((-20, 0, 0, 4, 2), (0, 20, 0, 8, 0.01), (20, 0, 0, 4, 2)), view_rad=math.pi)
    assert seen.within[0, 0] == 0.0
    assert seen.within[0, 1] == pytest.approx(0.5, abs=1e-3)
    assert seen.within[0, 2] == 1.0


def test_a_body_around_the_sensor_is_in_view_and_hides_nothing() -> None:
    assert _seen(_bodies((0, 0, 0, 4, 2), (20, 0, 0, 4, 2))).visible[0].tolist() == [1.0, 1.0]


@pytest.mark.parametrize("seed", range(4))
def test_shares_are_those_that_rays_find_among_bodies_that_do_not_overlap(seed: int) -> None:
    numbers = np.random.default_rng(seed)
    kept: list[np.ndarray] = []
    while len(kept) < 6:
        away, angle = numbers.uniform(6, 45), numbers.uniform(-math.pi, math.pi)
        new = np.array([away * math.cos(angle), away * math.sin(angle), numbers.uniform(0, math.tau), 8, 2.5])
        shapes = [shapely.Polygon(oriented_rectangle(each[:2], float(each[2]), (8.0, 2.5))) for each in (*kept, new)]
        if all(not shape.intersects(shapes[-1]) for shape in (*shapes[:-1], shapely.Point(0, 0))):
            kept.append(new)
    rectangles = np.array(kept)
    seen = _seen(_bodies(*rectangles))
    target = int(np.argmin(seen.visible[0]))
    assert seen.visible[0, target] == pytest.approx(_share_by_rays(rectangles, target, 801), abs=5e-3)


def test_the_walls_of_a_building_hide_what_is_behind_it_but_a_median_strip_does_not() -> None:
    corners = np.array([[10.0, -5.0], [14.0, -5.0], [14.0, 5.0], [10.0, 5.0]])
    shares = {}
    for kind in (ObstacleType.BUILDING, ObstacleType.MEDIAN_STRIP):
        scenario = scenario_on(straight_road(), EnvironmentObstacle(9, kind, Polygon(corners)))
        walls = walls_of(scenario)
        shares[kind] = _seen(_bodies((30, 0, 0, 4, 2)).and_walls(walls), count=1).visible[0, 0]
    assert shares == {ObstacleType.BUILDING: 0.0, ObstacleType.MEDIAN_STRIP: 1.0}


def test_a_scenario_without_buildings_has_no_walls() -> None:
    assert walls_of(scenario_on(straight_road())) is NO_BODIES
