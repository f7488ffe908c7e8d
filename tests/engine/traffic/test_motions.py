import math

import numpy as np

from plannerforge.engine.geometry.polyline import project, segment_lengths
from plannerforge.engine.traffic.motions import GeneratedVehicle, drop_infeasible, generated_vehicles
from plannerforge.engine.traffic.simulation import RawTrack
from plannerforge.engine.vehicles.classes import vehicle_classes
from plannerforge.engine.vehicles.motion import Motion

CLASSES = vehicle_classes()
RADIUS_M = 15.0


def standing(key: str, x_m: float, name: str = "car", *, feasible: bool = True) -> GeneratedVehicle:
    still = np.zeros(5)
    motion = Motion(np.tile([x_m, 0.0], (5, 1)), still, still, still)
    return GeneratedVehicle(key, CLASSES[name], motion, feasible)


def names(kept: tuple[GeneratedVehicle, ...]) -> set[str]:
    return {vehicle.vehicle_id for vehicle in kept}


def test_of_overlapping_vehicles_the_one_with_most_overlaps_is_removed() -> None:
    row = [standing("a", 0), standing("b", 4), standing("c", 8), standing("d", 30)]
    assert names(drop_infeasible(row, {})[0]) == {"a", "c", "d"}


def test_a_requested_class_stays_and_the_car_next_to_it_is_removed() -> None:
    row = [standing("bus", 0, "bus"), standing("one", 7), standing("other", 30)]
    assert names(drop_infeasible(row, {"bus": 1})[0]) == {"bus", "other"}


def test_an_undrivable_vehicle_is_removed_unless_its_class_was_requested() -> None:
    row = [standing("a", 0, feasible=False), standing("b", 20), standing("bus", 50, "bus", feasible=False)]
    assert names(drop_infeasible(row, {"bus": 1, "car": 1})[0]) == {"b", "bus"}


def test_the_centre_of_a_long_vehicle_keeps_to_the_lane_in_a_curve() -> None:
    """Straight on, a quarter turn of 15 m radius, straight on, with 7 m/s; the line is the lane's."""
    turn = np.linspace(0, math.pi / 2, 34)
    bend = np.stack([RADIUS_M * np.sin(turn), RADIUS_M * (1 - np.cos(turn))], axis=1)
    straight = np.stack([0.7 * np.arange(1, 61), np.zeros(60)], axis=1)
    before, after = -straight[::-1], straight[:, ::-1] + bend[-1]
    line = np.concatenate([before, bend, after])
    along = np.concatenate([[0.0], segment_lengths(line)])
    track = RawTrack("long", CLASSES["trailer"], line, along, np.zeros(len(line)), 0.0, 20)
    (made,) = generated_vehicles((track,), 0.1)
    aside = [abs(project(line, position)[1]) for position in made.motion.positions]
    assert made.feasible
    assert max(aside) < 0.8


def test_a_vehicle_that_missed_several_lane_changes_counts_as_not_drivable() -> None:
    """It stands while SUMO slides it over two lanes: others drive as if it were there."""
    along = np.concatenate([np.full(100, 0.5), np.zeros(100)])
    aside = np.concatenate([np.zeros(110), np.full(60, 0.107), np.zeros(30)])
    track = np.stack([np.cumsum(along), np.cumsum(aside)], axis=1)
    (made,) = generated_vehicles((RawTrack("a", CLASSES["car"], track, along, aside, 0.0, 50),), 0.1)
    assert not made.feasible
    assert np.abs(made.motion.headings_rad).max() < math.radians(5)
