"""Requests that search the catalogue: places, tags, counts and speeds, with the ids that satisfy all of them."""

from collections.abc import Iterator, Sequence
from typing import Any

from ...schemas.scenarios import ScenarioFacts
from ...schemas.vocabulary import OBSTACLE_TYPES, TAGS
from .materials import STYLES, Condition, CorpusLine, Draw, KnownScenario, Materials, rounds, styled

_MOST_MATCHES = 10
_KMH = 3.6
_OPERATIONS = ("exact", "at_least", "at_most", "range")
_MARGIN_MPS = 0.02
"""Margin of a speed from a deciding bound, as in the development corpora."""
_WORDS = {"priorityVehicle": "emergency vehicle", "parkedVehicle": "parked vehicle", "motorcycle": "motorbike"}
_UNKNOWN_TAGS = ("snowstorm", "tunnel", "night_drive", "school_zone")
_UNKNOWN_OBSTACLES = ("tram", "elephant", "hovercraft")


def selection_lines(materials: Materials, count: int, draw: Draw) -> Iterator[CorpusLine]:
    """Yield requests, three quarters of them with matches.

    The others match nothing, use words outside the vocabulary, or state no condition.
    """
    found = _found(materials, draw)
    for number in range(count):
        kind = {5: "absent_tag", 10: "oov_tag", 13: "oov_obstacle", 16: "absent_obstacle", 19: "clarify"}.get(
            number % 20
        )
        line = next(found, None) if kind is None else _other(kind, materials, draw)
        if line is not None:
            yield line


def plain_search(materials: Materials, draw: Draw) -> tuple[str, dict[str, Any]]:
    """Return a search by place, tag and a minimum count, and its truth as in conversations: slots and all matches."""
    one = draw.choice(materials.scenarios)
    counts = one.facts.participants.counts
    tags = [tag for tag in one.facts.tags if tag in TAGS and tag != "simulated"]
    conditions = [_place(one.facts), *(_tag(tag) for tag in draw.sample(tags, min(len(tags), 1)))]
    conditions += [_count(kind, counts[kind], draw, ("at_least",)) for kind in draw.sample(sorted(counts), 1)]
    words = [condition.words for condition in conditions]
    slots = _truth(conditions)
    slots["obstacles"] = {kind: slot["count"] for kind, slot in slots["obstacles"].items()}
    matches = [f"{key}.xml" for key in materials.matching(*conditions)]
    return f"Find scenarios {words[0]}, {', '.join(words[1:])}.", {"slots": slots, "matches": matches}


def _found(materials: Materials, draw: Draw) -> Iterator[CorpusLine]:
    """Yield requests from the facts of a scenario, with enough conditions to leave few other scenarios."""
    seen = set[str]()
    styles = rounds(STYLES, draw)
    for tries, one in enumerate(rounds(materials.scenarios, draw)):
        if tries > 50 * len(materials.scenarios):
            return
        conditions = _conditions(one, draw)
        matching = materials.matching(*conditions)
        key = " ".join(condition.words for condition in conditions)
        if 1 <= len(matching) <= _MOST_MATCHES and key not in seen:
            seen.add(key)
            yield _line(materials, conditions, matching, draw, next(styles), one.facts.scenario_id)


def _conditions(one: KnownScenario, draw: Draw) -> list[Condition]:
    facts = one.facts
    found = [_place(facts)]
    tags = [tag for tag in facts.tags if tag in TAGS and tag != "simulated"]
    if tags and draw.random() < 0.6:
        found.append(_tag(draw.choice(tags)))
    counts = facts.participants.counts
    kinds = draw.sample(sorted(counts), min(len(counts), draw.choice((1, 1, 2))))
    found += [_count(kind, counts[kind], draw) for kind in kinds]
    if facts.ego is not None and draw.random() < 0.35:
        found.append(_speed(facts.ego.speed_mps, draw))
    return found


def _place(facts: ScenarioFacts) -> Condition:
    place, country = facts.location.place, facts.location.country
    value = {"country": country, "city": place}
    return Condition(
        "location",
        value,
        f"from {place}",
        lambda other: (other.location.country, other.location.place) == (country, place),
    )


def _tag(tag: str) -> Condition:
    return Condition("tags", [tag], f"tagged {tag}", lambda facts: tag in facts.tags)


def _count(kind: str, count: int, draw: Draw, operations: Sequence[str] = _OPERATIONS) -> Condition:
    word = _WORDS.get(kind, kind)
    several = f"{word}es" if word.endswith("s") else f"{word}s"
    operation = draw.choice(operations)
    low, high = max(count - draw.randint(0, 3), 1), count + draw.randint(1, 4)
    value: Any = {"exact": count, "at_least": low, "at_most": high, "range": [low, high]}[operation]
    words = {
        "exact": f"exactly {count} {word if count == 1 else several}",
        "at_least": f"at least {low} {word if low == 1 else several}",
        "at_most": f"at most {high} {several}",
        "range": f"between {low} and {high} {several}",
    }[operation]
    bounds = {"exact": (count, count), "at_least": (low, 10**9), "at_most": (0, high), "range": (low, high)}[operation]
    truth = {kind: {"op": operation, "count": value}}
    return Condition(
        "obstacles", truth, words, lambda facts: bounds[0] <= facts.participants.counts.get(kind, 0) <= bounds[1]
    )


def _speed(speed_mps: float, draw: Draw) -> Condition:
    """Return a range of speeds with a margin, in m/s or km/h."""
    low_mps = max(round(speed_mps - draw.choice((1.0, 2.0)), 0), 0.0)
    high_mps = round(speed_mps + draw.choice((1.5, 2.5)), 0)
    unit = draw.choice(("m/s", "km/h"))
    scale = 1.0 if unit == "m/s" else _KMH
    value = [int(low_mps * scale), int(high_mps * scale) + 1]
    low, high = value[0] / scale, value[1] / scale
    truth = {"value": value, "unit": unit, "op": "range", "tolerance": 0.0}

    def holds(facts: ScenarioFacts) -> bool:
        return facts.ego is not None and low + _MARGIN_MPS <= facts.ego.speed_mps <= high - _MARGIN_MPS

    return Condition("velocity", truth, f"where the ego starts with {value[0]} to {value[1]} {unit}", holds)


def _truth(conditions: list[Condition]) -> dict[str, Any]:
    truth: dict[str, Any] = {}
    for condition in conditions:
        if condition.slot == "tags":
            truth["tags"] = [*truth.get("tags", []), *condition.value]
        elif condition.slot == "obstacles":
            truth["obstacles"] = {**truth.get("obstacles", {}), **condition.value}
        else:
            truth[condition.slot] = condition.value
    return truth


def _line(
    materials: Materials, conditions: list[Condition], matching: list[str], draw: Draw, style: Any, about: str
) -> CorpusLine:
    words = [condition.words for condition in conditions]
    text = (
        f"Find scenarios {' '.join(words[:1])}, {', '.join(words[1:])}." if words[1:] else f"Find scenarios {words[0]}."
    )
    terse = ", ".join(words).replace("from ", "").replace("tagged ", "").replace("where the ego starts with", "ego")
    stages: dict[str, int] = {}
    for slot in dict.fromkeys(condition.slot for condition in conditions):
        upto = [condition for condition in conditions if condition.slot in {*stages, slot}]
        stages[slot] = len(materials.matching(*upto))
    truth = {**_truth(conditions), "matching_ids": matching, "n_after_stage": stages}
    category = "+".join(stages)
    return CorpusLine("selection", styled(text, terse, style, draw), truth, "ok", category, style, about)


def _other(kind: str, materials: Materials, draw: Draw) -> CorpusLine | None:
    one = draw.choice(materials.scenarios)
    facts, place = one.facts, _place(one.facts)
    city = facts.location.place
    empty: dict[str, Any] = {"matching_ids": []}
    if kind == "clarify":
        text = draw.choice(
            ("Find me a good scenario.", "I need something interesting to test on.", "Show me the right one.")
        )
        return CorpusLine("selection", text, {**empty, "missing": ["any condition"]}, "clarify", kind, "normal", city)
    if kind in ("oov_tag", "oov_obstacle"):
        slot = "tags" if kind == "oov_tag" else "obstacles"
        word = draw.choice(_UNKNOWN_TAGS if kind == "oov_tag" else _UNKNOWN_OBSTACLES)
        text = (
            f"Scenarios from {city} with the tag {word}"
            if kind == "oov_tag"
            else f"Scenarios from {city} with two {word}s"
        )
        truth = {"location": place.value, "refused": [{"slot": slot, "value": word}], **empty}
        return CorpusLine("selection", f"{text}.", truth, "refuse", kind, "normal", facts.scenario_id)
    there = {tag for other in materials.scenarios for tag in other.facts.tags}
    counts = {kind for other in materials.scenarios for kind in other.facts.participants.counts}
    if kind == "absent_tag":
        absent = sorted(set(TAGS) - there)
        if not absent:
            return None
        condition = _tag(draw.choice(absent))
    else:
        absent = sorted(set(OBSTACLE_TYPES) - counts - {"unknown", "roadBoundary"})
        if not absent:
            return None
        condition = _at_least_one(draw.choice(absent))
    if materials.matching(place, condition):
        return None
    constraint = condition.value[0] if condition.slot == "tags" else next(iter(condition.value))
    emptied = {"stage": condition.slot, "constraint": constraint}
    without = materials.matching(place)
    truth = {
        **_truth([place, condition]),
        **empty,
        "n_after_stage": {"location": len(without), condition.slot: 0},
        "emptied_by": emptied,
        "ids_without_it": without,
    }
    text = f"Find scenarios {place.words}, {condition.words}."
    return CorpusLine("selection", text, truth, "empty", kind, "normal", facts.scenario_id)


def _at_least_one(kind: str) -> Condition:
    word = _WORDS.get(kind, kind)
    truth = {kind: {"op": "at_least", "count": 1}}
    return Condition(
        "obstacles", truth, f"with at least one {word}", lambda facts: facts.participants.counts.get(kind, 0) > 0
    )
