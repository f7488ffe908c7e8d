"""A scenario that is edited again is not read again, unless its content is another."""

from pathlib import Path

import pytest
from support.builders import driving, town_road
from support.edits import apply_to

from plannerforge.engine.commonroad.reader import RecordedScenario, XmlLimits, kept_recording
from plannerforge.engine.cosimulation.replay import SimulationSetup
from plannerforge.engine.edits.ego_risk import EgoDrive, base_drive
from plannerforge.engine.edits.scene_cache import scene_of
from plannerforge.engine.execution.executor import silent
from plannerforge.engine.scenarios.description import describe
from plannerforge.engine.scene.ego_relations import leader_and_follower
from plannerforge.engine.scene.scene import Ego, Scene
from plannerforge.schemas.errors import UnsafeInput
from plannerforge.schemas.scenarios import DescribeRequest

EDIT = {"op": "set_behaviour", "vehicles": ["31"], "preset": "aggressive"}


def test_the_same_content_is_read_once(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "base.xml")
    assert scene_of(path) is scene_of(path)


def test_a_scenario_that_was_described_is_not_read_for_an_edit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = town_road().write(tmp_path / "base.xml")
    describe(DescribeRequest(path=path, detail="brief", focus=None, radius_m=50.0), silent)

    def read_again(path: Path, limits: XmlLimits) -> RecordedScenario:
        del limits
        raise AssertionError(f"{path.name} is read again")

    monkeypatch.setattr("plannerforge.engine.commonroad.reader.read_recorded", read_again)
    assert apply_to(path, tmp_path / "out", EDIT).outcome.touched


def test_lead_and_follower_of_a_scenario_are_looked_for_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    request = DescribeRequest(path=town_road().write(tmp_path / "base.xml"), detail="brief", focus=None, radius_m=50.0)
    looked: list[Ego] = []

    def look(scene: Scene, ego: Ego) -> tuple[int | None, int | None]:
        looked.append(ego)
        return leader_and_follower(scene, ego)

    monkeypatch.setattr("plannerforge.engine.edits.scene_cache.leader_and_follower", look)
    assert describe(request, silent) == describe(request, silent)
    assert len(looked) == 1


def test_a_recording_is_read_once_for_runs_pictures_and_edits(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "base.xml")
    assert kept_recording(path) is kept_recording(path)
    assert scene_of(path).scene.loaded is kept_recording(path).loaded
    first, stored = kept_recording(path), tmp_path / "stored.xml"
    stored.write_bytes(path.read_bytes())
    assert kept_recording(stored).loaded.scenario is first.loaded.scenario
    assert kept_recording(stored).loaded.path == stored
    town_road().with_vehicles(driving(77, (60, 0), 10.0, 101)).write(path)
    assert kept_recording(path) is not first


def test_other_content_under_the_same_name_is_read_again(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "base.xml")
    assert 31 in scene_of(path).scene.tracks
    town_road().with_vehicles(driving(77, (60, 0), 10.0, 101)).write(path)
    assert list(scene_of(path).scene.tracks) == [77]


def test_an_edit_does_not_change_the_cached_scene(tmp_path: Path) -> None:
    path = town_road().write(tmp_path / "base.xml")
    first = apply_to(path, tmp_path / "one", EDIT).xml.read_bytes()
    apply_to(path, tmp_path / "two", {"op": "remove_vehicle", "vehicles": ["all"]}, {"op": "set_goal", "to": ["11"]})
    assert apply_to(path, tmp_path / "three", EDIT).xml.read_bytes() == first


def test_the_ego_drives_before_the_edits_once_for_a_scene_and_a_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seeds = []

    def counted(base: Scene, setup: SimulationSetup) -> EgoDrive | None:
        seeds.append(setup.seed)
        return base_drive(base, setup)

    monkeypatch.setattr("plannerforge.engine.edits.scene_cache.base_drive", counted)
    path = town_road().write(tmp_path / "base.xml")
    goal = {"op": "set_goal", "to": ["11"]}
    dangers = [apply_to(path, tmp_path / "out", EDIT, seed=seed).outcome.ego_before for seed in (5, 5, 6)]
    dangers.append(apply_to(path, tmp_path / "out", goal, seed=6).outcome.ego_before)
    assert seeds == [5, 6]
    assert dangers[0] == dangers[1]
    assert dangers[2] == dangers[3]


def test_a_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(UnsafeInput, match=r"nothing\.xml"):
        scene_of(tmp_path / "nothing.xml")
