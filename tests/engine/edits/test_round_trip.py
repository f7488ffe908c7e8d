"""SUMO shows every road user where and as fast as it was recorded."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from support.builders import ScenarioBuilder, Vehicle, driving, town_road

from benchmarks.modification.round_trip import RoundTrip, round_trip
from plannerforge.engine.commonroad.reader import read_scenario
from plannerforge.engine.scene.scene import Scene

WALKER = driving(36, (75, 12), 1.2, 101, heading_rad=math.pi / 2, kind="pedestrian", size_m=(0.5, 0.6))
FAR_AWAY = driving(37, (100, 90), 1.2, 101, kind="pedestrian", size_m=(0.5, 0.6))
BESIDE = driving(38, (20, 6.2), 9.0, 101, heading_rad=0.3)
ARRIVES = replace(driving(39, (10, 3.5), 10.0, 60), first_step=45)
PARKED = Vehicle(40, ((120.0, -2.0, 0.1, 0.0),))


def tried(builder: ScenarioBuilder, folder: Path) -> RoundTrip:
    return round_trip(Scene.of(read_scenario(builder.write(folder / "base.xml"))))


@pytest.mark.parametrize("version", ["2018b", "2020a"])
def test_all_road_users_keep_their_recording(tmp_path: Path, version: str) -> None:
    town = town_road()
    builder = replace(town.with_vehicles(*town.vehicles, WALKER, BESIDE, ARRIVES), parked=(PARKED,), version=version)
    result = tried(builder, tmp_path)
    assert result.road_users == 9
    # BESIDE leaves the road at step 11: it is replaced by a new vehicle, because libsumo may crash over the old one.
    assert result.missing == ()
    assert result.position_error_m <= 0.01
    assert result.speed_error_mps <= 0.01


def test_a_vehicle_far_from_every_lane_keeps_its_recording(tmp_path: Path) -> None:
    result = tried(town_road().with_vehicles(FAR_AWAY), tmp_path)
    assert result.missing == ()
    assert result.position_error_m <= 0.01
