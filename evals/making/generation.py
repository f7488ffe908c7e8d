"""Requests for scenarios: a site of a map, with a density, vehicles and a duration; some without a possible map."""

from collections.abc import Iterator
from typing import Any

from ...schemas.generation import MapFacts
from .materials import STYLES, CorpusLine, Draw, Materials, rounds, styled

_DENSITIES = {"low": "quiet traffic", "medium": "moderate traffic", "high": "rush hour"}
_CLASSES = {"truck": "trucks", "bus": "buses", "taxi": "taxis", "motorcycle": "motorcycles", "delivery": "vans"}
_ONE = {"delivery": "van"}
_TOWN_CLASSES = {"bicycle": "bicycles", "moped": "mopeds"}
_TYPES = {
    "roundabout": "a roundabout",
    "intersection": "an intersection",
    "signalised_intersection": "a crossing with traffic lights",
    "highway": "a stretch of motorway",
    "ramp": "a motorway ramp",
    "rural": "a country road",
    "urban": "a street in town",
}
_FAST = ("highway", "ramp")
_NOWHERE = ("Wolkenkuckucksheim", "Nowhereville", "Atlantis")
_NO_CLASSES = ("tank", "helicopter", "spaceship")


def generation_lines(materials: Materials, count: int, draw: Draw) -> Iterator[CorpusLine]:
    """Yield requests, four fifths of them possible; the rest have an unknown place, site or class, or no place."""
    sites = [
        (one, kind) for one in materials.maps for kind, there in sorted(one.sites.items()) if there and kind in _TYPES
    ]
    drawn, styles = rounds(sites, draw), rounds(STYLES, draw)
    for number in range(count):
        kind = {4: "type_missing", 9: "unknown_place", 14: "unknown_class", 18: "underspecified"}.get(number % 20)
        if kind == "underspecified":
            yield _underspecified(draw)
        elif kind is not None:
            yield _refused(kind, draw.choice(materials.maps), draw)
        else:
            chosen, site = next(drawn)
            yield _possible(chosen, site, next(styles), draw)


def _possible(chosen: MapFacts, kind: str, style: Any, draw: Draw) -> CorpusLine:
    density = draw.choice((None, *_DENSITIES))
    words = _CLASSES if kind in _FAST else {**_CLASSES, **_TOWN_CLASSES}
    classes = draw.sample(sorted(words), draw.choice((0, 1, 1, 2)))
    counts = {name: draw.choice(("present", 1, 2, 2)) for name in classes}
    duration_s = draw.choice((None, None, 10, 15, 30))
    with_them = [
        words[name] if number == "present" else f"{number} {words[name] if number != 1 else _ONE.get(name, name)}"
        for name, number in counts.items()
    ]
    parts = [f"with {' and '.join(with_them)}"] if with_them else []
    parts += [f"in {_DENSITIES[density]}"] if density else []
    parts += [f"{duration_s} seconds long"] if duration_s else []
    text = f"Make {_TYPES[kind]} in {chosen.place}{''.join(f', {part}' for part in parts)}."
    terse = ", ".join([f"{chosen.place} {kind.replace('_', ' ')}", *parts])
    truth = _truth(chosen, kind, density, counts, duration_s)
    category = "map" if not classes else "map_classes"
    return CorpusLine(
        "generation",
        styled(text, terse, style, draw),
        truth,
        "ok",
        category,
        style,
        chosen.file_name,
        {"map": chosen.file_name},
    )


def _truth(
    chosen: MapFacts, kind: str, density: str | None, counts: dict[str, Any], duration_s: int | None
) -> dict[str, Any]:
    given = {"density": density, "vehicles": counts or None, "duration_s": duration_s}
    left_open = [name for name, value in given.items() if value is None]
    known = kind if kind != "signalised_intersection" else "intersection"
    truth: dict[str, Any] = {
        "location": {"city": chosen.place, "place": None, "country": chosen.country, "bbox": None},
        "map": chosen.file_name,
        "road_classes": ["roads", "link"] if kind == "ramp" else ["roads"],
        "scenario_type": known,
        "density": density or "low",
        "vehicles": {"car": "present", **counts},
        "duration_s": duration_s or 20,
        "ego": {"strategy": "first"},
        "goal": {"strategy": "forward_offset", "offset_steps": 50},
        "count": 1,
        "defaults": [*([] if kind == "ramp" else ["road_classes"]), *left_open, "ego", "goal", "count"],
    }
    return truth | ({"feature": "signalised_crossing"} if kind == "signalised_intersection" else {})


def _refused(kind: str, chosen: MapFacts, draw: Draw) -> CorpusLine:
    missing = sorted(name for name in ("roundabout", "highway", "ramp", "rural") if not chosen.sites.get(name))
    if kind == "type_missing" and missing:
        site = draw.choice(missing)
        truth = _truth(chosen, site, None, {}, None) | {"reason": "no_such_site"}
        text = f"Make {_TYPES[site]} in {chosen.place}."
    elif kind == "unknown_class":
        word = draw.choice(_NO_CLASSES)
        truth = _truth(chosen, "any", None, {word: 2}, None) | {"reason": "unknown_class"}
        text = f"A scenario in {chosen.place} with two {word}s."
    else:
        place, kind = draw.choice(_NOWHERE), "unknown_place"
        truth = _truth(chosen, "intersection", None, {}, None) | {"map": None, "reason": "unknown_place"}
        truth["location"] = {"city": place, "place": None, "country": None, "bbox": None}
        text = f"An intersection in {place}, please."
    return CorpusLine("generation", text, truth, "refuse", kind, "normal", chosen.file_name, {"map": truth["map"]})


def _underspecified(draw: Draw) -> CorpusLine:
    text = draw.choice(("A scenario, please.", "Make me something.", "Generate one."))
    truth = {"location": None, "map": None, "reason": "missing:location", "also_accept": ["ok"], "defaults": []}
    return CorpusLine("generation", text, truth, "clarify", "underspecified", "normal", "", {"map": None})
