"""CommonRoad's vehicles 1 to 4, the vehicle of each ego class, and the vehicle of a configuration with a class.

The server's process imports this module, so it does not use numpy.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from types import MappingProxyType
from typing import Any, Literal

from ...schemas.errors import InvalidRequest, NotPossible, UnknownName, closest
from ...schemas.planning import PlannerSettings
from ...schemas.text import class_noun
from .classes import VehicleClass, nearest_class, vehicle_classes


@dataclass(frozen=True)
class VehicleParameters:
    """Size and limits of the ego; lengths in m, accelerations in m/s², angles in rad; by default vehicle 2.

    ``switching_speed_mps``: above it the engine's power limits the acceleration. ``vehicle_class``: the ego's class, as
    named in requests. ``friction``: the coefficient of friction of the road, which the limits of :meth:`on_road`
    include; None if it is not stated. Source: CommonRoad vehicle models.
    """

    length_m: float = 4.508
    width_m: float = 1.61
    wheelbase_m: float = 2.579
    rear_axle_behind_center_m: float = 1.4227
    maximum_acceleration_mps2: float = 11.5
    maximum_speed_mps: float = 50.8
    switching_speed_mps: float = 7.319
    maximum_steering_rad: float = 1.066
    maximum_steering_rate_radps: float = 0.4
    vehicle_class: str = "car"
    friction: float | None = None

    def on_road(self, friction: float | None) -> "VehicleParameters":
        """Return the vehicle on a road with the given friction, which limits the tyres; the power stays the same."""
        if friction is None:
            return self
        largest = min(self.maximum_acceleration_mps2, friction * GRAVITY_MPS2)
        switching = self.switching_speed_mps * self.maximum_acceleration_mps2 / largest
        return replace(self, maximum_acceleration_mps2=largest, switching_speed_mps=switching, friction=friction)

    @property
    def hardest_braking_mps2(self) -> float:
        """The deceleration that tyres allow on the road."""
        return hardest_braking_mps2(self.friction)

    @property
    def comfortable_mps2(self) -> float:
        """The comfortable braking and lateral acceleration on the road, in m/s²."""
        return comfortable_mps2(self.friction)

    @property
    def size_m(self) -> tuple[float, float]:
        """The length and width in m."""
        return self.length_m, self.width_m

    def most_acceleration_mps2(self, speed_mps: float) -> float:
        """Return the maximum acceleration at a speed: limited by tyres up to the switching speed, above it by power."""
        return self.maximum_acceleration_mps2 * min(1.0, self.switching_speed_mps / max(speed_mps, 1e-6))

    @property
    def largest_curvature_per_m(self) -> float:
        """The curvature in 1/m of the rear axle's path at full lock."""
        return math.tan(self.maximum_steering_rad) / self.wheelbase_m


GRAVITY_MPS2 = 9.81

BMW_320I = VehicleParameters()
VEHICLES = {
    1: VehicleParameters(4.298, 1.674, 2.39264, 1.50876, 11.5, 45.8, 4.755, 0.91, 0.4),  # Ford Escort
    2: BMW_320I,
    3: VehicleParameters(4.569, 1.844, 2.471928, 1.321136, 11.5, 41.7, 7.824, 1.023, 0.4),  # VW Vanagon
    4: VehicleParameters(5.1, 2.55, 3.6, 1.8, 11.5, 22.22, 7.824, 0.55, 0.7103, "truck"),
}
"""Vehicle 4 is a semi-trailer truck; a planner of single bodies drives its tractor without the trailer."""

EGO_SIZE_M = (BMW_320I.length_m, BMW_320I.width_m)
"""Length and width of the ego if the configuration states no vehicle: CommonRoad's vehicle 2."""
LARGEST_ACCELERATION_MPS2 = BMW_320I.maximum_acceleration_mps2
LARGEST_SPEED_MPS = BMW_320I.maximum_speed_mps
"""Bounds that no car exceeds, for a goal or a speed of a car with unknown parameters."""
HARDEST_BRAKING_MPS2 = 8.0
HARDEST_LATERAL_MPS2 = 8.0
"""What tyres allow on a dry road, longitudinally and laterally: a coefficient of friction of 0.8 times 9.81 m/s²."""
COMFORTABLE_MPS2 = 4.0
"""Comfortable braking and lateral acceleration: half of what the tyres allow."""


def hardest_braking_mps2(friction: float | None) -> float:
    """Return the acceleration in m/s² that tyres allow, in any direction, at a friction; None means a dry road."""
    return HARDEST_BRAKING_MPS2 if friction is None else min(HARDEST_BRAKING_MPS2, friction * GRAVITY_MPS2)


def comfortable_mps2(friction: float | None) -> float:
    """Return the comfortable acceleration in m/s² on a road with the given friction."""
    return COMFORTABLE_MPS2 if friction is None else min(COMFORTABLE_MPS2, friction * GRAVITY_MPS2 / 2)


PARAMETER_NAMES = tuple(
    item.name for item in fields(VehicleParameters) if item.name not in ("vehicle_class", "friction")
)
"""The names of a vehicle's parameters, in order."""


MotionModel = Literal["KS", "KST"]
"""CommonRoad's names: the kinematic single-track model, and the one with a trailer on the tractor's rear axle."""
MODEL_WORDS: Mapping[MotionModel, str] = MappingProxyType(
    {"KS": "kinematic single-track", "KST": "kinematic single-track with a trailer"}
)


@dataclass(frozen=True)
class EgoClass:
    """An ego class with its limits.

    ``vehicle``: size and limits; for a semi-trailer, the size of the combination and the limits of its tractor.
    ``source``: the source of the limits, as text; size and axles of every class except ``car`` are those of its traffic
    (``classes.py``). ``commonroad_vehicle``: the vehicle that a solution file can state for the class; None if
    CommonRoad has no such vehicle.
    """

    name: str
    vehicle: VehicleParameters
    motion_model: MotionModel
    source: str
    commonroad_vehicle: int | None = None

    @property
    def in_words(self) -> str:
        """The class and its size, such as ``bus, 12 × 2.5 m``."""
        return f"{class_noun(self.name)}, {self.vehicle.length_m:g} × {self.vehicle.width_m:g} m"


_SUMO_TRUCK_MPS2 = 7.0
_SUMO_TWO_WHEELS_MPS2 = 10.0
"""Hardest braking of trucks, buses and coaches, and of motorcycles and mopeds: ``emergencyDecel`` in SUMO's table
"Vehicle Type Parameter Defaults" (version 1.28). Tyres that brake so hard allow as much laterally, and when starting.
"""
_BUS_STEERING_RAD = math.radians((53 + 46) / 2)
"""The mean of the front wheels' largest angles, 53° inside and 46° outside: Mercedes-Benz, "The Citaro: Technical
information" (12 m, turning circle 21.03 m, which the single-track model gives with 50°)."""
_BUS_W_PER_KG = 210_000 / 18_000
"""Power over gross mass of the same bus: 210 kW, 18,000 kg."""
_TRUCK_W_PER_KG = 130_000 / 7_500
"""Power over gross mass of a rigid truck of 7.1 m: Mercedes-Benz Atego 818 (130 kW, 7,500 kg)."""
_TURNING_RADIUS_M = 12.5
"""Outer radius of the circle in which every vehicle must be able to turn: § 32d StVZO (and Directive 96/53/EC)."""
_MOTORCYCLE_STEERING_RAD = math.asin(1.41 / 2.7)
"""Wheelbase over turning radius, which is the front wheel's: Honda CB500F (1.41 m, 2.7 m; neither
is checked against a data sheet)."""
_MOTORCYCLE_W_PER_KG = 128.0
"""Power over mass of the same motorcycle, 35 kW: 128 kW/t in The Press (New Zealand, 25 February 2017), which is that
of 274 kg with a rider."""
_MOPED_W_PER_KG = 4_000 / 155
"""4 kW, the most that a moped may have (class L1e-B, Regulation (EU) 168/2013), over 80 kg (SUMO) and a rider of 75."""


def _steering_on_circle_rad(known: VehicleClass, outer_radius_m: float) -> float:
    """Return the steering angle at which a rigid body's outer front corner runs on a circle of the given radius."""
    front_m = known.length_m / 2 + known.rear_axle_m  # from the rear axle to the front bumper
    rear_axle_radius_m = math.sqrt(outer_radius_m**2 - front_m**2) - known.width_m / 2
    return math.atan(known.wheelbase_m / rear_axle_radius_m)


def _as_traffic(known: VehicleClass, limits: VehicleParameters) -> VehicleParameters:
    """Return the limits, combined with the size and axles of a class of traffic."""
    return replace(
        limits,
        length_m=known.length_m,
        width_m=known.width_m,
        wheelbase_m=known.wheelbase_m,
        rear_axle_behind_center_m=known.rear_axle_m,
        vehicle_class=known.name,
    )


def _own_limits(
    known: VehicleClass, hardest_mps2: float, power_w_per_kg: float, steering_rad: float, steering_rate_radps: float
) -> VehicleParameters:
    """Return the size of a vehicle class combined with the given limits.

    Above the switching speed, engine power limits the acceleration instead of the tyres.
    """
    limits = VehicleParameters(
        maximum_acceleration_mps2=hardest_mps2,
        maximum_speed_mps=known.maximum_speed_mps,
        switching_speed_mps=power_w_per_kg / hardest_mps2,
        maximum_steering_rad=steering_rad,
        maximum_steering_rate_radps=steering_rate_radps,
    )
    return _as_traffic(known, limits)


@cache
def ego_classes() -> Mapping[str, EgoClass]:
    """Return the possible classes of the ego by the word for them in requests: every motor vehicle class."""
    known = vehicle_classes()
    heavy_rate_radps = VEHICLES[4].maximum_steering_rate_radps
    light_rate_radps = BMW_320I.maximum_steering_rate_radps
    van = "those of CommonRoad's vehicle 3, a van"
    circle_rad = _steering_on_circle_rad(known["coach"], _TURNING_RADIUS_M)
    classes = (
        EgoClass("car", BMW_320I, "KS", "CommonRoad's vehicle 2 (BMW 320i)", 2),
        EgoClass("taxi", _as_traffic(known["taxi"], BMW_320I), "KS", "those of a car (CommonRoad's vehicle 2)"),
        EgoClass("delivery", _as_traffic(known["delivery"], VEHICLES[3]), "KS", van),
        EgoClass("emergency", _as_traffic(known["emergency"], VEHICLES[3]), "KS", van),
        EgoClass(
            "truck",
            _own_limits(
                known["truck"], _SUMO_TRUCK_MPS2, _TRUCK_W_PER_KG, VEHICLES[4].maximum_steering_rad, heavy_rate_radps
            ),
            "KS",
            "braking and speed of SUMO's trucks, power of a 7.5 t truck, steering of CommonRoad's vehicle 4",
        ),
        EgoClass(
            "bus",
            _own_limits(known["bus"], _SUMO_TRUCK_MPS2, _BUS_W_PER_KG, _BUS_STEERING_RAD, heavy_rate_radps),
            "KS",
            "braking of SUMO's buses, power and steering angle of a Citaro, steering rate of CommonRoad's vehicle 4",
        ),
        EgoClass(
            "coach",
            _own_limits(known["coach"], _SUMO_TRUCK_MPS2, _BUS_W_PER_KG, circle_rad, heavy_rate_radps),
            "KS",
            "braking and speed of SUMO's coaches, power of a bus, steering by the circle of § 32d StVZO (12.5 m), "
            "steering rate of CommonRoad's vehicle 4",
        ),
        EgoClass(
            "motorcycle",
            _own_limits(
                known["motorcycle"],
                _SUMO_TWO_WHEELS_MPS2,
                _MOTORCYCLE_W_PER_KG,
                _MOTORCYCLE_STEERING_RAD,
                light_rate_radps,
            ),
            "KS",
            "braking and speed of SUMO's motorcycles, power and steering angle of a Honda CB500F, steering rate of "
            "CommonRoad's cars; it does not lean",
        ),
        EgoClass(
            "moped",
            _own_limits(
                known["moped"], _SUMO_TWO_WHEELS_MPS2, _MOPED_W_PER_KG, _MOTORCYCLE_STEERING_RAD, light_rate_radps
            ),
            "KS",
            "braking of SUMO's mopeds, power by Regulation (EU) 168/2013, steering of the motorcycle; it does not lean",
        ),
        EgoClass(
            "trailer",
            replace(
                VEHICLES[4],
                length_m=known["trailer"].length_m,
                width_m=known["trailer"].width_m,
                vehicle_class="trailer",
            ),
            "KST",
            "CommonRoad's vehicle 4 (semi-trailer truck)",
            4,
        ),
    )
    return MappingProxyType({each.name: each for each in classes})


def ego_class(name: str) -> EgoClass:
    """Return the ego class with this name.

    Raises:
        UnknownName: the ego cannot have this class.
    """
    if name not in ego_classes():
        valid = closest(name, ego_classes()) or list(ego_classes())
        raise UnknownName(f"the ego cannot be a {name!r}", valid=valid, reason="ego_class")
    return ego_classes()[name]


def ego_class_of(commonroad_type: str, length_m: float) -> EgoClass | None:
    """Return the ego's class in place of a recorded vehicle of a CommonRoad type and length, or None."""
    known = nearest_class(commonroad_type, length_m)
    return ego_classes().get(known.name) if known.commonroad_type == commonroad_type else None


def commonroad_vehicle(settings: PlannerSettings, vehicle_class: str = "car") -> int | None:
    """Return the id of CommonRoad's vehicle for an ego of a class, or None if it has its own parameters."""
    if _own_parameters(settings):
        return None
    return settings.vehicle if settings.states_vehicle else ego_class(vehicle_class).commonroad_vehicle


def refused_by_planners(vehicle_class: str) -> str:
    """Return one sentence on why the built-in planners refuse an ego of a class; empty if they drive it."""
    known = ego_class(vehicle_class)
    if known.motion_model != "KST":
        return ""
    return (
        f"the built-in planners refuse this ego: a {vehicle_class} ({known.in_words}) is a tractor with a trailer, but "
        "they drive only single bodies"
    )


def vehicle_of(settings: PlannerSettings, vehicle_class: str = "car") -> VehicleParameters:
    """Return the vehicle of a run: the vehicle that the configuration states, otherwise the vehicle of the ego's class.

    Raises:
        NotPossible: the class is a vehicle with a trailer, which is two bodies, and the configuration states no other
            vehicle.
        InvalidRequest: a length or axle that the configuration states does not fit the class.
    """
    own = _own_parameters(settings)
    if settings.states_vehicle:
        return replace(VEHICLES[settings.vehicle], **own)
    requested = ego_class(vehicle_class)
    if requested.motion_model == "KST":
        raise NotPossible(
            f"the ego is a {vehicle_class} ({requested.in_words}), a tractor with a trailer, but the planners here and "
            "the judge of their runs support only single bodies",
            valid=[name for name, each in ego_classes().items() if each.motion_model == "KS"],
            next_step="give the ego another class with modify_scenario (set_ego, vehicle_class=truck), or let a "
            "configuration state a vehicle (vehicle=4 is the tractor without its trailer)",
            reason="articulated_ego",
        )
    vehicle = replace(requested.vehicle, **own)
    if own and not fits_together(vehicle.length_m, vehicle.wheelbase_m, vehicle.rear_axle_behind_center_m):
        raise InvalidRequest(
            f"length_m={vehicle.length_m:g}, wheelbase_m={vehicle.wheelbase_m:g} and rear_axle_behind_center_m="
            f"{vehicle.rear_axle_behind_center_m:g} do not fit together; the ego is a {requested.in_words} unless the "
            "configuration states a vehicle",
            valid=["wheelbase_m <= length_m", "rear_axle_behind_center_m <= length_m / 2 and <= wheelbase_m"],
            next_step="state vehicle too, or set the three together",
        )
    return vehicle


def fits_together(length_m: float, wheelbase_m: float, rear_axle_behind_center_m: float) -> bool:
    """Return whether a body of a given length can have the given axles."""
    return wheelbase_m <= length_m and rear_axle_behind_center_m <= min(length_m / 2, wheelbase_m)


def parameter_values(vehicle: VehicleParameters) -> dict[str, float]:
    """Return a vehicle's parameters by name, in a fixed order."""
    return {name: getattr(vehicle, name) for name in PARAMETER_NAMES}


def _own_parameters(settings: PlannerSettings) -> dict[str, Any]:
    return {name: value for name in PARAMETER_NAMES if (value := getattr(settings, name)) is not None}
