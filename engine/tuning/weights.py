"""The cost weights of Frenetix: what each term measures, what raising its weight does, and who computes it.

Thirteen weights of the planner and three of external modules for occlusion, after the paper and its released code.
The C++ core computes nine terms; four are computed by us (``engine/planners/cost_terms.py``). The external modules
are not part of this planner, so their weights are kept and written but do not act.
"""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class CostWeight:
    """One weight: a factor ≥ 0 on the raw value of its term; or a parameter of a planner that has no such terms."""

    name: str
    meaning: str
    raising: str
    computed_by: Literal["core", "ours", "nobody"]
    lowest: float = 0.0
    highest: float = 1e6

    @property
    def acts(self) -> bool:
        """Whether the weight changes what is driven."""
        return self.computed_by != "nobody"


_WEIGHTS = (
    CostWeight("acceleration", "integral of acceleration² (Simpson)", "gentler speed changes", "core"),
    CostWeight("jerk", "integral of total jerk²", "smoother acceleration", "core"),
    CostWeight("lateral_jerk", "root of lateral jerk² over the first 0.1 s", "smoother steering", "core"),
    CostWeight("longitudinal_jerk", "root of longitudinal jerk² over the first 0.1 s", "smoother pedals", "core"),
    CostWeight(
        "orientation_offset", "heading against the path, second half and end", "straighter along the path", "core"
    ),
    CostWeight("path_length", "length of the candidate in m", "shorter, slower candidates", "ours"),
    CostWeight(
        "lane_center_offset", "mean distance to the lane's centre, 5 m off it", "keeps to the lane's centre", "ours"
    ),
    CostWeight("velocity_offset", "norm of speed − desired speed", "keeps the desired speed", "core"),
    CostWeight("velocity", "|mean speed − speed that reaches the goal in time|", "arrives on time", "ours"),
    CostWeight("distance_to_reference_path", "norm of the offset over the second half", "keeps to the path", "core"),
    CostWeight("distance_to_obstacles", "Σ 1 / smallest distance², others standing", "keeps away from others", "core"),
    CostWeight("prediction", "collision probability with predicted others × 1000", "avoids predicted motion", "core"),
    CostWeight("responsibility", "nearness the ego would answer for", "keeps lane, distance, right of way", "ours"),
)

_EXTERNAL = (
    CostWeight("occ_pm", "occlusion phantom module: harm to an unseen pedestrian", "module absent", "nobody"),
    CostWeight("occ_um", "occlusion uncertainty module: distance to its map", "module absent", "nobody"),
    CostWeight("occ_ve", "occlusion visibility estimator: shift to see more", "module absent", "nobody"),
)


def cost_weights() -> dict[str, CostWeight]:
    """The thirteen weights in the paper's order."""
    return {weight.name: weight for weight in _WEIGHTS}


def external_weights() -> dict[str, CostWeight]:
    """The three weights of external modules; 0 by default, and no preset changes them."""
    return {weight.name: weight for weight in _EXTERNAL}
