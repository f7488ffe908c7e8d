"""The roads of a site as netconvert reads them: its own few tags in the place of all that OSM has for the same things.

netconvert knows a part of OSM's tags and reads some of them otherwise than they are documented. So a site's roads are
written with ``oneway``, ``lanes``, ``turn:lanes``, ``bus:lanes``, ``width`` and ``maxspeed`` alone, worked out here,
and with a type of their own (``service=no_…``) where not every vehicle may drive. What had to be left out, or was
worked out without a sign, is told in notes.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path

from lxml import etree

from ..osm import OsmNode, OsmWay, ground_distance_m
from ..road_tags.access import (
    ROAD_USERS,
    RoadUser,
    closing_tag,
    conditional_tags,
    in_words,
    is_for_access_only,
    is_open,
    users_of,
)
from ..road_tags.lanes import SHARED_LANE_M, Lanes, Side, arrows, lanes_of, mirrored, oneway_of
from ..road_tags.limits import Jurisdiction, Limit, class_limits, conditional_limits, limit_of, says_urban
from ..site_search.built_up import BuiltUp

_REPLACED = ("lanes", "turn", "width", "est_width", "maxspeed", "source:maxspeed", "zone", "oneway", "busway")
"""Keys that are worked out anew, with all that follows a colon after them."""
_KEYS_OF_ACCESS = """
access vehicle motor_vehicle motorcar hgv goods bus psv taxi motorcycle tourist_bus coach hov moped
"""
_ACCESS_KEYS = frozenset(_KEYS_OF_ACCESS.split())
_SUMO_CLASSES: Mapping[RoadUser, tuple[str, ...]] = {
    "car": ("passenger", "private", "evehicle", "hov", "vip", "custom1", "custom2"),
    "taxi": ("taxi",),
    "truck": ("truck", "trailer"),
    "van": ("delivery",),
    "bus": ("bus", "coach"),
    "motorcycle": ("motorcycle", "moped"),
}
_ALWAYS = ("emergency", "authority", "army")
_NO_MOTOR = ("bicycle", "pedestrian")
_TOWN_ROADS = frozenset({"residential", "living_street"})
_FAST = frozenset({"motorway", "motorway_link"})
_HOUSES_WITHIN_M, _LOOKED_EVERY_M, _BUILT_UP_SHARE = 100.0, 50.0, 0.2
"""A road lies in a town where a house or a built-up area lies within this of it, looked at every so many metres, on
this share of its length. Of 785 roads of 68 maps with a signed limit and no tag that tells of a town, 599 have at most
60 km/h: by half of their length, 93 % of these count as roads of a town; by a fifth and the cores of settlements, 96 %.
"""
_SIDES = ("yes", "both", "left", "right", "separate")


@dataclass
class _Told:
    """Names of roads by what is told of them."""

    names: dict[str, list[str]] = field(default_factory=dict)

    def add(self, what: str, name: str) -> None:
        self.names.setdefault(what, []).append(name)


class RoadReader:
    """Reads the roads of one site, and remembers what is to be told of them.

    Args:
        built_up: of the whole map: what lies around a road tells whether it lies in a town.
        where: the country and states of the site.
        lefthand: whether traffic keeps to the left.
    """

    def __init__(self, built_up: BuiltUp, where: Jurisdiction, *, lefthand: bool) -> None:
        self._built_up, self._where, self._lefthand = built_up, where, lefthand
        self._told = _Told()
        self._limits: dict[str, dict[tuple[float, str], list[str]]] = {}
        self._types: dict[str, etree._Element] = {}
        self._signed = 0
        self._states: set[int] = set()

    def tags_of(self, way: OsmWay, nodes: Sequence[OsmNode], tags: Mapping[str, str]) -> dict[str, str] | None:
        """The tags with which a part of a way is written; None where it is no road for vehicles.

        Args:
            way: with all its tags.
            nodes: of the part.
            tags: those of the way that stand (pavements may have changed).
        """
        name = way.tags.get("name") or way.tags.get("ref") or f"way {way.way_id}"
        users = users_of(way.tags)
        if not users:
            self._told.add("closed", f"{name} ({closing_tag(way.tags)})")
            return None
        lanes = lanes_of(way.tags, lefthand=self._lefthand, oneway=self._oneway(way, name), default=_lanes_of_type(way))
        if lanes.too_narrow:
            width = way.tags.get("width") or way.tags.get("est_width", "")
            self._told.add("too_narrow", f"{name} (width={width})")
            return None
        for note in lanes.notes:
            self._told.add(note, name)
        if any(node.tags.get("highway") == "mini_roundabout" for node in nodes):
            self._told.add("mini_roundabout", name)
        if is_for_access_only(way.tags):
            self._told.add("access_only", name)
        for tag in (*conditional_tags(way.tags), *conditional_limits(way.tags)):
            self._told.add("conditional", f"{name} ({tag})")
        kept = {key: value for key, value in tags.items() if not _is_replaced(key)}
        if "placement" in lanes.notes:
            kept = {key: value for key, value in kept.items() if key.partition(":")[0] != "placement"}
        kept |= _oneway_tags(way.tags, lanes.oneway) | _lane_tags(lanes, lefthand=self._lefthand)
        kept |= self._speed_tags(way, nodes, lanes.oneway, name)
        kept |= self._type_tags(way, users, name)
        return kept

    def write_types(self, target: Path) -> None:
        """Write the types of the roads that not every vehicle may use, as netconvert reads them; none if all may."""
        if self._types:
            root = etree.Element("types")
            root.extend(self._types[key] for key in sorted(self._types))
            target.write_bytes(etree.tostring(root))

    def blocked(self, tag: str) -> None:
        """Remember a barrier that cuts a road."""
        self._told.add("barrier", tag)

    def _oneway(self, way: OsmWay, name: str) -> int:
        """The direction of a road by its tags, and by access in one direction alone."""
        oneway = oneway_of(way.tags)
        forward, backward = users_of(way.tags, "forward"), users_of(way.tags, "backward")
        if oneway == 0 and bool(forward) != bool(backward):
            return 1 if forward else -1
        if oneway == 0 and forward != backward:
            self._told.add("one_sided", name)
        return oneway

    def _speed_tags(self, way: OsmWay, nodes: Sequence[OsmNode], oneway: int, name: str) -> dict[str, str]:
        urban = self.is_urban(way, nodes)
        ahead, back = (
            limit_of(way.tags, self._where, urban=urban, direction=direction) for direction in ("forward", "backward")
        )
        used = [ahead] * (oneway >= 0) + [back] * (oneway <= 0)
        for limit in used[:1]:
            self._remember(limit, way, name)
        speeds = {"maxspeed": f"{used[0].kmh:g}"}
        return speeds | ({"maxspeed:backward": f"{back.kmh:g}"} if back.kmh != used[0].kmh and oneway == 0 else {})

    def _remember(self, limit: Limit, way: OsmWay, name: str) -> None:
        if limit.unread:
            self._told.add("unread", f"{name} ({limit.unread})")
        if limit.source in ("law", "usual", "driven"):
            kind = "on motorways" if way.road_class in _FAST else "in town" if limit.urban else "outside towns"
            self._limits.setdefault(limit.source, {}).setdefault((limit.kmh, kind), []).append(name)
            if limit.legal is not None and limit.legal.states > 1 and limit.source == "law":
                self._states.add(limit.legal.states)

    def is_urban(self, way: OsmWay, nodes: Sequence[OsmNode]) -> bool:
        """Whether a road lies in a built-up area: by its own tags, else by what lies along it."""
        said = says_urban(way.tags)
        if said is not None:
            return said
        if way.road_class in _TOWN_ROADS or way.tags.get("lit") == "yes":
            return True
        if any(way.tags.get(key) in _SIDES for key in ("sidewalk", "sidewalk:both", "sidewalk:left", "sidewalk:right")):
            return True
        if not self._built_up.is_mapped:
            return self._built_up.is_dense
        points = _along(nodes)
        inside = sum(self._built_up.within(point, _HOUSES_WITHIN_M) for point in points)
        return inside >= _BUILT_UP_SHARE * len(points) or self._built_up.is_in_settlement(points[len(points) // 2])

    def _type_tags(self, way: OsmWay, users: frozenset[RoadUser], name: str) -> dict[str, str]:
        """What gives a road a type of its own, where not every vehicle may use it or some have a limit of their own."""
        speeds = class_limits(way.tags)
        bus = {"bus": "yes"} if way.road_class == "service" and _opens_to_buses(way.tags) else {}
        if "car" not in users:
            self._told.add("no_cars", f"{name} ({closing_tag(way.tags)})")
        if (
            users == frozenset(ROAD_USERS) or (way.road_class in ("service", "track") and "car" in users)
        ) and not speeds:
            return bus
        closed = [user for user in ROAD_USERS if user not in users]
        number = [f"{vehicle}{round(kmh)}" for vehicle, kmh in sorted(speeds.items())]
        type_name = "_".join(["no", *closed, *number])
        key = f"highway.{way.road_class}|service.{type_name}"
        if key not in self._types:
            self._types[key] = _type_element(key, way.road_class, users, speeds)
        return {"service": type_name, **bus}

    def notes(self) -> list[str]:
        """What is to be told of the roads, in sentences."""
        told = self._told.names
        notes = [text.format(in_words(told[what])) for what, text in _SENTENCES.items() if what in told]
        return notes + [self._limit_note(source, limits) for source, limits in sorted(self._limits.items())]

    def _limit_note(self, source: str, limits: Mapping[tuple[float, str], Sequence[str]]) -> str:
        parts = [f"{kmh:g} km/h {kind} ({in_words(names)})" for (kmh, kind), names in sorted(limits.items())]
        if source == "driven":
            return (
                f"slip roads, drives and tracks without a signed speed limit have their usual speed: {'; '.join(parts)}"
            )
        law = f"the legal default of {self._where.name}"
        if source == "usual":
            unknown = "the country is not known"
            if self._where.name:
                unknown = f"the law of {self._where.name} is not known for this kind of road"
            law = f"the median of all countries' legal defaults, because {unknown}"
        elif self._states:
            law = f"the most frequent of the legal defaults of {max(self._states)} states of {self._where.name}"
        return f"roads without a signed speed limit have {law}: {'; '.join(parts)}"


_SENTENCES: Mapping[str, str] = {
    "closed": "closed to motor vehicles by their tags, and left out: {}",
    "too_narrow": "too narrow for a car, and left out: {}",
    "no_cars": "closed to cars, not to all vehicles: {}",
    "access_only": "open to those only who have business there (destination), traffic does not know this: {}",
    "barrier": "barriers end roads here, for every vehicle: {}",
    "mini_roundabout": "a mini-roundabout is drawn as a plain junction: {}",
    "one_lane": f"one lane for both directions, drawn as a lane of {SHARED_LANE_M:g} m in either: {{}}",
    "middle_lane": "the middle lane that both directions turn from is left out: {}",
    "odd_lanes": "the tags do not say which direction has the odd lane; forward is taken: {}",
    "width_for_fewer": "the mapped width has no room for the mapped lanes, so lanes have the usual width: {}",
    "narrow_lane": "lanes narrower than a car needs, as they are mapped: {}",
    "placement": "the nodes are taken for the middle of the road, although placement says otherwise: {}",
    "reversible": "reversible lanes are drawn along their nodes only: {}",
    "uneven": "lists over lanes that do not fit the number of lanes are left out: {}",
    "one_sided": "what closes one direction to some vehicles only is left out: {}",
    "conditional": "tags that hold at some times or for some vehicles only are left out: {}",
    "unread": "no speed limit can be read of {}",
}
"""What is told, by its key, in the order of the answer; ``{}`` are the roads."""


def _is_replaced(key: str) -> bool:
    first = key.partition(":")[0]
    return (
        first in _REPLACED
        or key.startswith("source:maxspeed")
        or first in _ACCESS_KEYS
        or key == "service"
        or (key.partition(":")[2].partition(":")[0] == "lanes" and first != "change")
    )


def _oneway_tags(tags: Mapping[str, str], oneway: int) -> dict[str, str]:
    against = any(tags.get(key) == "no" for key in ("oneway:bus", "oneway:psv"))
    contraflow = {"oneway:bus": "no"} if against and oneway == 1 else {}
    cycles = {key: tags[key] for key in ("oneway:bicycle",) if key in tags}
    return {"oneway": {1: "yes", 0: "no", -1: "-1"}[oneway], **contraflow, **cycles}


def _lane_tags(lanes: Lanes, *, lefthand: bool) -> dict[str, str]:
    tags: dict[str, str] = {}
    forward, backward = lanes.forward, lanes.backward
    if lanes.oneway:
        count = forward.count if lanes.oneway > 0 else backward.count
        tags |= {"lanes": str(count)} if count else {}
    elif forward.count and backward.count:
        tags |= {"lanes": str(forward.count + backward.count), "lanes:forward": str(forward.count)}
    elif forward.count or backward.count:
        tags |= {f"lanes:{'forward' if forward.count else 'backward'}": str(forward.count or backward.count)}
    if lanes.width_m is not None:
        tags["width"] = f"{lanes.width_m:.2f}"
    for direction, side in (("forward", forward), ("backward", backward)):
        tags |= _lists_of(side, direction, lefthand=lefthand)
    return tags


def _lists_of(side: Side, direction: str, *, lefthand: bool) -> dict[str, str]:
    """The lists over the lanes of a direction; netconvert mirrors roads of left-hand traffic, but not their arrows."""
    tags = {}
    if any(turn not in ("", "none") for turn in side.turns):
        leading = arrows(side.turns)
        tags[f"turn:lanes:{direction}"] = "|".join(mirrored(leading) if lefthand else leading)
    if any(side.buses):
        tags[f"bus:lanes:{direction}"] = "|".join("designated" if alone else "yes" for alone in side.buses)
    if any(side.widths_m):
        tags[f"width:lanes:{direction}"] = "|".join("0" if w is None else f"{w:.2f}" for w in side.widths_m)
    return tags


def _opens_to_buses(tags: Mapping[str, str]) -> bool:
    return ("bus" in tags or "psv" in tags) and is_open(tags, "bus")


def _along(nodes: Sequence[OsmNode]) -> list[OsmNode]:
    """Points on a line, evenly spaced, both ends left out; one at least."""
    pairs = list(pairwise(nodes))
    steps = [ground_distance_m(a.position, b.position) for a, b in pairs]
    total = sum(steps)
    count = max(1, min(round(total / _LOOKED_EVERY_M), 20))
    points: list[OsmNode] = []
    gone = 0.0
    for (start, end), step in zip(pairs, steps, strict=True):
        while len(points) < count and gone + step >= (wanted := total * (len(points) + 0.5) / count) - 1e-6:
            share = (wanted - gone) / max(step, 1e-9)
            latitude = start.latitude + share * (end.latitude - start.latitude)
            longitude = start.longitude + share * (end.longitude - start.longitude)
            points.append(OsmNode(0, latitude, longitude, {}))
        gone += step
    return points or [nodes[0]]


def _lanes_of_type(way: OsmWay) -> int:
    return int(_base_types().get(way.road_class, {}).get("numLanes", "1"))


@cache
def _base_types() -> dict[str, Mapping[str, str]]:
    """The attributes of SUMO's types of roads by OSM's class."""
    import sumo

    path = Path(sumo.SUMO_HOME) / "data" / "typemap" / "osmNetconvert.typ.xml"
    types = etree.parse(path).getroot().iterfind("type")
    return {
        each.get("id", "").removeprefix("highway."): {str(key): str(value) for key, value in each.attrib.items()}
        for each in types
    }


def _type_element(key: str, road_class: str, users: Iterable[RoadUser], speeds: Mapping[str, float]) -> etree._Element:
    base = _base_types()[road_class]
    classes = [name for user in ROAD_USERS if user in users for name in _SUMO_CLASSES[user]]
    wanted = [*classes, *_ALWAYS, *_NO_MOTOR]
    if "allow" in base:
        wanted = [name for name in wanted if name in base["allow"].split() or (name == "bus" and "car" not in users)]
    else:
        wanted = [name for name in wanted if name not in base.get("disallow", "").split()]
    kept = {name: base[name] for name in ("numLanes", "speed", "priority", "oneway") if name in base}
    element = etree.Element("type", {"id": key, **kept, "allow": " ".join(wanted)})
    for vehicle, kmh in sorted(speeds.items()):
        for name in {"hgv": ("truck", "trailer"), "bus": ("bus", "coach")}[vehicle]:
            etree.SubElement(element, "restriction", {"vClass": name, "speed": f"{kmh / 3.6:.2f}"})
    return element
