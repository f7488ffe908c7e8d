"""Reads an operational design domain in ASAM OpenODD 1.0, and finds what scenarios and runs cover of it.

A concept of the ODD's taxonomy is measured if its name is one of ``MEASURED``, which follow ISO 34503, or if a binding
file names the measurement (``probe: speed_limit``). openodd-py reads the files and judges values.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from math import log
from pathlib import Path
from typing import Any, Final, get_args

from ...schemas.errors import InvalidRequest, NotPossible
from ...schemas.generation import Density, SiteType, Turn
from ...schemas.odd import MOST_ODD_BYTES, OddConcept, OddCoverage, OddEntry, OddLevel, OddRequest, OddShare, OddValue
from ...schemas.scenarios import ScenarioFacts
from ...schemas.text import one_line, quoted, shown_name
from ..execution import ProgressReporter
from ..traffic import VEHICLES_PER_LANE_KM

_KMH = 3.6


@dataclass(frozen=True)
class _Measurement:
    """What is measured of a scenario: its unit, the edges of its ranges or its values, and other names."""

    unit: str = ""
    edges: tuple[float, ...] = ()
    values: tuple[int, ...] = ()
    names: tuple[str, ...] = ()

    def binding(self, name: str) -> dict[str, Any]:
        """Return how openodd-py measures a concept with this name."""
        levels = {"buckets": list(self.edges)} if self.edges else {"values": list(self.values)} if self.values else {}
        return {"probe": name, **levels}


MEASURED: Final[Mapping[str, _Measurement]] = {
    "junction": _Measurement(names=("junction_type", "site")),
    "intersection": _Measurement(names=("intersections",)),
    "roundabout": _Measurement(names=("roundabouts",)),
    "ramp": _Measurement(names=("slip_road", "slip_roads")),
    "motorway": _Measurement(names=("highway", "motorways")),
    "traffic_lights": _Measurement(names=("traffic_light", "signalised", "signalized")),
    "speed_limit": _Measurement("km/h", (0, 35, 55, 75, 105, 135, 300)),
    "lane_count": _Measurement(values=(1, 2, 3, 4), names=("number_of_lanes", "lanes")),
    "ego_speed": _Measurement("km/h", (0, 35, 55, 75, 105, 135, 300), names=("subject_vehicle_speed", "speed")),
    "ego_turn": _Measurement(names=("ego_manoeuvre", "turn")),
    "traffic_density": _Measurement(names=("density",)),
    "car": _Measurement(names=("cars",)),
    "truck": _Measurement(names=("trucks",)),
    "bus": _Measurement(names=("buses",)),
    "motorcycle": _Measurement(names=("motorcycles",)),
    "bicycle": _Measurement(names=("bicycles", "cyclist", "cyclists")),
    "pedestrian": _Measurement(names=("pedestrians",)),
    "illumination": _Measurement(names=("natural_illuminance", "time_of_day")),
    "rain": _Measurement(names=("rainfall", "rainfall_intensity")),
    "snow": _Measurement(names=("snowfall",)),
    "fog": _Measurement(names=("mist",)),
    "country": _Measurement(names=("region", "region_or_states")),
}
"""What is measured of a scenario, by its name in binding files.

Concepts are found by these names; the last part of a dotted name counts. Usual posted limits lie inside the
ranges of speeds, not at their edges (chosen).
"""
_SPELLINGS: Final = ("{value}", "{value}_{concept}", "{value}_time", "{concept}_{value}")
"""How taxonomies write a value: ``light`` or ``light_rain``."""
_CLASSES: Final = ("car", "truck", "bus", "motorcycle", "bicycle", "pedestrian")
_SITES: Final[Mapping[SiteType, Mapping[str, OddValue]]] = {
    "highway": {"motorway": True, "junction": "none"},
    "urban": {"motorway": False},
    "intersection": {"junction": "intersection", "intersection": True},
    "signalised_intersection": {"junction": "intersection", "intersection": True, "traffic_lights": True},
    "roundabout": {"junction": "roundabout", "roundabout": True},
    "rural": {"motorway": False},
    "ramp": {"junction": "ramp", "ramp": True},
}
"""What a type of site states."""


def odd_values(facts: ScenarioFacts) -> dict[str, OddValue]:
    """Return what an ODD can restrict of a scenario, by name; None for what its file does not state.

    A scenario that states no bad weather has good weather, because nothing in it depends on the weather.
    """
    features, tags, counts, ego = set(facts.features), set(facts.tags), facts.participants.counts, facts.ego
    junctions = [name for name in ("roundabout", "intersection", "ramp") if name in features]
    turns = [
        name
        for name in ("left", "right", "straight", "lane_change", "back")
        if {f"ego_turns_{name}", f"ego_goes_{name}", "ego_changes_lane" if name == "lane_change" else ""} & features
    ]
    stated = set(facts.circumstances)
    values: dict[str, OddValue] = {
        "junction": junctions[0] if junctions else "none",
        **{name: name in features for name in ("intersection", "roundabout", "ramp")},
        "motorway": bool(tags & {"highway", "interstate"}) if tags else None,
        "traffic_lights": facts.roads.traffic_lights_map > 0 or facts.roads.traffic_light_ego,
        "speed_limit": max(facts.roads.limits_ego_kmh, default=None),
        "lane_count": None if ego is None else ego.lanes,
        "ego_speed": None if ego is None else round(ego.speed_mps * _KMH, 3),
        "ego_turn": turns[0] if turns else None,
        "traffic_density": _nearest_density(facts.density_per_km),
        **{name: counts.get(name, 0) > 0 for name in _CLASSES},
        "illumination": "night" if "night" in stated else "day" if "rush_hour" in stated else None,
        "rain": "light" if "light_rain" in stated else "heavy" if "heavy_rain" in stated else "none",
        "snow": "snow" in stated,
        "fog": "fog" in stated,
        "country": facts.location.country,
    }
    return values


def _nearest_density(per_km: float) -> Density:
    """Return the density with the nearest number of vehicles per km of lane, as a ratio."""
    return min(VEHICLES_PER_LANE_KM, key=lambda name: abs(log(max(per_km, 1.0) / VEHICLES_PER_LANE_KM[name])))


def judge_odd(request: OddRequest, report: ProgressReporter) -> OddCoverage:
    """Return what scenarios and runs cover of an ODD, and what is missing (a worker's operation).

    Raises:
        InvalidRequest: the file is not an ODD, or imports files from elsewhere.
        NotPossible: no concept of the ODD is measured.
    """
    report(0.0, "reading the ODD")
    domain = _Domain(_read(request.path))
    sides = {True: list[OddEntry](), False: list[OddEntry]()}
    assumed = 0
    for entry in request.entries:
        verdict = domain.verdict(entry.values)
        sides[verdict.inside].append(entry)
        assumed += verdict.assumed
    concepts = tuple(domain.concepts(sides))
    levels = domain.levels()
    inside = [entry.values for entry in sides[True]]
    alone = [(key, _is_covered([one], inside)) for key, one in levels]
    pairs = [
        _is_covered([one, other], inside)
        for ((factor, _), one), ((factor_2, _), other) in combinations(levels, 2)
        if factor != factor_2
        and "weather" not in (factor, factor_2)
        and not _contradict(one, other)
        and domain.verdict({**one, **other}).inside
    ]
    missing = [f"{factor} {level}" for (factor, level), covered in alone if not covered]
    varied = {factor for (factor, _), _ in alone} - {"weather"}
    calls: list[dict[str, list[str]]] = []
    if any(not covered for (factor, _), covered in alone if factor in varied) or not all(pairs):
        by_factor = {
            factor: [level for (name, level), _ in levels if name == factor] for factor in _FACTORS if factor in varied
        }
        calls.append({"cover": [f"{factor}={'|'.join(found)}" for factor, found in by_factor.items()]})
    calls += [
        {"conditions": [f"weather={level}"]}
        for (factor, level), covered in alone
        if factor == "weather" and not covered
    ]
    missing += [
        f"{concept.name} {level.level}"
        for concept in concepts
        for level in concept.levels
        if level.is_inside and not level.scenarios and domain.is_only_found(concept.name)
    ]
    return OddCoverage(
        name=domain.odd.name,
        revision=str(domain.odd.revision),
        inside=_share(sides[True]),
        outside=_share(sides[False]),
        assumed=assumed,
        concepts=concepts,
        not_measured=domain.not_measured,
        pairs=len(pairs),
        covered_pairs=sum(pairs),
        missing=tuple(missing),
        calls=tuple(calls),
    )


_FACTORS: Final = ("scenario_type", "density", "vehicles", "turn", "country")


def _share(entries: Sequence[OddEntry]) -> OddShare:
    return OddShare(
        scenarios=len(entries), runs=sum(entry.runs for entry in entries), failed=sum(entry.failed for entry in entries)
    )


def _is_covered(levels: Sequence[Mapping[str, OddValue]], inside: Iterable[Mapping[str, OddValue]]) -> bool:
    wanted = [pair for level in levels for pair in level.items()]
    return any(all(values.get(name) == value for name, value in wanted) for values in inside)


def _contradict(one: Mapping[str, OddValue], other: Mapping[str, OddValue]) -> bool:
    return any(name in other and other[name] != value for name, value in one.items())


class _Domain:
    """An ODD with its measured concepts."""

    def __init__(self, odd: Any) -> None:
        self.odd = odd
        self._measured = {one.name: one.source[1] for one in odd.attributes if one.source[0] == "probe"}
        self._spelt = {one.name: _levels_of(one) for one in odd.attributes}
        if not self._measured:
            raise NotPossible(
                f"no concept of the ODD {quoted(odd.name)} is measured",
                valid=sorted(MEASURED),
                next_step="name its concepts so, or write a binding file with 'probe: NAME' for each concept",
            )

    @property
    def not_measured(self) -> tuple[str, ...]:
        """The concepts in its conditions that no scenario states."""
        used = {
            name for module in self.odd.modules for condition in module.conditions() for name in condition.attributes()
        }
        return tuple(one.name for one in self.odd.attributes if one.name in used and one.name not in self._measured)

    def verdict(self, values: Mapping[str, OddValue]) -> Any:
        """Return the ODD's verdict on the values of a scenario, or on some of them."""
        return self.odd.evaluate(self._named(values))

    def _named(self, values: Mapping[str, OddValue]) -> dict[str, OddValue]:
        """Return values by the names of the ODD's concepts, spelt as its taxonomy spells them."""
        return {name: _spelt(values.get(key), self._spelt[name], key) for name, key in self._measured.items()}

    def concepts(self, sides: Mapping[bool, Sequence[OddEntry]]) -> Iterator[OddConcept]:
        """Yield the measured concepts with their levels."""
        for attribute in self.odd.attributes:
            if attribute.name not in self._measured or attribute.item is None:
                continue
            outside = set(self.odd.outside_buckets(attribute))
            levels = []
            for bucket in attribute.item.describe()["buckets"]:
                is_inside = bucket not in outside
                having = [
                    entry
                    for entry in sides[is_inside]
                    if (value := self._named(entry.values)[attribute.name]) is not None
                    and attribute.item.bucket_of(value) == bucket
                ]
                share = _share(having)
                levels.append(OddLevel(level=bucket, is_inside=is_inside, **share.model_dump()))
            yield OddConcept(name=attribute.name, unit=attribute.unit, levels=tuple(levels))

    def levels(self) -> list[tuple[tuple[str, str], dict[str, OddValue]]]:
        """Return the levels of each factor of ``generate_scenarios`` inside the ODD, as factor, level and values.

        Factors that the ODD does not restrict, or that it cannot tell apart, are left out.
        """
        keys = set(self._measured.values())
        stated: dict[str, dict[str, dict[str, OddValue]]] = {
            "scenario_type": {name: {**_SITES[name]} for name in get_args(SiteType)},
            "density": {name: {"traffic_density": name} for name in get_args(Density)},
            "vehicles": {"cars": dict.fromkeys(_CLASSES[1:], False), **{name: {name: True} for name in _CLASSES[1:]}},
            "turn": {name: {"ego_turn": name} for name in get_args(Turn)[:4]},
            "weather": {
                "light_rain": {"rain": "light"},
                "heavy_rain": {"rain": "heavy"},
                "snow": {"snow": True},
                "fog": {"fog": True},
            },
        }
        found = []
        for factor, named in stated.items():
            told = list[dict[str, OddValue]]()
            for level, values in named.items():
                known = {key: value for key, value in values.items() if key in keys and self._has(key, value)}
                if known and known not in told and self.verdict(known).inside:
                    told.append(known)
                    found.append(((factor, level), known))
        return found

    def _has(self, key: str, value: OddValue) -> bool:
        """Return whether a concept with this measurement has the value."""
        return any(
            not isinstance(value, str) or _spelt(value, self._spelt[name], key) in (*self._spelt[name], True, False)
            for name, measured in self._measured.items()
            if measured == key
        )

    def is_only_found(self, name: str) -> bool:
        """Return whether no factor or condition of ``generate_scenarios`` sets this concept."""
        return self._measured[name] in ("speed_limit", "lane_count", "ego_speed", "country", "illumination")


def _levels_of(attribute: Any) -> tuple[str, ...]:
    return () if attribute.item is None else tuple(attribute.item.describe()["buckets"])


def _spelt(value: OddValue, levels: Sequence[str], key: str) -> OddValue:
    """Return a value as the taxonomy spells it; a category as a yes or no if the concept is one."""
    if not isinstance(value, str):
        return value
    if {level.lower() for level in levels} == {"true", "false"}:
        return value not in ("none", "")
    spellings = (spelling.format(value=value, concept=key) for spelling in _SPELLINGS)
    return next((one for one in spellings if one in levels), value)


def _read(path: Path) -> Any:
    """Return the ODD of an OpenODD document or a binding file.

    Raises:
        InvalidRequest: the file is not an ODD, or imports files from elsewhere.
    """
    import openodd

    content = _checked(path)
    units = {name: (partial(_value_of, name), one.unit) for name, one in MEASURED.items()}
    backend = openodd.Backend(name="PlannerForge", probes=units, allow_imports=False)
    try:
        if "openodd" in content:
            return openodd.load_odd_binding(path, backend=backend)
        bare = openodd.load_openodd(path, backend=backend)
        names = {other: name for name, one in MEASURED.items() for other in (name, *one.names)}
        bindings = {
            attribute.name: MEASURED[name].binding(name)
            for attribute in bare.attributes
            if (name := names.get(attribute.name.rpartition(".")[2])) is not None
        }
        return openodd.load_openodd(path, bindings=bindings, name=path.stem, backend=backend)
    except ValueError as error:  # OpenOddError is one
        raise InvalidRequest(
            f"{shown_name(path.name)} is not an ODD that openodd-py reads: {one_line(str(error), 300)}",
            valid=["ASAM OpenODD 1.0 YAML: TAXONOMY, MODULES with INCLUDE_AND, INCLUDE_OR, EXCLUDE_AND, EXCLUDE_OR"],
            next_step="correct the file",
        ) from error


def _value_of(name: str, values: Mapping[str, OddValue]) -> OddValue:
    return values.get(name)


def _checked(path: Path, seen: frozenset[Path] = frozenset()) -> Mapping[str, Any]:
    """Return the content of a file, after a check of the files that it imports.

    openodd-py would fetch files from git and read any path, so only files next to the first one are allowed.

    Raises:
        InvalidRequest: a file is unreadable, too large or elsewhere.
    """
    import yaml

    try:
        if path.stat().st_size > MOST_ODD_BYTES:
            raise InvalidRequest(f"{shown_name(path.name)} is too large for an ODD", valid=["at most 1 MB"])
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise InvalidRequest(
            f"{shown_name(path.name)} is unreadable: {one_line(str(error), 200)}", valid=["a YAML file of OpenODD"]
        ) from error
    if not isinstance(content, dict):
        raise InvalidRequest(f"{shown_name(path.name)} is not an ODD", valid=["a YAML file of OpenODD"])
    for key in ("IMPORT", "openodd"):
        imported = content.get(key) or []
        for one in imported if isinstance(imported, list) else [imported]:
            file = path.parent / one if isinstance(one, str) and "://" not in one else None
            if file is None or not file.resolve().is_relative_to(path.parent.resolve()) or not file.is_file():
                raise InvalidRequest(
                    f"{shown_name(path.name)} imports {quoted(str(one))}",
                    valid=["files in the same folder"],
                    next_step="put the file there",
                )
            if file.resolve() not in seen:
                _checked(file, seen | {path.resolve()})
    return content
