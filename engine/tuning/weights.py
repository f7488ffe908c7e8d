"""The cost weights of Frenetix: what each term measures, what raising its weight does, and who computes it.

Thirteen weights of the planner and three of external modules for occlusion, after the paper and its released code.
The C++ core computes nine terms; four are computed by us (``engine/planners/cost_terms.py``). The external modules
are not part of this planner, so their weights are kept and written but do not act.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from ...schemas.errors import UnknownName, closest

# ---------- weights
# The cost weights of Frenetix: what each term measures, what raising its weight does, and who computes it.
#
# Thirteen weights of the planner and three of external modules for occlusion, after the paper and its released code.
# The C++ core computes nine terms; four are computed by us (``engine/planners/cost_terms.py``). The external modules
# are not part of this planner, so their weights are kept and written but do not act.


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


# ---------- presets
# The five presets of cost weights. The paper names them; the values are those of its released code.


@dataclass(frozen=True)
class Preset:
    """A full set of weights, by default Frenetix's thirteen in their order.

    ``short_name`` is the paper's in its comparison figure.
    """

    name: str
    short_name: str
    intent: str
    values: tuple[float, ...]
    names: tuple[str, ...] = field(default_factory=lambda: tuple(cost_weights()))

    @property
    def weights(self) -> dict[str, float]:
        """The values by weight."""
        return dict(zip(self.names, self.values, strict=True))


_PRESETS = (
    Preset(
        "Default",
        "Default",
        "the reference's tuning: follow the path, keep the speed",
        (0.0, 0.0, 0.2, 0.2, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 0.0, 0.2, 0.0),
    ),
    Preset(
        "Comfort",
        "Comfort",
        "gentle: jerk and acceleration count most",
        (0.2, 0.2, 0.8, 0.8, 0.0, 0.0, 0.5, 0.3, 0.0, 1.0, 0.3, 0.2, 0.1),
    ),
    Preset(
        "Balanced", "Balanced", "between the others", (0.3, 0.3, 0.5, 0.5, 0.1, 0.2, 0.7, 0.6, 0.2, 2.0, 0.8, 0.3, 0.2)
    ),
    Preset(
        "Efficiency-Sporty",
        "Sporty",
        "brisk: speed and progress count, comfort less",
        (0.2, 0.15, 0.25, 0.25, 0.2, 0.6, 0.6, 1.0, 0.4, 2.0, 0.6, 0.2, 0.1),
    ),
    Preset(
        "Safety-Conservative",
        "Safety",
        "Default with distance to others, prediction and responsibility",
        (0.0, 0.0, 0.2, 0.2, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0, 1.0, 0.5, 0.3),
    ),
)


def presets() -> dict[str, Preset]:
    """The presets of Frenetix by name."""
    return {preset.name: preset for preset in _PRESETS}


def find_preset(word: str, among: Mapping[str, Preset] | None = None) -> Preset:
    """A preset by its name or the paper's short name, whatever the case; of Frenetix unless others are given.

    Raises:
        UnknownName: with the names, the likeliest first.
    """
    folded, available = word.strip().lower(), among or presets()
    for preset in available.values():
        if folded in (preset.name.lower(), preset.short_name.lower()):
            return preset
    likely = closest(word, available)
    raise UnknownName(
        f"there is no preset '{word}'",
        valid=[*likely, *(name for name in available if name not in likely)],
        next_step="name one of them, or set single weights with name=value",
    )
