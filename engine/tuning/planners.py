"""What can be set in Frenetix: thirteen weights, three of external modules, five presets, every setting."""

from .configurations import PlannerTuning
from .weights import CostWeight, Preset, cost_weights, external_weights, presets

# ---------- idm_tuning
# What can be set in the lane-following baseline: four parameters of the Intelligent Driver Model and one for bends.
#
# Default holds the values of the model's source (Treiber, Hennecke, Helbing: Congested traffic states in empirical
# observations and microscopic simulations, Physical Review E 62, 2000, table I); Cautious and Sporty are ours. The
# three lateral accelerations are those that passengers judged on a test track (Optimal Lateral Acceleration for
# Different Levels of Automated Driving, preprint 10.31234/osf.io/kcw2d): 2 m/s² often too slow, 3 balanced, 4 often
# too fast.

_PARAMETERS = (
    CostWeight("time_headway_s", "desired time gap T to the leader, s", "follows farther away", "ours", 0.1, 10.0),
    CostWeight("minimum_gap_m", "gap s0 at standstill, m", "stops earlier behind others", "ours", 0.1, 30.0),
    CostWeight("acceleration_mps2", "maximum acceleration a, m/s²", "brisker, closer to its speed", "ours", 0.1, 10.0),
    CostWeight("deceleration_mps2", "comfortable deceleration b, m/s²", "brakes later and harder", "ours", 0.1, 10.0),
    CostWeight("lateral_acceleration_mps2", "largest in bends, m/s²", "faster through bends", "ours", 0.5, 10.0),
)
_NAMES = tuple(parameter.name for parameter in _PARAMETERS)
_PRESETS = (
    Preset("Default", "Default", "the values of its source", (1.6, 2.0, 0.73, 1.67, 3.0), _NAMES),
    Preset("Cautious", "Cautious", "large gaps, gentle", (2.4, 4.0, 0.6, 1.2, 2.0), _NAMES),
    Preset("Sporty", "Sporty", "small gaps, brisk", (1.0, 1.5, 2.0, 3.0, 4.0), _NAMES),
)


def idm_tuning() -> PlannerTuning:
    """The tuning of the Intelligent Driver Model."""
    return PlannerTuning(
        summary="lane-following Intelligent Driver Model, a baseline; no cost terms",
        weights={parameter.name: parameter for parameter in _PARAMETERS},
        external={},
        presets={preset.name: preset for preset in _PRESETS},
        idle_settings=("sampling_level", "switching_speed_mps", "maximum_steering_rate_radps"),
    )


# ---------- frenetix_tuning
# What can be set in Frenetix: thirteen weights, three of external modules, five presets, every setting.


def frenetix_tuning() -> PlannerTuning:
    """The tuning of Frenetix."""
    return PlannerTuning(
        summary="sampling planner of TUM", weights=cost_weights(), external=external_weights(), presets=presets()
    )
