"""Long vehicles are driven and judged with the axles of their class, not with a car's."""

import numpy as np
import pytest
from support.builders import driving, town_road
from support.edits import Apply

from plannerforge.engine.commonroad.tracks import Track
from plannerforge.engine.vehicles.classes import nearest_class, vehicle_classes
from plannerforge.engine.vehicles.motion import Motion, check_drivability, check_kinematics

BUS = vehicle_classes()["bus"]
TURN = {"op": "reroute", "vehicles": ["36"], "turn": "right"}


def turning_bus(apply: Apply, **request: object) -> tuple[Track, bool]:
    """The track of a bus that takes a bend, and whether the report calls it drivable."""
    bus = driving(36, (160, 0), 7.0, 101, kind="bus", size_m=(BUS.length_m, BUS.width_m))
    applied = apply(TURN, builder=town_road().with_vehicles(bus), **request)
    return applied.tracks()[36], applied.outcome.touched[0].feasible


def sideways_m(track: Track, rear_axle_m: float) -> float:
    """How far a point behind the centre moves across its heading in a step, at most."""
    forward = np.stack([np.cos(track.headings_rad), np.sin(track.headings_rad)], axis=1)
    moved = np.diff(track.positions - rear_axle_m * forward, axis=0)
    middle = forward[:-1] + forward[1:]
    middle /= np.linalg.norm(middle, axis=1)[:, None]
    return float(np.abs(moved[:, 0] * middle[:, 1] - moved[:, 1] * middle[:, 0]).max())


def test_the_rear_axle_of_a_bus_follows_its_front_without_slipping(apply: Apply) -> None:
    track, feasible = turning_bus(apply)
    assert feasible
    assert np.ptp(track.headings_rad) > 1.4
    assert sideways_m(track, BUS.rear_axle_m) < 0.005


def test_the_checker_judges_a_bus_by_its_own_axles(apply: Apply) -> None:
    _, feasible = turning_bus(apply, detail="checks")
    assert feasible


@pytest.mark.filterwarnings("ignore:Excess work")  # of the checker's search, where it finds no steering
@pytest.mark.parametrize("check", [check_kinematics, check_drivability])
def test_a_curve_that_a_car_can_take_is_too_tight_for_a_bus(check: object) -> None:
    assert callable(check)
    rate, rear_m, step_s, speed_mps = 2.0, 1.0, 0.1, 4.0
    turn_rad = rate * step_s * np.arange(6)
    rear = speed_mps / rate * np.stack([np.sin(turn_rad), 1 - np.cos(turn_rad)], axis=1)
    centers = rear + rear_m * np.stack([np.cos(turn_rad), np.sin(turn_rad)], axis=1)
    motion = Motion(centers, turn_rad, np.full(6, speed_mps), np.zeros(6))
    assert check(motion, step_s, wheelbase_m=vehicle_classes()["car"].wheelbase_m, rear_axle_m=rear_m).feasible
    assert not check(motion, step_s, wheelbase_m=BUS.wheelbase_m, rear_axle_m=rear_m).feasible


@pytest.mark.parametrize(
    ("kind", "length_m", "name"),
    [
        ("truck", 7.5, "truck"),
        ("truck", 15.0, "trailer"),
        ("bus", 12.4, "bus"),
        ("car", 5.3, "car"),
        ("tram", 9, "car"),
    ],
)
def test_a_recorded_vehicle_is_of_the_class_that_is_nearest_in_length(kind: str, length_m: float, name: str) -> None:
    assert nearest_class(kind, length_m).name == name


def test_no_added_vehicle_drives_faster_than_its_class_can(apply: Apply) -> None:
    moped = {"op": "add_vehicle", "vehicle_class": "moped", "at": "1", "position": "5m", "speed": "5m/s"}
    applied = apply(moped, builder=town_road().with_vehicles(driving(34, (280, 7), 11.0, 151, heading_rad=np.pi)))
    speeds = applied.tracks()[101].speeds_mps
    assert speeds[0] < 12.0 < speeds.max() < vehicle_classes()["moped"].maximum_speed_mps + 0.1


def test_a_recorded_vehicle_may_be_as_fast_as_it_was(apply: Apply) -> None:
    racer = driving(36, (20, 0), 9.0, 101, kind="bicycle", size_m=(1.6, 0.65))
    applied = apply(
        {"op": "set_behaviour", "vehicles": ["36"], "params": ["sigma=0"]}, builder=town_road().with_vehicles(racer)
    )
    assert applied.tracks()[36].speeds_mps[-1] == pytest.approx(9.0, abs=0.2)
