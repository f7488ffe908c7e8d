"""Tags of a scenario in ASAM OpenLABEL 1.0 (scenario tagging): written from facts, and read as CommonRoad's tags.

Class names and units are those of the standard's ontology. CommonRoad's own tags are written too, under a second
ontology, so that reading a written file gives the same tags.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

from ....schemas.errors import InvalidRequest, NotPossible
from ....schemas.scenarios import OpenLabelTags, ScenarioFacts
from ....schemas.text import one_line, shown_name
from ....schemas.vocabulary import TAGS

OPENLABEL_ENDING: Final = ".openlabel.json"
_ONTOLOGY = "https://openlabel.asam.net/V1-0-0/ontologies/openlabel_ontology_scenario_tags.ttl"
_COMMONROAD = "https://commonroad.in.tum.de"
"""Stands for CommonRoad's tags, which have no ontology."""
_MOST_BYTES = 5_000_000
"""The maximum size of a file of tags (chosen)."""
_KMH = 3.6
_OF_TAGS: Final[Mapping[str, str]] = {
    "highway": "RoadTypeMotorway",
    "interstate": "RoadTypeMotorway",
    "slip_road": "RoadTypeSlip",
    "intersection": "JunctionIntersection",
    "roundabout": "JunctionRoundabout",
    "turn_left": "MotionTurnLeft",
    "turn_right": "MotionTurnRight",
}
_OF_FEATURES: Final[Mapping[str, str]] = {
    "intersection": "JunctionIntersection",
    "roundabout": "JunctionRoundabout",
    "ego_turns_left": "MotionTurnLeft",
    "ego_turns_right": "MotionTurnRight",
    "ego_turns_back": "MotionUTurn",
    "ego_stands_at_start": "MotionStop",
    "cut_in": "MotionCutIn",
    "cut_out": "MotionCutOut",
    "overtaking": "MotionOvertake",
    "crossing": "MotionCross",
    "lead_brakes_hard": "MotionDecelerate",
}
_OF_ROAD_USERS: Final[Mapping[str, str]] = {
    "car": "VehicleCar",
    "taxi": "VehicleCar",
    "parkedVehicle": "VehicleCar",
    "truck": "VehicleTruck",
    "bus": "VehicleBus",
    "motorcycle": "VehicleMotorcycle",
    "bicycle": "VehicleCycle",
    "pedestrian": "HumanPedestrian",
    "priorityVehicle": "VehicleEmergency",
    "constructionZone": "TemporaryStructureRoadWorks",
}
_OF_CIRCUMSTANCES: Final[Mapping[str, str]] = {
    "light_rain": "WeatherRain",
    "heavy_rain": "WeatherRain",
    "snow": "WeatherSnow",
    "fog": "ParticulatesWater",
    "night": "LowLightNight",
}
_AS_TAG: Final[Mapping[str, str]] = {
    **{cls: tag for tag, cls in _OF_TAGS.items()},
    "MotorwayManaged": "highway",
    "MotorwayUnmanaged": "highway",
    "RoadTypeMotorway": "highway",
    "MotionLaneChangeLeft": "lane_change",
    "MotionLaneChangeRight": "lane_change",
}
_SPECIFIC: Final[Mapping[str, str]] = {"Intersection": "intersection", "Roundabout": "roundabout"}
"""The tags of the more specific classes, by the beginning of their names."""
_LANES, _SPEED, _DENSITY = "LaneSpecificationLaneCount", "SubjectVehicleSpeed", "TrafficAgentDensity"


def openlabel_of(facts: ScenarioFacts) -> dict[str, Any]:
    """Return the tags of a scenario as OpenLABEL.

    The boundary lists the classes that are always determined, so the absence of one of them has a meaning.
    """
    classes = {
        *_mapped(_OF_TAGS, facts.tags),
        *_mapped(_OF_FEATURES, facts.features),
        *_mapped(_OF_ROAD_USERS, (kind for kind, count in facts.participants.counts.items() if count)),
        *_mapped(_OF_CIRCUMSTANCES, facts.circumstances),
    }
    values: dict[str, float] = {_DENSITY: round(facts.density_per_km)}
    if facts.ego is not None:
        values[_SPEED] = round(facts.ego.speed_mps * _KMH)
        values |= {_LANES: facts.ego.lanes} if facts.ego.lanes else {}
    standard = [{"type": name, "ontology_uid": "0"} for name in sorted(classes)]
    valued = [
        {"type": name, "ontology_uid": "0", "tag_data": {"num": [{"type": "value", "val": value}]}}
        for name, value in sorted(values.items())
    ]
    name = {"text": [{"type": "value", "val": facts.scenario_id}]}
    named = [{"type": "scenarioName", "ontology_uid": "0", "tag_data": name}]
    own = [{"type": tag, "ontology_uid": "1"} for tag in facts.tags if tag in TAGS]
    determined = {*_OF_TAGS.values(), *_OF_FEATURES.values(), *_OF_ROAD_USERS.values(), *classes, *values}
    return {
        "openlabel": {
            "metadata": {
                "schema_version": "1.0.0",
                "annotator": "PlannerForge MCP",
                "tagged_file": f"{facts.scenario_id.partition('#')[0]}.xml",
            },
            "ontologies": {
                "0": {"uri": _ONTOLOGY, "boundary_list": sorted(determined), "boundary_mode": "include"},
                "1": {"uri": _COMMONROAD, "boundary_list": sorted(TAGS), "boundary_mode": "include"},
            },
            "tags": {str(number): tag for number, tag in enumerate([*standard, *valued, *named, *own])},
        }
    }


def write_openlabel(facts: ScenarioFacts, path: Path) -> None:
    """Write the tags of a scenario as an OpenLABEL file."""
    path.write_text(json.dumps(openlabel_of(facts), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _mapped(names: Mapping[str, str], found: Iterable[str]) -> Iterator[str]:
    return (names[name] for name in found if name in names)


def read_openlabel(path: Path) -> OpenLabelTags:
    """Read a file's tags: the file that it tags, CommonRoad's tags, and the types that have no such tag.

    If the file lists CommonRoad's tags as its boundary, those that it does not state are absent, whatever its classes.

    Raises:
        InvalidRequest: the file is not OpenLABEL, too large, or has no tags.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InvalidRequest(f"{shown_name(path.name)} is too large for tags", valid=["at most 5 MB"])
        root = json.loads(path.read_text(encoding="utf-8"))["openlabel"]
        tags = [(str(tag["type"]), str(tag["ontology_uid"]), tag.get("tag_data")) for tag in root["tags"].values()]
        bounded = {
            key: {"uri": one} if isinstance(one, str) else {"uri": one["uri"], **one}
            for key, one in root["ontologies"].items()
        }
        ontologies = {key: one["uri"] for key, one in bounded.items()}
        absent = {
            str(tag)
            for one in bounded.values()
            if one["uri"] == _COMMONROAD and one.get("boundary_mode") == "include"
            for tag in one.get("boundary_list", ())
        }
        tagged = str(root["metadata"].get("tagged_file", ""))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        detail = f": {one_line(str(error), 120)}" if isinstance(error, OSError | ValueError) else ""
        raise InvalidRequest(
            f"{shown_name(path.name)} has no tags of ASAM OpenLABEL 1.0{detail}",
            valid=["a JSON file with openlabel.metadata, openlabel.ontologies and openlabel.tags"],
            next_step="import a file of scenario tags",
        ) from error
    found: dict[str, None] = {}
    unread: list[str] = []
    for name, ontology, data in tags:
        if ontologies.get(ontology) == _COMMONROAD and name in TAGS:
            found[name] = None
        elif (tag := _tag_of(name, data)) is None:
            unread.append(one_line(name, 80))
        elif tag not in absent:
            found[tag] = None
    return OpenLabelTags(tagged_file=tagged, tags=tuple(sorted(found)), unread=tuple(unread))


def _tag_of(name: str, data: Any) -> str | None:
    """Return CommonRoad's tag for a class, or None."""
    if name == _LANES:
        numbers = [float(one) for one in re.findall(r"\d+(?:\.\d+)?", json.dumps(data))]
        return None if not numbers else "single_lane" if min(numbers) < 2 else "multi_lane"
    specific = (tag for beginning, tag in _SPECIFIC.items() if name.startswith(beginning))
    return _AS_TAG.get(name) or next(specific, None)


def with_tags(content: bytes, tags: Iterable[str]) -> bytes:
    """Return a CommonRoad file with additional tags; all other bytes stay.

    Raises:
        NotPossible: the file has no place for tags.
    """
    new = sorted(tags)
    elements = "".join(f"<{tag}/>" for tag in new).encode()
    for pattern, replacement in (
        (rb"</scenarioTags\s*>", elements + b"</scenarioTags>"),
        (rb"<scenarioTags\s*/>", b"<scenarioTags>" + elements + b"</scenarioTags>"),
    ):
        changed, count = re.subn(pattern, replacement, content, count=1)
        if count:
            return changed
    attribute = re.search(rb"""(<commonRoad\b[^>]*?\stags=)(["'])(.*?)\2""", content, re.DOTALL)
    if attribute is None:
        raise NotPossible(
            "the scenario's file has no list of tags", next_step="add <scenarioTags/> after its <location>"
        )
    kept = attribute[3].decode("utf-8", "replace").split()
    text = quoteattr(" ".join([*kept, *(tag for tag in new if tag not in kept)])).encode()
    return content[: attribute.start()] + attribute[1] + text + content[attribute.end() :]
