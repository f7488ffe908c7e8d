"""The density of generated traffic beside the one that was asked for, and why it is another where it is."""

from collections.abc import Sequence

from plannerforge.engine.traffic.motions import Participant
from plannerforge.engine.traffic.vehicle_counts import FEWEST, PAPER_TRIPS, VEHICLES_PER_LANE_KM, Demand
from plannerforge.schemas.generation import DensityFacts, GenerationRequest

MISSED_BY = 0.25
"""Share of the target by which the density may differ before a note tells why."""


def density_facts(
    request: GenerationRequest, lane_km: float, everyone: Sequence[Participant], step_s: float
) -> DensityFacts:
    """Vehicles per kilometre of lane at step 0 and at the last step, beside the target."""
    last = round(request.duration_s / step_s)
    staying = sum(vehicle.steps > last - 1 for vehicle in everyone)
    return DensityFacts(
        wish=request.density,
        paper_trips=PAPER_TRIPS[request.density],
        lane_km=round(lane_km, 3),
        target_per_lane_km=VEHICLES_PER_LANE_KM[request.density],
        at_start_per_lane_km=round(len(everyone) / lane_km, 2),
        at_end_per_lane_km=round(staying / lane_km, 2),
    )


def density_notes(density: DensityFacts, demand: Demand, realised: int) -> list[str]:
    """What found no room, and why the density misses its target, where it does."""
    notes = []
    if realised < demand.total:
        notes.append(f"{realised} of {demand.total} vehicles found room on the roads of the site")
    target, found = density.target_per_lane_km, density.at_start_per_lane_km
    if abs(found - target) > MISSED_BY * target:
        notes.append(
            f"{density.wish} density missed: {found:g} vehicles per lane-km at the start instead of {target:g}, "
            f"because {_reason(density, demand, too_many=found > target)}"
        )
    return notes


def _reason(density: DensityFacts, demand: Demand, *, too_many: bool) -> str:
    if too_many:
        small = f"the site has only {density.lane_km:g} lane-km, and no fewer than {FEWEST} vehicles are put on one"
        return small if demand.total <= FEWEST else "so many vehicles were asked for by number"
    if demand.total >= (1 - MISSED_BY) * density.target_per_lane_km * density.lane_km:
        return "no more found room"
    return demand.bounded_by or "the number of cars was bounded"
