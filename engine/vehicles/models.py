"""CommonRoad's vehicles 1 to 4, the vehicle that a configuration means, and limits where a vehicle's own are unknown.

The server's process imports this module, so it does without numpy.
"""

from dataclasses import dataclass, fields, replace

from ...schemas.planning import PlannerSettings


@dataclass(frozen=True)
class VehicleParameters:
    """Size and limits of the ego; lengths in m, accelerations in m/s², angles in rad; by default vehicle 2.

    ``switching_speed_mps``: above it the engine's power limits the acceleration. Source: CommonRoad vehicle models.
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


BMW_320I = VehicleParameters()
VEHICLES = {
    1: VehicleParameters(4.298, 1.674, 2.39264, 1.50876, 11.5, 45.8, 4.755, 0.91, 0.4),  # Ford Escort
    2: BMW_320I,
    3: VehicleParameters(4.569, 1.844, 2.471928, 1.321136, 11.5, 41.7, 7.824, 1.023, 0.4),  # VW Vanagon
    4: VehicleParameters(5.1, 2.55, 3.6, 1.8, 11.5, 22.22, 7.824, 0.55, 0.7103),
}
"""Vehicle 4 is a semi-trailer truck; a planner of single bodies drives its tractor without the trailer."""

EGO_SIZE_M = (BMW_320I.length_m, BMW_320I.width_m)
"""Length and width of the ego where no configuration states a vehicle: CommonRoad's vehicle 2."""
LARGEST_ACCELERATION_MPS2 = BMW_320I.maximum_acceleration_mps2
LARGEST_SPEED_MPS = BMW_320I.maximum_speed_mps
"""Bounds that no car beats, wherever a goal or a speed is asked of one whose own parameters are not known."""
HARDEST_BRAKING_MPS2 = 8.0
HARDEST_LATERAL_MPS2 = 8.0
"""What tyres hold on a dry road, along and across: a coefficient of friction of 0.8 times 9.81 m/s²."""
COMFORTABLE_MPS2 = 4.0
"""Braking and lateral acceleration of a driver who is in no trouble: half of what the tyres hold."""


PARAMETER_NAMES = tuple(item.name for item in fields(VehicleParameters))
"""The names of a vehicle's parameters, in their order."""


def commonroad_vehicle(settings: PlannerSettings) -> int | None:
    """The id of CommonRoad's vehicle; None for one with parameters of its own."""
    return None if _own_parameters(settings) else settings.vehicle


def vehicle_of(settings: PlannerSettings) -> VehicleParameters:
    """The vehicle of a configuration: CommonRoad's with the parameters that the settings name themselves."""
    return replace(VEHICLES[settings.vehicle], **_own_parameters(settings))


def _own_parameters(settings: PlannerSettings) -> dict[str, float]:
    return {name: value for name in PARAMETER_NAMES if (value := getattr(settings, name)) is not None}
