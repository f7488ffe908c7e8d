"""How a generated scenario came out, as ``describe_scenario`` tells it: what was asked beside what was realised."""

from plannerforge.schemas.base import Model
from plannerforge.schemas.generation import DensityFacts, ScenarioType, SiteFacts


class DescribedGeneration(Model):
    """Site, traffic and checks of a generated scenario, as they were when it was made.

    ``notes`` (repairs among them), ``network_warnings`` and ``netconvert_warnings`` are listed only where the detail
    asks for them; their numbers always stand there. ``feasible_share``: of the recorded tracks, in [0, 1].
    """

    site: SiteFacts
    scenario_type_asked: ScenarioType
    vehicles_asked: int
    vehicles_realised: int
    classes_asked: dict[str, int]
    classes_realised: dict[str, int]
    density: DensityFacts
    duration_asked_s: float
    recorded_s: float
    feasible_share: float
    checks_failed: tuple[str, ...]
    notes_total: int
    warnings_total: int
    notes: tuple[str, ...] = ()
    network_warnings: tuple[str, ...] = ()
    netconvert_warnings: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """Site, traffic and checks in a line, then notes and warnings, one each."""
        site, density = self.site, self.density
        streets = ", ".join(site.streets) or "unnamed roads"
        mark = f", OSM {site.osm_id}" if site.osm_id else ""
        classes = ", ".join(f"{count} {name}" for name, count in self.classes_realised.items()) or "the ego alone"
        asked = "".join(f", at least {count} {name}" for name, count in self.classes_asked.items())
        listed = [f"Generation note: {note}" for note in self.notes]
        listed += [f"Road network: {warning}" for warning in self.network_warnings]
        listed += [f"netconvert: {warning}" for warning in self.netconvert_warnings]
        told = listed or self.notes_total + self.warnings_total == 0
        unlisted = "" if told else f" {self.notes_total} notes, {self.warnings_total} warnings: detail checks."
        first = (
            f"Generated: {site.scenario_type} (asked: {self.scenario_type_asked}) at {site.latitude:.5f}, "
            f"{site.longitude:.5f} within {site.radius_m:g} m ({streets}{mark}); vehicles {self.vehicles_realised} "
            f"(asked: {self.vehicles_asked}{asked}), beside the ego {classes}; {density.at_start_per_lane_km:g} per "
            f"lane-km at the start, {density.at_end_per_lane_km:g} at the end (asked: {density.wish}, "
            f"{density.target_per_lane_km:g}); {self.recorded_s:g} s recorded (asked: {self.duration_asked_s:g} s); "
            f"{self.feasible_share:.0%} of tracks drivable; checks failed: {', '.join(self.checks_failed) or 'none'}."
        )
        return [first + unlisted, *listed]
