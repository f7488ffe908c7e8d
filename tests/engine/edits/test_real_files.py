"""Edits on real scenarios of several countries and both formats."""

from pathlib import Path

import pytest
from edit_support import Applied, apply_to, schema_errors

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
def test_touched_vehicles_change_and_nothing_else(shared_data: Path, tmp_path: Path, name: str) -> None:
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
