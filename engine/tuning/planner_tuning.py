"""What can be set in a planner: its weights, presets, and the settings that act in it."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module

from plannerforge.engine.planners.registry import PLANNERS, known_planner
from plannerforge.engine.tuning.presets import Preset
from plannerforge.engine.tuning.settings import known_settings
from plannerforge.engine.tuning.weights import CostWeight


@dataclass(frozen=True)
class PlannerTuning:
    """Weights by name in their order; ``external`` ones are kept but act on nothing; presets by name.

    ``first_preset`` is what the bare name of the planner means; ``idle_settings`` do nothing in this planner.
    """

    summary: str
    weights: Mapping[str, CostWeight]
    external: Mapping[str, CostWeight]
    presets: Mapping[str, Preset]
    first_preset: str = "Default"
    idle_settings: tuple[str, ...] = ()

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Ranges of the weights that do not go from 0 to 1e6."""
        narrow = (weight for weight in self.weights.values() if (weight.lowest, weight.highest) != (0.0, 1e6))
        return {weight.name: (weight.lowest, weight.highest) for weight in narrow}


def tuning_of(planner: str) -> PlannerTuning:
    """What can be set in a planner.

    Raises:
        UnknownName: no such planner.
    """
    module, _, function = PLANNERS[known_planner(planner)].tuning.partition(":")
    found: PlannerTuning = getattr(import_module(module), function)()
    return found


def names_elsewhere(planner: str) -> dict[str, str]:
    """Names that are no weights of this planner → what they are: weights of others, and settings."""
    found: dict[str, str] = {}
    for other in PLANNERS:
        tuning = tuning_of(other)
        found |= dict.fromkeys((*tuning.weights, *tuning.external), f"it is a weight of {other}, not of {planner}")
    return found | dict.fromkeys(known_settings(), "it is a setting; give it in settings")
