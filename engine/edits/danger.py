"""How close an ego comes to the traffic of a scenario: what an edit did to its danger, as numbers."""

from collections.abc import Iterable
from dataclasses import dataclass

from plannerforge.engine.planners.criticality import criticality
from plannerforge.engine.planners.interface import EgoState
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
    found = criticality(states, _Others(tuple(others)), BMW_320I)
    return EgoDanger(
        minimum_distance_m=_rounded(found.minimum_distance_m),
        minimum_time_to_collision_s=_rounded(found.minimum_time_to_collision_s),
        risk_score=found.risk_score,
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
