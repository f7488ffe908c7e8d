"""Rewrites a site's roads for netconvert: a few tags that it understands replace all of OSM's tags.

netconvert knows some of OSM's tags, and reads a few of them differently from their documentation. A site's roads are
therefore written only with ``oneway``, ``lanes``, ``turn:lanes``, ``bus:lanes``, ``width`` and ``maxspeed``, computed
here, and with a type of their own (``service=no_…``) if some vehicles may not use them. Notes report what was left out,
or computed although no sign is mapped.
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
from ..road_tags.limits import Jurisdiction, Limit, class_limits, conditional_limits, is_tagged_urban, limit_of
from ..site_search.built_up import BuiltUp

_REPLACED = ("lanes", "turn", "width", "est_width", "maxspeed", "source:maxspeed", "zone", "oneway", "busway")
"""Keys that are computed here, with all their subkeys after a colon."""
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
"""A road is in a town if a house or a built-up area is within this distance, sampled at this spacing, over this share
of its length.

Measured on roads with a posted limit and no tag of a town, each judged without its own limit, on 68 maps that nothing
was tuned on: of 1,556 with at most 60 km/h, 81% count as roads of a town; of 468 with 70 km/h or more, 78% do not.
Without other roads' posted limits it is 40% and 82%. On the maps that the rule was tuned on, it is 97% of 599 and
40% of 186.
"""
_TOWN_KMH, _OPEN_KMH = 60.0, 80.0
"""Posted limits of other roads up to the first speak of a town, and from the second on of open country."""
_SIDES = ("yes", "both", "left", "right", "separate")


@dataclass
class _Reported:
    """Names of roads, by the fact that a note reports about them."""

    names: dict[str, list[str]] = field(default_factory=dict)

    def add(self, what: str, name: str) -> None:
        self.names.setdefault(what, []).append(name)


class RoadReader:
    """Reads the roads of one site, and collects the notes on them.

    Args:
        built_up: the built-up parts of the whole map: the surroundings of a road determine whether it is in a town.
        where: the country and states of the site.
        lefthand: whether traffic keeps left.
    """

    def __init__(self, built_up: BuiltUp, where: Jurisdiction, *, lefthand: bool) -> None:
        self._built_up, self._where, self._lefthand = built_up, where, lefthand
        self._reported = _Reported()
        self._limits: dict[str, dict[tuple[float, str], list[str]]] = {}
        self._types: dict[str, etree._Element] = {}
        self._signed = 0
        self._states: set[int] = set()

    def tags_of(self, way: OsmWay, nodes: Sequence[OsmNode], tags: Mapping[str, str]) -> dict[str, str] | None:
        """Return the tags for writing a part of a way, or None if it is not a road for vehicles.

        Args:
            way: the way with all its tags.
            nodes: the nodes of the part.
            tags: the way's current tags (pavements may have changed).
        """
        name = way.tags.get("name") or way.tags.get("ref") or f"way {way.way_id}"
        users = users_of(way.tags)
        if not users:
            self._reported.add("closed", f"{name} ({closing_tag(way.tags)})")
            return None
        lanes = lanes_of(way.tags, lefthand=self._lefthand, oneway=self._oneway(way, name), default=_lanes_of_type(way))
        if lanes.too_narrow:
            width = way.tags.get("width") or way.tags.get("est_width", "")
            self._reported.add("too_narrow", f"{name} (width={width})")
            return None
        for note in lanes.notes:
            self._reported.add(note, name)
        if any(node.tags.get("highway") == "mini_roundabout" for node in nodes):
            self._reported.add("mini_roundabout", name)
        if is_for_access_only(way.tags):
            self._reported.add("access_only", name)
        for tag in (*conditional_tags(way.tags), *conditional_limits(way.tags)):
            self._reported.add("conditional", f"{name} ({tag})")
        kept = {key: value for key, value in tags.items() if not _is_replaced(key)}
        if "placement" in lanes.notes:
            kept = {key: value for key, value in kept.items() if key.partition(":")[0] != "placement"}
        kept |= _oneway_tags(way.tags, lanes.oneway) | _lane_tags(lanes, lefthand=self._lefthand)
        kept |= self._speed_tags(way, nodes, lanes.oneway, name)
        kept |= self._type_tags(way, users, name)
        return kept

    def write_types(self, target: Path) -> None:
        """Write the types of roads that not every vehicle may use, in netconvert's format, if there are any."""
        if self._types:
            root = etree.Element("types")
            root.extend(self._types[key] for key in sorted(self._types))
            target.write_bytes(etree.tostring(root))

    def blocked(self, tag: str) -> None:
        """Record a barrier that cuts a road."""
        self._reported.add("barrier", tag)

    def _oneway(self, way: OsmWay, name: str) -> int:
        """Return the direction of a road, as :func:`oneway_of` does; access tags may also limit it to one direction."""
        oneway = oneway_of(way.tags)
        forward, backward = users_of(way.tags, "forward"), users_of(way.tags, "backward")
        if oneway == 0 and bool(forward) != bool(backward):
            return 1 if forward else -1
        if oneway == 0 and forward != backward:
            self._reported.add("one_sided", name)
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
            self._reported.add("unread", f"{name} ({limit.unread})")
        if limit.source in ("law", "usual", "driven"):
            kind = "on motorways" if way.road_class in _FAST else "in town" if limit.urban else "outside towns"
            self._limits.setdefault(limit.source, {}).setdefault((limit.kmh, kind), []).append(name)
            if limit.legal is not None and limit.legal.states > 1 and limit.source == "law":
                self._states.add(limit.legal.states)

    def is_urban(self, way: OsmWay, nodes: Sequence[OsmNode]) -> bool:
        """Return whether a road is in a built-up area: by its own tags, else by its surroundings."""
        tagged = is_tagged_urban(way.tags)
        if tagged is not None:
            return tagged
        if way.road_class in _TOWN_ROADS or way.tags.get("lit") == "yes":
            return True
        if any(way.tags.get(key) in _SIDES for key in ("sidewalk", "sidewalk:both", "sidewalk:left", "sidewalk:right")):
            return True
        points = _along(nodes)
        posted_kmh = self._built_up.posted_kmh_around(way, points[len(points) // 2])
        if posted_kmh is not None and not _TOWN_KMH < posted_kmh < _OPEN_KMH:
            return posted_kmh <= _TOWN_KMH
        if not self._built_up.is_mapped:
            return self._built_up.is_dense or self._built_up.is_in_settlement(points[len(points) // 2])
        inside = sum(self._built_up.within(point, _HOUSES_WITHIN_M) for point in points)
        return inside >= _BUILT_UP_SHARE * len(points) or self._built_up.is_in_settlement(points[len(points) // 2])

    def _type_tags(self, way: OsmWay, users: frozenset[RoadUser], name: str) -> dict[str, str]:
        """Return tags for a road's own type, if some vehicles may not use it or have their own speed limit on it."""
        speeds = class_limits(way.tags)
        bus = {"bus": "yes"} if way.road_class == "service" and _opens_to_buses(way.tags) else {}
        if "car" not in users:
            self._reported.add("no_cars", f"{name} ({closing_tag(way.tags)})")
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
        """Return notes on the roads, as sentences."""
        reported = self._reported.names
        notes = [text.format(in_words(reported[what])) for what, text in _SENTENCES.items() if what in reported]
        return notes + [self._limit_note(source, limits) for source, limits in sorted(self._limits.items())]

    def _limit_note(self, source: str, limits: Mapping[tuple[float, str], Sequence[str]]) -> str:
        parts = [f"{kmh:g} km/h {kind} ({in_words(names)})" for (kmh, kind), names in sorted(limits.items())]
        if source == "driven":
            return (
                f"slip roads, driveways and tracks without a signed speed limit get a typical one: {'; '.join(parts)}"
            )
        law = f"the statutory default of {self._where.name}"
        if source == "usual":
            unknown = "the country is unknown"
            if self._where.name:
                unknown = f"the law of {self._where.name} is unknown for this kind of road"
            law = f"the median of all countries' statutory defaults, because {unknown}"
        elif self._states:
            law = f"the most frequent of the statutory defaults of {max(self._states)} states of {self._where.name}"
        return f"roads without a signed speed limit get {law}: {'; '.join(parts)}"


_SENTENCES: Mapping[str, str] = {
    "closed": "roads left out because their tags close them to motor vehicles: {}",
    "too_narrow": "roads left out because they are too narrow for a car: {}",
    "no_cars": "roads closed to cars but not to all vehicles: {}",
    "access_only": "roads for destination traffic only, which the simulation treats as open: {}",
    "barrier": "some roads are closed at points with these tags: {}",
    "mini_roundabout": "a mini-roundabout becomes a plain junction: {}",
    "one_lane": f"roads with one lane for both directions get a lane of {SHARED_LANE_M:g} m in each: {{}}",
    "middle_lane": "the centre turn lane is left out: {}",
    "odd_lanes": "the tags do not state which direction has the odd lane; it goes to forward: {}",
    "width_for_fewer": "the mapped width is too small for the mapped lanes, so lanes have the usual width: {}",
    "narrow_lane": "mapped lanes are narrower than a car needs: {}",
    "placement": "the nodes count as the middle of the road, although placement differs: {}",
    "reversible": "reversible lanes run only along their nodes: {}",
    "uneven": "per-lane lists that do not match the number of lanes are left out: {}",
    "one_sided": "closures of one direction to some vehicles are left out: {}",
    "conditional": "tags for certain times or vehicles are left out: {}",
    "unread": "the speed limit is unreadable: {}",
}
"""Texts of notes by key, in the order of the answer; ``{}`` are the roads."""


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
    """Return the lists of lane values in a direction; netconvert mirrors left-hand roads, but not their arrows."""
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
    """Return evenly spaced points on a line, at least one, excluding its ends."""
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
    """Return the attributes of SUMO's road types, by OSM road class."""
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
