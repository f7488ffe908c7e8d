"""How close an ego comes to the traffic of a scenario: what an edit did to its danger, as numbers."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from plannerforge.engine.planners.criticality import encounters, gaps_m, risk_scores
from plannerforge.engine.planners.interface import EgoState
from plannerforge.engine.planners.time_to_collision import times_to_collision_s
from plannerforge.engine.planners.vehicle_models import BMW_320I
from plannerforge.engine.scenarios.tracks import Track
from plannerforge.schemas.modification import EgoDanger


@dataclass(frozen=True)
class _Others:
    moving: tuple[Track, ...]
    standing: tuple[Track, ...] = ()


def danger_to(drive: Track, others: Iterable[Track]) -> EgoDanger:
    """The most critical figures of a motion of the ego among others that do as their tracks say."""
    states = [
        EgoState(drive.first_step + index, position, float(heading), float(speed))
        for index, (position, heading, speed) in enumerate(
            zip(drive.positions, drive.headings_rad, drive.speeds_mps, strict=True)
        )
    ]
    met = encounters(states, _Others(tuple(others)), BMW_320I)
    if not len(met.state):
        return EgoDanger(minimum_distance_m=None, minimum_time_to_collision_s=None, risk_score=None)
    gaps, times = gaps_m(met), times_to_collision_s(met.ego, met.other)
    soonest = float(times.min())
    return EgoDanger(
        minimum_distance_m=round(float(gaps.min()), 3),
        minimum_time_to_collision_s=round(soonest, 3) if math.isfinite(soonest) else None,
        risk_score=int(risk_scores(gaps, times).min()),
    )
