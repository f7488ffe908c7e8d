"""Vehicle classes: the words of a request, their SUMO class, CommonRoad type and real dimensions.

Classes and mapping after the paper's generation intent (``request_types``); a class that CommonRoad has no type for
(trailer, delivery, coach, moped) takes the nearest type, and its own name stays in the scenario's metadata.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class VehicleClass:
    """One class of vehicle.

    ``commonroad_type`` is a value of CommonRoad's ``ObstacleType``; lengths in metres, speeds in m/s.
    """

    name: str
    sumo_class: str
    commonroad_type: str
    length_m: float
    width_m: float
    acceleration_mps2: float
    deceleration_mps2: float
    minimum_gap_m: float
    maximum_speed_mps: float


_CLASSES = (
    VehicleClass("car", "passenger", "car", 4.5, 1.8, 2.6, 4.5, 2.5, 55.6),
    VehicleClass("truck", "truck", "truck", 7.1, 2.4, 1.3, 4.0, 2.5, 36.1),
    VehicleClass("trailer", "trailer", "truck", 16.5, 2.55, 1.1, 4.0, 2.5, 36.1),
    VehicleClass("delivery", "delivery", "truck", 6.5, 2.16, 2.2, 4.5, 2.5, 44.4),
    VehicleClass("bus", "bus", "bus", 12.0, 2.5, 1.2, 4.0, 2.5, 23.6),
    VehicleClass("coach", "coach", "bus", 14.0, 2.55, 1.2, 4.0, 2.5, 27.8),
    VehicleClass("taxi", "taxi", "taxi", 4.8, 1.85, 2.6, 4.5, 2.5, 55.6),
    VehicleClass("emergency", "emergency", "priorityVehicle", 6.5, 2.16, 2.6, 4.5, 2.5, 55.6),
    VehicleClass("motorcycle", "motorcycle", "motorcycle", 2.2, 0.9, 4.0, 6.0, 2.0, 55.6),
    VehicleClass("moped", "moped", "motorcycle", 2.1, 0.8, 1.1, 5.0, 2.0, 12.5),
    VehicleClass("bicycle", "bicycle", "bicycle", 1.6, 0.65, 1.0, 3.0, 0.5, 5.6),
)


def vehicle_classes() -> dict[str, VehicleClass]:
    """All classes by the word used for them in requests."""
    return {vehicle_class.name: vehicle_class for vehicle_class in _CLASSES}


def sumo_class_of(commonroad_type: str) -> str:
    """SUMO's class for a CommonRoad obstacle type; ``passenger`` for types that SUMO has no class for."""
    for vehicle_class in _CLASSES:
        if vehicle_class.commonroad_type == commonroad_type:
            return vehicle_class.sumo_class
    return "pedestrian" if commonroad_type == "pedestrian" else "passenger"
