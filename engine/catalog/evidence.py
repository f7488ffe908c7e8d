"""The facts of a scenario behind a condition: why it is satisfied, or what stands in its way."""

from plannerforge.engine.catalog.constraints import Constraint
from plannerforge.engine.catalog.vocabulary_words import measure_name, obstacle_name, road_net_name
from plannerforge.schemas.scenarios import ScenarioFacts


def evidence(constraint: Constraint, facts: ScenarioFacts) -> str:
    """The fact that a condition looks at, in a few words: ``truck=2``, ``limit 50 km/h``, ``place Munich``."""
    if constraint.stage == "location":
        return f"{facts.location.place}, {facts.location.country}"
    if constraint.stage == "tags":
        return _tags(constraint, facts)
    if constraint.stage == "obstacles":
        name = obstacle_name(constraint.subject)
        return f"{name}={facts.participants.counts.get(name, 0)}"
    if constraint.stage == "velocity":
        return f"ego {facts.ego.speed_mps:.2f} m/s ({facts.ego.speed_mps * 3.6:.1f} km/h)" if facts.ego else "no ego"
    return _road_net(constraint, facts)


def unmet_label(constraint: Constraint, facts: ScenarioFacts) -> str:
    """The condition and the fact that fails it: ``truck>=2 (truck=0)``."""
    return f"{constraint.label} ({evidence(constraint, facts)})"


def _tags(constraint: Constraint, facts: ScenarioFacts) -> str:
    if not constraint.words:
        return _measure(constraint, facts)
    kind = constraint.words[0][0]
    held = facts.tags if kind == "tag" else facts.features
    shown = [word if word in held else f"no {word}" for _, word in constraint.words]
    if constraint.negated or len(shown) == 1:
        return f"{kind} {', '.join(shown)}"
    carried = [word for word in shown if not word.startswith("no ")]
    return f"{kind} {', '.join(carried or shown)}"


def _measure(constraint: Constraint, facts: ScenarioFacts) -> str:
    name = measure_name(constraint.subject)
    if name == "horizon":
        return f"horizon {facts.horizon_s:g} s"
    if name == "density":
        return f"density {facts.density_per_km:g} vehicles/km"
    time_s = facts.ego.time_to_collision_s if facts.ego else None
    return "no collision if the ego keeps on" if time_s is None else f"ttc {time_s:g} s"


def _road_net(constraint: Constraint, facts: ScenarioFacts) -> str:
    name, roads = road_net_name(constraint.subject), facts.roads
    everywhere = "@map" in constraint.label
    if name == "lanes":
        return f"lanes={facts.ego.lanes}" if facts.ego else "no ego"
    if name == "speed_limit":
        limits = roads.limits_map_kmh if everywhere else roads.limits_ego_kmh
        return f"limit {'/'.join(f'{limit:g}' for limit in limits)} km/h" if limits else "no limit posted"
    if name == "traffic_light":
        there = bool(roads.traffic_lights_map) if everywhere else roads.traffic_light_ego
    else:
        there = name in (roads.signs_map if everywhere else roads.signs_ego)
    return f"{'' if there else 'no '}{name}{' on the map' if everywhere else ''}"
