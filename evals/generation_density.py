"""Whether a made scenario has the density asked for, counted in its files apart from the generator's own figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from plannerforge.engine.network.net_parser import SumoNet
from plannerforge.evals.made_files import MadeFiles
from plannerforge.schemas.generation import Density

TARGETS: Mapping[Density, float] = {"low": 7.0, "medium": 16.0, "high": 28.0}
"""Vehicles per kilometre of lane, as ``docs/generation.md`` promises them."""
WITHIN = 0.25
TOLD = "density missed"


@dataclass(frozen=True)
class DensityVerdict:
    """Vehicles per kilometre of lane at the start, the ego included, beside the target; whether a miss is told."""

    target: float
    found: float
    told: bool

    @property
    def met(self) -> bool:
        """Within a quarter of the target."""
        return abs(self.found - self.target) <= WITHIN * self.target

    @property
    def honest(self) -> bool:
        """Met, or missed with the reason in a note."""
        return self.met or self.told


def judge_density(made: MadeFiles, wish: Density, notes: Sequence[str]) -> DensityVerdict:
    """Count the obstacles and the ego on the lanes of the net that cars may use, insides of junctions left out."""
    found = (len(made.obstacles) + 1) / _lane_km(made.net)
    return DensityVerdict(TARGETS[wish], round(found, 2), any(TOLD in note for note in notes))


def _lane_km(net: SumoNet) -> float:
    shapes = [lane.shape for lane in net.lanes.values() if "passenger" in lane.allowed and not lane.internal]
    return sum(float(np.linalg.norm(np.diff(shape, axis=0), axis=1).sum()) for shape in shapes) / 1000
