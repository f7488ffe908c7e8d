"""What the ego of a class is and can do, and which vehicle a configuration and a class mean together."""

import math
from pathlib import Path

import libsumo
import pytest
from support.builders import town_road
from support.edits import schema_errors

from plannerforge.engine.commonroad import ScenarioDocument, read_recorded
from plannerforge.engine.network import sumo_net
from plannerforge.engine.scene import Scene
from plannerforge.engine.traffic import sumo_running, vehicle_type
from plannerforge.engine.vehicles import (
    VEHICLES,
    commonroad_vehicle,
    ego_class,
    ego_class_of,
    vehicle_classes,
    vehicle_of,
)
from plannerforge.engine.vehicles.models import ego_classes
from plannerforge.schemas.errors import InvalidRequest, NotPossible, UnknownName, UnsafeInput
from plannerforge.schemas.planning import PlannerSettings
from plannerforge.schemas.vocabulary import EGO_CLASSES

SINGLE_BODIES = [name for name in EGO_CLASSES if name != "trailer"]


def test_every_word_has_a_class_and_every_limit_a_source() -> None:
    assert set(ego_classes()) == set(EGO_CLASSES)
    assert all(known.source for known in ego_classes().values())
    assert [name for name, known in ego_classes().items() if known.motion_model == "KST"] == ["trailer"]


@pytest.mark.parametrize("name", SINGLE_BODIES)
def test_size_and_axles_match_the_class(name: str) -> None:
    vehicle, known = ego_class(name).vehicle, vehicle_classes()[name]
    assert vehicle.vehicle_class == name
    assert vehicle.rear_axle_behind_center_m <= vehicle.length_m / 2
    assert vehicle.rear_axle_behind_center_m < vehicle.wheelbase_m < vehicle.length_m
    if name != "car":
        assert vehicle.size_m == (known.length_m, known.width_m)
        assert (vehicle.wheelbase_m, vehicle.rear_axle_behind_center_m) == (known.wheelbase_m, known.rear_axle_m)


def test_a_car_is_vehicle_2_and_a_semi_trailer_vehicle_4_as_long_as_the_combination() -> None:
    assert ego_class("car").vehicle == VEHICLES[2]
    trailer = ego_class("trailer").vehicle
    assert trailer.size_m == (16.5, 2.55)
    assert (trailer.maximum_speed_mps, trailer.maximum_steering_rad) == (22.22, 0.55)


def test_braking_of_heavy_and_two_wheeled_vehicles_is_sumo_s_emergency_braking(tmp_path: Path) -> None:
    scene = Scene.of(read_recorded(town_road().write(tmp_path / "base.xml")).loaded)
    net = tmp_path / "scenario.net.xml"
    net.write_text(sumo_net(scene.layout, scene.lane_speeds_mps, scene.signals), encoding="utf-8")
    names = ("truck", "bus", "coach", "motorcycle", "moped")
    types = [vehicle_type(f"t{name}", vClass=vehicle_classes()[name].sumo_class) for name in names]
    with sumo_running(net, tmp_path / "types.add.xml", types, step_s=0.1, seed=0, options={}):
        hardest = {name: libsumo.vehicletype.getEmergencyDecel(f"t{name}") for name in names}
    assert hardest == {name: ego_class(name).vehicle.maximum_acceleration_mps2 for name in names}


def test_a_coach_turns_within_the_circle_of_the_law() -> None:
    vehicle = ego_class("coach").vehicle
    rear_axle_radius_m = vehicle.wheelbase_m / math.tan(vehicle.maximum_steering_rad)
    front_m = vehicle.length_m / 2 + vehicle.rear_axle_behind_center_m
    assert math.hypot(front_m, rear_axle_radius_m + vehicle.width_m / 2) == pytest.approx(12.5)


def test_a_bus_turns_as_in_its_data_sheet() -> None:
    vehicle = ego_class("bus").vehicle
    front_m = vehicle.length_m / 2 + vehicle.rear_axle_behind_center_m
    outer_m = math.hypot(front_m, vehicle.wheelbase_m / math.tan(vehicle.maximum_steering_rad) + vehicle.width_m / 2)
    assert 2 * outer_m == pytest.approx(21.03, abs=0.4)


@pytest.mark.parametrize("name", SINGLE_BODIES)
def test_power_limits_the_acceleration_of_every_class(name: str) -> None:
    vehicle = ego_class(name).vehicle
    fast_mps = 3 * vehicle.switching_speed_mps
    assert vehicle.most_acceleration_mps2(0.0) == vehicle.maximum_acceleration_mps2
    assert vehicle.most_acceleration_mps2(fast_mps) == pytest.approx(vehicle.maximum_acceleration_mps2 / 3)


@pytest.mark.parametrize(
    ("settings", "name", "length_m", "speed_mps", "drives"),
    [
        ({}, "car", 4.508, 50.8, "car"),
        ({}, "truck", 7.1, 36.1, "truck"),
        ({"vehicle": 3}, "truck", 4.569, 41.7, "car"),
        ({"vehicle": 2, "vehicle_stated": True}, "bus", 4.508, 50.8, "car"),
        ({"vehicle": 4}, "trailer", 5.1, 22.22, "truck"),
        ({"length_m": 8.0}, "truck", 8.0, 36.1, "truck"),
        ({"maximum_speed_mps": 25.0}, "bus", 12.0, 25.0, "bus"),
    ],
)
def test_a_configuration_s_vehicle_takes_precedence_over_the_class(
    settings: dict[str, float], name: str, length_m: float, speed_mps: float, drives: str
) -> None:
    vehicle = vehicle_of(PlannerSettings.model_validate(settings), name)
    assert (vehicle.length_m, vehicle.maximum_speed_mps, vehicle.vehicle_class) == (length_m, speed_mps, drives)


def test_a_semi_trailer_is_refused_by_name_with_drivable_classes() -> None:
    with pytest.raises(NotPossible, match="trailer") as caught:
        vehicle_of(PlannerSettings(), "trailer")
    assert caught.value.reason == "articulated_ego"
    assert set(caught.value.valid) == set(SINGLE_BODIES)


def test_a_length_that_does_not_fit_the_class_is_refused() -> None:
    with pytest.raises(InvalidRequest, match="bus"):
        vehicle_of(PlannerSettings(length_m=5.0), "bus")


def test_a_solution_file_can_name_the_vehicle_of_cars_alone() -> None:
    assert commonroad_vehicle(PlannerSettings(), "car") == 2
    assert commonroad_vehicle(PlannerSettings(vehicle=3), "truck") == 3
    assert all(commonroad_vehicle(PlannerSettings(), name) is None for name in SINGLE_BODIES if name != "car")


@pytest.mark.parametrize(
    ("kind", "length_m", "name"),
    [
        ("car", 4.9, "car"),
        ("truck", 8.2, "truck"),
        ("truck", 15.0, "trailer"),
        ("bus", 11.0, "bus"),
        ("taxi", 4.5, "taxi"),
    ],
)
def test_a_recorded_vehicle_is_the_class_of_its_type_with_the_nearest_length(
    kind: str, length_m: float, name: str
) -> None:
    known = ego_class_of(kind, length_m)
    assert known is not None
    assert known.name == name


@pytest.mark.parametrize("kind", ["bicycle", "pedestrian", "parkedVehicle", "unknown"])
def test_a_class_that_is_not_a_motor_vehicle_is_not_an_ego(kind: str) -> None:
    assert ego_class_of(kind, 2.0) is None
    with pytest.raises(UnknownName, match="cannot be") as caught:
        ego_class(kind)
    assert set(caught.value.valid) <= set(EGO_CLASSES)


def written(tmp_path: Path, name: str) -> Path:
    """A scenario whose file says that its ego is that."""
    path = town_road().write(tmp_path / f"{name}.xml")
    document = ScenarioDocument.read(path)
    document.set_ego_class(100, name)
    document.write(path, "ZAM_Builder-1_1_T-1")
    return path


@pytest.mark.parametrize("name", EGO_CLASSES)
def test_a_file_states_its_ego_s_class_and_matches_the_schema(name: str, tmp_path: Path) -> None:
    plain = town_road().write(tmp_path / "plain.xml")
    path = written(tmp_path, name)
    read = read_recorded(path)
    assert read.loaded.ego_class(100) == name
    assert schema_errors(path) == schema_errors(plain)
    assert {key: track.kind for key, track in read.tracks.items()} == {
        key: track.kind for key, track in read_recorded(plain).tracks.items()
    }
    assert Scene.of(read.loaded).ego.size_m == ego_class(name).vehicle.size_m  # type: ignore[union-attr]


def test_a_car_is_written_as_before_there_were_classes(tmp_path: Path) -> None:
    path = written(tmp_path, "bus")
    document = ScenarioDocument.read(path)
    document.set_ego_class(100, "car")
    document.write(path, "ZAM_Builder-1_1_T-1")
    assert "plannerforge" not in path.read_text(encoding="utf-8")
    assert read_recorded(path).loaded.ego_class(100) == "car"


def test_a_file_with_an_impossible_ego_is_refused_with_the_valid_classes(tmp_path: Path) -> None:
    path = written(tmp_path, "bus")
    path.write_text(path.read_text(encoding="utf-8").replace('"bus"', '"tank"'), encoding="utf-8")
    with pytest.raises(UnsafeInput, match="tank") as caught:
        read_recorded(path)
    assert set(caught.value.valid) == set(EGO_CLASSES)
