"""Describe a scenario in words from its facts: the description to embed and search, and one line for lists."""

import re

from ...schemas.scenarios import EgoFacts, ScenarioFacts
from ...schemas.text import counted
from ...schemas.vocabulary import Origin

_FEATURE_WORDS = {
    "intersection": "an intersection",
    "roundabout": "a roundabout",
    "oncoming_traffic": "oncoming traffic",
    "lead_vehicle": "a vehicle ahead in the ego's lane",
}
_MANOEUVRES = {
    "ego_turns_left": "turns left",
    "ego_turns_right": "turns right",
    "ego_turns_back": "turns back",
    "ego_goes_straight": "goes straight on",
    "ego_changes_lane": "changes lane",
}

_DONE = {
    "cut_in": "cuts in ahead of the ego",
    "cut_out": "cuts out ahead of the ego",
    "merging": "merges into the ego's lane",
    "overtaking": "overtakes another vehicle",
    "lead_brakes_hard": "brakes hard ahead of the ego",
    "crossing": "crosses the ego's lane",
    "oncoming_turns": "comes towards the ego and turns across its lane",
}
"""Manoeuvres of road users, as text."""

_RECORDINGS = re.compile(
    r"ngsim|next generation simulation|\b(?:high|in|round|exi|uni)d\b|interaction|sind\b|argoverse|nuplan|nuscenes"
    r"|waymo|opendd|pneuma|mona\b|lyft|kitti|recorded|recording|drone",
    re.IGNORECASE,
)
"""Names of data sets of observed traffic, as CommonRoad files give their source."""
_SIMULATORS = re.compile(r"\bsumo\b|\bots\b|opentrafficsim|carla\b|simulated", re.IGNORECASE)
_BY_HAND = re.compile(r"hand[- ]?(?:crafted|made)|synthesis|synthetic|scenario designer|unittest", re.IGNORECASE)


_MANOEUVRES_SHOWN = 2
"""The most manoeuvres of others in a line for lists (chosen)."""


def origins_of(facts: ScenarioFacts) -> tuple[Origin, ...]:
    """Return the origins of a scenario's roads and traffic, judged by its tags, country and stated source."""
    origins: list[Origin] = []
    if "simulated" in facts.tags or _SIMULATORS.search(facts.source):
        origins.append("simulated")
    elif _RECORDINGS.search(facts.source):
        origins.append("recorded")
    if facts.location.country == "ZAM" or _BY_HAND.search(facts.source):
        origins.append("artificial")
    return tuple(origins)


def description_of(facts: ScenarioFacts) -> str:
    """Return a few plain sentences about place, kind of road, signs, traffic, and the ego's start and task."""
    where = f"{facts.location.place}, {facts.location.country}"
    parts = [f"Traffic scenario in {where}."]
    if facts.tags:
        parts.append(f"Tagged {', '.join(tag.replace('_', ' ') for tag in facts.tags)}.")
    if facts.circumstances:
        parts.append(f"Circumstances: {', '.join(word.replace('_', ' ') for word in facts.circumstances)}.")
    seen = [words for feature, words in _FEATURE_WORDS.items() if feature in facts.features]
    if seen:
        parts.append(f"The road shows {', '.join(seen)}.")
    parts.append(_road_sentence(facts))
    parts.append(_traffic_sentence(facts))
    if facts.ego:
        parts.append(_ego_sentence(facts, facts.ego))
        typed = [found.partition(":") for found in facts.ego.manoeuvres or ()]
        parts += [f"A {kind} {_DONE[name]}." for name, _, kind in typed]
    return " ".join(part for part in parts if part)


def summary(facts: ScenarioFacts) -> str:
    """Summarise a scenario in one line: traffic, lanes, ego speed, manoeuvre."""
    counts = ", ".join(_counted(kind, count) for kind, count in _by_number(facts.participants.counts)) or "no traffic"
    ego = facts.ego
    parts = [counts]
    if ego:
        parts.append(f"ego {ego.speed_mps:.1f} m/s ({_lanes(ego.lanes)})")
        parts += _ego_does(facts)
        parts += [found.replace(":", ": ") for found in ego.manoeuvres or ()][:_MANOEUVRES_SHOWN]
    else:
        parts.append("no planning problem, so no ego")
    if len(facts.egos) > 1:
        others = ", ".join(f"#{other.problem_id}" for other in facts.egos[1:_PROBLEMS_SHOWN])
        parts.append(f"{len(facts.egos)} planning problems: this is the first, the others are ID{others}")
    return ", ".join(parts)


_PROBLEMS_SHOWN = 6
"""The most planning problems in a line (chosen)."""


def _road_sentence(facts: ScenarioFacts) -> str:
    roads, parts = facts.roads, []
    if facts.ego and facts.ego.lanes:
        parts.append(f"{_lanes(facts.ego.lanes)} in the ego's direction")
    if roads.limits_ego_kmh:
        parts.append(f"speed limit {' and '.join(f'{limit:g}' for limit in roads.limits_ego_kmh)} km/h")
    if roads.traffic_light_ego:
        parts.append("a traffic light on the ego's lane")
    elif roads.traffic_lights_map:
        parts.append("traffic lights elsewhere on the map")
    signs = [sign.replace("_", " ") for sign in roads.signs_ego if sign != "speed_limit"]
    if signs:
        parts.append(f"signs: {', '.join(signs)}")
    return f"Road: {'; '.join(parts)}." if parts else ""


def _traffic_sentence(facts: ScenarioFacts) -> str:
    counts = _by_number(facts.participants.counts)
    if not counts:
        return "No other traffic."
    amount = "Dense" if facts.participants.total >= 20 else "Some" if facts.participants.total >= 6 else "Little"
    return f"{amount} traffic: {', '.join(_counted(kind, count) for kind, count in counts)}."


def _ego_sentence(facts: ScenarioFacts, ego: EgoFacts) -> str:
    pace = "stands" if ego.speed_mps < 0.5 else f"starts at {ego.speed_mps:.0f} m/s ({ego.speed_mps * 3.6:.0f} km/h)"
    manoeuvres = _ego_does(facts)
    task = f" and {' and '.join(manoeuvres)} to its goal" if manoeuvres else ""
    return f"The ego vehicle {pace}{task}, within {facts.horizon_steps * facts.step_s:.0f} s."


def _ego_does(facts: ScenarioFacts) -> list[str]:
    """Return the manoeuvres that the ego's route requires, as text."""
    does = [words for feature, words in _MANOEUVRES.items() if feature in facts.features]
    unprotected = "unprotected_left" in facts.features
    return ["turns left across oncoming lanes" if unprotected and one == "turns left" else one for one in does]


def _by_number(counts: dict[str, int]) -> list[tuple[str, int]]:
    return sorted(counts.items(), key=lambda item: (-item[1], item[0]))


def _counted(kind: str, count: int) -> str:
    return counted(count, "unknown object" if kind == "unknown" else kind)


def _lanes(count: int) -> str:
    return "1 lane" if count == 1 else f"{count} lanes"
