"""Edits in memory give the scenario that a run reads from the written file, value for value."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.builders import town_road
from support.edits import NEW_ID, apply_to

from plannerforge.engine.commonroad.reader import LoadedScenario, kept_recording
from plannerforge.engine.edits.in_memory import EditableScenario, NeedsFile
from plannerforge.engine.planners.interface import EgoState
from plannerforge.schemas.errors import NotPossible
from plannerforge.schemas.modification import Edit

_CAR_AHEAD = {"op": "add_vehicle", "vehicle_class": "car", "at": "ego", "offset_m": 15.0, "speed": "10m/s"}
EDITS: dict[str, list[dict[str, Any]]] = {
    "braking": [{"op": "set_speed", "vehicles": ["31"], "speed": "2m/s", "rate_mps2": 5.0, "time_s": 2.0}],
    "ordered speed": [{"op": "set_speed", "vehicles": ["31"], "speed": "4m/s"}],
    "lane change": [{"op": "change_lane", "vehicles": ["33"], "lane": "right", "time_s": 4.0, "lateral_s": 3.0}],
    "shift": [{"op": "shift_time", "vehicles": ["34"], "time_s": 0.7}],
    "shift earlier": [{"op": "shift_time", "vehicles": ["32"], "time_s": -0.5}],
    "removal": [{"op": "remove_vehicle", "vehicles": ["31"]}],
    "another class": [{"op": "replace", "vehicles": ["35"], "vehicle_class": "bicycle"}],
    "added": [_CAR_AHEAD],
    "added and braking": [
        _CAR_AHEAD,
        {"op": "set_speed", "vehicles": ["new:0"], "speed": "0m/s", "rate_mps2": 4.0, "time_s": 1.0},
    ],
    "walker": [{"op": "add_vehicle", "vehicle_class": "pedestrian", "at": "1", "position": "120m", "side": "right"}],
    "triggered walker": [
        {
            "op": "add_vehicle",
            "vehicle_class": "pedestrian",
            "at": "1",
            "position": "130m",
            "side": "right",
            "when": "gap<=2s",
        }
    ],
    "parked": [{"op": "add_vehicle", "vehicle_class": "car", "at": "1", "position": "120m", "side": "right"}],
    "ego": [{"op": "set_ego", "speed": "12.3456789m/s"}, {"op": "set_goal", "to": ["11"]}],
    "truck ego": [{"op": "set_ego", "vehicle_class": "truck"}],
}
_REMOVED_LEAD = {"op": "remove_vehicle", "vehicles": ["35"]}


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return town_road().cut(100).write(tmp_path_factory.mktemp("base") / "base.xml")


def _same_runs_input(here: LoadedScenario, file: LoadedScenario) -> None:
    """Assert that both scenarios have the same content for a run."""
    assert list(here.tracks) == list(file.tracks)
    for key, track in file.tracks.items():
        mine = here.tracks[key]
        assert (mine.kind, mine.size_m, mine.first_step) == (track.kind, track.size_m, track.first_step), key
        for name in ("positions", "headings_rad", "speeds_mps"):
            assert np.array_equal(getattr(mine, name), getattr(track, name)), (key, name)
    starts = [EgoState.of(one.problem().initial_state) for one in (here, file)]
    assert np.array_equal(starts[0].position, starts[1].position)
    assert {**vars(starts[0]), "position": None} == {**vars(starts[1]), "position": None}
    assert here.problem().goal == file.problem().goal
    assert here.ego_classes == file.ego_classes
    assert here.prescribed_ids == file.prescribed_ids
    assert sorted(here.script_texts) == sorted(file.script_texts)
    bodies = [
        {one.obstacle_id: (one.obstacle_type, one.obstacle_shape) for one in loaded.scenario.obstacles}
        for loaded in (here, file)
    ]
    assert bodies[0] == bodies[1]


@pytest.mark.parametrize("name", EDITS)
def test_the_scenario_in_memory_is_that_of_the_file(name: str, base: Path, tmp_path: Path) -> None:
    edits = [_REMOVED_LEAD, *EDITS[name]] if "35" not in str(EDITS[name]) else EDITS[name]
    edits = [{**edit, "vehicles": ["new:1"]} if edit.get("vehicles") == ["new:0"] else edit for edit in edits]
    written = apply_to(base, tmp_path / "out", *edits, benchmark_id=NEW_ID)
    with EditableScenario(base) as scenario:
        edited = scenario.edited(tuple(Edit.model_validate(edit) for edit in edits))
    _same_runs_input(edited.loaded, kept_recording(written.xml).loaded)
    infeasible = tuple(one.vehicle_id for one in written.outcome.touched if not one.feasible)
    assert edited.infeasible == infeasible


def test_the_base_stays_as_it_is(base: Path) -> None:
    with EditableScenario(base) as scenario:
        before = {key: track.positions.copy() for key, track in scenario.loaded.tracks.items()}
        scenario.edited((Edit.model_validate(EDITS["braking"][0]), Edit(op="remove_vehicle", vehicles=["33"])))
        again = scenario.edited((Edit(op="set_ego", speed="9m/s"),))
        assert {key: track.positions.tolist() for key, track in again.loaded.tracks.items()} == {
            key: positions.tolist() for key, positions in before.items()
        }


def test_edits_of_the_whole_scene_need_a_file(base: Path) -> None:
    with EditableScenario(base) as scenario, pytest.raises(NeedsFile):
        scenario.edited((Edit(op="mirror"),))


def test_collisions_among_others_are_refused(base: Path) -> None:
    crossing = Edit(op="change_lane", vehicles=["33"], lane="right", time_s=0.5, lateral_s=1.0)
    with EditableScenario(base) as scenario, pytest.raises(NotPossible):
        scenario.edited((Edit(op="set_speed", vehicles=["31"], speed="2m/s", rate_mps2=6.0, time_s=0.0), crossing))


def test_a_horizon_ends_the_simulation_of_vehicles_and_nothing_else(base: Path) -> None:
    alone = Edit(op="remove_vehicle", vehicles=["32", "35"])
    edits = (Edit.model_validate(EDITS["ordered speed"][0]), alone)
    with EditableScenario(base, horizon_s=4.0) as scenario:
        cut, whole = scenario.edited(edits), scenario.edited(edits, whole=True)
    assert (cut.is_cut, whole.is_cut) == (True, False)
    short, long = cut.loaded.tracks, whole.loaded.tracks
    assert short.keys() == long.keys()
    assert 40 <= short[31].last_step < long[31].last_step
    assert np.allclose(short[31].positions[:35], long[31].positions[:35], atol=0.01)
    assert all(np.array_equal(track.positions, long[key].positions) for key, track in short.items() if key != 31)


@pytest.mark.parametrize("horizon_s", [8.0, None])
def test_a_horizon_that_saves_little_cuts_nothing(base: Path, horizon_s: float | None) -> None:
    with EditableScenario(base, horizon_s=horizon_s) as scenario:
        assert not scenario.edited(
            (Edit.model_validate(EDITS["ordered speed"][0]), Edit.model_validate(_REMOVED_LEAD))
        ).is_cut
