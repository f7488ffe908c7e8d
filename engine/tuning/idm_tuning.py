"""What can be set in the lane-following baseline: four parameters of the Intelligent Driver Model.

Default holds the values of its source (Treiber, Hennecke, Helbing: Congested traffic states in empirical observations
and microscopic simulations, Physical Review E 62, 2000, table I); Cautious and Sporty are ours.
"""

from plannerforge.engine.tuning.planner_tuning import PlannerTuning
from plannerforge.engine.tuning.presets import Preset
from plannerforge.engine.tuning.weights import CostWeight

_PARAMETERS = (
    CostWeight("time_headway_s", "desired time gap T to the leader, s", "follows farther away", "ours", 0.1, 10.0),
    CostWeight("minimum_gap_m", "gap s0 at standstill, m", "stops earlier behind others", "ours", 0.1, 30.0),
    CostWeight("acceleration_mps2", "maximum acceleration a, m/s²", "brisker, closer to its speed", "ours", 0.1, 10.0),
    CostWeight("deceleration_mps2", "comfortable deceleration b, m/s²", "brakes later and harder", "ours", 0.1, 10.0),
)
_NAMES = tuple(parameter.name for parameter in _PARAMETERS)
_PRESETS = (
    Preset("Default", "Default", "the values of its source", (1.6, 2.0, 0.73, 1.67), _NAMES),
    Preset("Cautious", "Cautious", "large gaps, gentle", (2.4, 4.0, 0.6, 1.2), _NAMES),
    Preset("Sporty", "Sporty", "small gaps, brisk", (1.0, 1.5, 2.0, 3.0), _NAMES),
)


def tuning() -> PlannerTuning:
    """The tuning of the Intelligent Driver Model."""
    return PlannerTuning(
        summary="lane-following Intelligent Driver Model, a baseline; no cost terms",
        weights={parameter.name: parameter for parameter in _PARAMETERS},
        external={},
        presets={preset.name: preset for preset in _PRESETS},
        idle_settings=(
            "sampling_level",
            "wheelbase_m",
            "rear_axle_behind_center_m",
            "switching_speed_mps",
            "maximum_steering_rad",
            "maximum_steering_rate_radps",
        ),
    )
