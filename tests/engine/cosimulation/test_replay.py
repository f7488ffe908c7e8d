"""A re-simulation runs no longer than anything can still be seen of the vehicles that are driven."""

import itertools
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from support.builders import Vehicle, driving, swinging_bus, town_road

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.cosimulation import actors, plans, replay
from plannerforge.engine.cosimulation.actors import Actor, all_actors
from plannerforge.engine.cosimulation.driver import Behaviour, usual_behaviour
from plannerforge.engine.cosimulation.plans import recorded_plan
from plannerforge.engine.cosimulation.replay import SimulationSetup, replayed_states, resimulate
from plannerforge.engine.network.sumo_export.writer import sumo_net
from plannerforge.engine.scene.scene import Scene
from plannerforge.engine.traffic.sumo import Sumo
from plannerforge.engine.vehicles import VehicleClass

ASTRAY = driving(36, (20, 6.8), 10.0, 151)
"""Recorded nearer to the oncoming lane than to its own."""


@dataclass(frozen=True)
class Runs:
    """The steps of every simulation so far."""

    steps: list[int] = field(default_factory=list)
    simulations: list[Sumo] = field(default_factory=list)


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> Runs:
    """Counts the steps of the test's simulations."""
    counted, step = Runs(), Sumo.step

    def counted_step(sumo: Sumo) -> None:
        if not any(known is sumo for known in counted.simulations):
            counted.simulations.append(sumo)
            counted.steps.append(0)
        counted.steps[-1] += 1
        step(sumo)

    monkeypatch.setattr(Sumo, "step", counted_step)
    return counted


def test_without_a_driven_vehicle_no_simulation_runs(tmp_path: Path, runs: Runs) -> None:
    scene = _scene(tmp_path)
    assert resimulate(_setup(scene, tmp_path), all_actors(scene, {})) == {}
    assert runs.steps == []


def test_a_run_ends_when_the_last_driven_vehicle_has_left(tmp_path: Path, runs: Runs) -> None:
    scene = _scene(tmp_path)
    setup = replace(_setup(scene, tmp_path), last_step=50_000)
    seen = resimulate(setup, _driving(scene, 31, 35))
    last = max(track.first_step + len(track.front) - 1 for track in seen.values())
    assert all(track.leaves for track in seen.values())
    assert runs.steps == [last + 2]


def test_a_run_ends_once_all_astray_vehicles_are_known(tmp_path: Path, runs: Runs) -> None:
    scene = _scene(tmp_path, ASTRAY)
    seen = resimulate(_setup(scene, tmp_path), _driving(scene, 36))
    assert runs.steps[0] == 1
    assert runs.steps[1] >= len(seen[36].front) > 100


def test_stray_vehicles_are_searched_for_until_the_last_hand_over(tmp_path: Path, runs: Runs) -> None:
    scene = _scene(tmp_path, *town_road().vehicles, ASTRAY)
    late = recorded_plan(scene, 33, "edited", 40)
    plans = {36: recorded_plan(scene, 36, "edited", 0), 33: late}
    resimulate(_setup(scene, tmp_path), all_actors(scene, plans))
    assert runs.steps[0] == 41


def test_a_long_vehicle_that_swings_out_of_its_lane_is_driven_on_along_its_route(tmp_path: Path) -> None:
    scene = _scene(tmp_path, swinging_bus(37, 40))
    setup = replace(_setup(scene, tmp_path), last_step=40)
    seen = resimulate(setup, _driving(scene, 37))[37]
    assert len(seen.front) == 41
    assert all(seen.lanes)
    assert seen.lanes[-1].startswith(scene.layout.lane_of[13][0])


def test_poses_for_sumo_are_the_front_bumpers(tmp_path: Path) -> None:
    for actor in _driving(_scene(tmp_path), 31):
        for index in range(len(actor.track.positions)):
            assert actor.pose_at(index)[:2] == tuple(actor.track.front_at(index))


@pytest.fixture
def placed(monkeypatch: pytest.MonkeyPatch, runs: Runs) -> list[tuple[str, int]]:
    """Every placing by hand: SUMO's id, and the step."""
    noted, move_to = list[tuple[str, int]](), Sumo.move_to

    def noting(sumo: Sumo, key: str, *pose: Any, **options: Any) -> None:
        noted.append((key, runs.steps[-1] if sumo in runs.simulations else 0))
        move_to(sumo, key, *pose, **options)

    monkeypatch.setattr(Sumo, "move_to", noting)
    return noted


def test_far_vehicles_are_left_out_without_any_effect(
    tmp_path: Path, placed: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Without imperfection: it is drawn from random numbers that all vehicles of a lane share.
    for module in (actors, plans):
        monkeypatch.setattr(module, "usual_behaviour", _perfect_driver)
    scene = _scene(tmp_path, *(driving(50 + row, (20.0 + 14.0 * row, 3.5), 2.0, 90) for row in range(20)))
    setup = _setup(scene, tmp_path)
    acting = all_actors(scene, {53: recorded_plan(scene, 53, "edited", 20)})
    near = resimulate(setup, acting)[53]
    few = len(placed)
    monkeypatch.setattr(replay, "AROUND_M", 1e6)
    everywhere = resimulate(setup, acting)[53]
    assert near.front.tolist() == everywhere.front.tolist()
    assert len(near.front) == 70
    assert few < 0.5 * (len(placed) - few)


def test_a_removed_vehicle_returns(
    tmp_path: Path, placed: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    hurries = [(20.0 + 3.0 * step, 0.0, 0.0, 0.0) for step in range(50)]  # recorded as if it stood: it is soon left out
    waits = [(170.0, 0.0, 0.0, 0.0)] * 100
    scene = _scene(tmp_path, driving(50, (20, 3.5), 10.0, 151), Vehicle(51, (*hurries, *waits), "car", 4.5, 1.8, 0))
    monkeypatch.setattr(replay, "AROUND_M", 0.0)
    resimulate(_setup(scene, tmp_path), all_actors(scene, {50: recorded_plan(scene, 50, "edited", 0)}))
    steps = [step for key, step in placed if key == "51"]
    assert steps[0] == 0
    assert 1 < max(later - earlier for earlier, later in itertools.pairwise(steps)) < 100


def test_a_standing_vehicle_is_not_placed_again_and_stays_visible(
    tmp_path: Path, placed: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    waits = [(120.0, 0.0, 0.0, 0.0)] * 60
    goes_on = [(120.0 + 0.8 * step, 0.0, 0.0, 8.0) for step in range(90)]
    waiting = Vehicle(51, (*waits, *goes_on), "car", 4.5, 1.8, 0)
    at_the_end = driving(52, (297.5, 3.5), 0.0, 151)
    scene = _scene(tmp_path, driving(50, (20, 0), 12.0, 151), driving(53, (60, 3.5), 12.0, 151), waiting, at_the_end)
    acting = all_actors(scene, {key: recorded_plan(scene, key, "edited", 0) for key in (50, 53)})
    setup = _setup(scene, tmp_path)
    left_standing = resimulate(setup, acting)
    steps = [step for key, step in placed if key == "51"]
    seldom = len(placed)
    monkeypatch.setattr(Actor, "stands_at", lambda *_: False)
    placed_again = resimulate(setup, acting)
    for key in (50, 53):
        assert left_standing[key].front.tolist() == placed_again[key].front.tolist()
        assert left_standing[key].lanes == placed_again[key].lanes
    assert any(later - earlier > 40 for earlier, later in itertools.pairwise(steps))
    assert [key for key, _ in placed[:seldom]].count("52") > 40, "it ends there: SUMO would take it out"
    assert len(placed) - seldom > seldom + 30


def test_a_vehicle_that_leaves_the_road_is_removed_and_placed_as_a_new_one(
    tmp_path: Path, placed: list[tuple[str, int]]
) -> None:
    # SUMO crashes on a vehicle that left the road while its rear was on other lanes, as soon as another comes by.
    there = [(250.0 + step, 0.0, 0.0, 10.0) for step in range(20)]
    aside = [(270.0 + step, -40.0, 0.0, 10.0) for step in range(10)]
    back = [(280.0 + step, 0.0, 0.0, 10.0) for step in range(10)]
    scene = _scene(tmp_path, Vehicle(51, (*there, *aside, *back), "truck", 8.0, 2.5, 0))
    shown = replayed_states(_setup(scene, tmp_path), all_actors(scene, {}))
    assert {step for key, step in shown if key == "51"} == set(range(40))
    assert len([step for key, step in placed if key == "51"]) == 40


def _perfect_driver(vehicle_class: VehicleClass) -> Behaviour:
    driver = usual_behaviour(vehicle_class)
    return replace(driver, values={**driver.values, "sigma": 0.0})


def _scene(folder: Path, *vehicles: Vehicle) -> Scene:
    builder = town_road().with_vehicles(*vehicles) if vehicles else town_road()
    return Scene.of(read_scenario(builder.write(folder / "base.xml")))


def _setup(scene: Scene, folder: Path) -> SimulationSetup:
    net = folder / "scenario.net.xml"
    net.write_text(sumo_net(scene.layout, scene.lane_speeds_mps, scene.signals), encoding="utf-8")
    return SimulationSetup(net, folder, scene.step_s, scene.last_step, seed=0)


def _driving(scene: Scene, *keys: int) -> tuple[Actor, ...]:
    plans = {key: recorded_plan(scene, key, "edited", 0) for key in keys}
    return all_actors(scene, plans)
