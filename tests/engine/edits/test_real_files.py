"""Edits on real scenarios of several countries and both formats."""

from pathlib import Path

import pytest
from support.edits import Applied, apply_to, schema_errors

FILES = (
    "ARG_Carcarana-12_1_T-1.xml",
    "USA_Lanker-1_1_T-1.xml",
    "DEU_Lohmar-32_1_T-1.xml",
    "CHN_Qingdao-33_9_T-1.xml",
    "ITA_Foggia-19_1_T-1.xml",
)
EDITS = (
    {"op": "set_behaviour", "vehicles": ["nearest:1"], "preset": "aggressive"},
    {"op": "remove_vehicle", "vehicles": ["farthest"]},
)


def edited(shared_data: Path, name: str, tmp_path: Path) -> Applied:
    return apply_to(shared_data / "data" / "commonroad" / name, tmp_path / name, *EDITS)


@pytest.mark.shared_data
@pytest.mark.parametrize("name", FILES)
def test_only_touched_vehicles_change(shared_data: Path, tmp_path: Path, name: str) -> None:
    applied = edited(shared_data, name, tmp_path)
    touched = {vehicle.vehicle_id for vehicle in applied.outcome.touched}
    assert applied.changed_elements() == {str(key) for key in touched | set(applied.outcome.removed)}
    assert schema_errors(applied.xml) <= schema_errors(applied.base)
    tracks, base = applied.tracks(), applied.base_tracks()
    assert set(tracks) == set(base) - set(applied.outcome.removed)
    for vehicle in applied.outcome.touched:
        assert vehicle.handover_jump_m is not None
        assert vehicle.handover_jump_m <= 0.05
        assert tracks[vehicle.vehicle_id].positions[0] == pytest.approx(base[vehicle.vehicle_id].positions[0])


@pytest.mark.shared_data
@pytest.mark.parametrize(
    ("name", "edit"),
    [
        ("CHN_Qingdao-12_9_T-1.xml", {"op": "reroute", "vehicles": ["30737"], "to": ["248"]}),
        ("DEU_Arnstadt-83_1_T-4.xml", {"op": "reroute", "vehicles": ["20047"], "to": ["1778"]}),
        ("CHN_Qingdao-38_3_T-1.xml", {"op": "add_vehicle", "vehicle_class": "bus", "at": "ego", "offset_m": 25.0}),
    ],
    ids=["who creeps across lanes is seen in both", "a queue of six behind", "a bus right before a fast car"],
)
def test_no_collision_is_left(shared_data: Path, tmp_path: Path, name: str, edit: dict[str, object]) -> None:
    applied = apply_to(shared_data / "data" / "commonroad" / name, tmp_path / name, edit)
    assert applied.outcome.collisions == ()


@pytest.mark.shared_data
def test_an_obstacle_may_have_the_number_of_the_planning_problem(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "data" / "commonroad" / "ZAM_OpenDrive-1.xml"
    applied = apply_to(source, tmp_path, {"op": "set_behaviour", "vehicles": ["all"], "preset": "eco"})
    assert [one.vehicle_id for one in applied.outcome.touched] == [256, 257]
    assert applied.outcome.ego_after is not None


@pytest.mark.shared_data
def test_standing_behind_an_ego_inside_the_junction_is_reported(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "data" / "commonroad" / "CHN_Qingdao-33_4_T-1.xml"
    applied = apply_to(source, tmp_path, {"op": "reroute", "vehicles": ["30693"], "to": ["859"]})
    (route,) = applied.outcome.edits[0].routes
    assert route.reason.endswith(" s standing on lanelet 124 behind the ego")
