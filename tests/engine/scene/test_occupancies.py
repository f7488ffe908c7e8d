"""Obstacles that are given by occupancies are in the way of edits like everybody else."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commonroad.common.util import Interval
from commonroad.geometry.shape import Circle, Polygon, Rectangle, Shape, ShapeGroup
from commonroad.prediction.prediction import Occupancy, SetBasedPrediction
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
from commonroad.scenario.scenario import Scenario
from commonroad.scenario.state import InitialState
from support.builders import ScenarioBuilder, driving, town_road
from support.edits import Applied, apply_to

from plannerforge.engine.scene.occupancies import occupied_regions
from plannerforge.schemas.errors import NotPossible

STEPS = 60
WITH_SETS = town_road().with_vehicles(driving(31, (70, 0), 5.0, STEPS), driving(32, (15, 0), 10.0, STEPS))
BESIDE = town_road().with_vehicles(driving(31, (50, 3.5), 5.0, STEPS), driving(32, (15, 3.5), 10.0, STEPS))
AWAY = town_road().with_vehicles(driving(31, (70, 60), 5.0, STEPS), driving(32, (15, 0), 10.0, STEPS))
PHANTOM = (
    '  <phantomObstacle id="77"><occupancySet><occupancy><shape><rectangle><length>5</length><width>2</width>'
    "<orientation>0</orientation><center><x>50</x><y>0</y></center></rectangle></shape><time><exact>1</exact></time>"
    "</occupancy></occupancySet></phantomObstacle>\n"
)
EditBase = Callable[..., Applied]


def as_occupancies(xml: str, vehicle_id: int) -> str:
    """The scenario with a vehicle's trajectory as an occupancy set of rectangles of its size."""
    head, tail = xml.split(f'<dynamicObstacle id="{vehicle_id}">')
    body, rest = tail.split("</dynamicObstacle>", 1)
    before, states = body.split("<trajectory>")
    regions = [
        f"<occupancy><shape><rectangle><length>4.5</length><width>1.8</width><orientation>0</orientation><center>"
        f"<x>{x}</x><y>{y}</y></center></rectangle></shape><time><exact>{step}</exact></time></occupancy>"
        for x, y, step in re.findall(r"<x>(.*?)</x><y>(.*?)</y>.*?<time><exact>(\d+)</exact>", states)
    ]
    made = f"{before}<occupancySet>{''.join(regions)}</occupancySet>"
    return f'{head}<dynamicObstacle id="{vehicle_id}">{made}</dynamicObstacle>{rest}'


@pytest.fixture
def edit(tmp_path: Path) -> EditBase:
    """Applies edits to a road on which vehicle 31 is an occupancy set, and a phantom is about."""

    def run(*edits: dict[str, Any], builder: ScenarioBuilder = WITH_SETS) -> Applied:
        base = tmp_path / "base.xml"
        text = as_occupancies(builder.xml(), 31).replace("  <planningProblem", PHANTOM + "  <planningProblem", 1)
        base.write_text(text, encoding="utf-8")
        return apply_to(base, tmp_path / "out", *edits)

    return run


def test_their_place_is_taken(edit: EditBase) -> None:
    onto = {"op": "add_vehicle", "vehicle_class": "car", "at": "1", "position": "71m", "speed": "5m/s"}
    with pytest.raises(NotPossible, match="occupied by obstacle 31"):
        edit(onto)
    assert edit({"op": "remove_vehicle", "vehicles": ["31"]}, onto).outcome.edits[1].done


def test_driven_vehicles_see_them(edit: EditBase) -> None:
    chasing = {"op": "set_speed", "vehicles": ["32"], "speed": "20m/s"}
    applied = edit(chasing, builder=BESIDE)
    assert applied.outcome.collisions == ()
    assert applied.tracks()[32].speeds_mps[-1] < 10.0
    assert (
        edit({"op": "remove_vehicle", "vehicles": ["31"]}, chasing, builder=BESIDE).tracks()[32].speeds_mps[-1] > 15.0
    )


def test_a_collision_with_one_is_reported_once(edit: EditBase) -> None:
    too_late = {"op": "add_vehicle", "vehicle_class": "car", "at": "1", "position": "62m", "speed": "25m/s"}
    (hit,) = edit(too_late).outcome.collisions
    assert hit.vehicles == (101, 31)
    assert 0.0 < hit.time_s < 1.0


def test_the_ego_s_risk_counts_them(edit: EditBase) -> None:
    outcome = edit({"op": "remove_vehicle", "vehicles": ["31"]}, {"op": "remove_vehicle", "vehicles": ["32"]}).outcome
    assert outcome.ego_before is not None
    assert outcome.ego_before.minimum_time_to_collision_s is not None
    assert outcome.ego_after is not None
    assert outcome.ego_after.minimum_distance_m is None


def test_they_are_copied_byte_for_byte(edit: EditBase) -> None:
    applied = edit({"op": "set_speed", "vehicles": ["32"], "speed": "20m/s"})
    assert applied.changed_elements() == {"32"}
    assert b"occupancySet" in applied.xml.read_bytes()


def test_road_users_that_are_not_seen_are_named(edit: EditBase) -> None:
    told = edit({"op": "set_speed", "vehicles": ["32"], "speed": "5m/s"}, builder=AWAY).outcome.warnings
    assert any("driven vehicles do not see 31, because" in one for one in told)
    assert any("phantom" in one and one.endswith(": 77") for one in told)


def obstacle(key: int, regions: dict[int | Interval, Shape], heading_rad: float = 0.0) -> DynamicObstacle:
    """An obstacle that begins at the origin, 4.5 m long and 1.8 m wide."""
    start = InitialState(time_step=0, position=np.zeros(2), orientation=heading_rad, velocity=5.0)
    prediction = SetBasedPrediction(1, [Occupancy(time, shape) for time, shape in regions.items()]) if regions else None
    return DynamicObstacle(key, ObstacleType.CAR, Rectangle(4.5, 1.8), start, prediction)


def scenario(*obstacles: DynamicObstacle) -> Scenario:
    """A scenario of obstacles and nothing else."""
    made = Scenario(0.1)
    made.add_objects(list(obstacles))
    return made


def test_growing_occupancies_are_bounded_by_tracks_that_are_not_much_larger() -> None:
    growing = {step: Rectangle(4.5 + 0.4 * step, 1.8, np.array([0.5 * step, 0.0])) for step in range(1, 21)}
    tracks = occupied_regions(scenario(obstacle(7, growing)))[7]
    assert len(tracks) > 5
    assert len({track.obstacle_id for track in tracks}) == len(tracks)
    for step, region in growing.items():
        (there,) = [track for track in tracks if track.index_at(step) is not None]
        assert region.length <= there.length_m < region.length + 0.5
        assert there.positions[step - there.first_step] == pytest.approx(region.center)
        assert there.speeds_mps[step - there.first_step] == pytest.approx(5.0)


def test_rectangles_point_in_their_direction_of_motion() -> None:
    north = {step: Rectangle(1.8, 4.5, np.array([0.0, 0.5 * step])) for step in range(1, 6)}
    (track,) = occupied_regions(scenario(obstacle(7, north, heading_rad=np.pi / 2)))[7]
    assert track.headings_rad == pytest.approx(np.full(6, np.pi / 2))
    assert (track.length_m, track.width_m) == pytest.approx((4.5, 1.8))


def test_every_kind_of_shape_is_bounded() -> None:
    corners = np.array([[10.0, -1.0], [14.0, -1.0], [14.0, 1.0], [10.0, 1.0]])
    shapes = {1: Circle(1.0, np.array([5.0, 0.0])), 2: Polygon(corners)}
    shapes[3] = ShapeGroup([Rectangle(4.0, 2.0, np.array([15.0, 0.0])), Rectangle(3.0, 2.0, np.array([15.0, 8.0]))])
    tracks = occupied_regions(scenario(obstacle(7, shapes)))[7]
    at = {step: [t for t in tracks if t.index_at(step) is not None] for step in range(4)}
    assert [(t.length_m, t.width_m) for t in at[1]] == [(2.0, 2.0)]
    assert at[2][0].positions[2 - at[2][0].first_step] == pytest.approx((12.0, 0.0))
    assert at[2][0].length_m == pytest.approx(4.0)
    assert sorted(t.positions[3 - t.first_step][1] for t in at[3]) == pytest.approx([0.0, 8.0])


def test_occupancies_over_intervals_and_missing_occupancies() -> None:
    held = obstacle(7, {Interval(1, 10): Rectangle(4.5, 1.8, np.array([3.0, 0.0]))})
    regions = occupied_regions(scenario(held, obstacle(8, {})))
    assert [(track.first_step, track.last_step) for track in regions[7]] == [(0, 10)]
    assert [(track.first_step, track.last_step) for track in regions[8]] == [(0, 0)]
    assert regions[8][0].speeds_mps.tolist() == [0.0]
