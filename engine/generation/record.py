"""The record of a generated scenario: what was asked beside what came out, with notes where the two differ."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...schemas.generation import Checks, DensityFacts, GeneratedEgo, GeneratedScenario, GenerationRequest, SiteFacts
from ..maps import is_net
from ..traffic import FEWEST, PAPER_TRIPS, VEHICLES_PER_LANE_KM, Demand, GeneratedVehicle
from .metadata import limits_without_sign
from .planning_problem import PlanningTask
from .site_network import SiteNetwork

MISSED_BY = 0.25
"""Share of the target by which the density may differ before a note tells why (chosen)."""


@dataclass(frozen=True)
class WrittenScenario:
    """A scenario in its file, with all that it was made of.

    ``vehicles``: the ego first; ``lane_km``: lanes at the site that are open to cars; ``obstacle_ids``: CommonRoad's id
    by the vehicle's id, the ego left out; ``notes``: on its traffic and ego.
    """

    request: GenerationRequest
    site: SiteNetwork
    lane_km: float
    demand: Demand
    task: PlanningTask
    vehicles: tuple[GeneratedVehicle, ...]
    obstacle_ids: Mapping[str, int]
    checks: Checks
    notes: tuple[str, ...]

    def record(self) -> GeneratedScenario:
        """The answer about the scenario; classes are counted without the ego."""
        request, site, metadata = self.request, self.site.site, self.site.metadata
        others = [vehicle for vehicle in self.vehicles if vehicle is not self.task.ego]
        counts = Counter(vehicle.vehicle_class.name for vehicle in others)
        density = self._density()
        recorded_s = round((max(vehicle.steps for vehicle in self.vehicles) - 1) * metadata.step_s, 6)
        limits = limits_without_sign(metadata, self.site.network)
        return GeneratedScenario(
            benchmark_id=metadata.benchmark_id,
            site=SiteFacts(
                scenario_type=site.kind,
                latitude=round(site.latitude, 6),
                longitude=round(site.longitude, 6),
                streets=site.streets,
                radius_m=round(self.site.radius_m, 1),
                osm_id="" if is_net(Path(request.map_path)) else site.osm_id,
            ),
            vehicles_asked=self.demand.total,
            vehicles_realised=len(self.vehicles),
            classes_asked=self.demand.least,
            classes_realised={name: counts[name] for name in self.demand.counts if counts[name]},
            density=density,
            duration_s=request.duration_s,
            recorded_s=recorded_s,
            lanelets=len(self.site.network.lanelets),
            traffic_lights=len(self.site.network.lights),
            ego=_ego_facts(self.task, self.vehicles, metadata.step_s),
            checks=self.checks,
            notes=(
                *self.site.notes,
                *self.notes,
                *density_notes(density, self.demand, len(self.vehicles)),
                *_duration_notes(request, recorded_s, metadata.step_s),
                *_limit_notes(limits),
            ),
            netconvert_warnings=tuple(dict.fromkeys(self.site.warnings)),
            attribution=request.attribution,
            unsigned_limits_kmh=limits,
            vehicle_classes={self.obstacle_ids[other.vehicle_id]: other.vehicle_class.name for other in others},
        )

    def _density(self) -> DensityFacts:
        """Vehicles per kilometre of lane at step 0 and at the last step, beside the target."""
        wish, last_step = self.request.density, round(self.request.duration_s / self.site.metadata.step_s)
        staying = sum(vehicle.steps > last_step - 1 for vehicle in self.vehicles)
        return DensityFacts(
            wish=wish,
            paper_trips=PAPER_TRIPS[wish],
            lane_km=round(self.lane_km, 3),
            target_per_lane_km=VEHICLES_PER_LANE_KM[wish],
            at_start_per_lane_km=round(len(self.vehicles) / self.lane_km, 2),
            at_end_per_lane_km=round(staying / self.lane_km, 2),
        )


def density_notes(density: DensityFacts, demand: Demand, realised: int) -> list[str]:
    """How many vehicles found no room, and why the density misses its target, where it does."""
    notes = []
    if realised < demand.total:
        notes.append(f"{realised} of {demand.total} vehicles found room on the roads of the site")
    target, reached = density.target_per_lane_km, density.at_start_per_lane_km
    if abs(reached - target) > MISSED_BY * target:
        notes.append(
            f"{density.wish} density missed: {reached:g} vehicles per lane-km at the start instead of {target:g}, "
            f"because {_miss_reason(density, demand, too_many=reached > target)}"
        )
    return notes


def _miss_reason(density: DensityFacts, demand: Demand, *, too_many: bool) -> str:
    if too_many:
        small = f"the site has only {density.lane_km:g} lane-km, and no fewer than {FEWEST} vehicles are put on one"
        return small if demand.total <= FEWEST else "so many vehicles were asked for by number"
    if demand.total >= (1 - MISSED_BY) * density.target_per_lane_km * density.lane_km:
        return "no more found room"
    return demand.bounded_by or "the number of cars was bounded"


def _duration_notes(request: GenerationRequest, recorded_s: float, step_s: float) -> list[str]:
    """A note where all vehicles have left before the time is up."""
    if recorded_s > request.duration_s - 2 * step_s:
        return []
    left = "the last vehicle has left the site by then, and CommonRoad's schema lets none come later"
    return [f"{recorded_s:g} s of the asked {request.duration_s:g} s are recorded: {left}"]


def _limit_notes(limits_kmh: Mapping[int, float]) -> list[str]:
    if not limits_kmh:
        return []
    values = ", ".join(f"{value:g}" for value in sorted(set(limits_kmh.values())))
    return [f"the file holds no speed-limit signs: CommonRoad has none for this country; posted are {values} km/h"]


def _ego_facts(task: PlanningTask, vehicles: Sequence[GeneratedVehicle], step_s: float) -> GeneratedEgo:
    first, last = task.time_steps
    return GeneratedEgo(
        vehicle=task.ego.vehicle_id,
        cars_to_choose_from=sum(vehicle.vehicle_class.name == "car" for vehicle in vehicles),
        speed_mps=float(task.ego.motion.speeds_mps[0]),
        goal_step=task.goal_step,
        goal_distance_m=round(task.goal_distance_m, 2),
        goal_lanelet=task.lanelet_id,
        goal_time_s=(round(first * step_s, 3), round(last * step_s, 3)),
        goal_size_m=task.size_m,
    )
