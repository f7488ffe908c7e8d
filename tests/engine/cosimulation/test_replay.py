"""A re-simulation runs no longer than anything can still be seen of the vehicles that are driven."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import libsumo
import pytest
from support.builders import Vehicle, driving, town_road

from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.cosimulation.actors import Actor, all_actors
from plannerforge.engine.cosimulation.plans import recorded_plan
from plannerforge.engine.cosimulation.replay import front_of, resimulate
from plannerforge.engine.cosimulation.session import SimulationSetup
from plannerforge.engine.network.sumo_export.writer import write_sumo_net
from plannerforge.engine.scene.scene import Scene

ASTRAY = driving(36, (20, 6.8), 10.0, 151)
"""Recorded nearer to the oncoming lane than to its own."""


@dataclass(frozen=True)
class Runs:
    """The steps of every simulation so far."""

    steps: list[int] = field(default_factory=list)


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> Runs:
    """Counts the steps of the test's simulations."""
    counted, start, step = Runs(), libsumo.start, libsumo.simulationStep

    def counted_start(arguments: list[str]) -> None:
        counted.steps.append(0)
        start(arguments)

    def counted_step() -> None:
        counted.steps[-1] += 1
        step()

    monkeypatch.setattr(libsumo, "start", counted_start)
    monkeypatch.setattr(libsumo, "simulationStep", counted_step)
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


def test_it_looks_for_those_astray_until_the_last_hand_over(tmp_path: Path, runs: Runs) -> None:
    scene = _scene(tmp_path, *town_road().vehicles, ASTRAY)
    late = recorded_plan(scene, 33, "edited", 40)
    plans = {36: recorded_plan(scene, 36, "edited", 0), 33: late}
    resimulate(_setup(scene, tmp_path), all_actors(scene, plans))
    assert runs.steps[0] == 41


def test_poses_for_sumo_are_the_front_bumpers(tmp_path: Path) -> None:
    for one in _driving(_scene(tmp_path), 31):
        fronts = [tuple(front_of(one.track, index)) for index in range(len(one.track.positions))]
        assert [pose[:2] for pose in one.poses] == fronts


def test_the_lanelets_of_all_poses_are_those_of_each(tmp_path: Path) -> None:
    for match in _scene(tmp_path).matches.values():
        assert match.at_each(151) == [match.at(index) for index in range(151)]


def test_vehicles_matched_together_are_matched_as_each_alone(tmp_path: Path) -> None:
    beside = driving(36, (20, 90), 10.0, 151)
    scene = _scene(tmp_path, *town_road().vehicles, beside, driving(37, (165, 3), 9.0, 7))
    alone = {key: scene.matcher.match(track) for key, track in scene.tracks.items()}
    assert alone[36] is None
    assert scene.matches == {key: match for key, match in alone.items() if match is not None}
    assert scene.matcher.match_all({}) == {}


def _scene(folder: Path, *vehicles: Vehicle) -> Scene:
    builder = town_road().with_vehicles(*vehicles) if vehicles else town_road()
    return Scene.of(read_scenario(builder.write(folder / "base.xml")))


def _setup(scene: Scene, folder: Path) -> SimulationSetup:
    net = folder / "scenario.net.xml"
    write_sumo_net(scene.layout, scene.lane_speeds_mps, net, scene.signals)
    return SimulationSetup(net, folder, scene.step_s, scene.last_step, seed=0)


def _driving(scene: Scene, *keys: int) -> tuple[Actor, ...]:
    plans = {key: recorded_plan(scene, key, "edited", 0) for key in keys}
    return all_actors(scene, plans)
