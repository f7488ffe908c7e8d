"""Vehicle classes: the words of a request, their SUMO class, CommonRoad type and real dimensions.

Classes and mapping follow the paper's generation intent (``request_types``); a class without a CommonRoad type
(trailer, delivery, coach, moped) uses the most similar type, and its own name is stored with the scenario. A car has
the axles of CommonRoad's vehicle 2.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class VehicleClass:
    """One class of vehicle.

    ``commonroad_type`` is a value of CommonRoad's ``ObstacleType``; lengths in metres, speeds in m/s. The wheelbase and
    the distance from the centre back to the rear axle are those of a single-track model; a trailer counts as rigid.
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
    wheelbase_m: float
    rear_axle_m: float


_CLASSES = (
    VehicleClass("car", "passenger", "car", 4.5, 1.8, 2.6, 4.5, 2.5, 55.6, 2.5789, 1.4227),
    VehicleClass("truck", "truck", "truck", 7.1, 2.4, 1.3, 4.0, 2.5, 36.1, 4.2, 1.9),
    VehicleClass("trailer", "trailer", "truck", 16.5, 2.55, 1.1, 4.0, 2.5, 36.1, 8.0, 4.0),
    VehicleClass("delivery", "delivery", "truck", 6.5, 2.16, 2.2, 4.5, 2.5, 44.4, 3.7, 1.7),
    VehicleClass("bus", "bus", "bus", 12.0, 2.5, 1.2, 4.0, 2.5, 23.6, 5.9, 2.65),
    VehicleClass("coach", "coach", "bus", 14.0, 2.55, 1.2, 4.0, 2.5, 27.8, 6.9, 2.9),
    VehicleClass("taxi", "taxi", "taxi", 4.8, 1.85, 2.6, 4.5, 2.5, 55.6, 2.85, 1.5),
    VehicleClass("emergency", "emergency", "priorityVehicle", 6.5, 2.16, 2.6, 4.5, 2.5, 55.6, 3.7, 1.7),
    VehicleClass("motorcycle", "motorcycle", "motorcycle", 2.2, 0.9, 4.0, 6.0, 2.0, 55.6, 1.45, 0.72),
    VehicleClass("moped", "moped", "motorcycle", 2.1, 0.8, 1.1, 5.0, 2.0, 12.5, 1.3, 0.65),
    VehicleClass("bicycle", "bicycle", "bicycle", 1.6, 0.65, 1.0, 3.0, 0.5, 5.6, 1.05, 0.52),
)

PEDESTRIAN = VehicleClass("pedestrian", "pedestrian", "pedestrian", 0.5, 0.6, 1.5, 2.0, 0.25, 5.0, 0.25, 0.0)
"""A pedestrian: 0.5 m long and 0.6 m wide, as edits add them, at most 5 m/s; not a vehicle class."""


def vehicle_classes() -> dict[str, VehicleClass]:
    """Return all classes by the word used for them in requests."""
    return {vehicle_class.name: vehicle_class for vehicle_class in _CLASSES}


def nearest_class(commonroad_type: str, length_m: float) -> VehicleClass:
    """Return the class of a CommonRoad type with the length nearest to a recorded length; a car for other types."""
    fitting = [known for known in _CLASSES if known.commonroad_type == commonroad_type] or _CLASSES[:1]
    return min(fitting, key=lambda known: abs(known.length_m - length_m))


def class_by_size(commonroad_type: str, length_m: float) -> VehicleClass | None:
    """Return the class that matches a recorded obstacle's CommonRoad type and length; None if no class does."""
    fitting = (known for known in _CLASSES if known.commonroad_type == commonroad_type)
    return next((known for known in fitting if abs(known.length_m - length_m) < 0.01), None)
