"""What can be set in Frenetix: thirteen weights, three of external modules, five presets, every setting."""

from plannerforge.engine.tuning.planner_tuning import PlannerTuning
from plannerforge.engine.tuning.presets import presets
from plannerforge.engine.tuning.weights import cost_weights, external_weights


def tuning() -> PlannerTuning:
    """The tuning of Frenetix."""
    return PlannerTuning(
        summary="sampling planner of TUM",
        weights=cost_weights(),
        external=external_weights(),
        presets=presets(),
    )
